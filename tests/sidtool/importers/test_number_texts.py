"""Texts that `int` and `float` convert and no format means are refused by line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from sidtool.formats.base.errors import InputError
from sidtool.importers.matrices import read_matrices
from sidtool.importers.mesh_files import read_mesh
from sidtool.importers.openfast import read_openfast

#: A digit of another script.
FOREIGN = "\N{FULLWIDTH DIGIT ONE}"
REALS = ("1_0", FOREIGN, "nan")
INTEGERS = ("1_0", FOREIGN, "5.")
LABELS = (*INTEGERS, "0", "9" * 19)

NARROW = tuple(f"{word:>9}" for word in LABELS if len(word) < 9)
CORNERS = [(x, y, z) for z in "01" for x, y in ("00", "10", "11", "01")]


def nodes(form: str) -> str:
    return "".join(form.format(i, *x) for i, x in enumerate(CORNERS, 1))


CELL = "1,2,3,4,5,6,7,8"
DECKS = {
    "inp": "*NODE\n"
    + nodes("{}, {}., {}., {}.\n")
    + f"*ELEMENT, TYPE=C3D8, ELSET=E\n1,{CELL}\n*MATERIAL, NAME=M\n*ELASTIC\n9., .3\n"
    "*DENSITY\n1.\n*SOLID SECTION, ELSET=E, MATERIAL=M\n*NSET, NSET=N\n3\n"
    "*SURFACE, NAME=S, TYPE=NODE\nN,\n*COUPLING, REF NODE=4, SURFACE=S, "
    "CONSTRAINT NAME=C\n*KINEMATIC\n1, 3\n",
    "bdf": nodes("GRID    {:<8}        {}.      {}.      {}.\n")
    + "CHEXA   1       1       1       2       3       4       5       6\n"
    "        7       8\nPSOLID,1,1\nMAT1,1,9.,,.3,1.\nSET1,1,3\nGRID,9,,0.,0.,2.\n"
    "=,*1,=,*1.,==\nENDDATA\n",
    "msh": "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n8\n"
    + nodes("{} {} {} {}\n")
    + f"$EndNodes\n$Elements\n1\n1 5 2 3 3 {CELL.replace(',', ' ')}\n$EndElements\n",
    "cdb": "/PREP7\nET,1,185\nMP,EX,1,9.\nMP,PRXY,1,.3\nMP,DENS,1,1.\nNBLOCK,6,SOLID\n"
    "(3i9,3e9.1)\n"
    + nodes("{:9}        0        0      {}.0      {}.0      {}.0\n")
    + f"N,R5.3,LOC,       -1,\nTYPE,1\nMAT,1\nEN,1,{CELL}\nFINISH\n",
    "mtx": "1 1 1 1 3.\n1 2 1 2 4D0\n",
    "dat": "---\n2 NBlInpSt\n---\nBlFract BMassDen FlpStff EdgStff\n(-) (-) (-) (-)\n"
    "0. 1. 2. 3.\n1. 1. 2D0 3.\n",
}
#: Format -> a line, the same with a mark @, what is valid there, and what is not.
CASES = {
    "inp": [
        ("1, 0., 0., 0.", "@, 0., 0., 0.", "1", LABELS),
        ("2, 1., 0., 0.", "2, @, 0., 0.", "1.D0", REALS),
        (f"1,{CELL}", f"@,{CELL}", "5", LABELS),
        (f"1,{CELL}", "1,@,2,3,4,5,6,7,8", "1", INTEGERS),
        ("9., .3", "@, .3", "1d5", REALS),
        ("*NSET, NSET=N\n3", "*NSET, NSET=N\n@", "5", INTEGERS),
        ("*KINEMATIC\n1, 3", "*KINEMATIC\n@, 3", "1", ("1_", FOREIGN, "1.5", "1e0")),
    ],
    "bdf": [
        ("GRID    1  ", "GRID    @  ", "1", LABELS[:4]),
        ("GRID    1               0.", "GRID    1               @ ", "0.", REALS),
        ("CHEXA   1  ", "CHEXA   @  ", "1", LABELS[:3]),
        ("MAT1,1,9.", "MAT1,1,@", "9.+0", ("1_0+5", FOREIGN)),
        ("SET1,1,3", "SET1,1,@", "4", ("1_0", FOREIGN)),
        ("=,*1,=,*1.", "=,*@,=,*1.", "2", ("1_0", "nan")),
    ],
    "msh": [
        ("1 0 0 0", "@ 0 0 0", "1", LABELS),
        ("2 1 0 0", "2 @ 0 0", "1e0", REALS),
        ("1 5 2 3 3 1", "@ 5 2 3 3 1", "7", LABELS),
    ],
    "cdb": [
        (f"{1:9}        0", "@        0", f"{1:9}", NARROW),
        (
            f"{1:9}        0        0      0.0",
            f"{1:9}        0        0@",
            "    1.0D0",
            ("      1_0", "      nan"),
        ),
        ("MP,EX,1,9.", "MP,EX,1,@", "9.D0", REALS),
        ("MP,EX,1,9.", "MP,EX,@,9.", "1", INTEGERS),
        (f"EN,1,{CELL}", f"EN,1,@{CELL[1:]}", "1", INTEGERS),
    ],
    "mtx": [
        ("1 2 1 2 4D0", "1 2 1 2 @", "4E0", REALS),
        ("1 2 1 2 4D0", "1 2 1 @ 4", "2", ("2_0", FOREIGN)),
    ],
    "dat": [
        ("1. 1. 2D0 3.", "1. @ 2. 3.", "1D0", REALS),
        ("2 NBlInpSt", "@ NBlInpSt", "2", ("2_0", FOREIGN, "2_", "nan")),
    ],
}


def read_with_nodes(path: Path) -> object:
    """Read a matrix of one node."""
    place = path.with_name("nodes.txt")
    place.write_text("1 0 0 0\n", encoding="utf-8")
    return read_matrices(str(path), str(path), str(place), None)


READERS: dict[str, Callable[[Path], object]] = {
    "mtx": read_with_nodes,
    "dat": lambda path: read_openfast(path, 1.0),
}


@pytest.mark.parametrize("ending", CASES)
def test_words_of_numbers(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"file.{ending}"
    read = READERS.get(ending, read_mesh)
    for line, marked, valid, words in CASES[ending]:
        before, behind = f"\n{DECKS[ending]}".split(f"\n{line}", 1)
        text = f"{before}\n{marked}{behind}"[1:]
        path.write_text(text.replace("@", valid), encoding="utf-8")
        read(path)
        number = text[: text.index("@")].count("\n") + 1
        for word in words:
            path.write_text(text.replace("@", word), encoding="utf-8")
            with pytest.raises(InputError) as caught:
                read(path)
            assert f"line {number}" in str(caught.value.place), (marked, word)
