"""Blocks on inclines and rocking rails break away and stop when Coulomb says."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from sidtool.formats.result import Result
from tests.solver.dynamics.friction.rubbed import (
    ENERGIES,
    INDEX_1,
    MASS,
    MU,
    REST,
    RTOL,
    G,
    assert_balanced,
    assert_changes,
    changes,
    simulate,
    vector,
)
from tests.solver.dynamics.friction.stick_slip import Rub

SLOPE = 0.2
WEIGHT, LOAD = MASS * G * np.sin(SLOPE), MASS * G * np.cos(SLOPE)
RAMP, PEAK, DOWN = 10.0, 2.0, 3.0


def block_on_incline(dimension: str, **options: Any) -> Result:
    """A pull that grows, falls to zero at 3 s and stays there; gravity is turned."""
    pieces = [
        {"from": 0.0, "to": PEAK, "coefficients": [0.0, RAMP]},
        {"from": PEAK, "to": DOWN, "coefficients": [20.0, -20.0]},
        {"from": DOWN, "to": 4.0, "coefficients": [0.0]},
    ]
    inertia = 0.1 if dimension == "planar" else [0.1, 0.1, 0.1]
    markers = ["ground", "block"]
    if options.pop("swapped", False):
        markers.reverse()
    law = {"coefficient": MU, "static": REST, **options.pop("law", {})}
    kind = {"type": options.pop("kind", "prismatic")}
    outputs = ["rail.displacement", "rail.friction", "rail.normal_force"]
    return simulate(
        dimension,
        4.0,
        gravity=vector(dimension, -G * np.sin(SLOPE), -G * np.cos(SLOPE)),
        bodies={"block": {"mass": MASS, "inertia": inertia}},
        joints={"rail": {**kind, "markers": markers, "friction": law}},
        forces={
            "pull": {
                "type": "force",
                "marker": "block",
                "force": vector(dimension, 1.0, 0.0),
                "function": {"type": "polynomial", "pieces": pieces},
            }
        },
        outputs={"record": [*outputs, "rail.sticking", *ENERGIES, "rail.fx"]},
        **options,
    )


def exact_incline() -> tuple[float, float, float]:
    """Breakaway, stop, and the way between them, from cubic polynomials."""
    loose = (WEIGHT + REST * LOAD) / RAMP
    resist = WEIGHT + MU * LOAD
    speed = (RAMP * (PEAK**2 - loose**2) / 2 - resist * (PEAK - loose)) / MASS
    way = RAMP / MASS * (PEAK**3 / 6 - loose**2 * PEAK / 2 + loose**3 / 3)
    way -= resist / MASS * (PEAK - loose) ** 2 / 2
    way += speed + (20.0 / 3.0 - resist / 2.0) / MASS
    speed += (10.0 - resist) / MASS
    stop = DOWN + speed * MASS / resist
    return loose, stop, way + speed**2 * MASS / resist / 2.0


@pytest.mark.parametrize("method", INDEX_1)
def test_block_breaks_away_and_stops_when_coulomb_says(method: str) -> None:
    result = block_on_incline("planar", method=method)
    loose, stop, way = exact_incline()
    found = changes(result, "rail")
    assert [kind for kind, _ in found] == ["slip", "stick"]
    assert [t for _, t in found] == pytest.approx([loose, stop], abs=1e-9)
    place, friction, load, sticks, *_, along = result.values.T
    assert place[-1] == pytest.approx(way, abs=1e-8)
    before, after = result.t < loose, result.t > stop
    np.testing.assert_allclose(place[before], 0.0, atol=1e-14)
    np.testing.assert_allclose(place[after], place[-1], atol=1e-14)  # no creep
    np.testing.assert_array_equal(sticks, (before | after).astype(float))
    np.testing.assert_allclose(load, LOAD, rtol=1e-10)
    np.testing.assert_allclose(friction[before], WEIGHT - RAMP * result.t[before])
    np.testing.assert_allclose(friction[~(before | after)], -MU * LOAD)
    np.testing.assert_allclose(along, friction, rtol=1e-12)
    assert_balanced(result, 1e-9)


def test_block_with_the_trapezoidal_rule() -> None:
    result = block_on_incline("planar", method="trapezoidal", rtol=1e-5)
    loose, stop, _ = exact_incline()
    times = [t for _, t in changes(result, "rail")]
    assert times == pytest.approx([loose, stop], abs=1e-5)


def test_block_in_fixed_steps() -> None:
    """The instants are found inside steps of 20 ms, and the steps go on from there."""
    result = block_on_incline("planar", method="radau5", step=0.02)
    loose, stop, way = exact_incline()
    times = [t for _, t in changes(result, "rail")]
    assert times == pytest.approx([loose, stop], abs=1e-9)
    assert result.values[-1, 0] == pytest.approx(way, abs=1e-9)


@pytest.mark.parametrize(
    ("dimension", "options"),
    [
        ("planar", {"swapped": True}),
        ("planar", {"kind": "point_on_line"}),
        ("spatial", {}),
        ("spatial", {"swapped": True}),
    ],
)
def test_block_said_differently_moves_the_same(
    dimension: str, options: dict[str, Any]
) -> None:
    """Markers exchanged, plane as space, a joint that also lets the block turn."""
    sign = -1.0 if "swapped" in options else 1.0
    result = block_on_incline(dimension, **options)
    loose, stop, way = exact_incline()
    times = [t for _, t in changes(result, "rail")]
    assert times == pytest.approx([loose, stop], abs=1e-9)
    assert sign * result.values[-1, 0] == pytest.approx(way, abs=1e-8)
    assert_balanced(result, 1e-9)


def test_block_with_generalised_alpha() -> None:
    """Instants from accelerations are exact; the way has its order of 2 in steps."""
    loose, stop, way = exact_incline()
    missed = []
    for step in (0.02, 0.01):
        result = block_on_incline("planar", method="generalised_alpha", step=step)
        times = [t for _, t in changes(result, "rail")]
        assert times == pytest.approx([loose, stop], abs=1e-9)
        missed.append(result.values[-1, 0] - way)
    assert missed[0] / missed[1] == pytest.approx(4.0, abs=0.4)
    result = block_on_incline("spatial", method="generalised_alpha", rtol=1e-6)
    assert result.values[-1, 0] == pytest.approx(way, abs=1e-5)
    assert_balanced(result, 1e-6)


#: Amplitude [rad] and angular frequency of a rail, start and width of its block.
TOP, OMEGA, START, WIDTH = 0.45, 5.0, 0.3, 0.15


@cache
def rocked_block() -> list[tuple[str, float, float]]:
    """N = m (g cos + 2 theta' x' + theta'' x) of the rail's angle theta."""

    def theta(t: float) -> tuple[float, float, float]:
        s, c = math.sin(OMEGA * t), math.cos(OMEGA * t)
        return TOP * s, TOP * OMEGA * c, -TOP * OMEGA**2 * s

    def mu(v: float) -> float:
        return MU + (REST - MU) * math.exp(-((v / WIDTH) ** 2))

    def load(t: float, x: float, v: float) -> float:
        angle, rate, push = theta(t)
        return abs(G * math.cos(angle) + 2.0 * rate * v + push * x)

    def need(t: float, x: float) -> float:
        angle, rate, _ = theta(t)
        return G * math.sin(angle) - rate**2 * x

    return Rub(
        need,
        lambda t, x: REST * load(t, x, 0.0),
        lambda t, x, v, s: -need(t, x) - s * mu(v) * load(t, x, v),
    ).motion(START, 0.0, 6.0)


@pytest.mark.parametrize(
    ("dimension", "method", "rtol", "tolerated"),
    [
        ("planar", "radau9", RTOL, 2e-8),
        ("spatial", "radau9", RTOL, 2e-8),
        ("planar", "generalised_alpha", 1e-4, 1e-5),
    ],
)
def test_block_on_a_rocking_rail(
    dimension: str, method: str, rtol: float, tolerated: float
) -> None:
    known, top, omega = rocked_block(), TOP, OMEGA
    inertia = 0.1 if dimension == "planar" else [0.1, 0.1, 0.1]
    energies = ENERGIES if method == "radau9" else []  # long to add up over many steps
    drive = {"type": "harmonic", "amplitude": top, "angular_frequency": omega}
    result = simulate(
        dimension,
        6.0,
        gravity=vector(dimension, 0.0, -G),
        bodies={
            "rail": {"mass": 1.0, "inertia": inertia},
            "block": {
                "mass": MASS,
                "inertia": inertia,
                "initial": {
                    "position": vector(dimension, START, 0.0),
                    "velocity": vector(dimension, 0.0, top * omega * START),
                    "angular_velocity": top * omega
                    if dimension == "planar"
                    else [0.0, 0.0, top * omega],
                },
            },
        },
        joints={
            "hinge": {"type": "revolute", "markers": ["ground", "rail"]},
            "slide": {
                "type": "prismatic",
                "markers": ["rail", "block"],
                "friction": {
                    "coefficient": MU,
                    "static": REST,
                    "stribeck_velocity": WIDTH,
                },
            },
        },
        drives={"rock": {"joint": "hinge", "function": drive}},
        outputs={"record": ["slide.displacement", "hinge.mz", *energies]},
        method=method,
        rtol=rtol,
    )
    assert len(known) > 6
    assert_changes(result, "slide", known, tolerated)
    if energies:
        assert_balanced(result, 1e-8)
