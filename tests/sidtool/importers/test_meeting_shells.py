"""Shells that meet: factors of an egg crate, and its outlines."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose
from scipy.sparse.linalg import splu

from sidtool.discretisation import structure
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.model import ModelFile
from sidtool.pipeline.model_to_sid import finite_element_model

from .mesh_files import mesh_model

#: Cells, elements along the side of a cell, and in the height; side of an element [m].
CELLS, SIDE, HEIGHT, LENGTH = 4, 3, 3, 0.05
THICKNESS, DENSITY = 2e-3, 2700.0


def crate() -> tuple[str, int]:
    """Bulk data of walls that cross on a floor, and the number of elements."""
    numbers: dict[tuple[int, int, int], int] = {}

    def node(*at: int) -> int:
        return numbers.setdefault(at, len(numbers) + 1)

    whole, elements = CELLS * SIDE, []
    for wall in range(0, whole + 1, SIDE):
        for a in range(whole):
            for z in range(HEIGHT):
                corners = ((a, z), (a + 1, z), (a + 1, z + 1), (a, z + 1))
                elements.append([node(x, wall, up) for x, up in corners])
                elements.append([node(wall, x, up) for x, up in corners])
    for a in range(whole):
        for b in range(whole):
            corners = ((a, b), (a + 1, b), (a + 1, b + 1), (a, b + 1))
            elements.append([node(x, y, 0) for x, y in corners])
    lines = ["BEGIN BULK"]
    lines += [
        f"GRID,{number},,{','.join(f'{LENGTH * x:g}' if x else '0.' for x in at)}"
        for at, number in numbers.items()
    ]
    lines += [
        f"CQUAD4,{k},1,{','.join(map(str, e))}" for k, e in enumerate(elements, 1)
    ]
    lines += [f"PSHELL,1,1,{THICKNESS},1,,1", f"MAT1,1,7.+10,,0.3,{DENSITY}", "ENDDATA"]
    return "\n".join(lines) + "\n", len(elements)


@pytest.fixture(scope="module")
def body_and_factors(
    tmp_path_factory: pytest.TempPathFactory,
) -> tuple[FiniteElementModel, sp.csr_matrix, Any, int]:
    folder = tmp_path_factory.mktemp("crate")
    text, count = crate()
    (folder / "a.bdf").write_text(text, encoding="utf-8")
    path = mesh_model(folder, "a.bdf", frame={"type": "buckens"})
    data = json.loads(path.read_text(encoding="utf-8"))
    del data["material"]
    data["markers"] = {"p": {"node": 1, "mesh_node": 1}}
    data["geometry"]["file"] = str(folder / "a.bdf")
    found = []
    factorise = structure.symmetric_factors

    def record(matrix: sp.csr_matrix, places: Any) -> Any:
        found.append((matrix, factorise(matrix, places)))
        return found[-1][1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SIDTOOL_FACTORS", "superlu")
        patch.setattr(structure, "symmetric_factors", record)
        body = finite_element_model(ModelFile.checked(data, "test"))
    ((matrix, factors),) = found
    return body, matrix, factors, count


def test_factors_of_shells_that_meet_fill_in_little(body_and_factors: Any) -> None:
    """A column order for general matrices (COLAMD) has three times as many entries, of
    the stiffness as it is: one with a unit diagonal exchanges fewer rows."""
    body, matrix, factors, _ = body_and_factors
    size = 1e-9 * body.stiffness.diagonal().max() / body.mass.diagonal().max()
    general = splu(sp.csc_matrix(body.stiffness + size * body.mass))
    assert general.shape == matrix.shape
    assert factors._factors.L.nnz + factors._factors.U.nnz < 0.5 * (
        general.L.nnz + general.U.nnz
    )


def test_mass_and_outlines_are_those_of_the_plates(body_and_factors: Any) -> None:
    """All plates move with a rigid motion of the body."""
    body, _, _, count = body_and_factors
    rigid = body.rigid_body_modes()
    area = count * LENGTH**2
    assert_allclose(
        rigid[:, 0] @ (body.mass @ rigid[:, 0]), area * THICKNESS * DENSITY, rtol=1e-9
    )
    outlines = body.outlines()
    assert len(outlines) == count
    for outline in outlines[:: count // 7]:
        motion = (outline.motion @ rigid).reshape(2, 6, 6)
        assert_allclose(motion[:, 3:, 3:], np.broadcast_to(np.eye(3), (2, 3, 3)))
        for place, moved in zip(outline.places, motion, strict=True):
            expected = np.cross(np.eye(3), place).T
            assert_allclose(moved[:3, 3:], expected, atol=1e-12)
