"""Every field of a deck matters: one that is changed is seen, refused, or told.

Decks of small parts are changed field by field and line by line. What is read of each
has to differ from what was read before, unless the file is refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.importers.mesh_files import read_mesh

from .decks import MATERIAL, STEEL, Block, deck

BLOCK = Block((2, 1, 1), (0.2, 0.05, 0.04))
LAST = len(BLOCK.points)
OTHER = (
    "*NODE\n"
    + "".join(
        f"{i + 100}, {x + 0.2!r}, {y!r}, {z!r}\n"
        for i, (x, y, z) in enumerate(BLOCK.points, 1)
    )
    + "*ELEMENT, TYPE=C3D8I, ELSET=E\n"
    + "".join(
        f"{i + 100}, " + ", ".join(str(n + 100) for n in e) + "\n"
        for i, e in enumerate(BLOCK.elements, 1)
    )
)
TIE = (
    "*SURFACE, NAME=A\n2, S4\n*SURFACE, NAME=B\n101, S6\n"
    "*TIE, NAME=T, POSITION TOLERANCE=0.001\nA, B\n"
)
PAIRS = list(zip(BLOCK.right, [n + 100 for n in BLOCK.left], strict=True))
EQUATIONS = "*EQUATION\n" + "".join(
    f"2\n{a}, {i}, 1., {b}, {i}, -1.\n" for a, b in PAIRS for i in (1, 2, 3)
)
FLAT = deck(BLOCK, "C3D8I")
HEAD, TAIL = FLAT.split("*MATERIAL")
TWO = HEAD + OTHER + "{tied}*MATERIAL" + TAIL
REFERENCE = "*NODE\n900, 0.3, 0.02, 0.02\n"
COUPLED = (
    REFERENCE + "*NSET, NSET=FACE\n" + "".join(f"{n},\n" for n in BLOCK.right) + ""
    "*SURFACE, NAME=S, TYPE=NODE\nFACE,\n"
    "*COUPLING, CONSTRAINT NAME=C, REF NODE=900, SURFACE=S\n*KINEMATIC\n1, 3\n"
    "*ELEMENT, TYPE=MASS, ELSET=M\n900, 900\n*MASS, ELSET=M\n2.5\n"
)
WOOD = (
    "*MATERIAL, NAME=S\n*ELASTIC, TYPE=ENGINEERING CONSTANTS\n"
    "1.1e10, 9e8, 5e8, 0.38, 0.45, 0.5, 7.5e8, 7e8\n4e7\n*DENSITY\n450.\n"
    "*ORIENTATION, NAME=O\n1., 0.2, 0.1, -0.3, 1., 0.\n1, 20.\n"
)
PART = "*PART, NAME=P\n" + HEAD + "*SOLID SECTION, ELSET=E, MATERIAL=S\n\n*END PART\n"
PLACED = (
    PART + "*ASSEMBLY, NAME=A\n*INSTANCE, NAME=I, PART=P\n0.1, 0.2, 0.3\n"
    "0.1, 0.2, 0.3, 0.4, 0.2, 0.5, 25.\n*END INSTANCE\n"
    "*INSTANCE, NAME=J, PART=P\n0.7, 0., 0.\n*END INSTANCE\n"
    "*NSET, NSET=Q, INSTANCE=J\n1, 3\n*NSET, NSET=R, INSTANCE=I\n2, 4\n"
    "*EQUATION\n2\nQ, 2, 1.5\nR, 2, -1.5\n*END ASSEMBLY\n" + MATERIAL.format(**STEEL)
)
DECKS = {
    "block": FLAT,
    "tie": TWO.format(tied=TIE),
    "equations": TWO.format(
        tied="*TRANSFORM, NSET=LEFT, TYPE=C\n0., 1., 0., 0.3, 0., 1.\n"
        + EQUATIONS
        + "*EQUATION\n2\n1, 2, 1., 3, 1, -1.\n"
    ),
    "mpc": TWO.format(
        tied="*MPC\n"
        + "".join(f"TIE, {a}, {b}\n" for a, b in PAIRS)
        + "LINEAR, 2, 1, 3\nLINK, 4, 6\nBEAM, 7, 8\n"
    ),
    "coupling": HEAD + COUPLED + "*MATERIAL" + TAIL,
    "wood": HEAD + WOOD + "*SOLID SECTION, ELSET=E, MATERIAL=S, ORIENTATION=O\n\n",
    "instances": PLACED,
}
#: What changes nothing of the body: the directions of a coupling that rotations of
#: solids follow or that it has without them, the number of an element with a mass, a
#: name that nothing else knows, an end, a keyword like that before it.
FREE = re.compile(r"\*ASSEMBLY|\*END|\*EQUATION$|1, 3$|1, 3 -> 1,4|900, 900 -> 901,")


def content(value: Any) -> Any:
    """What was read, without the places and sentences, to compare."""
    if is_dataclass(value):
        names = [
            f.name for f in fields(value) if f.name not in ("place", "diagnostics")
        ]
        return tuple((name, content(getattr(value, name))) for name in names)
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    if isinstance(value, dict):
        return tuple(sorted((key, content(item)) for key, item in value.items()))
    if isinstance(value, tuple | list):
        return tuple(content(item) for item in value)
    if hasattr(value, "model_dump"):
        return tuple(value.model_dump().items())
    return value


def read(folder: Path, text: str, file: str = "part.inp") -> Any:
    path = folder / file
    path.unlink(missing_ok=True)  # to shorten a file takes much longer
    path.write_text(text, encoding="utf-8")
    return content(read_mesh(path))


def other(word: str) -> str:
    """Another word of the same kind."""
    plain = word.strip()
    try:
        return str(int(plain) + 1)
    except ValueError:
        pass
    try:
        return repr(float(plain) * 1.37 + 0.011)
    except ValueError:
        return plain + "X"


def fields_changed(text: str) -> Iterator[tuple[str, str]]:
    """Every data field and every value of a parameter, each changed alone."""
    lines = text.splitlines()
    for i, line in enumerate(lines):
        words = line.split(",")
        for k, word in enumerate(words):
            if line.startswith("*"):
                name, equals, value = word.partition("=")
                changed = f"{name}={other(value)}" if equals else ""
            else:
                changed = other(word) if word.strip() else ""
            if changed:
                new = ",".join([*words[:k], changed, *words[k + 1 :]])
                yield f"{line} -> {new}", "\n".join([*lines[:i], new, *lines[i + 1 :]])


def lines_left_out(text: str) -> Iterator[tuple[str, str]]:
    lines = text.splitlines()
    for i, line in enumerate(lines):
        if line.strip():
            yield line, "\n".join([*lines[:i], *lines[i + 1 :]])


#: A part as Nastran has it, with all cards that are read beside its elements.
BULK = (
    "BEGIN BULK\nCORD2R,5,0,0.1,0.2,0.3,0.4,0.1,1.3\n,1.1,0.3,0.3\n"
    + "".join(
        f"GRID,{i},5,{x!r},{y!r},{z!r}\n" for i, (x, y, z) in enumerate(BLOCK.points, 1)
    )
    + "".join(
        f"CHEXA,{i},1,{','.join(map(str, e[:6]))}\n,{e[6]},{e[7]}\n"
        for i, e in enumerate(BLOCK.elements, 1)
    )
    + "PSOLID,1,3\nMAT1,3,2.1e11,,0.3,7850.\nGRID,900,,0.3,0.02,0.02\n"
    + f"RBE2,50,900,123456,{','.join(map(str, BLOCK.right))}\n"
    + "GRID,901,,0.,0.02,0.02\n"
    + f"RBE3,52,,901,123456,1.0,123,{','.join(map(str, BLOCK.left[:2]))}\n"
    + f",{','.join(map(str, BLOCK.left[2:]))}\n"
    + "CONM2,60,900,,2.5,0.01,0.02,0.03\n,0.1,0.01,0.2,0.02,0.03,0.3\n"
    + "SPC1,7,123,1,3\nSET1,9,1,4\nENDDATA\n"
)
#: Wood in a system of its own, and equations in one of the nodes.
LAW = [1e9 * (7 if i == j else 0.3 + 0.1 * j) for i in range(6) for j in range(i, 6)]
WORDS = ["3", *map(repr, LAW), "450."]
BULK_WOOD = (
    BULK.replace("BEGIN BULK", "CEND\nMPC = 40\nBEGIN BULK")
    .replace("PSOLID,1,3", "PSOLID,1,3,6")
    .replace("MAT1,3,2.1e11,,0.3,7850.\n", "")
    .replace(
        "ENDDATA",
        "\n".join(
            f"{'' if i else 'MAT9'},{','.join(WORDS[i : i + 8])}" for i in (0, 8, 16)
        )
        + "\nCORD2R,6,5,0.1,0.2,0.3,0.4,0.1,1.3\n,1.1,0.3,0.3\n"
        "GRID,903,,0.3,0.02,0.02,6\nGRID,904,5,0.3,0.02,0.02,6\n"
        "MPC,41,903,1,1.5,904,2,-1.5\n,,3,1,0.25\nMPC,42,903,2,1.5,904,2,-1.5\n"
        "MPCADD,40,41,42\nENDDATA",
    )
)
#: A frame of every kind of bar, with loads, temperatures and cases beside it.
BARS = """SOL 103
CEND
SPC = 7
METHOD = 20
BEGIN BULK
PARAM,COUPMASS,1
PARAM,WTMASS,0.5
CORD2C,5,,0.1,0.2,0.3,0.4,0.1,1.3
,1.1,0.3,0.3
GRDSET,,,,,,5
GRID,1,,0.,0.,0.,5
GRID,2,,0.4,0.1,0.
GRID,3,5,0.5,60.,0.2
GRID,4,,0.1,0.5,0.7,0
GRID,5,,0.1,0.5,0.8
GRID,6,,0.3,0.9,0.8
CORD2R,8,,0.,0.,0.,1.,0.2,0.
,0.,1.,0.3
CBAR,1,11,1,2,0.2,-0.3,0.9,GGG
,,,0.01,0.02,0.03,0.04,0.05,0.06
CBAR,2,12,2,3,6
CBEAM,3,13,3,4,0.2,-0.3,0.9
CBEAM,4,14,4,1,0.2,-0.3,0.9,BGG
CROD,5,15,1,3
CONROD,6,2,4,2,2.-4,3.-9,0.,0.7
PBAR,11,1,4.-4,3.-8,5.-8,4.-8,0.3
,,,,,,,,
,0.8,0.9
PBARL,12,1,,BOX
,0.06,0.04,0.002,0.003,0.4
PBEAM,13,1,4.-4,3.-8,5.-8,,4.-8,0.2
,,,,,,,,
,NO,1.0,3.-4,2.-8,4.-8,,3.-8,0.1
,0.7,0.6
PBEAML,14,1,,TUBE2
,0.03,0.004,0.3,NO,1.0,0.02,0.003,0.2
PROD,15,2,2.-4,3.-9,0.,0.5
MAT1,1,2.1+11,,0.3,7850.
MAT1,2,7.+10,2.6+10,,2700.
RBE2,50,4,123456,5
CONM2,60,5,8,2.5,0.01,0.02,0.03
,0.1,0.01,0.2,0.02,0.03,0.3
SPC1,7,123,1,3
SET1,9,1,4
FORCE,30,2,,1.,0.,0.,1.
PLOAD1,31,1,FZ,FR,0.,1.,1.,1.
TEMP,32,2,30.
EIGRL,20,,,6
ENDDATA
"""
#: Numbers of cards that nothing else names, the directions of a support, which names
#: nodes alone, and a weight that all nodes have.
FREE_BULK = re.compile(
    r"(RBE2|RBE3|CONM2),\d+.* -> \1,(51|53|61),|BEGIN|CEND|ENDDATA|"
    r"SPC1,7,123,.* -> SPC1,7,124,|RBE3.* -> RBE3.*,1.381,123,1,4$"
)


#: What changes nothing of bars: case control, loads, results, stress points.
FREE_BARS = re.compile(
    r"SOL|CEND|SPC = |METHOD|BEGIN|ENDDATA|PARAM,COUPMASS|FORCE|PLOAD1|TEMP|EIGRL|"
    r"(RBE2|CONM2),\d+.* -> \1,(51|61),|SPC1,7,123,.* -> SPC1,7,124,|"
    r",,,,,,,,$|(PROD|CONROD).* -> .*,0.011,0"
)


def test_no_field_and_no_line_of_bars_is_lost(tmp_path: Path) -> None:
    before = read(tmp_path, BARS, "part.bdf")
    missing = []
    for change in (fields_changed, lines_left_out):
        for what, text in change(BARS):
            try:
                same = read(tmp_path, text + "\n", "part.bdf") == before
            except InputError:
                continue
            if same and not FREE_BARS.match(what):
                missing.append(what)
    assert not missing


def archive() -> str:
    """Two materials and a component of each, as ANSYS writes them, with loads."""
    lines = ["/PREP7", "/TITLE,a part", "ET,1,185", "KEYOPT,1,2,2", "ET,2,185"]
    lines += ["MP,EX,1,2.1E11", "MP,PRXY,1,0.3", "MP,DENS,1,7850."]
    lines += ["MPTEMP,R5.0, 1, 1, 0.", "MPDATA,R5.0, 1,EX, 2, 1, 7.0E10"]
    lines += ["MPDATA,R5.0, 1,NUXY, 2, 1, 0.33", "MPDATA,R5.0, 1,DENS, 2, 1, 2700."]
    lines += ["MP,ALPX,2,2.3E-5", "NBLOCK,6,SOLID", "(3i9,6e21.13e3)"]
    for i, point in enumerate(BLOCK.points[:-1], 1):
        words = "".join(f"{x + 0.01:21.13e}" for x in point)
        lines.append(f"{i:9d}{0:9d}{0:9d}{words}")
    x, y, z = BLOCK.points[-1]
    lines += [
        "N,R5.3,LOC,       -1,",
        f"N,{LAST},{x + 0.01!r},{y + 0.01!r},{z + 0.01!r}",
    ]
    lines += ["EBLOCK,19,SOLID", "(19i9)"]
    head = [1, 1, 3, 4, 0, 0, 6, 7, 8, 0, 1]
    lines.append("".join(f"{v:9d}" for v in [*head, *BLOCK.elements[0]]))
    nodes = ",".join(map(str, BLOCK.elements[1]))
    lines += ["-1", "MAT,2", "TYPE,2", f"EN,5,{nodes}"]
    lines += ["CMBLOCK,LEFT,NODE,       3", "(8i10)", f"{1:10d}{-2:10d}{4:10d}"]
    lines += ["CMBLOCK,OLD,ELEM,       1", "(8i10)", f"{1:10d}"]
    lines += ["D,1,UX,0.", "F,2,FX,10.", "SF,1,PRES,5.", "ACEL,0.,0.,9.8", "FINISH"]
    return "\n".join([*lines, ""])


#: Titles, loads and constants of heat; real constants, sections, keys of the solid
#: model and of the shape, which say nothing of these elements; versions and how long a
#: table may become; two kinds of enhanced strains, both incompatible modes here.
FREE_ARCHIVE = re.compile(
    r"/PREP7|/TITLE|MPTEMP|MP,ALPX|D,|F,|SF,|ACEL|FINISH|-1$|N,R5|ROW (2|3|4|6|7|9) |"
    r"(KEYOPT,1,2,2|NBLOCK.*|EBLOCK.*|CMBLOCK.*|.*13e3.) -> "
    r"(KEYOPT,1,2,3|NBLOCK|EBLOCK,20|CMBLOCK,(LEFT,NODEX|OLD,ELEMX)|.*13e3.X)|"
    r"MPDATA.* -> MPDATA,(R5.0X|R5.0,2),|"
    r" *\d+ +0 +0 .* ->  *\d+ +(1 +0|0 +1) "
)


def archive_fields(text: str) -> Iterator[tuple[str, str]]:
    """Every number of a block and every word of a command, each changed alone."""
    lines = text.splitlines()
    for i, line in enumerate(lines):
        block = line.startswith(" ")
        parts = list(re.finditer(r"\S+" if block else r"[^,]+", line))
        for k, part in enumerate(parts if block else parts[1:]):
            word = other(part.group())
            if block and len(word) > len(part.group()) and "e" not in word:
                word = word[: len(part.group())]
            start = part.end() - len(word) if block else part.start()
            new = line[:start] + word + line[part.end() :]
            if block and "e" in part.group():
                size = len(part.group())
                word = f"{float(part.group()) + 0.001:{size}.13e}"
                new = line[: part.start()] + word + line[part.end() :]
            name = f"ROW {k} " if block and len(parts) > 11 else ""
            yield (
                f"{name}{line} -> {new}",
                "\n".join([*lines[:i], new, *lines[i + 1 :]]),
            )


def test_no_field_and_no_line_of_an_archive_is_lost(tmp_path: Path) -> None:
    text = archive()
    before = read(tmp_path, text, "part.cdb")
    missing = []
    for change in (archive_fields, lines_left_out):
        for what, changed in change(text):
            try:
                same = read(tmp_path, changed + "\n", "part.cdb") == before
            except InputError:
                continue
            if same and not FREE_ARCHIVE.match(what):
                missing.append(what)
    assert not missing


@pytest.mark.parametrize("deck", [BULK, BULK_WOOD], ids=["steel", "wood"])
def test_no_field_and_no_line_of_bulk_data_is_lost(deck: str, tmp_path: Path) -> None:
    before = read(tmp_path, deck, "part.bdf")
    missing = []
    for change in (fields_changed, lines_left_out):
        for what, text in change(deck):
            try:
                same = read(tmp_path, text + "\n", "part.bdf") == before
            except InputError:
                continue
            if same and not FREE_BULK.match(what):
                missing.append(what)
    assert not missing


@pytest.mark.parametrize("name", DECKS)
@pytest.mark.parametrize("change", [fields_changed, lines_left_out])
def test_no_field_and_no_line_is_lost(change: Any, name: str, tmp_path: Path) -> None:
    before = read(tmp_path, DECKS[name])
    missing = []
    for what, text in change(DECKS[name]):
        try:
            same = read(tmp_path, text) == before
        except InputError:
            continue
        if same and not FREE.match(what):
            missing.append(what)
    assert not missing


@pytest.mark.parametrize("name", DECKS)
def test_case_and_blanks_do_not_matter(name: str, tmp_path: Path) -> None:
    before = read(tmp_path, DECKS[name])
    text = DECKS[name].replace(", ", " ,  ").replace("*NODE", "*Node")
    for keyword in ("Element", "Nset", "Equation", "Elastic", "Surface", "Tie"):
        text = text.replace(f"*{keyword.upper()}", f"*{keyword}")
    assert read(tmp_path, "** a remark\n" + text.replace("\n*", "\n**\n*")) == before
