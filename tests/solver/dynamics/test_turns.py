"""Springs about axes in space count their turns, as they do in the plane."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene, simulate
from sidtool.solver.analyses.inverse_dynamics import inverse_dynamics
from sidtool.solver.analyses.static_equilibrium import static_equilibrium
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.solver.system.errors import SimulationError

from .joint_scenes import scene

#: A rotation of 2 rad/s from 10 rad on.
TURNING = {
    "type": "polynomial",
    "pieces": [{"from": 0.0, "coefficients": [10.0, 2.0]}],
}


def rotor(dimension: str, speed: float, **tables: Any) -> SceneFile:
    """One kg m2 on an axle with a spring of one N m / rad: the angle is speed sin t."""
    plane = dimension == "planar"
    body = {
        "mass": 1.0,
        "inertia": 1.0 if plane else [0.5, 0.5, 1.0],
        "initial": {"angular_velocity": speed if plane else [0.0, 0.0, speed]},
    }
    spring = {"type": "spring_damper", "joint": "axle", "stiffness": 1.0}
    content: dict[str, Any] = {
        "bodies": {"rotor": body},
        "joints": {"axle": {"type": "revolute", "markers": ["ground", "rotor"]}},
        "forces": {"spring": spring},
        "outputs": {"record": ["rotor.wz", "energy.potential", "energy.balance"]},
    }
    return scene(dimension, 8.0, **(content | tables))


def mount(velocity: list[float], **tables: Any) -> SceneFile:
    """A ball of one kg m2 on a bushing of one N m / rad about all axes."""
    body = {
        "mass": 1.0,
        "inertia": [1.0, 1.0, 1.0],
        "initial": {"angular_velocity": velocity},
    }
    stiffness = [9.0, 9.0, 9.0, 1.0, 1.0, 1.0]
    rubber = {"type": "bushing", "markers": ["ground", "top"], "stiffness": stiffness}
    outputs = {"record": ["top.wx", "top.wz", "energy.balance"]}
    content = {"bodies": {"top": body}, "forces": {"mount": rubber}, "outputs": outputs}
    return scene("spatial", 8.0, **(content | tables))


def stopped(content: SceneFile, **settings: Any) -> Result:
    with pytest.raises(SimulationError) as failure:
        simulate(compile_scene(content), **settings)
    assert failure.value.result is not None
    return failure.value.result


@pytest.mark.parametrize("speed", [3.1, 20.0])
@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_spring_counts_its_turns(dimension: str, speed: float) -> None:
    result = simulate(compile_scene(rotor(dimension, speed)), rtol=1e-9)
    energy = 0.5 * (speed * np.sin(result.t)) ** 2
    assert result["rotor.wz"] == pytest.approx(speed * np.cos(result.t), abs=1e-6)
    assert result["energy.potential"] == pytest.approx(energy, abs=1e-5)
    assert np.ptp(result["energy.balance"]) < 1e-6 * speed**2


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_every_integrator_counts_turns(integrator: str) -> None:
    content = rotor("spatial", 5.0)
    result = simulate(compile_scene(content), integrator=integrator, rtol=1e-5)
    exact = 5.0 * np.cos(result.t)
    assert result["rotor.wz"] == pytest.approx(exact, abs=5e-3)
    assert np.ptp(result["energy.balance"]) < 5e-3


@pytest.mark.parametrize("integrator", ["radau9", "dop853", "generalised_alpha"])
def test_turns_are_counted_between_outputs(integrator: str) -> None:
    """Some eighty radians lie between two of them, and loose steps are large."""
    content = rotor("spatial", 200.0)
    result = simulate(compile_scene(content), integrator=integrator, rtol=1e-3)
    assert result.position_names[-1] == "axle.angle"
    assert result.positions[:, -1] == pytest.approx(200.0 * np.sin(result.t), abs=1.0)


def test_a_step_that_turns_too_far_is_told() -> None:
    content = rotor("spatial", 60.0)
    found = stopped(content, step=0.05).diagnostics[0]
    assert (found.code, found.subject, found.data["limit"]) == ("N318", "axle", 2.5)
    result = simulate(compile_scene(content), step=0.02)
    assert result["rotor.wz"] == pytest.approx(60.0 * np.cos(result.t), abs=1e-3)


def test_friction_and_dampers_turn_as_fast_as_they_like() -> None:
    """Nothing depends on their angle: no steps are needed to count it."""
    damper = {"type": "spring_damper", "joint": "axle", "damping": 0.1}
    content = rotor("spatial", 20.0, forces={"d": damper})
    result = simulate(compile_scene(content), step=0.2)
    exact = 20.0 * np.exp(-0.1 * result.t)
    assert result["rotor.wz"] == pytest.approx(exact, rel=1e-5)
    assert result.positions.shape[1] == 7


@pytest.mark.parametrize("integrator", ["radau9", "dop853"])
def test_friction_turns_on_where_nobody_counts(integrator: str) -> None:
    """J w' = -M tanh(w / s): sinh(w / s) decays with exp(-M t / (J s)).

    The angle that two orientations tell jumps at half a turn; the way between the ends
    of a step does not.
    """
    friction = {"type": "friction", "joint": "axle", "force": 0.4, "speed": 0.5}
    content = rotor("spatial", 4.0, forces={"f": friction})
    result = simulate(compile_scene(content), integrator=integrator, rtol=1e-8)
    exact = 0.5 * np.arcsinh(np.sinh(8.0) * np.exp(-0.8 * result.t))
    assert result["rotor.wz"] == pytest.approx(exact, abs=1e-6)
    assert result.positions.shape[1] == 7


def test_a_bushing_tumbles_beyond_half_a_turn() -> None:
    """About an axis across: the rotation is 5 sin t, no component of it alone."""
    result = simulate(compile_scene(mount([3.0, 0.0, 4.0])), rtol=1e-8)
    assert result["top.wx"] == pytest.approx(3.0 * np.cos(result.t), abs=1e-5)
    assert result["top.wz"] == pytest.approx(4.0 * np.cos(result.t), abs=1e-5)
    assert np.ptp(result["energy.balance"]) < 1e-6
    exact = 4.0 * np.sin(result.t)
    assert result.positions[:, -1] == pytest.approx(exact, abs=1e-5)


@pytest.mark.parametrize("settings", [{}, {"step": 0.1}, {"integrator": "dop853"}])
def test_a_bushing_stops_before_a_full_turn(settings: dict[str, Any]) -> None:
    """The direction of its rotation vector is not defined there."""
    result = stopped(mount([6.0, 0.0, 8.0]), **settings)
    found = result.diagnostics[0]
    assert (found.code, found.subject) == ("N315", "mount")
    time = found.t or 0.0
    step = settings.get("step", 0.0)
    assert math.asin(0.6) - step - 1e-3 < time < math.asin(0.6) + 1e-3
    assert result["top.wx"] == pytest.approx(6.0 * np.cos(result.t), abs=1e-3)


def test_a_bushing_starts_at_half_a_turn() -> None:
    """Exactly there the skew part of the rotation vanishes."""
    turned = {"axis_angle": [0.6 * math.pi, 0.0, 0.8 * math.pi]}
    body = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "initial": turned}
    result = simulate(compile_scene(mount([0.0] * 3, bodies={"top": body})))
    energy = 0.5 * math.pi**2
    assert result["energy.balance"] == pytest.approx(energy, rel=1e-6)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize("extra", [[], ["turn.f1"]], ids=["eliminated", "kept"])
def test_a_driven_turn_is_counted(dimension: str, extra: list[str]) -> None:
    """From the value of the drive at the start on, 10 rad."""
    record = ["axle.angle", "axle.angle_rate", "energy.potential", *extra]
    tables = {
        "drives": {"turn": {"joint": "axle", "function": TURNING}},
        "outputs": {"record": record},
    }
    result = simulate(compile_scene(rotor(dimension, 0.0, **tables)))
    angle = 10.0 + 2.0 * result.t
    assert result["axle.angle"] == pytest.approx(angle, rel=1e-9)
    assert result["axle.angle_rate"] == pytest.approx(0.0 * angle + 2.0, rel=1e-9)
    assert result["energy.potential"] == pytest.approx(0.5 * angle**2, rel=1e-9)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_inverse_dynamics_count_turns(dimension: str) -> None:
    """Eight radians from one output to the next, and growing."""
    pieces = [{"from": 0.0, "coefficients": [0.0, 20.0, 3.0]}]
    function = {"type": "polynomial", "pieces": pieces}
    tables = {
        "drives": {"turn": {"joint": "axle", "function": function}},
        "outputs": {"record": ["turn.f1", "energy.supplied", "energy.potential"]},
    }
    content = rotor(dimension, 20.0, **tables)
    result = inverse_dynamics(compile_scene(content, keep_joints=True))
    angle = 20.0 * result.t + 3.0 * result.t**2
    assert np.abs(result["turn.f1"]) == pytest.approx(angle + 6.0, rel=1e-9)
    assert result["energy.potential"] == pytest.approx(0.5 * angle**2, rel=1e-9)
    work = 0.5 * angle**2 + 0.5 * (20.0 + 6.0 * result.t) ** 2 - 200.0
    assert result["energy.supplied"] == pytest.approx(work, rel=1e-3)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_static_equilibrium_winds_springs_up(dimension: str) -> None:
    torque = 9.0 if dimension == "planar" else [0.0, 0.0, 9.0]
    forces = {
        "spring": {"type": "spring_damper", "joint": "axle", "stiffness": 1.0},
        "load": {"type": "force", "marker": "rotor", "torque": torque},
    }
    content = rotor(dimension, 0.0, forces=forces, outputs={"record": ["axle.angle"]})
    result = static_equilibrium(compile_scene(content, keep_joints=True)).result()
    assert result["axle.angle"][0] == pytest.approx(9.0, rel=1e-9)


def test_a_shaft_turns_in_a_bushing_that_it_leans_on() -> None:
    """Driven by 2 N m along itself and pushed over by 0.6 N m about a fixed axis. It
    leans where the torque of the bushing, k sin a cos a, balances that, and speeds up
    steadily about itself for three turns and more."""
    tilt = 0.5 * math.asin(2.0 * 0.6 / 5.0)
    axis = [0.0, -math.sin(tilt), math.cos(tilt)]
    body = {
        "mass": 1.0,
        "inertia": [0.3, 0.3, 0.5],
        "initial": {"axis_angle": [tilt, 0.0, 0.0]},
    }
    forces = {
        "mount": {
            "type": "bushing",
            "markers": ["ground", "shaft"],
            "stiffness": [9.0, 9.0, 9.0, 5.0, 5.0, 0.0],
            "shaft": "z",
        },
        "motor": {"type": "force", "marker": "shaft", "torque": [0.0, 0.0, 2.0]},
        "load": {"type": "force", "marker": "shaft", "torque": [0.6, 0.0, 0.0]},
    }
    forces["motor"]["axes"] = "marker"
    record = ["shaft.wx", "shaft.wy", "shaft.wz", "energy.balance"]
    content = scene(
        "spatial",
        4.0,
        bodies={"shaft": body},
        forces=forces,
        outputs={"record": record},
    )
    result = simulate(compile_scene(content), rtol=1e-8)
    turned = 0.5 * 4.0 * result.t[-1] ** 2
    assert turned > 3.0 * 2.0 * math.pi
    for name, component in zip(record, axis, strict=False):
        exact = 4.0 * component * result.t
        assert result[name] == pytest.approx(exact, abs=1e-5)
    assert np.ptp(result["energy.balance"]) < 1e-5


@pytest.mark.parametrize("shaft", ["x", "y", "z"])
def test_a_shaft_of_springs_keeps_its_energy(shaft: str) -> None:
    """Large tilts on stiff springs, while it is wound up and unwinds for turns."""
    k = "xyz".index(shaft)
    spin = np.roll([0.8, -0.5, 12.0], k - 2)
    turning = np.roll([30.0, 40.0, 1.0], k - 2)
    body = {
        "mass": 1.0,
        "inertia": np.roll([0.3, 0.4, 0.5], k - 2).tolist(),
        "initial": {"angular_velocity": spin.tolist()},
        "markers": {"end": {"position": [0.1, 0.2, -0.1]}},
    }
    mount = {
        "type": "bushing",
        "markers": ["ground", "body.end"],
        "stiffness": [9.0, 7.0, 8.0, *turning.tolist()],
        "shaft": shaft,
    }
    ground = {"markers": {"base": {"position": [0.1, 0.2, -0.1]}}}
    mount["markers"] = ["ground.base", "body.end"]
    record = ["energy.balance", "energy.kinetic"]
    content = scene(
        "spatial",
        8.0,
        ground=ground,
        bodies={"body": body},
        forces={"mount": mount},
        outputs={"record": record},
    )
    result = simulate(compile_scene(content), rtol=1e-9)
    assert result["energy.kinetic"].max() > 30.0 > 10.0 * result["energy.kinetic"].min()
    assert np.ptp(result["energy.balance"]) < 1e-6 * result["energy.kinetic"].max()
    assert abs(result.positions[:, -1]).max() > 7.0


def test_the_angle_that_is_told_is_the_one_that_the_spring_has() -> None:
    """Wound up by 10 rad at rest, a rotor at 3 rad is a turn further to the spring."""
    spring = {"type": "spring_damper", "joint": "axle", "stiffness": 5.0, "rest": 10.0}
    found = simulate(
        compile_scene(
            rotor(
                "spatial",
                0.0,
                bodies={
                    "rotor": {
                        "mass": 1.0,
                        "inertia": [0.5, 0.5, 1.0],
                        "initial": {"axis_angle": [0.0, 0.0, 3.0]},
                    }
                },
                forces={"spring": spring},
                outputs={"record": ["axle.angle", "spring.mz"]},
            )
        )
    )
    assert found["axle.angle"][0] == pytest.approx(3.0 + 2.0 * math.pi)
    torque = 5.0 * (10.0 - found["axle.angle"])
    assert found["spring.mz"] == pytest.approx(torque, abs=1e-9)
