"""Drives that follow the motion of others: cranes, cascades, closed loops."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigvals

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import SceneFile
from sidtool.solver import (
    compile_scene,
    linearise,
    simulate,
)
from tests.solver.functions.servos import SERVO, formula, servo, step_response, values
from tests.solver.scenes import GRAVITY, scene, slender_rod

HANGING, HUNG = 0.7, 0.4
P, D, Q, R = 5.0, 3.0, 8.0, 1.5


def crane(**more: Any) -> SceneFile:
    """A trolley with a prescribed place, led by that and by the swing of its load."""
    bodies = {
        "trolley": {"mass": 3.0, "markers": {"m": {"position": [0.0, 0.0]}}},
        "load": {
            "mass": HUNG,
            "inertia": 0.0,
            "markers": {"hook": {"position": [0.0, HANGING]}},
            "initial": {"position": [0.0, -HANGING]},
        },
    }
    bodies["trolley"]["inertia"] = 1.0
    bodies["load"]["inertia"] = 0.02
    joints = {
        "rail": {"type": "prismatic", "markers": ["ground", "trolley.m"]},
        "hook": {"type": "revolute", "markers": ["trolley.m", "load.hook"]},
    }
    law = formula(
        "p*(0.6 - value) - d*rate + q*hook.angle + r*hook.angle_rate",
        parameters={"p": P, "d": D, "q": Q, "r": R},
    )
    drive = {"joint": "rail", "of": "acceleration", "function": law}
    return scene(
        bodies,
        joints,
        {"trolley_drive": drive},
        record=["rail.displacement", "hook.angle", "trolley_drive.fx"],
        gravity=[0.0, -GRAVITY],
        **more,
    )


INERTIA = 0.02 + HUNG * HANGING**2


def swing(t: float, y: Array) -> list[float]:
    """s, s', angle and its rate of the crane, by its own equations."""
    s, ds, a, da = y
    dds = P * (0.6 - s) - D * ds + Q * a + R * da
    push = -HUNG * HANGING * (dds * math.cos(a) + GRAVITY * math.sin(a))
    return [ds, dds, da, push / INERTIA]


def test_drive_that_follows_the_swing_of_its_load() -> None:
    result = simulate(compile_scene(crane(end=2.0)), integrator="radau9", rtol=1e-8)
    exact = solve_ivp(
        swing, (0.0, 2.0), np.zeros(4), "DOP853", result.t, rtol=1e-12, atol=1e-13
    ).y
    found = values(result)
    assert found["rail.displacement"] == pytest.approx(exact[0], abs=1e-7)
    assert found["hook.angle"] == pytest.approx(exact[2], abs=1e-7)
    rates = np.array([swing(0.0, y) for y in exact.T])
    a, da, dds, dda = exact[2], exact[3], rates[:, 1], rates[:, 3]
    force = 3.0 * dds + HUNG * (dds + HANGING * (dda * np.cos(a) - da * da * np.sin(a)))
    assert found["trolley_drive.fx"] == pytest.approx(force, abs=1e-5)


def test_servos_and_forces_follow_the_states_of_a_servo() -> None:
    """A servo that follows another's reference, and an actuator that follows it."""
    arms = {"a": slender_rod(0.5), "b": slender_rod(0.4), "c": slender_rod(0.3)}
    joints = {
        f"j{k}": {"type": "revolute", "markers": ["ground", f"{k}.a"]} for k in arms
    }
    follow = formula("400*(first.state.x - value) + 40*(first.state.v - rate)")
    drives = {
        "first": {"joint": "ja", "function": SERVO},
        "second": {"joint": "jb", "of": "acceleration", "function": follow},
    }
    pushed = formula("30*(second.state.value - jc.angle) - 2*jc.angle_rate")
    made = scene(
        arms,
        joints,
        drives,
        record=["jb.angle", "jc.angle", "energy.balance"],
        gravity=[0.0, -GRAVITY],
        forces={"push": {"type": "actuator", "joint": "jc", "function": pushed}},
    )

    def rates(t: float, y: Array) -> list[float]:
        q, dq, c, dc = y
        x, v, _ = step_response(np.array(t))
        moment = 30.0 * (q - c) - 2.0 * dc - 0.15 * GRAVITY * math.cos(c)
        return [dq, 400.0 * (x - q) + 40.0 * (v - dq), dc, moment / 0.03]

    result = simulate(compile_scene(made), integrator="radau9", rtol=1e-8)
    found, times = values(result), (0.0, 1.0)
    exact = solve_ivp(
        rates, times, np.zeros(4), "DOP853", result.t, rtol=1e-11, atol=1e-12
    ).y
    assert found["jb.angle"] == pytest.approx(exact[0], abs=1e-8)
    assert found["jc.angle"] == pytest.approx(exact[2], abs=1e-8)
    assert np.ptp(found["energy.balance"]) < 1e-7


def test_linearised_crane_is_the_closed_loop() -> None:
    """Eigenvalues of the linear equations; what moves, moves all."""
    made = crane()
    rest = made.model_dump(by_alias=True, exclude_none=True)
    rest["drives"]["trolley_drive"]["start"] = 0.6
    for name, height in (("trolley", 0.0), ("load", -HANGING)):
        rest["bodies"][name]["initial"] = {"position": [0.6, height]}
    found = linearise(compile_scene(SceneFile.model_validate(rest), keep_joints=True))
    lever = -HUNG * HANGING / INERTIA
    led = np.array([-P, -D, Q, R])
    matrix = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            led,
            [0.0, 0.0, 0.0, 1.0],
            lever * (led + [0.0, 0.0, GRAVITY, 0.0]),
        ]
    )
    exact = [k for k in eigvals(matrix) if k.imag >= 0.0]
    exact.sort(key=abs)
    assert found.eigenvalues == pytest.approx(np.array(exact), rel=1e-6)
    assert not found.diagnostics
    place = found.names.index("trolley.vx_body")
    assert np.abs(found.shapes[:, place]).min() > 1e-3


def test_a_stiff_law_of_a_drive_is_in_newtons_matrix() -> None:
    """A servo 1000 times as fast as its slow command: steps follow the command."""
    law = formula(
        "w**2*(sin(t) - pin.angle) - 2*w*pin.angle_rate", parameters={"w": 1e3}
    )
    made = servo({"of": "acceleration", "function": law, "start_rate": 1.0})
    result = simulate(compile_scene(made), integrator="radau5", rtol=1e-5)
    found = values(result)["pin.angle"]
    assert found[-1] == pytest.approx(math.sin(1.0 - 2e-3), abs=1e-5)
    steps = result.counters["steps"]
    assert steps < 100
    assert result.counters["newton_iterations"] < 6 * steps
