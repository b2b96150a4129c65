"""What forces put on their markers, as outputs, against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.solver import compile_scene, simulate

from ..dynamics.joint_scenes import scene


def block(**more: Any) -> dict[str, Any]:
    return {"mass": 2.0, "inertia": [1.0, 1.0, 1.0], **more}


def test_a_force_of_the_same_name_is_no_part_of_the_joint() -> None:
    """A rail bears the weight m g alone; what pushes along it is not its own."""
    content = scene(
        "spatial",
        gravity=[0.0, -9.81, 0.0],
        bodies={"block": block()},
        joints={"rail": {"type": "prismatic", "markers": ["ground", "block"]}},
        forces={"rail": {"type": "force", "marker": "block", "force": [3.0, 0.0, 0.0]}},
        outputs={"record": ["rail.fx", "rail.fy", "block.ax"]},
    )
    result = simulate(compile_scene(content))
    assert result.values == pytest.approx(
        np.tile([0.0, 2.0 * 9.81, 1.5], (len(result.t), 1)), abs=1e-9
    )


def test_the_force_of_a_spring_accelerates_its_body() -> None:
    """An oscillator of 3 rad/s along a diagonal, with a spring, whose force and that
    of the damper are those of both parts of its law."""
    start = {"position": [0.9, 1.2, 0.0]}
    spring = {
        "type": "spring_damper",
        "markers": ["ground", "block"],
        "stiffness": 18.0,
        "damping": 0.5,
        "rest": 1.0,
    }
    rail = {"type": "prismatic", "markers": ["ground", "block"], "axis": [0.6, 0.8, 0]}
    words = ["fx", "fy", "fz", "mx", "my", "mz"]
    record = [f"spring.{word}" for word in words] + ["block.ax", "block.ay"]
    content = scene(
        "spatial",
        2.0,
        bodies={"block": block(initial=start)},
        joints={"rail": rail},
        forces={"spring": spring},
        outputs={"record": record},
    )
    result = simulate(compile_scene(content), rtol=1e-9)
    assert result["spring.fx"][0] == pytest.approx(-0.6 * 18.0 * 0.5)
    for axis in "xy":
        force = 2.0 * result[f"block.a{axis}"]
        assert result[f"spring.f{axis}"] == pytest.approx(force, abs=1e-9)
    for word in words[2:]:
        assert np.abs(result[f"spring.{word}"]).max() < 1e-12


@pytest.mark.parametrize("markers", [["ground", "block"], ["block", "ground"]])
def test_a_motor_and_a_bushing_act_on_the_second_marker(markers: list[str]) -> None:
    """The motor in a joint turns its second part on; a bushing holds it back and
    carries its weight, until both balance."""
    joint = {"type": "cylindrical", "markers": markers}
    function = {"type": "constant", "value": 0.3}
    motor = {"type": "actuator", "joint": "axle", "function": function}
    mount = {
        "type": "bushing",
        "markers": ["ground", "block"],
        "stiffness": [0.0, 0.0, 50.0, 0.0, 0.0, 2.0],
        "damping": [0.0, 0.0, 40.0, 0.0, 0.0, 4.0],
    }
    content = scene(
        "spatial",
        40.0,
        bodies={"block": block()},
        joints={"axle": joint},
        forces={"motor": motor, "mount": mount},
        gravity=[0.0, 0.0, -9.81],
        outputs={"record": ["motor.mz", "mount.mz", "mount.fz", "block.angle"]},
    )
    result = simulate(compile_scene(content), rtol=1e-9)
    sign = 1.0 if markers[1] == "block" else -1.0
    assert result["motor.mz"] == pytest.approx(np.full_like(result.t, 0.3))
    assert result["mount.mz"][-1] == pytest.approx(-sign * 0.3, abs=1e-6)
    assert result["mount.fz"][-1] == pytest.approx(2.0 * 9.81, abs=1e-6)
    assert result["block.angle"][-1] == pytest.approx(0.15, abs=1e-6)


def test_a_force_that_follows_its_body_turns_with_it() -> None:
    """2 N along a marker that turns at 3 rad/s, as a harmonic function of time."""
    thrust = {
        "type": "force",
        "marker": "block",
        "force": [2.0, 0.0, 0.0],
        "axes": "marker",
        "function": {"type": "harmonic", "amplitude": 1.0, "angular_frequency": 5.0},
    }
    start = {"angular_velocity": [0.0, 0.0, 3.0]}
    events = {"turned": {"quantity": "thrust.fx", "value": 0.0, "direction": "falling"}}
    content = scene(
        "spatial",
        1.0,
        bodies={"block": block(initial=start)},
        forces={"thrust": thrust},
        events=events,
        outputs={"record": ["thrust.fx", "thrust.fy"]},
    )
    result = simulate(compile_scene(content), rtol=1e-9)
    t = result.t
    size = 2.0 * np.sin(5.0 * t)
    assert result["thrust.fx"] == pytest.approx(size * np.cos(3.0 * t), abs=1e-7)
    assert result["thrust.fy"] == pytest.approx(size * np.sin(3.0 * t), abs=1e-7)
    assert [e.t for e in result.events] == pytest.approx([math.pi / 6.0], abs=1e-7)


def test_a_force_has_no_multipliers() -> None:
    spring = {"type": "spring_damper", "markers": ["ground", "block"], "stiffness": 1.0}
    with pytest.raises(InputError, match="force spring has no 'f1'; expected .*fx"):
        scene(
            "spatial",
            1.0,
            bodies={"block": block()},
            forces={"spring": spring},
            outputs={"record": ["spring.f1"]},
        )


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_spring_without_direction_is_refused(dimension: str) -> None:
    """One of rest length 1 between points that coincide; without rest length it may."""
    body = block() if dimension == "spatial" else block(inertia=1.0)
    spring = {"type": "spring_damper", "markers": ["ground", "block"], "stiffness": 9.0}
    free = scene(dimension, 1.0, bodies={"block": body}, forces={"spring": spring})
    assert simulate(compile_scene(free)).completed
    strained = {"spring": {**spring, "rest": 1.0}}
    content = scene(dimension, 1.0, bodies={"block": body}, forces=strained)
    with pytest.raises(InputError, match="markers of spring coincide at the start"):
        simulate(compile_scene(content))
