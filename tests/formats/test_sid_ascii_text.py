"""The ASCII file to the column: what is written, and what may be read."""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Node, Taylor
from sidtool.formats.sid_ascii.writer import STYLES
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.formats.storage.hdf5_files import written_by
from tests.bodies import particle_body
from tests.codes import only, with_code
from tests.formats.sids import assert_same

FRAGMENT = """\
    1   2    :No. nodes, No. modes:example [OWN]
 part
      new modal                                 =
           refmod
                mass                            = 7.06500000000D+02
                nelastq                         =    2
                ielastq (   1)                  = Eigen Mode    1 :        9.089 Hz
                ielastq (   2)                  = Eigen Mode    2 :       27.028 Hz
           end refmod
           frame
                new node                        =        4
                     rframe                     = body ref
                     origin
                          order                 =    1
                          nrow                  =    3
                          ncol                  =    1
                          nq                    =    2
                          nqn                   =    0
                          structure             =    3
                          m0( 1, 1)             = 3.00000000000D+00
                          m1( 2, 2, 1)          = 7.49096359787D-02
                          m1( 3, 1, 1)          =-7.52731261365D-02
                     end origin
"""
NUMBER = re.compile(r"[ -]\d\.\d{11}D[+-]\d{2}")
STIFFNESS = Taylor([[4e6, 1e5, -3.0], [1e5, 2e6, 0.0], [-3.0, 0.0, 9e6]])
BODY = replace(particle_body(3, 8, seed=5), Ke=STIFFNESS)
PRINTED = 5e-12


def beam_end() -> SID:
    """The body of a short file, every column stated."""
    phi = np.zeros((3, 2))
    phi[1, 1], phi[2, 0] = 7.49096359787e-2, -7.52731261365e-2
    node = Node(
        id="4",
        origin=Taylor([[3.0], [0.0], [0.0]], phi.T[:, :, None]),
        phi=Taylor(phi),
        psi=Taylor(np.zeros((3, 2))),
        AP=Taylor(np.eye(3)),
    )
    labels = ("Eigen Mode    1 :        9.089 Hz", "Eigen Mode    2 :       27.028 Hz")
    return replace(
        particle_body(2, 8), title="example", mass=706.5, labels=labels, nodes=(node,)
    )


def written(sid: SID, folder: Path, dialect: str = "fembs") -> str:
    write_sid(folder / "body.SID_FEM", sid, dialect)
    return (folder / "body.SID_FEM").read_bytes().decode("ascii")


def read_text(text: str, folder: Path) -> SID:
    path = folder / "read.SID_FEM"
    path.write_bytes(text.encode("latin-1"))
    return read_sid(path)


def test_the_canonical_fragment(tmp_path: Path) -> None:
    assert written(beam_end(), tmp_path).startswith(
        FRAGMENT.replace("OWN", written_by(), 1)
    )


def test_every_line_of_a_canonical_file(tmp_path: Path) -> None:
    sid = particle_body(12, 12, stiffening=True)
    text = written(sid, tmp_path)
    lines = text.split("\n")
    assert lines.pop() == ""
    for line in lines[1:]:
        assert line and line == line.rstrip() and "\t" not in line
        key, equals, value = line.partition("=")
        assert not equals or len(key) == 48
        if re.match(r" {26}m[01]\(", line):
            assert NUMBER.fullmatch(value)
        elif re.match(r" {26}\w", line):
            assert re.fullmatch(r"[ \d]{4}\d", value)
    assert text.count("order ") == 11 + 2 * 4
    for name in ("mdCM", "J", "Ct", "Cr", "Me", "Gr", "Ge", "Oe", "ksigma", "Ke", "De"):
        assert f"\n           {name}\n" in text
        assert f"\n           end {name}\n" in text


def test_order_of_entries(tmp_path: Path) -> None:
    """m0 by rows; m1 with the column outermost, then the row, the mode fastest."""
    text = written(particle_body(3, 8), tmp_path)
    block = text[text.index("     Oe\n") : text.index("     end Oe\n")]
    m0 = [tuple(map(int, pair)) for pair in re.findall(r"m0\( *(\d+), *(\d+)\)", block)]
    m1 = re.findall(r"m1\( *(\d+), *(\d+), *(\d+)\)", block)
    assert m0 == sorted(m0) and len(m0) == 18
    indices = [(int(column), int(row), int(mode)) for row, mode, column in m1]
    assert indices == sorted(indices) and len(indices) == 54
    assert block.rindex("m0(") < block.index("m1(")


def test_structures(tmp_path: Path) -> None:
    """Symmetric blocks in both halves, identities in full, zero blocks empty."""
    text = written(particle_body(3, 8), tmp_path)
    header = r"(?m)^ +(\w+)\n(?:.*=.*\n){5} +structure +=    (\d)$"
    found = dict(re.findall(header, text))
    general = ("origin", "phi", "psi", "AP", "mdCM", "J", "Ct", "Cr", "Gr", "Ge", "Oe")
    symmetric = dict.fromkeys(("Me", "Ke", "De"), "2")
    assert found == dict.fromkeys(general, "3") | symmetric | {"ksigma": "0"}


def test_titles_survive_but_stay_one_ascii_line(tmp_path: Path) -> None:
    sid = replace(BODY, title="Körper\nB; part = refmod " + "x" * 500)
    first = written(sid, tmp_path).split("\n")[0]
    assert len(first) == 400
    assert first.startswith(
        "    2   3    :No. nodes, No. modes:Korper B; part = refmod"
    )


def without(*items: str) -> Callable[[str], str]:
    def drop(text: str) -> str:
        return re.sub(rf"(?m)^ +({'|'.join(items)}) +=.*\n", "", text)

    return drop


def shuffled_entries(text: str) -> str:
    """Entries of each block in any order, m0 and m1 mixed."""
    rng = random.Random(1)

    def shuffle(match: re.Match[str]) -> str:
        lines = match[0].splitlines(keepends=True)
        rng.shuffle(lines)
        return "".join(lines)

    return re.sub(r"(?m)(^ +(m\d|order|n\w+|structure) *[(=].*\n)+", shuffle, text)


def lower_half(text: str) -> str:
    """Only the lower half of the symmetric blocks."""
    head, mid, tail = re.split(r"(?=     Ke\n)|(?=     end Ke\n)", text)

    def keep(match: re.Match[str]) -> str:
        return match[0] if int(match[1]) >= int(match[2]) else ""

    return head + re.sub(r" +m0\( *(\d+), *(\d+)\).*\n", keep, mid) + tail


TOLERATED: dict[str, Callable[[str], str]] = {
    "no title": lambda text: text.partition("\n")[2],
    "title of FEMBeam": lambda text: "2 nodes, 3 modes, x\n" + text.partition("\n")[2],
    "no wrapping part and modal": lambda text: re.sub(
        r"(?m)^.*(part|modal).*\n", "", text.partition("\n")[2]
    ),
    "tabs": lambda text: re.sub(r"(?m)^ {6}| +(?==)|(?<==) +", "\t", text),
    "trailing blanks": lambda text: text.replace("\n", "    \n"),
    "no indentation": lambda text: re.sub(r"(?m)^ +", "", text),
    "no blanks around =": lambda text: re.sub(" *= *", "=", text),
    "blank lines": lambda text: text.replace("\n", "\n  \n"),
    "carriage returns": lambda text: text.replace("\n", "\r\n"),
    "no final newline": lambda text: text.rstrip("\n"),
    "byte order mark": lambda text: "\xef\xbb\xbf" + text,
    "capitals": lambda text: re.sub(r"(?m)^ +(?!iel|new node)[^=\n]+", upper, text),
    "new frame": lambda text: text.replace("    frame\n", "    new frame\n"),
    "a body name": lambda text: re.sub("new modal +=", "new modal = end refmod", text),
    "new modal without =": lambda text: re.sub("new modal +=", "new modal", text),
    "no nqn, no structure": without("nqn", "structure"),
    "no modes in the header of a constant block": lambda text: re.sub(
        r"( Me\n(?:.*\n){3} +nq +=) +3\n", r"\1 0\n", text
    ),
    "no header at all": without("order", "nrow", "ncol", "nq", "nqn", "structure"),
    "E exponents": lambda text: re.sub(r"(\d)D([+-])", r"\1E\2", text),
    "small exponents": lambda text: re.sub(r"(\d)D([+-])", r"\1d\2", text),
    "no exponent letter": lambda text: re.sub(r"(\d)D([+-])", r"\1\2", text),
    "plain integers": lambda text: re.sub(r"1\.0{11}D\+00", "1", text),
    "blanks in index lists": lambda text: re.sub(r"([(,])", r"\1   ", text),
    "no blanks in index lists": lambda text: re.sub(r"([(,]) +", r"\1", text),
    "any order of entries": shuffled_entries,
    "lower half of a symmetric block": lower_half,
    "bare identity": lambda text: re.sub(
        r"( AP\n(?:.*\n){5} +structure +=) +3\n(?:.*m0.*\n){3}", r"\1 4\n", text
    ),
    "identity with its ones": lambda text: re.sub(
        r"( AP\n(?:.*\n){5} +structure +=) +3\n", r"\1 4\n", text
    ),
    "names of MatMorembs": lambda text: re.sub(
        r"(?m)^( +(?:end )?)(mdCM|J)$",
        lambda match: match[1] + {"mdCM": "mCM", "J": "mmi"}[match[2]],
        text,
    ),
}


def upper(match: re.Match[str]) -> str:
    return match[0].upper()


@pytest.mark.parametrize("habit", TOLERATED)
def test_habits_of_other_writers(tmp_path: Path, habit: str) -> None:
    text = written(BODY, tmp_path)
    changed = TOLERATED[habit](text)
    assert changed != text
    found = read_text(changed, tmp_path)
    assert_same(replace(found, title=BODY.title), BODY, PRINTED)


@pytest.mark.parametrize("dialect", STYLES)
def test_what_gives_each_dialect_away(tmp_path: Path, dialect: str) -> None:
    found = read_text(written(BODY, tmp_path, dialect), tmp_path)
    style = STYLES[dialect]
    assert found.dialect.exponent == ("" if dialect == "fembeam" else style.letter)
    assert found.dialect.j_shape == ("3x3" if dialect == "fembeam" else "6x1")


def test_node_names_may_be_any_text_in_any_order(tmp_path: Path) -> None:
    names = ("6024", "1", "left bearing")
    nodes = zip(particle_body(2, 8, nodes=3).nodes, names, strict=True)
    sid = replace(
        particle_body(2, 8, nodes=0),
        nodes=tuple(replace(node, id=name) for node, name in nodes),
    )
    assert_same(read_text(written(sid, tmp_path), tmp_path), sid, PRINTED)


def test_wrong_counts_in_the_title_are_noted(tmp_path: Path) -> None:
    text = written(BODY, tmp_path).replace("    2   3", "   12   5", 1)
    found = read_text(text, tmp_path)
    assert_same(found, BODY, PRINTED)
    assert only(found, "N842").data["announced"] == "12 nodes and 5 modes"


def test_entries_win_over_the_declared_structure(tmp_path: Path) -> None:
    text = written(BODY, tmp_path)
    for structure in "014":
        changed = text.replace("structure             =    3", f"structure={structure}")
        found = read_text(changed, tmp_path)
        assert_same(found, BODY, PRINTED)
        assert with_code(found, "N840")


def test_unknown_blocks_are_kept(tmp_path: Path) -> None:
    block = "Kgeo\n m1(2,3,1) = 5\n m0(1,2) = 7\nend Kgeo\n"
    text = written(BODY, tmp_path).replace("      end modal", block + "      end modal")
    found = read_text(text, tmp_path)
    kept = found.extra["Kgeo"]
    assert kept.shape == (2, 2)
    assert kept.m0.tolist() == [[0.0, 7.0], [0.0, 0.0]]
    assert kept.first_order(3)[2].tolist() == [[0.0, 0.0], [5.0, 0.0]]
    assert_same(read_text(written(found, tmp_path), tmp_path), found, PRINTED)


def test_columns_by_mode_or_by_axis_are_the_same_body(tmp_path: Path) -> None:
    """Column 3 (l-1) + a of the book is column (a-1) nq + l of FEMBS."""
    entry = re.compile(r"m0\( *2, *(\d+)\) *= *(\S+)")
    found = {}
    for dialect in ("fembs", "pysid"):
        text = written(BODY, tmp_path, dialect)
        block = text[text.index("     Gr\n") : text.index("     end Gr\n")]
        found[dialect] = {int(column): value for column, value in entry.findall(block)}
    for mode in range(3):
        for axis in range(3):
            by_axis = found["fembs"].get(axis * 3 + mode + 1)
            assert by_axis == found["pysid"].get(mode * 3 + axis + 1)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["body.SID_FEM", "body.h5"])
def test_no_nan_is_ever_written(tmp_path: Path, name: str, value: float) -> None:
    path = tmp_path / name
    write_sid(path, BODY)
    before = path.read_bytes()
    ke = np.array(BODY.Ke.m0)
    ke[1, 2] = value
    for sid in (replace(BODY, Ke=Taylor(ke)), replace(BODY, mass=value)):
        with pytest.raises(InputError, match="finite"):
            write_sid(path, sid)
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == [name]


def test_what_an_ascii_file_cannot_hold(tmp_path: Path) -> None:
    nodes = (replace(BODY.nodes[0], id="a\nb"),)
    for sid in (
        replace(BODY, nodes=nodes),
        replace(BODY, extra={"two words": Taylor(np.zeros((1, 1)))}),
        replace(BODY, extra={"mmi": Taylor(np.zeros((1, 1)))}),
    ):
        with pytest.raises(InputError, match="cannot be written"):
            write_sid(tmp_path / "body.SID_FEM", sid)
    with pytest.raises(InputError, match="dialect"):
        write_sid(tmp_path / "body.SID_FEM", BODY, "nastran")
    with pytest.raises(InputError, match="dialect"):
        write_sid(tmp_path / "body.h5", BODY, "pysid")
    assert list(tmp_path.iterdir()) == []
