"""Tower of the NREL 5 MW wind turbine (J. Jonkman and others, NREL/TP-500-38060, 2009).

As in the tests of E. Branlard's welib: ten Euler-Bernoulli elements with mass and
bending stiffness linear in each, no rotary inertia, base clamped; one bending mode in
either plane, scaled to one at the top. The matrices are integrated here and go the way
of those that another program exports.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.model import ModelFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model

from .slender import hertz

HEIGHT, ELEMENTS = 87.6, 10  # m
#: At 11 stations: mass per length [kg/m], bending stiffness in both planes [N m^2].
MASSES = np.array(
    [
        5590.87,
        5232.43,
        4885.76,
        4550.87,
        4227.75,
        3916.41,
        3616.83,
        3329.03,
        3053.01,
        2788.75,
        2536.27,
    ]
)
STIFFNESSES = 1e9 * np.array(
    [
        614.343,
        534.821,
        463.267,
        399.131,
        341.883,
        291.011,
        246.027,
        206.457,
        171.851,
        141.776,
        115.820,
    ]
)
#: Recomputed by another program, to all digits printed.
LINEAR = {
    "mass [kg]": 347460.2316,
    "first moment [kg m]": 13265404.8382,
    "Jxx [kg m^2]": 7.1985988432e8,
    "f1 [Hz]": 0.89144882,
    "f2 [Hz]": 4.37517869,
    "f3 [Hz]": 11.39570735,
    "Me": 61094.664906,
    "Ct": 104625.690724,
    "Cr": 6449889.71609,
}
#: The same with mass and stiffness averaged in each element.
AVERAGED = {"f1 [Hz]": 0.88825861, "Me": 61346.2064}
#: Stiffening of the mode by rotation about an axis across the tower [N/m].
STIFFENED = {"averaged axial force": 77201.43393, "exact axial force": 76907.03431}


class Points(NamedTuple):
    """Places in an element from 0 to 1 and their weights."""

    x: Array
    weights: Array


def linear(values: Array, element: int, x: Array) -> Array:
    """Between the stations."""
    return np.asarray(values[element] * (1 - x) + values[element + 1] * x)


def averaged(values: Array, element: int, x: Array) -> Array:
    """The mean of both stations."""
    return np.full_like(x, values[element : element + 2].mean())


def tower(folder: Path, between: Callable[[Array, int, Array], Array]) -> SID:
    """The SID of the matrices with six modes, three in either plane."""
    stiffness, mass = _matrices(between)
    numbers = np.arange(1, ELEMENTS + 2)
    places = np.zeros((ELEMENTS + 1, 3))
    places[:, 2] = np.linspace(0, HEIGHT, ELEMENTS + 1)
    file = folder / "tower.npz"
    arrays = {
        "stiffness": stiffness,
        "mass": mass,
        "nodes": np.column_stack([numbers, places]),
        "dofs": np.column_stack(
            [np.repeat(numbers, 6), np.tile(np.arange(1, 7), len(numbers))]
        ),
        "set.foot": numbers[:1],
    }
    np.savez(file, **arrays)  # type: ignore[arg-type]
    model = {
        "format": "sidtool model",
        "version": 1,
        "geometry": {"type": "matrices", "file": str(file)},
        "discretisation": {"type": "matrices"},
        "frame": {"type": "tangent", "marker": "base", "clamp": "foot"},
        "markers": {
            "base": {"node": 1, "mesh_node": 1},
            "top": {"node": 2, "mesh_node": ELEMENTS + 1},
        },
        "reduction": {"method": "modal", "modes": 6},
    }
    return sid_from_model(validate_data(model, ModelFile))


def _matrices(between: Callable[[Array, int, Array], Array]) -> tuple[Array, Array]:
    """Stiffness and mass; rods carry tension and torsion, which move on their own."""
    x, weights = np.polynomial.legendre.leggauss(5)
    points = Points((x + 1) / 2, weights / 2)
    n, step = 6 * (ELEMENTS + 1), HEIGHT / ELEMENTS
    stiffness, mass = np.zeros((n, n)), np.zeros((n, n))
    rod = 1e12 / step * np.array([[1.0, -1.0], [-1.0, 1.0]])
    for element in range(ELEMENTS):
        first = 6 * element
        bent, moved, pulled = _element(between, element, points, step)
        # Along x turned about y, along y turned about x, backwards.
        for shift, turn, sign in ((0, 4, 1.0), (1, 3, -1.0)):
            rows = first + np.array([shift, turn, 6 + shift, 6 + turn])
            signs = np.outer([1, sign, 1, sign], [1, sign, 1, sign])
            stiffness[np.ix_(rows, rows)] += signs * bent
            mass[np.ix_(rows, rows)] += signs * moved
        for direction in (2, 5):
            rows = first + np.array([direction, 6 + direction])
            stiffness[np.ix_(rows, rows)] += rod
            mass[np.ix_(rows, rows)] += pulled
    return stiffness, mass


def _element(
    between: Callable[[Array, int, Array], Array], element: int, at: Points, step: float
) -> tuple[Array, Array, Array]:
    """Bending stiffness and mass (4, 4) of a cubic element, mass (2, 2) of a rod."""
    x = at.x
    shapes = np.array(
        [
            1 - 3 * x**2 + 2 * x**3,
            step * (x - 2 * x**2 + x**3),
            3 * x**2 - 2 * x**3,
            step * (x**3 - x**2),
        ]
    )
    curvatures = np.array(
        [-6 + 12 * x, step * (6 * x - 4), 6 - 12 * x, step * (6 * x - 2)]
    )
    bending = at.weights * between(STIFFNESSES, element, x) / step**3
    mass = at.weights * between(MASSES, element, x) * step
    along = np.array([1 - x, x])
    return (
        (curvatures * bending) @ curvatures.T,
        (shapes * mass) @ shapes.T,
        (along * mass) @ along.T,
    )


def smooth_tower(elements: int) -> SID:
    """A beam with polynomials of degree 10 through the stations.

    Height and width of a thin rectangle give mass and bending stiffness in one plane,
    with next to no rotary inertia.
    """
    young, density = 1e16, 1e5
    height = np.sqrt(12 * STIFFNESSES * density / (young * MASSES))
    model = {
        "format": "sidtool model",
        "version": 1,
        "material": {
            "youngs_modulus": young,
            "poissons_ratio": 0.3,
            "density": density,
        },
        "geometry": {
            "type": "beam",
            "start": [0.0, 0.0, 0.0],
            "end": [HEIGHT, 0.0, 0.0],
            "section": {
                "shape": "rectangle",
                "height": height.tolist(),
                "width": (MASSES / (density * height)).tolist(),
            },
        },
        "discretisation": {"type": "beam", "elements": elements},
        "frame": {"type": "tangent", "marker": "base", "clamp": "start"},
        "markers": {
            "base": {"node": 1, "parameters": [0.0]},
            "top": {"node": 2, "parameters": [1.0]},
        },
        "reduction": {"method": "modal", "modes": 1},
        "stiffening": {},
    }
    return sid_from_model(validate_data(model, ModelFile))


def stiffened(sid: SID) -> float:
    """K0omega of the first mode, in the plane of the rotation and scaled [N/m]."""
    top = sid.node(2).phi.m0[1, 0]
    return float((sid.Oe.m1[0, 0, 2] + sid.Me.m0[0, 0]) / top**2)


def quantities(sid: SID) -> dict[str, float]:
    """What the source prints, with the first mode scaled to one at the top."""
    top = np.linalg.norm(sid.node(2).phi.m0[:, 0])
    return {
        "mass [kg]": sid.mass,
        "first moment [kg m]": float(sid.mdCM.m0.ravel()[2]),
        "Jxx [kg m^2]": float(sid.J.m0.ravel()[0]),
        **{f"f{i + 1} [Hz]": float(hertz(sid)[2 * i]) for i in range(3)},
        "Me": float(sid.Me.m0[0, 0] / top**2),
        "Ct": float(np.linalg.norm(sid.Ct.m0[0]) / top),
        "Cr": float(np.linalg.norm(sid.Cr.m0[0]) / top),
    }


@pytest.mark.filterwarnings("ignore:the mass matrix is a consistent one")
def test_tower_of_linear_and_of_averaged_elements(tmp_path: Path) -> None:
    found = quantities(tower(tmp_path, linear))
    for name, value in LINEAR.items():
        assert_allclose(found[name], value, rtol=1e-8, err_msg=name)
    found = quantities(tower(tmp_path, averaged))
    for name, value in AVERAGED.items():
        assert_allclose(found[name], value, rtol=1e-8, err_msg=name)


@pytest.mark.filterwarnings("ignore:Young's modulus", "ignore:the density")
def test_stiffening_by_rotation() -> None:
    """Smooth between the stations: the digits that do not depend on what is there."""
    sid = smooth_tower(40)
    assert_allclose(hertz(sid)[0], LINEAR["f1 [Hz]"], rtol=3e-3)
    assert_allclose(stiffened(sid), STIFFENED["exact axial force"], rtol=3e-3)
