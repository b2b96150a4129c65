"""Bulk data of Nastran and ANSYS, by packages that need not be there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from formats.errors import InputError
from sidtool.convert import sid_from_model
from sidtool.frontends.mesh import Mesh, check_mesh
from sidtool.importers.meshes import read_mesh

from .mesh_files import (
    BDF,
    bdf_text,
    cdb_mesh,
    cdb_text,
    importable,
    mesh_model,
    msh_2,
    rod_mesh,
)


def test_nastran(tmp_path: Path) -> None:
    """With pyNastran one tetrahedron with its material; without, what is missing."""
    path = tmp_path / "one.bdf"
    path.write_text(BDF)
    if not importable("pyNastran.bdf.bdf"):
        with pytest.raises(InputError, match="needs the package pyNastran"):
            read_mesh(path)
        return
    imported = read_mesh(path)
    assert imported.mesh.blocks[0].kind == "tet4"
    assert imported.materials["5"].density == 7850.0
    assert set(imported.mesh.node_sets["SPC9"]) == {0, 1, 2}


def test_ansys(tmp_path: Path) -> None:
    """With mapdl-archive one brick; without, what is missing."""
    path = tmp_path / "one.cdb"
    path.write_text(cdb_text())
    if not importable("mapdl_archive"):
        with pytest.raises(InputError, match="needs the package mapdl-archive"):
            read_mesh(path)
        return
    imported = read_mesh(path)
    assert imported.mesh.blocks[0].kind == "hex8"
    check_mesh(imported.mesh)


BULK: dict[str, tuple[str, str, Callable[[Mesh], str], str]] = {
    "bdf": ("pyNastran.bdf.bdf", "rod.bdf", bdf_text, "SPC9"),
    "cdb": ("mapdl_archive", "rod.cdb", cdb_mesh, "LEFT"),
}


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet4", "tet10"])
@pytest.mark.parametrize("name", BULK)
def test_bulk_data_hold_the_same_mesh(tmp_path: Path, name: str, kind: str) -> None:
    """The rod by every element: nodes, order of nodes, sets, and its frequencies."""
    module, file, writer, clamped = BULK[name]
    if not importable(module):
        pytest.skip(f"{module.split('.')[0]} does not work here")
    mesh = rod_mesh(kind)
    (tmp_path / file).write_text(writer(mesh))
    imported = read_mesh(tmp_path / file)
    assert_allclose(imported.mesh.positions, mesh.positions, atol=1e-9)
    (block,) = imported.mesh.blocks
    assert block.kind == kind
    assert (block.nodes == mesh.blocks[0].nodes).all()
    assert set(imported.mesh.node_sets[clamped]) == set(mesh.node_sets["0.0"])
    frame = {"type": "tangent", "marker": "crank_pin", "clamp": clamped}
    found = sid_from_model(mesh_model(tmp_path, file, frame=frame))
    (tmp_path / "rod.msh").write_text(msh_2(mesh))
    expected = sid_from_model(mesh_model(tmp_path, "rod.msh"))
    assert_allclose(np.diag(found.Ke.m0), np.diag(expected.Ke.m0), rtol=1e-6)


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("bdf", "CTETRA,1,7,", "CTETRA,1,7,1", "not defined|cannot be read"),
        ("bdf", "CTETRA,1,7,1,2,3,4", "CBEAM,1,7,1,2,0.,0.,1.", "is a CBEAM"),
        ("bdf", "GRID,4,,", "GRID,4,6,", "coordinate system 6"),
        ("cdb", "1,185", "1,181", "of type 181"),
    ],
)
def test_mistakes_in_bulk_data(
    tmp_path: Path, name: str, old: str, new: str, message: str
) -> None:
    module, file, *_ = BULK[name]
    if not importable(module):
        pytest.skip(f"{module.split('.')[0]} does not work here")
    text = BDF if name == "bdf" else cdb_text()
    assert old in text
    (tmp_path / file).write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=message) as caught:
        read_mesh(tmp_path / file)
    assert caught.value.source == str(tmp_path / file)
