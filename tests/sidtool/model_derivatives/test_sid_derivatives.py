"""Derivatives of SIDs against closed forms, scaling laws and differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.discretisation.registry import finite_element_model
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.model_derivatives.sid_derivatives import DifferentiableBody
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.validate import check
from tests.sidtool.models import rod
from tests.steel_bars import bar_data

from .references import arrays, central_difference, largest_difference

MIDDLE = sidtool.ShapeVariable(
    "middle",
    {"geometry.control_points[1][0][1]": -1, "geometry.control_points[1][1][1]": 1},
)


def bar(**changes: Any) -> ModelFile:
    return validate_data(bar_data(width=0.03, elements=6, modes=3), ModelFile).with_(
        changes
    )


def logarithmic(derivatives: Any, name: str) -> Any:
    """Per cent of the frequencies per per cent of a variable."""
    squares = np.diag(derivatives.sid.Ke.m0)
    change = np.diag(derivatives[name].Ke.m0) / (2 * squares)
    return change * derivatives.variables[name]


def test_frequencies_and_mass_of_a_uniform_beam() -> None:
    """Bending frequencies are w = k^2 sqrt(E I / (rho A)) but for rotary inertia, whose
    share s of the kinetic energy grows with the square of height over length.
    """
    model = bar()
    names = ["material.youngs_modulus", "material.density", "geometry.end[0]"]
    names += ["geometry.section.height", "geometry.section.width"]
    d = sidtool.sid_derivatives(model, names)
    modulus, density, length, height, width = (logarithmic(d, name) for name in names)
    assert modulus == pytest.approx(0.5, abs=1e-9)
    assert density == pytest.approx(-0.5, abs=1e-9)
    points = finite_element_model(model).inertia_points
    assert points is not None
    body = DifferentiableBody(model)
    shapes = body.basis.shapes
    turns = (points.rotation @ shapes).reshape(-1, 3, 3)
    share = np.einsum("pal,pab,pbl->l", turns, points.inertias, turns)
    along_y = np.array([True, False, True])  # 20 x 30 mm: first y, then z, then y
    assert height == pytest.approx(np.where(along_y, 1 - share, 0), abs=1e-9)
    assert width == pytest.approx(np.where(along_y, 0, 1 - share), abs=1e-9)
    assert length == pytest.approx(share - 2, abs=1e-9)
    for name in names[1:]:
        slope = d[name].mass * d.variables[name] / d.sid.mass
        assert slope == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("variable", ["geometry.thickness", MIDDLE], ids=["t", "y"])
def test_every_block_of_the_tapered_rod(variable: Any) -> None:
    model = rod()
    name = variable if isinstance(variable, str) else variable.name
    derivatives = sidtool.sid_derivatives(model, [variable])
    expected = central_difference(
        model, variable, lambda m: arrays(DifferentiableBody(m).sid)
    )
    unit = abs(derivatives.variables[name]) or 0.02
    error = largest_difference(derivatives[name], expected, derivatives.sid, unit)
    assert error < (2e-7, "")


def test_sid_is_that_of_a_conversion() -> None:
    model = bar()
    sid = sidtool.sid_derivatives(model, ["geometry.end[0]"]).sid
    for name, value in arrays(sid_from_model(model)).items():
        assert np.array_equal(arrays(sid)[name], value), name


def test_neighbours_satisfy_the_identities() -> None:
    """Identities are linear or bilinear: a small step keeps them to second order."""
    step = 1e-7
    derivatives = sidtool.sid_derivatives(rod(), [MIDDLE])
    near = derivatives.neighbour({"middle": step})
    assert [c.id for c in check(near) if c.failed] == []
    assert near.Me.m0 == pytest.approx(np.eye(near.nq), abs=1e-12)


@pytest.mark.parametrize(
    ("key", "problem"),
    [
        ("discretisation.elements[0]", "changes the discretisation"),
        ("geometry.knots[0][3]", "changes the discretisation"),
        ("markers.tip.node", "changes the discretisation"),
        ("geometry.end", "has 3 entries"),
        ("geometry.section", "is a table"),
        ("geometry.end[7]", "is not there"),
        ("geometry.nothing", "is not there"),
        ("wings.length", "there is nothing named"),
        ("material.name", "is not there"),
        ("markers.tip.position", "is not given"),
        ("markers.tip.edge", "is not given"),
    ],
)
def test_what_is_no_design_variable(key: str, problem: str) -> None:
    with pytest.raises(InputError) as error:
        sidtool.sid_derivatives(bar(), [key])
    assert problem in str(error.value)
    assert key in str(error.value) or key.partition(".")[0] in str(error.value)
