"""Whatever SID is written, in whatever format and dialect, it is read back the same."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from hypothesis.extra.numpy import arrays

from sidtool.formats.base.sid import (
    BLOCK_SHAPES,
    NODE_SHAPES,
    SID,
    ComplianceShares,
    Dialect,
    Node,
    Taylor,
    block_shape,
)
from sidtool.formats.sid_ascii.title import is_own
from sidtool.formats.sid_ascii.writer import STYLES
from sidtool.formats.sid_files import FORMATS, read_sid, write_sid
from sidtool.formats.storage.hdf5_files import written_by
from tests.bodies import particle_body, skew
from tests.codes import with_code
from tests.formats.sids import assert_same

#: Relative to the largest number of a term, half a unit of the twelfth digit.
TWELVE_DIGITS = 5e-12

HYPOTHESIS = settings(
    deadline=None,
    max_examples=8,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)

ascii_characters = st.characters(min_codepoint=32, max_codepoint=126)
words = st.from_regex(r"\A[A-Za-z0-9_=.]{1,8}\Z", alphabet=ascii_characters)
printable = st.text(ascii_characters, max_size=60).map(str.strip)
numbers = st.one_of(
    st.just(0.0),
    st.floats(1e-90, 1e90),
    st.floats(-1e90, -1e-90),
    st.integers(-3, 3).map(float),
)


@st.composite
def expansions(draw: st.DrawFn, shape: tuple[int, int], nq: int) -> Taylor:
    """Any expansion of order 0, 1 or 2, however unphysical."""
    order = draw(st.integers(0, 2 if 0 not in shape else 0))
    m0 = draw(arrays(float, shape, elements=numbers, fill=st.just(0.0)))
    m1 = mn = None
    if order > 0 and nq:
        m1 = draw(arrays(float, (nq, *shape), elements=numbers, fill=st.just(0.0)))
    if order > 1:
        count = draw(st.integers(1, 3))
        mn = draw(arrays(float, (count, *shape), elements=numbers, fill=st.just(0.0)))
        order = 2
    return Taylor(m0, m1, mn, order)


@st.composite
def arbitrary_sids(draw: st.DrawFn) -> SID:
    """Any SID that the data model allows, with numbers that mean nothing."""
    nq = draw(st.integers(0, 4))
    ids = draw(st.lists(words, max_size=3, unique=True))
    blocks = {
        name: draw(expansions(block_shape(name, nq), nq)) for name in BLOCK_SHAPES
    }
    nodes = []
    for name in ids:
        entries = {
            entry: draw(expansions(block_shape(entry, nq), nq)) for entry in NODE_SHAPES
        }
        if draw(st.booleans()):
            del entries["sigma"]
        nodes.append(Node(id=name, **entries))
    extra = {"Kx": draw(expansions((2, 3), nq))} if draw(st.booleans()) else {}
    return SID(
        mass=draw(st.floats(0.0, 1e9)),
        labels=tuple(draw(printable) for _ in range(nq)),
        nodes=tuple(nodes),
        title=draw(printable),
        extra=extra,
        **blocks,
    )


@HYPOTHESIS
@given(sid=arbitrary_sids())
def test_any_sid_in_any_dialect_and_in_hdf5_bit_for_bit(
    tmp_path: Path, sid: SID
) -> None:
    """To draw a SID takes longer than to write and read it."""
    for dialect in STYLES:
        path = tmp_path / f"{dialect}.SID_FEM"
        write_sid(path, sid, dialect)
        assert_same(read_sid(path), sid, TWELVE_DIGITS)
    path = tmp_path / "body.h5"
    write_sid(path, sid)
    found = read_sid(path)
    assert_same(found, sid, 0.0)
    assert found.dialect == sid.dialect


def with_sigma(sid: SID) -> SID:
    """Section forces at every node."""
    rng = np.random.default_rng(3)
    sigma = Taylor(rng.normal(size=(6, 1)), rng.normal(size=(sid.nq, 6, 1)))
    return replace(sid, nodes=tuple(replace(n, sigma=sigma) for n in sid.nodes))


def with_turned_nodes(sid: SID) -> SID:
    """Node frames that are not the body frame: AP m1_l = skew(psi_l) AP0."""
    turn = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    nodes = tuple(
        replace(node, AP=Taylor(turn, skew(node.psi.m0.T) @ turn)) for node in sid.nodes
    )
    return replace(sid, nodes=nodes)


def with_foreign_title(sid: SID) -> SID:
    """A title that names another writer than the one at work."""
    return replace(sid, title="read from PY_SID, 3 nodes: refmod frame new node = 4")


BODIES = {
    "rigid": particle_body(0, 4),
    "rigid, no node": particle_body(0, 4, nodes=0),
    "one mode": particle_body(1, 4),
    "one mode, one node": particle_body(1, 4, nodes=1),
    "planar": particle_body(5, 9, planar=True),
    "no node": particle_body(3, 8, nodes=0),
    "many nodes": particle_body(2, 30, nodes=30),
    "geometric stiffening": particle_body(4, 9, stiffening=True),
    "100 modes": particle_body(100, 70, nodes=1),
    "sigma": with_sigma(particle_body(3, 8)),
    "turned nodes": with_turned_nodes(particle_body(3, 8)),
    "foreign title": with_foreign_title(particle_body(3, 8)),
}


@pytest.mark.parametrize(
    ("dialect", "body"),
    [(d, b) for d in STYLES for b in BODIES if b != "100 modes" or d == "fembs"],
)
def test_consistent_bodies(tmp_path: Path, dialect: str, body: str) -> None:
    sid, path = BODIES[body], tmp_path / "body.SID_FEM"
    write_sid(path, sid, dialect)
    found = read_sid(path)
    layout = STYLES[dialect].layout
    assert_same(found, sid, TWELVE_DIGITS)
    assert not with_code(found, "N840", "N841", "N842")
    assert found.dialect.m1_index == layout.m1_index
    assert (found.dialect.gr_layout, found.dialect.ge_layout) == (layout.gr, layout.ge)


@pytest.mark.parametrize("body", [name for name in BODIES if name != "100 modes"])
@pytest.mark.parametrize("dialect", STYLES)
def test_numbers_alone_give_the_dialect_away(
    tmp_path: Path, dialect: str, body: str
) -> None:
    """The identities tell the layouts apart without any help from the title."""
    sid, path = BODIES[body], tmp_path / "body.SID_FEM"
    write_sid(path, sid, dialect)
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join(lines[1:]), encoding="utf-8")
    assert_same(read_sid(path), replace(sid, title=""), TWELVE_DIGITS)


@pytest.mark.parametrize("dialect", STYLES)
def test_a_second_cycle_changes_nothing(tmp_path: Path, dialect: str) -> None:
    path, again = tmp_path / "a.SID_FEM", tmp_path / "b.SID_FEM"
    write_sid(path, BODIES["geometric stiffening"], dialect)
    write_sid(again, read_sid(path), dialect)
    assert again.read_bytes() == path.read_bytes()


def test_every_format_keeps_the_dialect_of_the_source(tmp_path: Path) -> None:
    dialect = Dialect("PY_SID", "mode", "axis", name="rod")
    sid = replace(particle_body(2, 5), dialect=dialect)
    write_sid(tmp_path / "a.hdf5", sid)
    assert read_sid(tmp_path / "a.hdf5").dialect == dialect


@pytest.mark.parametrize("known", FORMATS, ids=lambda known: known.name)
def test_the_content_decides_not_the_name(tmp_path: Path, known: object) -> None:
    suffix = (*known.suffixes, ".SID_FEM")[0]  # type: ignore[attr-defined]
    write_sid(tmp_path / f"body{suffix}", particle_body(2, 5))
    plain = tmp_path / "body.anything"
    (tmp_path / f"body{suffix}").rename(plain)
    assert_same(read_sid(plain), particle_body(2, 5), TWELVE_DIGITS)


FOREIGN = "    1   0    :No. nodes, No. modes:{}\n"


def test_files_of_our_own_say_so_and_stay_so_over_round_trips(tmp_path: Path) -> None:
    """The title line ends with a mark, which is no part of the title."""
    sid = replace(particle_body(2, 5, planar=False, seed=3), title="Arm of FEM; a=1")
    path = tmp_path / "arm.SID_FEM"
    for _ in range(3):
        write_sid(path, sid)
        sid = read_sid(path)
        assert sid.title == "Arm of FEM; a=1"
        assert sid.dialect.writer.startswith("sidtool")
        assert is_own(path.read_bytes()[:400])
        assert path.read_text(encoding="utf-8").partition("\n")[0].count("sidtool") <= 1
        assert sid.written_by == written_by()


@pytest.mark.parametrize("dialect", ["fembs", "pysid", "matmorembs", "fembeam"])
def test_titles_carry_what_shape_functions_carry(tmp_path: Path, dialect: str) -> None:
    """The poorest nodes first, in per cents, as far as a title of 400 has room."""
    plain = particle_body(2, 5, planar=False, seed=3)
    shares = {str(k): (k / 100, None, 1.0, None, None, 0.5) for k in range(99, 0, -1)}
    lost = (2.5e-6, 0.25, 1.0, 0.0, 0.0, 0.07, 0.0, 0.5, 0.5, 3.0, 0.0, 12.0)
    told = ComplianceShares(False, shares, lost)
    sid = replace(plain, title="Arm", carried=told)
    path = tmp_path / "arm.SID_FEM"
    write_sid(path, sid, dialect)
    assert len(path.read_text(encoding="utf-8").partition("\n")[0]) <= 400
    found = read_sid(path)
    assert found.carried is not None and found.title == "Arm"
    assert found.carried.lost == told.lost and not found.carried.free
    assert 10 < len(found.carried.shares) < 60
    assert found.carried.shares == {k: shares[k] for k in found.carried.shares}
    assert set(found.carried.shares) == {
        str(k) for k in range(1, 1 + len(found.carried.shares))
    }
    write_sid(tmp_path / "arm.h5", sid)
    assert read_sid(tmp_path / "arm.h5").carried == told
    assert read_sid(tmp_path / "arm.h5").written_by == written_by()


def test_nodes_of_equal_shares_keep_their_order() -> None:
    """Rounding on another processor must not change the title of a file."""
    equal = {"3": (1.0,) * 6, "1": (1.0 - 2e-16,) * 6, "2": (1.0 - 1e-16,) * 6}
    shares = ComplianceShares(False, {**equal, "4": (0.5,) * 6})
    names = [entry.split("=")[0] for entry in shares.text(400).split()[1:]]
    assert names == ["4", "3", "1", "2"]


@pytest.mark.parametrize("carried", [None, ComplianceShares(True, {"1": (0.5,) * 6})])
@pytest.mark.parametrize("name", ["a.h5", "a.SID_FEM", "fembeam", "pysid"])
def test_files_tell_whether_a_body_came_as_matrices(
    tmp_path: Path, name: str, carried: ComplianceShares | None
) -> None:
    plain = replace(particle_body(2, 5, planar=False, seed=3), carried=carried)
    path, dialect = tmp_path / "a.SID_FEM", (name,) if "." not in name else ()
    path = tmp_path / name if "." in name else path
    for matrices in (True, False):
        write_sid(path, replace(plain, from_matrices=matrices), *dialect)
        found = read_sid(path)
        assert found.from_matrices == matrices and found.carried == carried
        assert found.title == plain.title


@pytest.mark.parametrize("mark", ["[sidtool]", "[layout PY_SID]"])
def test_marks_of_earlier_versions_are_known(tmp_path: Path, mark: str) -> None:
    path = tmp_path / "arm.SID_FEM"
    write_sid(path, replace(particle_body(2, 5, planar=False, seed=3), title="Arm"))
    path.write_text(
        path.read_text(encoding="utf-8").replace(f"[{written_by()}]", mark),
        encoding="utf-8",
    )
    assert is_own(path.read_bytes()[:400])
    sid = read_sid(path)
    assert sid.written_by == "sidtool" and sid.title == "Arm" and sid.carried is None


@pytest.mark.parametrize("title", ["Arm", "Arm of sidtool", "sidtool", "[sidtool] arm"])
def test_files_of_others_are_not_taken_for_our_own(title: str) -> None:
    assert not is_own(FOREIGN.format(title).encode())
    assert not is_own(b"\x89HDF\r\n")


@pytest.mark.parametrize("ending", ["SID_FEM", "h5"])
def test_older_measures_of_inertia_loads_are_kept(tmp_path: Path, ending: str) -> None:
    """Files had six numbers of another measure, which nothing is judged by."""
    lost = (0.0, 0.25, 1.0, 0.0, 0.0, 0.07)
    sid = replace(particle_body(2, 5), carried=ComplianceShares(False, {}, lost))
    write_sid(tmp_path / f"arm.{ending}", sid)
    found = read_sid(tmp_path / f"arm.{ending}")
    assert found.carried is not None and found.carried.lost == lost
    assert not found.carried.knows_inertia


@pytest.mark.parametrize("ending", [".h5", ".SID_FEM"])
def test_a_file_that_changed_is_read_again(tmp_path: Path, ending: str) -> None:
    """Also one of the same size and time."""
    path, sids = (
        tmp_path / f"body{ending}",
        [replace(particle_body(2, 4), mass=m) for m in (2.0, 3.0)],
    )
    for sid in sids:
        write_sid(path, sid)
        os.utime(path, (0.0, 0.0))
        assert read_sid(path).mass == sid.mass
        assert read_sid(path) is read_sid(path)
