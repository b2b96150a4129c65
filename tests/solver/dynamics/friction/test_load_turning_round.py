"""Joints that rub and are pressed from one side, then from the other.

Their friction has a kink where the load is zero. The motions are integrals of known
loads: the press is a function of time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from sidtool.formats.result import Result
from tests.solver.dynamics.friction.rubbed import simulate

MASS, MU, SPEED, END = 1.3, 0.35, 2.0, 3.0
RTOL = 1e-7
RATE, PHASE, PRESS = 7.0, 0.4, 3.0
METHODS = ("radau5", "radau9", "radau13", "dop853")


def sliding(method: str, offset: float, turn: float, **joint: Any) -> Result:
    """A block that slides freely and is pressed by a sine, turned by another one."""
    law = {"coefficient": MU, **joint.pop("law", {})}
    waves = {
        "press": (PRESS, RATE, PHASE, offset),
        "turn": (turn, 2.0 * RATE, 0.0, 0.0),
    }
    forces = {
        name: {
            "type": "force",
            "marker": "block",
            "force": [0.0, float(name == "press")],
            "torque": float(name == "turn"),
            "function": {
                "type": "harmonic",
                "amplitude": amplitude,
                "angular_frequency": rate,
                "phase": phase,
                "offset": mean,
            },
        }
        for name, (amplitude, rate, phase, mean) in waves.items()
    }
    start = {"velocity": [SPEED, 0.0]}
    return simulate(
        "planar",
        END,
        method=method,
        rtol=RTOL,
        gravity=[0.0, 0.0],
        bodies={"block": {"mass": MASS, "inertia": 0.1, "initial": start}},
        joints={"rail": {**joint, "markers": ["ground", "block"], "friction": law}},
        forces=forces,
        outputs={"record": ["rail.displacement", "block.vx"]},
    )


def expected(*pressed: Callable[[float], float]) -> tuple[float, float]:
    """Place and velocity at the end, of a block with the load sum |p(t)|."""
    place, velocity = SPEED * END, SPEED
    grid = np.linspace(0.0, END, 500)
    for p in pressed:
        pairs = zip(grid[:-1], grid[1:], strict=True)
        zeros = [brentq(p, a, b, xtol=1e-14) for a, b in pairs if p(a) * p(b) < 0.0]
        assert len(zeros) >= 6
        edges = [0.0, *zeros, END]
        for a, b in zip(edges[:-1], edges[1:], strict=True):
            impulse = MU / MASS * abs(quad(p, a, b, epsabs=1e-13)[0])
            way = quad(lambda t, p=p: (END - t) * p(t), a, b, epsabs=1e-13)[0]
            velocity -= impulse
            place -= MU / MASS * abs(way)
    return place, velocity


def force(t: float, offset: float) -> float:
    return float(offset + PRESS * np.sin(RATE * t + PHASE))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("offset", [0.0, 0.7])
def test_block_pressed_up_and_down(method: str, offset: float) -> None:
    result = sliding(method, offset, 0.0, type="point_on_line")
    known = expected(lambda t: force(t, offset))
    np.testing.assert_allclose(result.values[-1], known, rtol=0.0, atol=RTOL)
    assert not result.events  # it slides on


@pytest.mark.parametrize("method", METHODS)
def test_both_ends_of_a_guide_are_pressed_from_either_side(method: str) -> None:
    """The force is shared, the torque adds to one end and takes from the other."""
    turn, length = 0.5, 0.4
    law = {"length": length}
    result = sliding(method, 0.0, turn, type="prismatic", law=law)

    def end(t: float, sign: float) -> float:
        torque = turn * np.sin(2.0 * RATE * t)
        return float(0.5 * force(t, 0.0) + sign * torque / length)

    known = expected(lambda t: end(t, 1.0), lambda t: end(t, -1.0))
    np.testing.assert_allclose(result.values[-1], known, rtol=0.0, atol=RTOL)


def test_guide_without_load_falls_freely() -> None:
    """What presses it is rounding, whose side tells nothing."""
    slope, g = 0.3, 9.81
    axis = [np.cos(slope), np.sin(slope)]
    result = simulate(
        "planar",
        1.0,
        method="radau9",
        rtol=RTOL,
        gravity=[g * axis[0], g * axis[1]],
        bodies={"block": {"mass": MASS, "inertia": 0.1}},
        joints={
            "rail": {
                "type": "prismatic",
                "axis": axis,
                "markers": ["ground", "block"],
                "friction": {"coefficient": MU},
            }
        },
        outputs={"record": ["rail.displacement"]},
    )
    t = result.t
    np.testing.assert_allclose(result.values[:, 0], 0.5 * g * t * t, atol=1e-9)
    assert result.counters["steps"] < 50
