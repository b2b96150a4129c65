"""The real files: read without loss, laid out as their writers do, and stable."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from sidtool.formats.base.sid import SID, Node, Taylor, by_mode, symmetric_3x3
from sidtool.formats.geometric_stiffening import has_stiffening
from sidtool.formats.sid_ascii.writer import STYLES
from sidtool.formats.sid_files import read_sid, write_sid
from tests.codes import with_code
from tests.formats.sids import assert_same

FILES = ("Beam_3m.SID_FEM", "balken1m.SID_FEM", "beam.SID_FEM", "example.sid_fem")


def sid_of(field_data: Path, name: str) -> SID:
    return read_sid(field_data / "sid" / name)


def entries_by_hand(path: Path) -> list[tuple[str, str, tuple[int, ...], float]]:
    """(node or "", block, indices, value) of each line, by nothing but string cutting.

    These four files are regular enough for it; m0 has two indices, m1 three.
    """
    found, node, block = [], "", ""
    for line in path.read_text(encoding="latin-1").splitlines():
        key, equals, value = (part.strip() for part in line.partition("="))
        if key == "new node":
            node = value
        elif key == "end node":
            node = ""
        elif not equals and not key.startswith("end"):
            block = key
        elif re.match(r"m[01]\(", key):
            indices = tuple(int(text) for text in re.findall(r"\d+", key)[1:])
            found.append((node, block, indices, float(value.replace("D", "E"))))
    return found


def stored(sid: SID, block: str, indices: tuple[int, ...], owner: SID | Node) -> float:
    """The number in memory that belongs to an entry of the file."""
    expansion: Taylor = getattr(owner, block)
    row, column = indices[0] - 1, indices[-1] - 1
    if block == "Gr" and sid.dialect.gr_layout == "mode":
        column = column % 3 * sid.nq + column // 3
    if len(indices) == 2:
        return float(expansion.m0[row, column])
    return float(expansion.first_order(sid.nq)[indices[1] - 1, row, column])


@pytest.mark.parametrize("name", FILES)
def test_every_number_of_the_file_arrives(field_data: Path, name: str) -> None:
    """Halves of symmetric matrices may differ in print; their mean is kept."""
    sid = sid_of(field_data, name)
    entries = entries_by_hand(field_data / "sid" / name)
    assert len(entries) >= 90
    for node, block, indices, value in entries:
        owner = sid.node(node) if node else sid
        in_memory = stored(sid, block, indices, owner)
        if block in ("Me", "Ke", "De"):
            scale = np.abs(getattr(sid, block).m0).max()
            assert abs(in_memory - value) <= 1e-12 * scale
        else:
            assert in_memory == value


@pytest.mark.parametrize("name", FILES)
def test_nothing_arrives_that_is_not_in_the_file(field_data: Path, name: str) -> None:
    """As many non-zeros in memory as in the file, but for bare identities."""
    sid = sid_of(field_data, name)
    in_file = sum(
        value != 0.0 for *_, value in entries_by_hand(field_data / "sid" / name)
    )
    expansions = list(sid.blocks.values())
    expansions += [getattr(n, e) for n in sid.nodes for e in ("origin", "phi", "psi")]
    in_memory = sum(map(non_zeros, expansions))
    text = (field_data / "sid" / name).read_text(encoding="utf-8")
    for node in sid.nodes:
        identity = np.array_equal(node.AP.m0, np.eye(3))
        assert identity
        in_memory += non_zeros(node.AP)
    bare = len(re.findall(r"structure *= *4\s+end AP", text))
    modes = len(re.findall(r"structure *= *4\s+end Me", text)) * sid.nq
    assert in_memory - 3 * bare - modes == in_file


def non_zeros(expansion: Taylor) -> int:
    parts = (expansion.m0, expansion.m1)
    return sum(int(np.count_nonzero(part)) for part in parts if part is not None)


@pytest.mark.parametrize(
    ("name", "writer", "gr", "modes", "nodes", "mass"),
    [
        ("Beam_3m.SID_FEM", "PY_SID", "mode", 4, 21, 706.5),
        ("balken1m.SID_FEM", "PY_SID", "mode", 1, 3, 0.784999999999),
        ("beam.SID_FEM", "PY_SID", "mode", 11, 6, 12.5604),
        ("example.sid_fem", "FEMBS", "axis", 3, 3, 0.3925),
    ],
)
def test_dialects(
    field_data: Path,
    name: str,
    writer: str,
    gr: str,
    modes: int,
    nodes: int,
    mass: float,
) -> None:
    sid = sid_of(field_data, name)
    assert (sid.nq, len(sid.nodes), sid.mass) == (modes, nodes, mass)
    dialect = sid.dialect
    assert (dialect.writer, dialect.gr_layout, dialect.ge_layout) == (
        writer,
        gr,
        "axis",
    )
    assert (dialect.m1_index, dialect.j_shape, dialect.exponent) == ("rlc", "6x1", "D")


@pytest.mark.parametrize("name", ("Beam_3m.SID_FEM", "beam.SID_FEM", "example.sid_fem"))
def test_layouts_are_found_without_the_title(
    field_data: Path, tmp_path: Path, name: str
) -> None:
    text = (field_data / "sid" / name).read_text(encoding="utf-8").partition("\n")[2]
    (tmp_path / name).write_text(text, encoding="utf-8")
    untitled, sid = read_sid(tmp_path / name), sid_of(field_data, name)
    assert np.array_equal(untitled.Gr.m0, sid.Gr.m0)
    assert np.array_equal(untitled.Ge.m0, sid.Ge.m0)
    assert untitled.dialect.gr_layout == sid.dialect.gr_layout


@pytest.mark.parametrize("name", FILES)
def test_identities_of_the_layouts(field_data: Path, name: str) -> None:
    """I6 and I7 of the format hold to print precision once the layout is right."""
    sid = sid_of(field_data, name)
    gr, ge = by_mode(sid.Gr.m0, sid.nq), by_mode(sid.Ge.m0, sid.nq)
    j1 = symmetric_3x3(sid.J.first_order(sid.nq)[:, :, 0])
    cr1 = sid.Cr.first_order(sid.nq)
    assert np.abs(gr + gr.swapaxes(1, 2) - 2 * j1).max() <= 1e-11 * np.abs(gr).max()
    assert np.abs(ge - 2 * cr1).max() <= 1e-11 * np.abs(ge).max()


def test_unsymmetrised_centrifugal_terms_are_noted_not_repaired(
    field_data: Path,
) -> None:
    """PY_SID leaves Oe1 xy, yz, xz unsymmetric; repair is the user's decision."""
    for name, noted in (("Beam_3m.SID_FEM", 1), ("balken1m.SID_FEM", 0)):
        sid = sid_of(field_data, name)
        assert [d.subject for d in with_code(sid, "N840")].count("Oe") == noted


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("dialect", STYLES)
def test_read_write_read(
    field_data: Path, tmp_path: Path, name: str, dialect: str
) -> None:
    sid, path = sid_of(field_data, name), tmp_path / "again.SID_FEM"
    write_sid(path, sid, dialect)
    assert_same(read_sid(path), sid, 1e-12)


@pytest.mark.parametrize("name", FILES)
def test_hdf5_and_back(field_data: Path, tmp_path: Path, name: str) -> None:
    sid, path = sid_of(field_data, name), tmp_path / "again.h5"
    write_sid(path, sid)
    found = read_sid(path)
    assert_same(found, sid, 0.0)
    assert found.dialect == sid.dialect


@pytest.mark.parametrize("name", FILES)
def test_none_of_them_has_stiffening(field_data: Path, name: str) -> None:
    """Four titles promise it; the integrals of the shape functions fill all blocks."""
    assert not has_stiffening(sid_of(field_data, name))
