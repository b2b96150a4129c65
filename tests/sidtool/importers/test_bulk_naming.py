"""Plane elements and bars without a material beside the solids of bulk data."""

from __future__ import annotations

from pathlib import Path

import pytest

from sidtool.importers.mesh_files import read_mesh
from sidtool.mesh.imported_mesh import ImportedMesh
from tests.codes import codes

from .test_bulk_shells import body

CUBE = """BEGIN BULK
GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID,3,,1.,1.,0.
GRID,4,,0.,1.,0.
GRID,5,,0.,0.,1.
GRID,6,,1.,0.,1.
GRID,7,,1.,1.,1.
GRID,8,,0.,1.,1.
CHEXA,1,1,1,2,3,4,5,6,
,7,8
PSOLID,1,1
MAT1,1,2.1e11,,0.3,7850.
"""
#: As Gmsh numbers them: properties of surfaces and lines that solids have as well.
SKIN = "CTRIA3,2,1,1,3,2\nCTRIA3,3,1,1,4,3\nCQUAD4,4,2,5,6,7,8\nCBAR,5,1,1,2,0.,0.,0.\n"


def read(folder: Path, cards: str) -> ImportedMesh:
    (folder / "part.bdf").write_text(f"{CUBE}{cards}ENDDATA\n", encoding="utf-8")
    return read_mesh(folder / "part.bdf")


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("property_", ["", "PSHELL,2,,0.01\n"])
def test_elements_without_material_name_nodes(tmp_path: Path, property_: str) -> None:
    found = read(tmp_path, SKIN + property_)
    labels = {k: list(found.mesh.labels[v]) for k, v in found.mesh.node_sets.items()}
    assert labels == {
        "SURFACE1": [1, 2, 3, 4],
        "SURFACE2": [5, 6, 7, 8],
        "LINE1": [1, 2],
    }
    assert codes(found)[:2] == ["N110", "N111"]
    kept, naming = found.diagnostics[:2]
    assert (kept.data["elements"], kept.data["used"]) == (1, 8)
    assert naming.data["count"] == 4
    assert naming.data["sets"] == ("SURFACE1", "SURFACE2", "LINE1")
    assert not found.bars
    sid = body(tmp_path, f"{CUBE}{SKIN}{property_}ENDDATA\n")
    assert sid.mass == pytest.approx(7850, rel=1e-12)


@pytest.mark.parametrize(
    ("cards", "ignored", "kinds"),
    [
        ("PSHELL,2,1,0.01\n", "CQUAD4", ["shells"]),
        ("CBAR,6,3,1,2,0.,1.,0.\nPBAR,3,1,1.,1.,1.,1.\n", "CBAR", ["bars"]),
    ],
)
def test_shells_and_bars_beside_solids_are_elements(
    tmp_path: Path, cards: str, ignored: str, kinds: list[str]
) -> None:
    found = read(tmp_path, SKIN + cards)
    held = [name for name in ("shells", "bars") if getattr(found, name)]
    assert held == kinds
    without = read_mesh(tmp_path / "part.bdf", [ignored])
    assert not without.is_structure
    assert [block.kind for block in without.mesh.blocks] == ["hex8"]
