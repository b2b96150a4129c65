"""Materials of ANSYS archives: what MP says of a solid."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.importers.mesh_files import read_mesh
from sidtool.mesh.imported_mesh import ImportedMesh
from sidtool.mesh.materials import AnisotropicMaterial

from ..importers.mesh_files import cdb_text
from ..importers.test_import_anisotropy import WOOD, strain_of

_PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))


def archive(
    folder: Path, given: dict[str, float], old: str = "", new: str = ""
) -> Path:
    lines = [f"MP,{name},1,{value!r}" for name, value in given.items()]
    text = cdb_text().replace(old, new, 1) + "\n".join([*lines, "MP,DENS,1,450.", ""])
    (folder / "cube.cdb").write_text(text, encoding="utf-8")
    return folder / "cube.cdb"


def law(imported: ImportedMesh) -> np.ndarray:
    material = imported.materials["1"]
    assert isinstance(material, AnisotropicMaterial)
    return material.law


def wood(minor: bool) -> dict[str, float]:
    names = ("EX", "EY", "EZ", "PRXY", "PRXZ", "PRYZ", "GXY", "GXZ", "GYZ")
    found = dict(zip(names, WOOD, strict=True))
    if minor:
        for pair in ("XY", "XZ", "YZ"):
            share = found[f"E{pair[1]}"] / found[f"E{pair[0]}"]
            found[f"NU{pair}"] = found.pop(f"PR{pair}") * share
    return found


@pytest.mark.parametrize("minor", [False, True])
def test_orthotropic_constants_are_those_of_hooke(minor: bool, tmp_path: Path) -> None:
    """Every unit stress strains as the major and as the minor ratios say."""
    mesh = law(read_mesh(archive(tmp_path, wood(minor))))
    for row, (i, j) in enumerate(_PAIRS):
        stress = np.zeros((3, 3))
        stress[i, j] = stress[j, i] = 1.0
        strain = strain_of(stress, np.eye(3))
        six = [strain[a, b] * (1 + (a != b)) for a, b in _PAIRS]
        assert_allclose(mesh @ six, np.eye(6)[row], atol=1e-9)


def test_a_shear_modulus_of_its_own_counts(tmp_path: Path) -> None:
    """It was lost beside EX and PRXY: a cube twisted 2.8 times too fast."""
    mesh = law(read_mesh(archive(tmp_path, {"EX": 2e11, "PRXY": 0.25, "GXY": 1e10})))
    assert_allclose(np.diag(mesh)[3:], 1e10)
    flexibility = np.linalg.inv(mesh)
    assert_allclose(np.diag(flexibility)[:3], 1 / 2e11)
    assert_allclose(flexibility[0, 1], -0.25 / 2e11)


def test_a_rounded_shear_modulus_is_isotropic(tmp_path: Path) -> None:
    imported = read_mesh(archive(tmp_path, {"EX": 2e11, "PRXY": 0.3, "GXY": 7.69e10}))
    assert not isinstance(imported.materials["1"], AnisotropicMaterial)


@pytest.mark.parametrize("given", [{"EX": 2e11}, {"EX": 2e11, "EY": 1e11, "PRXY": 0.3}])
def test_incomplete_materials_are_not_guessed(
    given: dict[str, float], tmp_path: Path
) -> None:
    """Without a ratio it was zero."""
    assert not read_mesh(archive(tmp_path, given)).materials


def test_axes_that_are_not_there_are_refused(tmp_path: Path) -> None:
    head = [1, 1, 1, 1, 0, 0, 0, 0, 8]
    old, new = ("".join(f"{x:9d}" for x in (*head[:4], e, *head[5:])) for e in (0, 12))
    with pytest.raises(InputError, match="the system 12 is not defined"):
        read_mesh(archive(tmp_path, wood(False), old, new))
