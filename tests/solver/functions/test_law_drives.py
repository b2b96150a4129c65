"""Drives that follow laws: servos with reference models, speeds, sampled commands."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigvals

from sidtool.formats.errors import InputError
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.formats.scene.units import unit_of
from sidtool.formats.sid import Array
from sidtool.solver import (
    Law,
    compile_scene,
    inverse_dynamics,
    linearise,
    simulate,
    static_equilibrium,
)
from tests.solver.scenes import GRAVITY, scene, slender_rod, soft_body

LENGTH, MASS = 0.9, 1.7
W, DAMPING, WANTED = 11.0, 0.35, 0.8
#: Second-order reference model of a servo: x'' = w^2 (wanted - x) - 2 d w x'.
MODEL = {"w": W, "d": DAMPING, "wanted": WANTED}
SERVO: dict[str, Any] = {
    "type": "expression",
    "value": "x",
    "parameters": MODEL,
    "states": {
        "x": {"rate": "v"},
        "v": {"rate": "w**2*(wanted - x) - 2*d*w*v"},
    },
}
RECORD = ["pin.angle", "pin.angle_rate", "servo.mz", "energy.balance"]


def formula(value: str, **more: Any) -> dict[str, Any]:
    return {"type": "expression", "value": value, **more}


def values(result: Result) -> dict[str, Array]:
    return dict(zip(result.names, result.values.T, strict=True))


def step_response(t: Array) -> tuple[Array, Array, Array]:
    """Angle, rate and acceleration of the reference model, from rest at zero."""
    fast = W * math.sqrt(1.0 - DAMPING**2)
    decay = WANTED * np.exp(-DAMPING * W * t)
    x = WANTED - decay * (np.cos(fast * t) + DAMPING * W / fast * np.sin(fast * t))
    v = decay * W * W / fast * np.sin(fast * t)
    return x, v, W * W * (WANTED - x) - 2.0 * DAMPING * W * v


def torque(x: Array, a: Array) -> Array:
    """Inverse dynamics of the uniform rod on its pin, angle from the horizontal."""
    return MASS * LENGTH * (LENGTH * a / 3.0 + 0.5 * GRAVITY * np.cos(x))


def servo(drive: dict[str, Any], space: bool = False, **more: Any) -> SceneFile:
    """A rod that a drive of its pin turns in a vertical plane."""
    rod: dict[str, Any] = slender_rod(LENGTH, MASS)
    pin: dict[str, Any] = {"type": "revolute", "markers": ["ground", "rod.a"]}
    more = {"gravity": [0.0, -GRAVITY], "record": RECORD} | more
    if space:
        more |= {"dimension": "spatial", "gravity": [0.0, -GRAVITY, 0.0]}
        rod["inertia"] = [1e-3, rod["inertia"], rod["inertia"]]
        rod["centre_of_mass"] = [LENGTH / 2, 0.0, 0.0]
        rod["markers"] = {"a": {"position": [0.0, 0.0, 0.0]}}
    drives = {"servo": {"joint": "pin", **drive}}
    return scene({"rod": rod}, {"pin": pin}, drives, **more)


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


# --- what follows the motion of others ---------------------------------------------

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
    assert not found.notes
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


# --- speeds and samples ------------------------------------------------------------


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


# --- analyses and refusals ---------------------------------------------------------


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


def test_generalised_alpha_refuses_by_name() -> None:
    system = compile_scene(servo({"function": SERVO}))
    with pytest.raises(InputError, match=r"no drives with laws \(servo\)"):
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
        'drives.servo.start: stands beside of = "value"',
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
