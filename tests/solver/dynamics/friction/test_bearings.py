"""A pendulum with dry friction in its bearing."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from sidtool.formats.result import Result
from sidtool.solver.simulation.replay import replay
from tests.solver.dynamics.friction.rubbed import (
    ENERGIES,
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
from tests.solver.dynamics.friction.test_blocks import block_on_incline

ROD = {"m": 1.5, "l": 0.4, "I": 0.03, "r": 0.05, "start": 1.2}
SWING = ROD["I"] + ROD["m"] * ROD["l"] ** 2


def pendulum(dimension: str, end: float, **options: Any) -> Result:
    start, arm = ROD["start"], ROD["l"]
    plane = dimension == "planar"
    at = "angle" if plane else "axis_angle"
    markers = ["ground", "bob.pin"]
    if options.pop("swapped", False):
        markers.reverse()
    law = {"coefficient": MU, "static": REST, "radius": ROD["r"]}
    return simulate(
        dimension,
        end,
        gravity=vector(dimension, 0.0, -G),
        bodies={
            "bob": {
                "mass": ROD["m"],
                "inertia": ROD["I"] if plane else [0.02, 0.025, ROD["I"]],
                "markers": {"pin": {"position": vector(dimension, 0.0, arm)}},
                "initial": {
                    "position": vector(
                        dimension, arm * np.sin(start), -arm * np.cos(start)
                    ),
                    at: start if plane else [0.0, 0.0, start],
                },
            }
        },
        joints={"pin": {"type": "revolute", "markers": markers, "friction": law}},
        outputs={
            "record": ["pin.angle", "pin.friction", "pin.normal_force", *ENERGIES]
        },
        **options,
    )


@cache
def known_pendulum(end: float) -> list[tuple[str, float, float]]:
    """theta'' depends on the load, and the load on theta''."""
    m, arm, r = ROD["m"], ROD["l"], ROD["r"]

    def load(angle: float, rate: float, push: float) -> float:
        along = G * math.cos(angle) + arm * rate**2
        return m * math.hypot(along, G * math.sin(angle) + arm * push)

    def slide(t: float, angle: float, rate: float, s: float) -> float:
        weight = m * G * arm * math.sin(angle)

        def left(push: float) -> float:
            return SWING * push + weight + s * MU * r * load(angle, rate, push)

        return float(brentq(left, -500.0, 500.0, xtol=1e-15))

    return Rub(
        lambda t, angle: m * G * arm * math.sin(angle),
        lambda t, angle: REST * r * load(angle, 0.0, 0.0),
        slide,
    ).motion(ROD["start"], 0.0, end)


@pytest.mark.parametrize(
    ("dimension", "method", "swapped", "rtol", "tolerated"),
    [
        ("planar", "radau9", False, RTOL, 1e-9),
        ("planar", "auto", True, RTOL, 1e-9),
        ("spatial", "radau9", True, RTOL, 1e-9),
        ("spatial", "auto", False, RTOL, 1e-9),
        ("spatial", "generalised_alpha", True, 1e-5, 1e-4),
    ],
)
def test_pendulum_with_friction_in_its_bearing(
    dimension: str, method: str, swapped: bool, rtol: float, tolerated: float
) -> None:
    end = 5.0
    known = [change for change in known_pendulum(end) if change[1] > 0.0]
    sign = -1.0 if swapped else 1.0
    result = pendulum(dimension, end, method=method, swapped=swapped, rtol=rtol)
    assert len(known) > 5
    exact = [(k, t, sign * x) for k, t, x in known]
    assert_changes(result, "pin", exact, tolerated)
    assert_balanced(result, 10.0 * rtol)


def test_pendulum_comes_to_rest_beside_the_lowest_point() -> None:
    known = known_pendulum(12.0)
    assert known[-1][0] == "stick"
    assert abs(known[-1][2]) > 0.01
    result = pendulum("planar", 12.0)
    assert changes(result, "pin")[-1] == ("stick", pytest.approx(known[-1][1]))
    assert result.values[-1, 0] == pytest.approx(known[-1][2], abs=1e-8)


def test_outputs_afterwards_are_those_of_the_run() -> None:
    """Nothing but states is kept: what sticks in them follows from them."""
    result = pendulum("planar", 3.0)
    names = ["pin.friction", "pin.normal_force", "pin.angle"]
    found = replay(result, names).outputs()
    for name in names:
        known = result.values[:, result.names.index(name)]
        np.testing.assert_allclose(found[name], known, rtol=1e-9, atol=1e-12)
    result = block_on_incline("planar")
    found = replay(result, ["rail.*"]).outputs()
    np.testing.assert_allclose(found["rail.friction"], result.values[:, 1], rtol=1e-9)
    np.testing.assert_array_equal(found["rail.sticking"], result.values[:, 3])
