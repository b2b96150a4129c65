"""Loads of joints that friction follows: of any sign, from bodies and moments."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from sidtool.formats.result import Result
from tests.bodies import Cloud
from tests.solver.dynamics.friction.rubbed import (
    ENERGIES,
    MASS,
    MU,
    RTOL,
    G,
    assert_balanced,
    assert_changes,
    changes,
    simulate,
    vector,
)
from tests.solver.dynamics.friction.stick_slip import Rub


def bead(
    dimension: str, law: dict[str, Any], function: dict[str, Any], rtol: float = RTOL
) -> Result:
    """A point mass on a line, pushed along it and to and fro across it."""
    return simulate(
        dimension,
        2.0,
        rtol=rtol,
        bodies={
            "bead": {
                "mass": 0.5,
                "initial": {"velocity": vector(dimension, 3.0, 0.0)},
            }
        },
        joints={
            "wire": {
                "type": "point_on_line",
                "markers": ["ground", "bead"],
                "friction": law,
            }
        },
        forces={
            "across": {
                "type": "force",
                "marker": "bead",
                "force": vector(dimension, 0.0, 1.0),
                "function": function,
            }
        },
        outputs={"record": ["wire.displacement_rate", "wire.normal_force", *ENERGIES]},
    )


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_load_that_changes_its_sign(dimension: str) -> None:
    """m v = m v0 - mu A int |sin wt|; nothing happens where the load is zero.

    In space a step may pass such a corner: at 60 frequencies the energy is off by up to
    5e-9 with this tolerance, by 1e-7 with 1e-9.
    """
    size, omega = 2.0, 7.0
    function = {"type": "harmonic", "amplitude": size, "angular_frequency": omega}
    result = bead(dimension, {"coefficient": MU}, function, rtol=1e-10)
    halves, rest = np.divmod(omega * result.t, np.pi)
    work = size / omega * (2.0 * halves + 1.0 - np.cos(rest))
    np.testing.assert_allclose(result.values[:, 0], 3.0 - MU / 0.5 * work, atol=3e-8)
    load = size * np.abs(np.sin(omega * result.t))
    np.testing.assert_allclose(result.values[:, 1], load, atol=1e-7)
    assert not changes(result, "wire")
    assert_balanced(result, 1e-7)


def test_viscous_friction_beside_the_dry_one() -> None:
    """m v' = -mu F - d v, to the stop at (m / d) ln(1 + d v0 / (mu F))."""
    force, viscous = 4.0, 0.7
    law = {"coefficient": MU, "viscous": viscous}
    result = bead("planar", law, {"type": "constant", "value": force})
    stop = 0.5 / viscous * np.log(1.0 + viscous * 3.0 / (MU * force))
    assert changes(result, "wire") == [("stick", pytest.approx(stop, abs=1e-9))]


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_belt_with_stribeck_friction(dimension: str) -> None:
    """A block that a spring holds on a moving belt sticks and slips for ever."""
    stiffness, belt, width = 40.0, 0.5, 0.2

    def mu(v: float) -> float:
        return MU + (0.6 - MU) * float(np.exp(-((v / width) ** 2)))

    # y: displacement of the block on the belt; its place is y + belt t
    rub = Rub(
        lambda t, y: stiffness * (y + belt * t),
        lambda t, y: 0.6 * MASS * G,
        lambda t, y, v, s: -stiffness * (y + belt * t) / MASS - s * mu(v) * G,
    )
    known = rub.motion(0.0, 0.0, 6.0)
    assert len(known) > 5
    inertia = 0.1 if dimension == "planar" else [0.1, 0.1, 0.1]
    line = {
        "type": "polynomial",
        "pieces": [{"from": 0.0, "coefficients": [0.0, belt]}],
    }
    result = simulate(
        dimension,
        6.0,
        gravity=vector(dimension, 0.0, -G),
        ground={"markers": {"wall": {"position": vector(dimension, -5.0, 0.0)}}},
        bodies={
            "belt": {"mass": 1.0, "inertia": inertia},
            "block": {
                "mass": MASS,
                "inertia": inertia,
                "initial": {"velocity": vector(dimension, belt, 0.0)},
            },
        },
        joints={
            "track": {"type": "prismatic", "markers": ["ground", "belt"]},
            "top": {
                "type": "prismatic",
                "markers": ["belt", "block"],
                "friction": {
                    "coefficient": MU,
                    "static": 0.6,
                    "stribeck_velocity": width,
                },
            },
        },
        drives={"run": {"joint": "track", "function": line}},
        forces={
            "spring": {
                "type": "spring_damper",
                "markers": ["ground.wall", "block"],
                "rest": 5.0,
                "stiffness": stiffness,
            }
        },
        outputs={"record": ["top.displacement", "track.fx", *ENERGIES]},
    )
    assert_changes(result, "top", known, 2e-8)
    assert_balanced(result, 1e-8)


def test_a_load_from_elastic_coordinates() -> None:
    """A mass that bounces on a sliding body: N = M g + m q'', known with q(t)."""
    frame, mass, stiffness, speed = 1.5, 0.5, 80.0, 2.0
    phi = np.zeros((3, 3, 1))
    phi[2, 1] = 1.0
    c = np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0], [0.0, 0.05, 0.0]])
    masses = np.array([0.5 * frame, 0.5 * frame, mass])
    sid = Cloud(masses, c, phi, np.zeros_like(phi)).sid(
        np.array([[stiffness]]), np.zeros((1, 1)), 1
    )
    omega, whole = np.sqrt(stiffness / mass), frame + mass
    sag, top = -mass * G / stiffness, 0.05

    def impulse(t: float) -> float:
        return whole * G * t - mass * omega * top * float(np.sin(omega * t))

    stop = float(
        brentq(lambda t: whole * speed - MU * impulse(t), 0.0, 2.0, xtol=1e-15)
    )
    result = simulate(
        "planar",
        1.0,
        {"cart": sid},
        gravity=[0.0, -G],
        bodies={
            "cart": {
                "sid": "cart",
                "initial": {"velocity": [speed, 0.0], "elastic": [sag + top]},
            }
        },
        joints={
            "rail": {
                "type": "prismatic",
                "markers": ["ground", "cart.1"],
                "friction": {"coefficient": MU},
            }
        },
        outputs={"record": ["rail.normal_force", *ENERGIES]},
    )
    load = whole * G - mass * omega**2 * top * np.cos(omega * result.t)
    np.testing.assert_allclose(result.values[:, 0], load, atol=1e-6)
    assert changes(result, "rail") == [("stick", pytest.approx(stop, abs=1e-8))]
    assert_balanced(result, 1e-7)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_guide_of_some_length_carries_moments_at_its_ends(dimension: str) -> None:
    """Pulled h above its guide, a block tilts: |N/2 + F h/l| + |N/2 - F h/l|."""
    pull, height, length = 3.0, 0.5, 0.1
    inertia = 0.1 if dimension == "planar" else [0.1, 0.1, 0.1]
    result = simulate(
        dimension,
        0.1,
        gravity=vector(dimension, 0.0, -1.0),
        bodies={
            "block": {
                "mass": MASS,
                "inertia": inertia,
                "markers": {"top": {"position": vector(dimension, 0.0, height)}},
            }
        },
        joints={
            "rail": {
                "type": "prismatic",
                "markers": ["ground", "block"],
                "friction": {"coefficient": 0.2, "length": length},
            }
        },
        forces={
            "pull": {
                "type": "force",
                "marker": "block.top",
                "force": vector(dimension, pull, 0.0),
            }
        },
        outputs={"record": ["rail.normal_force", "rail.friction", "rail.sticking"]},
    )
    load = 2.0 * pull * height / length
    expected = np.tile([load, -pull, 1.0], (len(result.t), 1))
    np.testing.assert_allclose(result.values, expected, rtol=1e-9)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_contact_pushes_a_body_whose_guide_has_no_load(dimension: str) -> None:
    """A cart hits a body at rest at t = sqrt(2 d m / F): no friction without a load.

    Until then the limit of the guide and the force along it are zero, not close to it.
    Momentum: m v + M V = F t.
    """
    m, M, distance, F = 0.2, 0.5, 0.05, 5.0
    space = 1e-3 if dimension == "planar" else [1e-3] * 3
    touching = f"1e5*max({distance} - (box.x - cart.x), 0)"
    rail = {"type": "prismatic", "axis": vector(dimension, 1.0, 0.0)}
    start = {"position": vector(dimension, 2.0 * distance, 0.0)}
    result = simulate(
        dimension,
        0.2,
        gravity=vector(dimension, 0.0, 0.0),
        bodies={
            "cart": {"mass": m, "inertia": space},
            "box": {"mass": M, "inertia": space, "initial": start},
        },
        joints={
            "free": rail | {"markers": ["ground", "cart"]},
            "rough": rail
            | {"markers": ["ground", "box"], "friction": {"coefficient": 0.3}},
        },
        forces={
            "motor": {
                "type": "actuator",
                "joint": "free",
                "function": {"type": "constant", "value": F},
            },
            "contact": {
                "type": "actuator",
                "markers": ["cart", "box"],
                "function": {"type": "expression", "value": touching},
            },
        },
        outputs={"record": ["cart.vx", "box.vx"]},
    )
    hit = math.sqrt(2.0 * distance * m / F)
    assert changes(result, "rough") == [("slip", pytest.approx(hit, abs=1e-6))]
    cart, box = result.values.T
    np.testing.assert_allclose(m * cart + M * box, F * result.t, atol=1e-8)
    assert box[-1] > 0.5
