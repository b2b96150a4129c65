"""Equilibria that only friction makes: a block on a slope, with and without an arm."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.solver import compile_scene, simulate
from sidtool.solver.analyses import static_equilibrium as module
from sidtool.solver.analyses.static_equilibrium import static_equilibrium
from sidtool.solver.system.errors import SimulationError
from tests.codes import codes, only
from tests.solver.dynamics.joint_scenes import scene

G, SLOPE, BLOCK, ARM, LENGTH = 9.81, 0.35, 2.0, 0.5, 0.3
ALONG, ACROSS = G * np.sin(SLOPE), G * np.cos(SLOPE)


@pytest.fixture(autouse=True)
def _short_search(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_ITERATIONS", 40)


def on_slope(coefficient: float, **changes: Any) -> dict[str, Any]:
    """A block on a rail that declines towards -x."""
    return {
        "gravity": [-ALONG, -ACROSS],
        "bodies": {"block": {"mass": BLOCK, "inertia": 0.01}},
        "joints": {
            "rail": {
                "type": "prismatic",
                "markers": ["ground", "block"],
                "friction": {"coefficient": coefficient},
            }
        },
        "outputs": {"record": ["rail.friction", "rail.normal_force"]},
        **changes,
    }


def with_pendulum(coefficient: float, pin: float) -> dict[str, Any]:
    """An arm hangs at the block, level at the start, on a pin of 10 mm radius."""
    data = on_slope(coefficient)
    data["bodies"]["arm"] = {
        "mass": ARM,
        "inertia": 0.004,
        "markers": {"end": {"position": [-LENGTH, 0.0]}},
        "initial": {"position": [LENGTH, 0.0]},
    }
    data["joints"]["pin"] = {
        "type": "revolute",
        "markers": ["block", "arm.end"],
        "friction": {"coefficient": pin, "radius": 0.01},
    }
    return data


def test_a_block_sticks_on_a_slope_and_stays_there() -> None:
    """The friction is its weight along the slope; a run stays where it starts."""
    data = scene("planar", 0.1, **on_slope(0.4, initial={"state": "static"}))
    system = compile_scene(data, keep_joints=True)
    found = static_equilibrium(system)
    assert codes(found) == ["N516"]
    np.testing.assert_allclose(found.friction, [BLOCK * ALONG], rtol=1e-12)
    values = found.result().values[0]
    np.testing.assert_allclose(values, [BLOCK * ALONG, BLOCK * ACROSS], rtol=1e-12)
    motion = simulate(system)
    np.testing.assert_allclose(np.ptp(motion.positions, axis=0), 0.0, atol=1e-14)
    assert only(motion, "N324").data["reason"] == "friction holds its joints"


def test_friction_below_the_slope_is_named() -> None:
    """tan 0.35 is 0.365."""
    system = compile_scene(scene("planar", 0.1, **on_slope(0.36)), keep_joints=True)
    with pytest.raises(SimulationError) as none:
        static_equilibrium(system)
    assert [each.code for each in none.value.diagnostics] == ["N701", "N517"]


def test_joints_that_slip_beside_sticking_ones_are_named() -> None:
    data = on_slope(0.4)
    data["bodies"]["other"] = data["bodies"]["block"]
    data["joints"]["track"] = {
        "type": "prismatic",
        "markers": ["ground", "other"],
        "friction": {"coefficient": 0.36},
    }
    with pytest.raises(SimulationError) as none:
        static_equilibrium(compile_scene(scene("planar", 0.1, **data)))
    assert only(none.value, "N517").subject == "track"


@pytest.mark.parametrize(("pin", "held"), [(0.05, "rail"), (40.0, "rail, pin")])
def test_what_friction_cannot_hold_hangs_down(pin: float, held: str) -> None:
    """A pin that holds m g l, level with the slope, or an arm along the weight."""
    data = scene("planar", 0.1, **with_pendulum(0.5, pin))
    found = static_equilibrium(compile_scene(data, keep_joints=True))
    assert only(found, "N516").subject == held
    rail, torque = found.friction
    assert rail == pytest.approx((BLOCK + ARM) * ALONG, rel=1e-9)
    expected = ARM * ACROSS * LENGTH if held == "rail, pin" else 0.0
    assert abs(torque) == pytest.approx(expected, abs=1e-9)
