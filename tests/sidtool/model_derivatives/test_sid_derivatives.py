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
from tests.sidtool.models import Q4, QM6, rod
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
    model = rod({**Q4, "elements": [20, 2]})
    name = variable if isinstance(variable, str) else variable.name
    derivatives = sidtool.sid_derivatives(model, [variable])
    expected = central_difference(
        model, variable, lambda m: arrays(DifferentiableBody(m).sid)
    )
    unit = abs(derivatives.variables[name]) or 0.02
    error = largest_difference(derivatives[name], expected, derivatives.sid, unit)
    assert error < (2e-7, "")


TIED = {
    "crank_pin": {"node": 1, "tie": {"type": "rigid", "to": "left"}},
    "piston_pin": {"node": 2, "tie": {"type": "distributing", "to": "right"}},
}
CHORD = {"type": "chord", "markers": ["crank_pin", "piston_pin"]}
PINS = {"interfaces": ["crank_pin", "piston_pin"]}
WAYS = {
    "supports": {"stiffening": {"prestress": {"forces": {"piston_pin": [2e3, 1e3]}}}},
    "stress": {"stress": {"peak_points": 1}},
    "Craig-Bampton": {
        "frame": {"type": "buckens"},
        "reduction": {"method": "craig_bampton", "modes": 2, **PINS},
        "markers": TIED,
        "stiffening": {},
    },
    "attachment": {
        "frame": CHORD,
        "reduction": {"method": "attachment", "modes": 2, **PINS, "rotations": False},
        "markers": TIED,
    },
    "Herting": {
        "frame": {"type": "buckens", "marker": "crank_pin"},
        "reduction": {"method": "herting", "modes": 1, **PINS, "rotations": False},
        "markers": TIED,
    },
    "Krylov": {
        "frame": {"type": "tangent", "marker": "crank_pin"},
        "reduction": {
            "method": "krylov",
            "frequencies": [0.0, 900.0],
            "moments": 1,
            "interfaces": ["piston_pin"],
        },
        "markers": TIED,
    },
    "fixed marker": {
        "frame": {"type": "buckens"},
        "reduction": {"method": "modal", "modes": 3, "fix": ["piston_pin"]},
        "markers": TIED,
    },
}


@pytest.mark.parametrize(
    ("way", "key"),
    [
        *((way, "geometry.control_points[2][0][1]") for way in WAYS),
        ("Craig-Bampton", "material.density"),
    ],
)
def test_reductions_frames_ties_and_loads(way: str, key: str) -> None:
    """The coordinate moves the end that is tied, so that conditions and ties change;
    the density changes loads and masses alone.
    """
    coarse = {**QM6, "elements": [12, 2]}
    model = rod(coarse, **WAYS[way]).with_({"geometry.control_points[1][0][1]": -0.006})
    derivatives = sidtool.sid_derivatives(model, [key])
    step = 1e-2 if key == "material.density" else 3e-3
    expected = central_difference(
        model, key, lambda m: arrays(DifferentiableBody(m).sid), step
    )
    unit = abs(derivatives.variables[key])
    error = largest_difference(derivatives[key], expected, derivatives.sid, unit)
    assert error < (1e-6, "")


def test_modes_of_one_frequency() -> None:
    """A square bar bends as easily in y as in z. Its height separates both frequencies:
    the block of the pair holds what the two modes gain, and Me stays the identity.
    """
    model = validate_data(bar_data(elements=4, modes=4), ModelFile)
    key = "geometry.section.height"
    derivatives = sidtool.sid_derivatives(model, [key])
    step = 1e-4
    near = derivatives.neighbour({key: step})
    exact = DifferentiableBody(model.with_({key: 0.02 + step})).sid
    for sid in (near, exact):
        assert sid.Me.m0 == pytest.approx(np.eye(4), abs=1e-9)
    change = np.linalg.eigvalsh(near.Ke.m0) / np.diag(derivatives.sid.Ke.m0) - 1
    expected = np.diag(exact.Ke.m0) / np.diag(derivatives.sid.Ke.m0) - 1
    assert change == pytest.approx(expected, abs=1e-4)
    assert change[1] == pytest.approx(2 * step / 0.02, rel=1e-2)
    gain = np.diag(derivatives[key].Ke.m0) / np.diag(derivatives.sid.Ke.m0) * 0.02 / 2
    assert sorted(gain) == pytest.approx([0, 0, 1, 1], abs=0.01)


def test_a_turned_pair_of_modes() -> None:
    """The response of the reduced body does not depend on the rotation of a pair.

    The axes of the sections are turned by the twist, so that the stiffness of the pair
    is a full block. The compliance at the tip is that of the changed bar.
    """
    model = validate_data(bar_data(elements=4, modes=2), ModelFile).with_(
        {"geometry.twist": 0.4}
    )
    key = "geometry.section.height"
    d = sidtool.sid_derivatives(model, [key])

    def compliance(sid: sidtool.SID) -> Any:
        phi = sid.node(2).phi.m0
        return phi @ np.linalg.solve(sid.Ke.m0 + 1e4 * sid.Me.m0, phi.T)

    expected = central_difference(
        model, key, lambda m: {"tip": compliance(DifferentiableBody(m).sid)}, 1e-3
    )["tip"]
    step = 1e-7
    moved = [compliance(d.neighbour({key: s * step})) for s in (1, -1)]
    found = (moved[0] - moved[1]) / (2 * step)
    assert found == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())
    block = d[key].Ke.m0
    assert abs(block[0, 1]) > 0.1 * abs(block[0, 0])


def test_sid_is_that_of_a_conversion() -> None:
    model = bar()
    expected = arrays(sid_from_model(model))
    sid = sidtool.sid_derivatives(model, []).sid
    assert largest_difference(sid, expected, sid, 1.0) < (1e-10, "")


def test_a_pair_that_is_cut() -> None:
    """One mode of a square bar: a height is fine, a shear of the section is not."""
    model = validate_data(bar_data(elements=2, modes=1), ModelFile)
    key = "geometry.section.height"
    assert sidtool.sid_derivatives(model, [key])[key].mass > 0
    with pytest.raises(InputError, match="mixes mode 1"):
        sidtool.sid_derivatives(model.with_({"geometry.twist": 0.3}), [key])


def test_neighbours_satisfy_the_identities() -> None:
    """Identities are linear or bilinear: a small step keeps them to second order."""
    step = 1e-7
    model = rod({**Q4, "elements": [20, 2]})
    derivatives = sidtool.sid_derivatives(model, [MIDDLE])
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
