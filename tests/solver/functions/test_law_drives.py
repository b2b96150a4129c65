"""Speeds and sampled accelerations as drives; analyses with them; refusals."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.scene.units import unit_of
from sidtool.solver import (
    Law,
    compile_scene,
    inverse_dynamics,
    simulate,
    static_equilibrium,
)
from tests.solver.functions.servos import SERVO, formula, servo, torque, values


def test_speed_as_a_function_of_time() -> None:
    """Runs up to a speed that is held: the integral in closed form."""
    ramp = {"type": "sine_ramp", "from": 0.2, "to": 0.6, "end": 3.0}
    made = servo({"of": "rate", "start": 0.5, "function": ramp})
    result = simulate(compile_scene(made), integrator="radau9", rtol=1e-9)
    x = np.clip((result.t - 0.2) / 0.4, 0.0, 1.0)
    turn = 2.0 * np.pi
    risen = 0.5 * x**2 + (np.cos(turn * x) - 1.0) / turn**2
    exact = 0.5 + 3.0 * (0.4 * risen + np.maximum(result.t - 0.6, 0.0))
    assert values(result)["pin.angle"] == pytest.approx(exact, abs=1e-8)


def test_sampled_acceleration_is_held_between_samples() -> None:
    """Exact: x'' is constant between samples of what is measured at them."""
    step, w = 0.05, 6.0
    law = formula(f"{w}**2*(0.7 - pin.angle) - {w}*pin.angle_rate", sample_time=step)
    made = servo({"of": "acceleration", "function": law}, end=1.0, steps=20)
    result = simulate(compile_scene(made), integrator="radau5", rtol=1e-8)
    x, v, exact = 0.0, 0.0, [0.0]
    for _ in range(20):
        a = w * w * (0.7 - x) - w * v
        x, v = x + step * v + 0.5 * step * step * a, v + step * a
        exact.append(x)
    assert values(result)["pin.angle"] == pytest.approx(exact, abs=1e-7)


def test_units_of_what_rates_add_up_to() -> None:
    made = servo({"of": "acceleration", "function": formula("-value - rate")})
    assert unit_of("servo.state.value", made) == "rad"
    assert unit_of("servo.state.rate", made) == "rad/s"


def test_static_equilibrium_holds_drives_where_they_start() -> None:
    made = servo({"of": "acceleration", "start": 0.3, "function": formula("0*t + 5")})
    found = static_equilibrium(compile_scene(made, keep_joints=True)).result()
    told = values(found)
    assert told["pin.angle"] == pytest.approx([0.3])
    assert told["servo.mz"] == pytest.approx([torque(np.array(0.3), np.array(0.0))])


def test_inverse_dynamics_does_not_know_the_motion() -> None:
    system = compile_scene(servo({"function": SERVO}), keep_joints=True)
    with pytest.raises(InputError, match="servo.state.x is no function of the motion"):
        inverse_dynamics(system)


def test_generalised_alpha_refuses_steps_of_its_own_by_name() -> None:
    system = compile_scene(servo({"function": SERVO}))
    with pytest.raises(InputError, match=r"laws \(servo\) in fixed steps alone"):
        simulate(system, integrator="generalised_alpha")


REFUSED = {
    "an output": (
        {"function": formula("0.5*pin.angle")},
        "second derivative of pin.angle, .*gear",
    ),
    "a velocity": (
        {"function": formula("pin.angle_rate")},
        "second derivative of pin.angle_rate, ",
    ),
    "lagged too little": (
        {"function": formula("x", states={"x": {"rate": "(rod.vx - x)/0.1"}})},
        "rate of rod.vx is an acceleration",
    ),
    "a limit of a position": (
        {"function": {**SERVO, "limits": [-0.1, 0.1]}},
        "jumps, or its rate does, where m",
    ),
    "a sampled position": (
        {"function": formula("0.1*pin.angle", sample_time=0.01)},
        "sample_time: a sampled law gives the value, which would jump",
    ),
    "a sampled speed": (
        {"of": "rate", "function": formula("-pin.angle", sample_time=0.01)},
        r"value = \"\(command - rate\)/SAMPLE_TIME\"",
    ),
    "a start of its own": (
        {"start": 0.1, "function": SERVO},
        'drives.servo.start: is given with of = "value"',
    ),
    "a name that is taken": (
        {"of": "rate", "function": formula("value", parameters={"value": 1.0})},
        "value is a parameter and what the rate adds up to",
    ),
    "no number at the start": (
        {"function": formula("log(t - 1)*t**3")},
        "no finite number at the start",
    ),
}


@pytest.mark.parametrize("drive, words", REFUSED.values(), ids=REFUSED)
def test_motions_that_are_not_sound_are_refused(
    drive: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        compile_scene(servo(drive))


def test_a_callable_has_no_derivatives() -> None:
    made = servo({"function": {"type": "callable"}})
    law = Law(lambda t, y: 0.1 * y[0], ["pin.angle"])
    with pytest.raises(InputError, match=r'of = "acceleration" of the drive'):
        compile_scene(made, drives={"servo": law})
    timed = servo({"of": "rate", "function": {"type": "callable"}})
    with pytest.raises(InputError, match="callable of time cannot give the rate"):
        compile_scene(timed, drives={"servo": math.sin})
