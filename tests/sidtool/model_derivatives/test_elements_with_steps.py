"""Every discretisation with an imaginary step, against differences of high order."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sidtool.discretisation.registry import finite_element_model
from sidtool.elements.finite_element_model import FiniteElementModel
from sidtool.elements.solid_mesh import SolidMesh
from sidtool.formats.base.complex_step import STEP, analytic_pinv
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.mesh.mesh import Mesh
from sidtool.mesh.reference_elements import ELEMENT_KINDS
from sidtool.model_derivatives.design_variables import design_variable
from tests.metamorphic.parts.meshes import STEEL, block, dimension, state
from tests.sidtool.bodies import volume_data
from tests.sidtool.models import IGA, QM6, annulus, rod
from tests.steel_bars import bar_data

from .references import central_difference

COARSE = {**QM6, "elements": [12, 2]}
CASES = [(kind, False) for kind in ELEMENT_KINDS] + [("quad4", True), ("hex8", True)]
#: Point of a plane body and of a solid, moved off its symmetry.
PLANE, SOLID = "geometry.control_points[1][0][1]", "geometry.control_points[1][0][0][1]"
SECTIONS = [
    ("circle", {"diameter": 0.02}),
    ("C", {"height": 0.03, "width": 0.02, "web": 0.002, "flange": 0.003}),
    ("L", {"height": 0.03, "width": 0.02, "thickness": 0.002, "fillet": 0.001}),
    ("general", {"area": 2e-4, "iy": 3e-9, "iz": 2e-9}),
    ("rectangle", {"height": 0.02, "width": 0.03}),
]


def assert_equal_derivatives(
    found: dict[str, Any], expected: dict[str, Any], sizes: dict[str, Any], unit: float
) -> None:
    for name, value in found.items():
        largest = np.abs(sizes[name]).max(initial=0.0) / unit
        size = max(np.abs(expected[name]).max(initial=0.0), 0.1 * largest)
        assert np.abs(value - expected[name]).max(initial=0.0) <= 2e-9 * size, name


@pytest.mark.parametrize(("kind", "relieved"), CASES)
def test_elements_by_node_positions(kind: str, relieved: bool) -> None:
    """Stiffness and mass of a distorted block by a random motion of its nodes."""
    mesh = block(kind, (1,) * dimension(kind), (1.0,) * dimension(kind), seed=2)
    motion = np.random.default_rng(3).normal(size=mesh.positions.shape)

    def matrices(amount: complex) -> dict[str, Any]:
        moved = Mesh(mesh.positions + amount * motion, mesh.blocks)
        body = SolidMesh(moved, {None: STEEL}, state(kind), incompatible_modes=relieved)
        mass, stiffness = body.matrices()
        return {"K": stiffness.toarray(), "M": mass.toarray()}

    with_step, unit = matrices(1j * STEP), 1e-3
    found = {name: value.imag / STEP for name, value in with_step.items()}
    expected = {
        name: sum(
            weight * (matrices(k * unit)[name] - matrices(-k * unit)[name]) / unit
            for k, weight in {1: 0.75, 2: -0.15, 3: 1 / 60}.items()
        )
        for name in found
    }
    assert_equal_derivatives(found, expected, matrices(0.0), 1.0)


def quantities(body: FiniteElementModel) -> dict[str, Any]:
    """Positions, matrices, and the rows of all markers."""
    values = {"positions": body.positions, "K": body.stiffness, "M": body.mass}
    for marker in body.markers:
        values |= {f"{marker.name} at": marker.position}
        values |= {f"{marker.name} rows": marker.displacement}
        values |= {f"{marker.name} turns": marker.rotation}
    return {
        name: value.toarray() if hasattr(value, "toarray") else value
        for name, value in values.items()
    }


def solid(discretisation: dict[str, Any]) -> ModelFile:
    data = volume_data(discretisation)
    data["geometry"]["control_points"][1][0][0][2] -= 0.002
    tie = {"type": "distributing", "to": "right"}
    data["markers"]["tied"] = {"node": 3, "tie": tie}
    return validate_data(data, ModelFile)


def beam(section: dict[str, Any], **geometry: Any) -> ModelFile:
    data = bar_data(elements=1)
    data["geometry"] |= {"section": section, **geometry}
    data["discretisation"]["theory"] = "timoshenko"
    if "through" not in geometry:
        data["markers"]["half"] = {"node": 3, "position": [0.4, 0.0, 0.0]}
    return validate_data(data, ModelFile)


TAPERED = {"shape": "rectangle", "height": [0.02, 0.03, 0.01], "width": 0.015}
MODELS: list[tuple[str, Callable[[], ModelFile], list[str]]] = [
    ("q4", lambda: rod(COARSE), [PLANE, "material.poissons_ratio"]),
    ("iga", lambda: annulus({**IGA, "elements": [2, 2]}), ["geometry.weights[1][1]"]),
    ("hex8", lambda: solid({"type": "hex8", "elements": [2, 1, 1]}), [SOLID]),
    ("hex20", lambda: solid({"type": "hex20", "elements": [1, 1, 1]}), [SOLID]),
    ("tet4", lambda: solid({"type": "tet4", "elements": [2, 1, 1]}), [SOLID]),
    ("tet10", lambda: solid({"type": "tet10", "elements": [1, 1, 1]}), [SOLID]),
    (
        "iga volume",
        lambda: solid({"type": "iga", "degrees": [2, 1, 1], "elements": [1, 1, 1]}),
        [SOLID],
    ),
    *(
        (
            f"beam {shape}",
            lambda shape=shape, sizes=sizes: beam({"shape": shape, **sizes}),
            [f"geometry.section.{key}" for key in sizes],
        )
        for shape, sizes in SECTIONS
    ),
    (
        "tapered beam",
        lambda: beam(TAPERED, interpolation="smooth", twist=[0.1, 0.4]),
        ["geometry.twist[1]"],
    ),
    (
        "curved beam",
        lambda: beam(
            {"shape": "rectangle", "height": 0.02, "width": 0.03},
            through=[[0.3, 0.1, 0.05], [0.7, 0.15, 0.1]],
        ),
        ["geometry.through[0][1]"],
    ),
    (
        "beam with a mass",
        lambda: beam(
            TAPERED,
            masses=[{"at": 0.7, "mass": 0.3, "inertia": [1e-4] * 3}],
            y_axis=[0.0, 1.0, 0.0],
        ),
        [
            "geometry.masses[0].at",
            "geometry.masses[0].inertia[1]",
            "geometry.y_axis[2]",
        ],
    ),
]


@pytest.mark.parametrize(
    ("model", "keys"), [m[1:] for m in MODELS], ids=[m[0] for m in MODELS]
)
def test_discretised_models(model: Callable[[], ModelFile], keys: list[str]) -> None:
    nominal = model()
    sizes = quantities(finite_element_model(nominal))
    for key in keys:
        variable = design_variable(nominal, key)
        body = finite_element_model(variable.with_imaginary_step(nominal))
        found = {n: np.imag(v) / variable.step for n, v in quantities(body).items()}
        expected = central_difference(
            nominal, key, lambda m: quantities(finite_element_model(m)), 1e-3
        )
        assert_equal_derivatives(found, expected, sizes, abs(variable.value) or 0.02)


def test_pseudo_inverses_of_tall_and_wide_matrices() -> None:
    random = np.random.default_rng(4)
    for shape in ((5, 3), (3, 5)):
        p, change = random.normal(size=(2, *shape))
        unit = 1e-3
        expected = sum(
            w
            * (
                np.linalg.pinv(p + k * unit * change)
                - np.linalg.pinv(p - k * unit * change)
            )
            for k, w in {1: 0.75, 2: -0.15, 3: 1 / 60}.items()
        )
        found = analytic_pinv(p + 1j * STEP * change).imag / STEP
        assert found == pytest.approx(expected / unit, abs=1e-11)
