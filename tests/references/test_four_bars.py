"""A row of N four-bar linkages that passes singular positions every half turn.

Benchmark A02 of the IFToMM library: links of 1 m and 1 kg, upright at first, with a tip
speed of 1 m/s. All posts turn alike, by the angle x with

    ((N + 1) / 3 + N) x'' = -g ((N + 1) / 2 + N) cos x,

which is integrated here by other means; for N = 2 the end is known by a Taylor series.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sidtool.solver import simulate
from sidtool.solver.system.system import System
from tests.solver.scenes import GRAVITY, compiled, scene, slender_rod

UPRIGHT = 0.5 * math.pi
PUBLISHED = (0.3284581115408154, 0.944518538178601)


def four_bars(loops: int, end: float) -> System:
    bodies: dict[str, Any] = {}
    joints = {}
    pivots = {f"p{i}": {"position": [float(i), 0.0]} for i in range(loops + 1)}

    def pin(name: str, first: str, second: str) -> None:
        joints[name] = {"type": "revolute", "markers": [first, second]}

    for i in range(loops + 1):
        place: dict[str, Any] = {"position": [float(i), 0.0], "angle": UPRIGHT}
        bodies[f"post{i}"] = slender_rod(1.0, angular_velocity=-1.0, **place)
        pin(f"pivot{i}", f"ground.p{i}", f"post{i}.a")
    for i in range(loops):
        bar = slender_rod(1.0, position=[float(i), 1.0], velocity=[1.0, 0.0])
        bodies[f"bar{i}"] = bar
        pin(f"left{i}", f"post{i}.b", f"bar{i}.a")
        pin(f"right{i}", f"bar{i}.b", f"post{i + 1}.b")
    more = {"ground": {"markers": pivots}, "gravity": [0.0, -GRAVITY]}
    record = ["post0.b.x", "post0.b.y"]
    return compiled(scene(bodies, joints, end=end, steps=50, record=record, **more))


def angles(loops: int, t: np.ndarray) -> np.ndarray:
    inertia, weight = (loops + 1) / 3 + loops, (loops + 1) / 2 + loops
    ratio = GRAVITY * weight / inertia
    found = solve_ivp(
        lambda _, y: [y[1], -ratio * math.cos(y[0])],
        (0.0, t[-1]),
        [UPRIGHT, -1.0],
        method="DOP853",
        t_eval=t,
        rtol=1e-13,
        atol=1e-13,
    )
    return np.asarray(found.y[0])


#: Long steps multiply the rounding of singular positions most: radau13 is up to 3e-9
#: off at its best.
DIGITS = {"radau5": 10, "radau9": 10, "radau13": 9}


@pytest.mark.parametrize(
    "integrator, rtol",
    [(name, 10.0**-k) for name, most in DIGITS.items() for k in (5, 8, most)],
)
def test_two_loops_end_where_published(integrator: str, rtol: float) -> None:
    result = simulate(four_bars(2, 10.0), integrator=integrator, rtol=rtol)
    assert result.values[-1] == pytest.approx(PUBLISHED, abs=10.0 * rtol)
    assert result.drift["position"] < 1e-10


@pytest.mark.parametrize("loops", [2, 6])
def test_all_loops_turn_as_one_pendulum(loops: int) -> None:
    result = simulate(four_bars(loops, 10.0), integrator="radau9", rtol=1e-9)
    exact = angles(loops, result.t)
    assert result["post0.b.x"] == pytest.approx(np.cos(exact), abs=1e-8)
    assert result["post0.b.y"] == pytest.approx(np.sin(exact), abs=1e-8)


def test_radau_continues_where_the_explicit_method_meets_a_singular_configuration() -> (
    None
):
    result = simulate(four_bars(2, 10.0), integrator="auto", rtol=1e-8)
    assert "dop853, then radau9 from t = " in str(result.settings["integrator"])
    assert result.values[-1] == pytest.approx(PUBLISHED, abs=1e-7)
