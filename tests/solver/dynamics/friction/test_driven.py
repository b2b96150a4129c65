"""Friction in joints that drives move: their force contains it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import fsolve

from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.solver import compile_scene
from sidtool.solver.analyses.inverse_dynamics import inverse_dynamics
from sidtool.solver.simulation import simulate
from tests.solver.dynamics.joint_scenes import scene

G = 9.81
MU, RADIUS, VISCOUS = 0.3, 0.05, 0.02
MASS, INERTIA, ARM = 1.5, 0.03, 0.4
TOP, OMEGA = 0.8, 3.0


def vector(dimension: str, x: float, y: float) -> list[float]:
    return [x, y] if dimension == "planar" else [x, y, 0.0]


def driven_pendulum(dimension: str, **law: Any) -> Any:
    """A rod that a harmonic drive swings about its end, 0 to 3 s."""
    plane = dimension == "planar"
    friction = {"coefficient": MU, "radius": RADIUS, "viscous": VISCOUS, **law}
    drive = {"type": "harmonic", "amplitude": TOP, "angular_frequency": OMEGA}
    return scene(
        dimension,
        3.0,
        gravity=vector(dimension, 0.0, -G),
        bodies={
            "bob": {
                "mass": MASS,
                "inertia": INERTIA if plane else [0.02, 0.025, INERTIA],
                "markers": {"pin": {"position": vector(dimension, 0.0, ARM)}},
                "initial": {"position": vector(dimension, 0.0, -ARM)},
            }
        },
        joints={
            "pin": {
                "type": "revolute",
                "markers": ["ground", "bob.pin"],
                "friction": friction,
            }
        },
        drives={"motor": {"joint": "pin", "function": drive}},
        outputs={
            "record": [
                "pin.angle",
                "pin.friction",
                "pin.normal_force",
                "pin.sticking",
                "motor.mz",
                "energy.balance",
                "energy.dissipated",
            ]
        },
    )


def torques(t: np.ndarray) -> tuple[np.ndarray, ...]:
    """Load of the pin, friction on the rod, torque of the drive: by hand."""
    angle = TOP * np.sin(OMEGA * t)
    rate = TOP * OMEGA * np.cos(OMEGA * t)
    push = -(OMEGA**2) * angle
    along = G * np.cos(angle) + ARM * rate**2
    load = MASS * np.hypot(along, G * np.sin(angle) + ARM * push)
    friction = -MU * RADIUS * load * np.sign(rate) - VISCOUS * rate
    needed = (INERTIA + MASS * ARM**2) * push + MASS * G * ARM * np.sin(angle)
    return load, friction, needed - friction


def columns(result: Result) -> dict[str, np.ndarray]:
    return dict(zip(result.names, result.values.T, strict=True))


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize("method", ["radau9", "dop853"])
def test_the_torque_of_a_drive_contains_the_friction(
    dimension: str, method: str
) -> None:
    system = compile_scene(driven_pendulum(dimension), ".")
    result = simulate.simulate(system, integrator=method, rtol=1e-8)
    found, (load, friction, torque) = columns(result), torques(result.t)
    np.testing.assert_allclose(found["pin.normal_force"], load, rtol=1e-8)
    np.testing.assert_allclose(found["pin.friction"], friction, atol=1e-8)
    np.testing.assert_allclose(found["motor.mz"], torque, atol=1e-7)
    assert not found["pin.sticking"].any()
    turns = [(e.t, e.kind) for e in result.events if e.name == "pin"]
    assert [kind for _, kind in turns] == ["slip"] * len(turns)
    known = (np.arange(len(turns)) + 0.5) * np.pi / OMEGA
    np.testing.assert_allclose([t for t, _ in turns], known, atol=1e-7)
    assert len(turns) == 3
    lost = found["energy.dissipated"]
    assert np.ptp(found["energy.balance"]) < 1e-7 * lost[-1]


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_inverse_dynamics_with_friction(dimension: str) -> None:
    system = compile_scene(driven_pendulum(dimension), ".", keep_joints=True)
    result = inverse_dynamics(system)
    found, (load, friction, torque) = columns(result), torques(result.t)
    np.testing.assert_allclose(found["pin.normal_force"], load, rtol=1e-10)
    np.testing.assert_allclose(found["pin.friction"], friction, atol=1e-10)
    np.testing.assert_allclose(found["motor.mz"], torque, atol=1e-9)
    assert np.ptp(found["energy.balance"]) < 1e-5


# --- a slider-crank with friction in its joints: each loads the others ----------------

CRANK, ROD, SPEED, PIN = 0.15, 0.5, 4.0, 0.02
CRANK_MASS, ROD_MASS, PISTON, SPIN = 0.4, 1.2, 0.8, 0.02


def slider_crank(dimension: str) -> Any:
    """A balanced crank that turns steadily, a rod, and a piston on a guide.

    In the plane all four joints rub, in space the main bearing and the guide do.
    """
    plane = dimension == "planar"
    inertia = SPIN if plane else [SPIN] * 3
    line = {"type": "polynomial", "pieces": [{"from": 0.0, "coefficients": [0, SPEED]}]}
    rub = {"friction": {"coefficient": MU, "radius": PIN}}
    turning = -CRANK * SPEED / ROD

    def at(x: float) -> dict[str, Any]:
        return {"position": vector(dimension, x, 0.0)}

    def spin(rate: float) -> Any:
        return rate if plane else [0.0, 0.0, rate]

    pin = {"type": "revolute", **rub} if plane else {"type": "spherical"}
    cardan = {"type": "universal", "axis": [0, 0, 1], "second_axis": [0, 1, 0]}
    guide = "prismatic" if plane else "point_on_line"
    return scene(
        dimension,
        2.0,
        gravity=vector(dimension, 0.0, -G),
        bodies={
            "crank": {
                "mass": CRANK_MASS,
                "inertia": inertia,
                "markers": {"tip": at(CRANK)},
                "initial": {"angular_velocity": spin(SPEED)},
            },
            "rod": {
                "mass": ROD_MASS,
                "inertia": inertia,
                "markers": {"a": at(-0.5 * ROD), "b": at(0.5 * ROD)},
                "initial": {
                    **at(CRANK + 0.5 * ROD),
                    "velocity": vector(dimension, 0.0, 0.5 * CRANK * SPEED),
                    "angular_velocity": spin(turning),
                },
            },
            "piston": {
                "mass": PISTON,
                **({"inertia": inertia} if plane else {}),
                "initial": at(CRANK + ROD),
            },
        },
        joints={
            "main": {"type": "revolute", "markers": ["ground", "crank"], **rub},
            "big": {**(pin if plane else cardan), "markers": ["crank.tip", "rod.a"]},
            "small": {**pin, "markers": ["rod.b", "piston"]},
            "guide": {
                "type": guide,
                "markers": ["ground", "piston"],
                "friction": {"coefficient": MU},
            },
        },
        drives={"motor": {"joint": "main", "function": line}},
        outputs={
            "record": [
                "main.friction",
                "guide.friction",
                "guide.normal_force",
                "motor.mz",
            ]
        },
    )


def cross(a: np.ndarray, b: np.ndarray) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def by_newton(t: float, pins: float) -> list[float]:
    """Friction of bearing and guide, normal force, torque: Newton's laws by hand.

    pins : coefficient in the two pins of the rod
    """
    s, c = np.sin(SPEED * t), np.cos(SPEED * t)
    phi = -np.arcsin(CRANK * s / ROD)
    sp, cp = np.sin(phi), np.cos(phi)
    turn = -CRANK * SPEED * c / (ROD * cp)
    push = (CRANK * SPEED**2 * s + ROD * sp * turn**2) / (ROD * cp)
    slide = -CRANK * SPEED * s - ROD * sp * turn
    jerk = -CRANK * SPEED**2 * c - ROD * cp * turn**2 - ROD * sp * push
    tip, half = CRANK * np.array([c, s]), 0.5 * ROD * np.array([cp, sp])
    centre = -(SPEED**2) * tip + 0.5 * ROD * (
        push * np.array([-sp, cp]) - turn**2 * np.array([cp, sp])
    )
    weight = np.array([0.0, -G])

    def rubbed(x: np.ndarray) -> tuple[float, float, float, float]:
        first, big, small, normal = x[:2], x[2:4], x[4:6], x[6]
        return (
            -MU * PIN * np.hypot(*first) * np.sign(SPEED),
            -pins * PIN * np.hypot(*big) * np.sign(turn - SPEED),
            -pins * PIN * np.hypot(*small) * np.sign(-turn),
            -MU * abs(normal) * np.sign(slide),
        )

    def left(x: np.ndarray) -> np.ndarray:
        first, big, small, normal, torque = x[:2], x[2:4], x[4:6], x[6], x[7]
        main, at_big, at_small, along = rubbed(x)
        rod = cross(-half, big) - cross(half, small) + at_big - at_small
        return np.array(
            [
                *(first - big + CRANK_MASS * weight),
                torque + main - at_big - cross(tip, big),
                *(big - small + ROD_MASS * (weight - centre)),
                rod - SPIN * push,
                small[0] + along - PISTON * jerk,
                small[1] + normal - PISTON * G,
            ]
        )

    found = fsolve(left, np.ones(8), xtol=1e-13, full_output=True)[0]
    assert np.abs(left(found)).max() < 1e-10
    main, _, _, along = rubbed(found)
    return [main, along, abs(found[6]), found[7]]


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize("way", ["run", "inverse"])
def test_joints_of_a_driven_slider_crank_rub(dimension: str, way: str) -> None:
    system = compile_scene(slider_crank(dimension), ".", keep_joints=way == "inverse")
    if way == "run":
        result = simulate.simulate(system, integrator="radau9", rtol=1e-8)
    else:
        result = inverse_dynamics(system)
    pins = MU if dimension == "planar" else 0.0
    inside = slice(1, None)  # at the start the guide turns round
    known = np.array([by_newton(t, pins) for t in result.t[inside]])
    np.testing.assert_allclose(result.values[inside], known, atol=2e-6)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_guide_rubs_beyond_a_crank_whose_motion_is_prescribed(
    dimension: str,
) -> None:
    """Its bearing has no friction, which acts on nothing beyond it."""
    made = slider_crank(dimension).model_dump(by_alias=True, exclude_none=True)
    del made["joints"]["main"]["friction"]
    made["outputs"] = {"record": ["guide.friction", "guide.normal_force"]}
    made["time"]["end"] = 0.3
    system = compile_scene(validate_data(made, SceneFile), ".")
    assert system.make_full_system is not None  # the crank has no coordinates
    result = simulate.simulate(system, integrator="radau9", rtol=1e-8)
    pins = MU if dimension == "planar" else 0.0
    known = np.array([by_newton(t, pins)[1:3] for t in result.t[1:]])
    np.testing.assert_allclose(result.values[1:], known, atol=2e-6)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_drive_that_rests_holds_without_friction(dimension: str) -> None:
    """It rests, goes up between 0.7 s and 1.5 s, rests, and comes back from 2 s on."""
    made = driven_pendulum(dimension).model_dump(by_alias=True, exclude_none=True)
    up = {"type": "smooth_step", "from": 0.7, "to": 1.5, "start": 0.4, "end": 1.0}
    down = {"type": "smooth_step", "from": 2.0, "to": 2.6, "end": -0.5}
    function = {"type": "sum", "parts": [up, down]}
    made["drives"]["motor"]["function"] = function
    made["time"]["output_step"] = 0.05
    system = compile_scene(validate_data(made, SceneFile), ".")
    result = simulate.simulate(system, integrator="radau9", rtol=1e-8)
    found = columns(result)
    t, angle = result.t, found["pin.angle"]
    moves = ((t > 0.7) & (t < 1.5)) | ((t > 2.0) & (t < 2.6))
    ways = np.where(moves, np.where(t < 1.8, 1.0, -1.0), 0.0)
    edges = np.isclose(t[:, None], [0.7, 1.5, 2.0, 2.6]).any(axis=1)
    np.testing.assert_array_equal(found["pin.sticking"][~edges], ~moves[~edges])
    rests = ~moves & ~edges
    weight = MASS * G * ARM * np.sin(angle)
    np.testing.assert_allclose(found["motor.mz"][rests], weight[rests], atol=1e-8)
    assert np.abs(found["pin.friction"][rests]).max() < 1e-14
    # the viscous part is not told apart by the sense
    load = found["pin.normal_force"]
    dry = found["pin.friction"] + VISCOUS * np.gradient(angle, t)
    near = moves & ~edges
    np.testing.assert_allclose(
        dry[near], -MU * RADIUS * (ways * load)[near], atol=VISCOUS * 0.2
    )
    events = [(e.kind, round(e.t, 2)) for e in result.events if e.name == "pin"]
    assert events == [("slip", 0.7), ("stick", 1.5), ("slip", 2.0), ("stick", 2.6)]
