"""CSHEAR: Garvey's shear panels, and a box of them that twists as Bredt's tube."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.discretisation.shell_elements import shear_panel_stiffness
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import finite_element_model

E, NU, T, RHO = 2.0e11, 0.3, 2e-3, 7850.0
G = E / 2 / (1 + NU)
LAW = E * T / (1 - NU**2) * np.array([[1, NU, 0], [NU, 1, 0], [0, 0, (1 - NU) / 2]])
#: Corners, and by what the direct stresses raise the energy of Garvey's flows: slopes
#: of 1/2 of parallel sides, and of 1 of the legs of a symmetric trapezoid.
PANELS = {
    "rectangle": ([[0, 0], [2, 0], [2, 1], [0, 1]], 1.0),
    "parallelogram": ([[0, 0], [2, 0], [2.5, 1], [0.5, 1]], 1 + 2 / 4 / (1 + NU)),
    "trapezoid": ([[-2, 0], [2, 0], [1, 1], [-1, 1]], 1 + 2 / 3 / (1 + NU)),
}
SIDE, LENGTH, AREA = 0.2, 1.0, 1e-4


@pytest.mark.parametrize("name", PANELS)
def test_the_stiffness_of_panels_is_that_of_garvey(name: str) -> None:
    """Along a diagonal of length l it is G t l^2 / (4 A), less by direct stresses."""
    flat, factor = PANELS[name]
    corners = np.pad(np.array(flat, float), ((0, 0), (0, 1)))
    corners[2, 2] += 0.1  # forces along the diagonals balance on warped panels, too
    (k,) = shear_panel_stiffness(corners[None], LAW[None], np.array([[1.0, 0.2, 0.0]]))
    turn = np.zeros((4, 6, 3))
    turn[:, :3] = -np.cross(corners[:, None], np.eye(3)).transpose(0, 2, 1)
    assert_allclose(k @ turn.reshape(24, 3), 0, atol=1e-9 * abs(k).max())
    corners[2, 2] = 0.0
    (k,) = shear_panel_stiffness(corners[None], LAW[None], np.array([[1.0, 0.2, 0.0]]))
    diagonal = corners[2] - corners[0]
    length, heights = np.linalg.norm(diagonal), np.ptp(corners[:, 1])
    area = (corners[1, 0] - corners[0, 0] + corners[2, 0] - corners[3, 0]) / 2 * heights
    along = diagonal / length
    expected = G * T * length**2 / (4 * area * factor)
    assert along @ k[:3, :3] @ along == pytest.approx(expected, rel=1e-5)


def box(bays: int, tail: str = "") -> str:
    """A square tube of panels with rods along all edges, closed at its ends."""
    lines = ["BEGIN BULK", f"PSHEAR,1,1,{T},0.5", f"PROD,2,1,{AREA},1.-9", tail]
    lines.append(f"MAT1,1,{E},,{NU},{RHO}")
    corners = [(0.0, 0.0), (SIDE, 0.0), (SIDE, SIDE), (0.0, SIDE)]
    for i in range(bays + 1):
        for k, (y, z) in enumerate(corners):
            lines.append(f"GRID,{4 * i + k + 1},,{LENGTH * i / bays!r},{y},{z}")
    panels = [(1, 2, 3, 4), tuple(4 * bays + k for k in (1, 2, 3, 4))]
    edges = [
        (4 * i + k + 1, 4 * i + (k + 1) % 4 + 1) for i in (0, bays) for k in range(4)
    ]
    for i in range(bays):
        for k in range(4):
            a, b = 4 * i + k + 1, 4 * i + (k + 1) % 4 + 1
            panels.append((a, b, b + 4, a + 4))
            edges += [(a, a + 4), *([(a, b)] if i else [])]
    lines += [
        f"CSHEAR,{n},1,{a},{b},{c},{d}" for n, (a, b, c, d) in enumerate(panels, 1)
    ]
    lines += [f"CROD,{100 + n},2,{a},{b}" for n, (a, b) in enumerate(edges)]
    return "\n".join([*lines, "ENDDATA", ""])


def imported(path: Path) -> FiniteElementModel:
    data = {
        "format": "sidtool model",
        "version": 1,
        "geometry": {"type": "mesh", "file": str(path)},
        "discretisation": {"type": "mesh"},
        "frame": {"type": "buckens"},
        "markers": {"p": {"node": 1, "mesh_node": 1}},
        "reduction": {"method": "modal", "modes": 2},
    }
    return finite_element_model(validate_data(data, ModelFile))


def test_a_square_tube_twists_as_bredts(tmp_path: Path) -> None:
    """Couples at the corners of its ends shear its walls evenly and nothing else."""
    bays = 2
    (tmp_path / "a.bdf").write_text(box(bays), encoding="utf-8")
    body = imported(tmp_path / "a.bdf")
    assert body.dof_table is not None
    arms = body.positions[:, 1:] - SIDE / 2
    pushes = np.zeros(body.ndof)
    for row, (y, z) in enumerate(arms):
        end = {0: -1.0, bays: 1.0}.get(row // 4, 0.0)
        pushes[body.dof_table[row, 1:3]] += end * np.array([-z, y]) / (2 * SIDE**2)
    turned, *_ = np.linalg.lstsq(body.stiffness.toarray(), pushes, rcond=1e-12)
    twist = pushes @ turned
    assert twist == pytest.approx(LENGTH * 4 * SIDE / T / (4 * SIDE**4 * G), rel=1e-9)
    walls = (4 * LENGTH + 2 * SIDE) * SIDE * (RHO * T + 0.5)
    rods = (4 * LENGTH + 4 * (bays + 1) * SIDE) * AREA * RHO
    heavy = [body.mass[np.ix_(d, d)].sum() for d in body.dof_table[:, :3].T]
    assert_allclose(heavy, walls + rods, rtol=1e-12)


WRONG = {
    "PSHEAR,1,1,0.002,0.5,0.3": "F1 = 0.3",
    "PSHEAR,1,1,0.": "T = 0",
    "PSHELL,1,1,0.002": "has the property PSHELL 1",
    "PSHEAR,1,1,0.002\nCQUAD4,90,1,1,2,6,5": r"90 \(quad4\) has the property PSHEAR 1",
    "PSHEAR,1,1,0.002\nGRID,90,,0.,0.1,0.\nCSHEAR,90,1,1,90,2,6": "90 has no area",
}


@pytest.mark.parametrize("lines", WRONG)
def test_other_panels_are_refused(lines: str, tmp_path: Path) -> None:
    text = box(1).replace(f"PSHEAR,1,1,{T},0.5", lines)
    (tmp_path / "a.bdf").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=WRONG[lines]):
        imported(tmp_path / "a.bdf")
