"""geometry.part of Nastran and ANSYS files: one of two bars beside each other."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from tests.codes import only

from .bars.decks import body as bars_body, bulk, grids
from .decks import STEEL, Block
from .test_import_couplings import body

SMALL, LARGE = Block((2, 1, 1), (0.2, 0.05, 0.04)), Block((3, 1, 1), (0.4, 0.06, 0.05))
APART = 100


def nastran(*cards: str) -> str:
    """Properties 1 and 2, each a bar of its own."""
    lines = ["BEGIN BULK", "PSOLID,1,1", "PSOLID,2,1"]
    lines += [f"MAT1,1,{STEEL['e']!r},,{STEEL['nu']!r},{STEEL['rho']!r}"]
    for number, (block, first) in enumerate(((SMALL, 0), (LARGE, APART)), 1):
        for i, (x, y, z) in enumerate(block.points, 1 + first):
            lines.append(f"GRID,{i},,{x!r},{y + first!r},{z!r}")
        for i, nodes in enumerate(block.elements, 1 + first):
            n = [str(a + first) for a in nodes]
            lines += [f"CHEXA,{i},{number},{','.join(n[:6])}", f",{n[6]},{n[7]}"]
    return "\n".join([*lines, *cards, "ENDDATA", ""])


def ansys() -> str:
    """Components SMALL and LARGE of elements, as ANSYS writes them."""
    lines = ["/PREP7", "ET,1,185", "KEYOPT,1,2,2", "NBLOCK,6,SOLID", "(3i9,6e21.13e3)"]
    lines[1:1] = [
        f"MP,{k},1,{STEEL[v]!r}"
        for k, v in (("EX", "e"), ("PRXY", "nu"), ("DENS", "rho"))
    ]
    elements = []
    members: dict[str, list[int]] = {}
    for name, block, first in (("SMALL", SMALL, 0), ("LARGE", LARGE, APART)):
        for i, (x, y, z) in enumerate(block.points, 1 + first):
            words = "".join(f"{v:21.13e}" for v in (x, y + first, z))
            lines.append(f"{i:9d}{0:9d}{0:9d}{words}")
        for i, nodes in enumerate(block.elements, 1 + first):
            row = [1, 1, 1, 1, 0, 0, 0, 0, 8, 0, i, *(n + first for n in nodes)]
            elements.append("".join(f"{v:9d}" for v in row))
            members.setdefault(name, []).append(i)
    lines += ["N,R5.3,LOC,       -1,", "EBLOCK,19,SOLID", "(19i9)", *elements, "-1"]
    for name, labels in members.items():
        lines += [f"CMBLOCK,{name},ELEM,{len(labels):8d}", "(8i10)"]
        lines.append("".join(f"{v:10d}" for v in labels))
    return "\n".join([*lines, ""])


def of(folder: Path, text: str, file: str, part: str, node: int = 1) -> SID:
    geometry = {"type": "mesh", "file": file, "part": part}
    markers = {"root": {"node": 1, "mesh_node": node}}
    return body(folder, text, file=file, geometry=geometry, markers=markers)


@pytest.mark.parametrize(
    ("file", "text", "names"),
    [("part.bdf", nastran(), "12"), ("part.cdb", ansys(), ("small", "LARGE"))],
)
@pytest.mark.filterwarnings("ignore")
def test_each_part_has_its_mass(
    file: str, text: str, names: Any, tmp_path: Path
) -> None:
    for block, name, node in ((SMALL, names[0], 1), (LARGE, names[1], APART + 1)):
        volume = 1.0
        for side in block.points[-1]:
            volume *= side
        sid = of(tmp_path, text, file, name, node)
        assert sid.mass == pytest.approx(STEEL["rho"] * volume, rel=1e-9)
        chosen, count = only(sid, "N134"), len(block.elements)
        assert chosen.subject == f"part {name}"
        whole = len(SMALL.elements) + len(LARGE.elements)
        assert (chosen.data["elements"], chosen.data["given"]) == (count, whole)
    with pytest.raises(InputError, match=r"no part '9'.*one of"):
        of(tmp_path, text, file, "9")
    with pytest.raises(InputError, match="2 unconnected parts"):
        body(tmp_path, text, file=file, geometry={"type": "mesh", "file": file})


@pytest.mark.filterwarnings("ignore")
def test_masses_go_with_their_part(tmp_path: Path) -> None:
    masses = ["CONM2,900,1,,3.0", f"CONM2,901,{APART + 1},,50.0"]
    plain = of(tmp_path, nastran(), "part.bdf", "1").mass
    found = of(tmp_path, nastran(*masses), "part.bdf", "1").mass
    assert found == pytest.approx(plain + 3.0, rel=1e-12)


def test_a_part_that_an_equation_holds_is_refused(tmp_path: Path) -> None:
    text = nastran(f"MPC,4,1,1,1.,{APART + 1},1,-1.")
    with pytest.raises(InputError, match="holds the part '1' to the rest"):
        of(tmp_path, text, "part.bdf", "1")


@pytest.mark.filterwarnings("ignore")
def test_bars_by_their_property(tmp_path: Path) -> None:
    places = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 1, 0]]
    cards = [
        "CBAR,1,1,1,2,0.,0.,1.",
        "CBAR,2,2,3,4,0.,0.,1.",
        "PBARL,1,1,,ROD\n,0.02",
        "PBARL,2,1,,BAR\n,0.02,0.03",
        "MAT1,1,2.1+11,,0.3,7850.",
    ]
    found = bars_body(
        tmp_path,
        bulk(*grids(places), *cards),
        geometry={"part": "2"},
        markers={"p": {"node": 1, "mesh_node": 3}},
    )
    assert found.mass == pytest.approx(7850 * 2 * 6e-4, rel=1e-12)
