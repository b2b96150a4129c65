"""Servos with reference models, said in several ways, on rods and cranks."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import SceneFile
from sidtool.solver import (
    Law,
    compile_scene,
    simulate,
)
from tests.solver.functions.servos import (
    DAMPING,
    MODEL,
    RECORD,
    SERVO,
    WANTED,
    W,
    formula,
    servo,
    step_response,
    torque,
    values,
)
from tests.solver.scenes import GRAVITY, scene, slender_rod, soft_body

#: The same motion, said in other ways.
SAID: dict[str, dict[str, Any]] = {
    "state": {"function": SERVO},
    "rate": {
        "of": "rate",
        "function": formula(
            "v",
            parameters=MODEL,
            states={"v": {"rate": "w**2*(wanted - value) - 2*d*w*v"}},
        ),
    },
    "acceleration": {
        "of": "acceleration",
        "function": formula("w**2*(wanted - value) - 2*d*w*rate", parameters=MODEL),
    },
    "read": {
        "of": "acceleration",
        "function": formula(
            "w**2*(wanted - pin.angle) - 2*d*w*pin.angle_rate", parameters=MODEL
        ),
    },
    "pid": {
        "of": "acceleration",
        "function": {
            "type": "pid",
            "measured": "pin.angle",
            "reference": WANTED,
            "p": W**2,
            "d": 2.0 * DAMPING * W,
        },
    },
    "formula of time": {
        "function": formula(
            "wanted - wanted*exp(-d*w*t)*(cos(f*t) + d*w/f*sin(f*t))",
            parameters={**MODEL, "f": W * math.sqrt(1.0 - DAMPING**2)},
        )
    },
}


@pytest.mark.parametrize("said", SAID)
def test_servo_pendulum_moves_as_its_reference_model(said: str) -> None:
    """Motion and torque against the closed step response and inverse dynamics."""
    result = simulate(compile_scene(servo(SAID[said])), integrator="radau9", rtol=1e-8)
    found, (x, v, a) = values(result), step_response(result.t)
    assert found["pin.angle"] == pytest.approx(x, abs=2e-8)
    assert found["pin.angle_rate"] == pytest.approx(v, abs=2e-7)
    assert found["servo.mz"] == pytest.approx(torque(x, a), abs=2e-6)
    assert np.ptp(found["energy.balance"]) < 1e-6


@pytest.mark.parametrize(
    "integrator, rtol", [("radau5", 1e-6), ("trapezoidal", 1e-4), ("dop853", 1e-6)]
)
def test_servo_in_space_by_other_methods(integrator: str, rtol: float) -> None:
    """More than a turn, in space."""
    far = {**SERVO, "parameters": {**MODEL, "wanted": 9.0}}
    made = servo({"function": far}, space=True, end=0.4)
    result = simulate(compile_scene(made), integrator=integrator, rtol=rtol)
    found, (x, _, a) = values(result), step_response(result.t)
    assert found["pin.angle"] == pytest.approx(x * 9.0 / WANTED, abs=20 * rtol)
    turned = torque(x * 9.0 / WANTED, a * 9.0 / WANTED)
    assert found["servo.mz"] == pytest.approx(turned, abs=1e3 * rtol)


@pytest.mark.parametrize("said", ["state", "read"])
def test_servo_in_fixed_steps_of_generalised_alpha(said: str) -> None:
    """Motion and torque have its order, 2."""
    missed = []
    for step in (4e-3, 2e-3):
        system = compile_scene(servo(SAID[said]))
        result = simulate(system, integrator="generalised_alpha", step=step)
        found, (x, v, a) = values(result), step_response(result.t)
        off = found["pin.angle"] - x, found["pin.angle_rate"] - v
        missed.append(
            [np.abs(e).max() for e in (*off, found["servo.mz"] - torque(x, a))]
        )
    assert np.divide(*missed) == pytest.approx(4.0, abs=0.3)
    assert missed[1] < [5e-5, 5e-4, 3e-3]


def test_a_law_of_a_program_gives_the_acceleration() -> None:
    def servo_law(t: float, y: Array) -> float:
        return W * W * (WANTED - y[0]) - 2.0 * DAMPING * W * y[1]

    made = servo({"of": "acceleration", "function": {"type": "callable"}})
    law = Law(servo_law, ["pin.angle", "pin.angle_rate"])
    system = compile_scene(made, drives={"servo": law})
    result = simulate(system, integrator="radau9", rtol=1e-8)
    found, (x, _, a) = values(result), step_response(result.t)
    assert found["pin.angle"] == pytest.approx(x, abs=2e-8)
    assert found["servo.mz"] == pytest.approx(torque(x, a), abs=2e-6)


@pytest.mark.parametrize("space", [False, True])
def test_flexible_rod_moves_as_with_the_function_of_time(space: bool) -> None:
    """The same motion as a callable of time, whose frame takes no part in the state."""
    sid = soft_body(3, 5, planar=not space)
    body = {"sid": "x.SID_FEM", "markers": {"a": 1, "b": 2}}
    more: dict[str, Any] = {"dimension": "spatial"} if space else {}
    record = ["pin.angle", "rod.q1", "rod.q3", "rod.b.x", "servo.mz", "pin.fy"]
    gravity = [0.0, -GRAVITY, 0.0] if space else [0.0, -GRAVITY]
    found = []
    for function in (SERVO, {"type": "callable"}):
        made = scene(
            {"rod": body},
            {"pin": {"type": "revolute", "markers": ["ground", "rod.a"]}},
            {"servo": {"joint": "pin", "function": function}},
            record=record,
            gravity=gravity,
            **more,
        )
        program = {"servo": lambda t: float(step_response(np.array(t))[0])}
        drives = program if function is not SERVO else None
        system = compile_scene(
            made, sids={"rod": sid}, drives=drives, accept_defects=True
        )
        found.append(values(simulate(system, integrator="radau9", rtol=1e-9)))
    for name, course in found[0].items():
        size = np.abs(found[1][name]).max()
        assert course == pytest.approx(found[1][name], abs=2e-6 * size), name


def test_servo_turns_a_crank_past_its_dead_points() -> None:
    """As with the function of time, by which the crank has no coordinates."""
    far = {**SERVO, "parameters": {**MODEL, "wanted": 9.0}}
    bodies: dict[str, Any] = {
        "crank": slender_rod(0.5, 2.0),
        "rod": slender_rod(1.3, 1.1, position=[0.5, 0.0]),
        "slider": {
            "mass": 1.0,
            "inertia": 1.0,
            "markers": {"m": {"position": [0.0, 0.0]}},
            "initial": {"position": [1.8, 0.0]},
        },
    }
    joints = {
        "main": {"type": "revolute", "markers": ["ground", "crank.a"]},
        "pin": {"type": "revolute", "markers": ["crank.b", "rod.a"]},
        "wrist": {"type": "revolute", "markers": ["rod.b", "slider.m"]},
        "guide": {"type": "prismatic", "markers": ["ground", "slider.m"]},
    }
    record = ["main.angle", "slider.x", "slider.vx", "servo.mz", "wrist.fx"]

    def turning(t: float) -> float:
        return float(step_response(np.array(t))[0]) * 9.0 / WANTED

    found = []
    for function, program in ((far, None), ({"type": "callable"}, {"servo": turning})):
        drives = {"servo": {"joint": "main", "function": function}}
        made = scene(bodies, joints, drives, record=record, gravity=[0.0, -GRAVITY])
        system = compile_scene(made, drives=program)
        found.append(simulate(system, integrator="radau9", rtol=1e-8).values)
    size = np.ptp(found[1], axis=0)
    assert (np.abs(found[0] - found[1]) / size).max() < 1e-7


def test_a_servo_overcomes_friction_from_the_load_of_its_pin() -> None:
    """The motion is the same; the torque is larger by mu r |F| with the motion."""
    made = servo({"function": SERVO}).model_dump(by_alias=True, exclude_none=True)
    made["joints"]["pin"]["friction"] = {"coefficient": 0.3, "radius": 0.02}
    made["outputs"]["record"] = [*RECORD, "pin.fx", "pin.fy"]
    system = compile_scene(SceneFile.model_validate(made))
    result = simulate(system, integrator="radau9", rtol=1e-8)
    found, (x, v, a) = values(result), step_response(result.t)
    assert found["pin.angle"] == pytest.approx(x, abs=1e-7)
    load = np.hypot(found["pin.fx"], found["pin.fy"])
    resisted = torque(x, a) + 0.3 * 0.02 * load * np.sign(v)
    assert found["servo.mz"][1:] == pytest.approx(resisted[1:], abs=1e-5)
    assert np.ptp(found["energy.balance"]) < 1e-6
