"""Springs about axes in space: right below half a turn, and told where that is."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from formats.result import Result
from formats.scene import SceneFile
from solver import compile_scene, simulate
from solver.errors import SimulationError

from .joint_scenes import scene


def rotor(dimension: str, speed: float, **tables: Any) -> SceneFile:
    """One kg m2 on an axle with a spring of one N m / rad, turning at t = 0."""
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
        "outputs": {"record": ["rotor.wz"]},
    }
    return scene(dimension, 8.0, **(content | tables))


def stopped(content: SceneFile, **settings: Any) -> tuple[str, Result]:
    with pytest.raises(SimulationError) as failure:
        simulate(compile_scene(content), **settings)
    assert failure.value.result is not None
    return str(failure.value), failure.value.result


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_spring_swings_nearly_half_a_turn(dimension: str) -> None:
    result = simulate(compile_scene(rotor(dimension, 3.1)), rtol=1e-9)
    assert result["rotor.wz"] == pytest.approx(3.1 * np.cos(result.t), abs=1e-7)


def test_in_the_plane_a_spring_counts_its_turns() -> None:
    result = simulate(compile_scene(rotor("planar", 20.0)), rtol=1e-9)
    assert result["rotor.wz"] == pytest.approx(20.0 * np.cos(result.t), abs=1e-6)


@pytest.mark.parametrize("integrator", ["radau9", "generalised_alpha", "dop853"])
def test_in_space_a_run_stops_at_half_a_turn(integrator: str) -> None:
    """With what there is until then: the angle is 5 sin t."""
    content = rotor("spatial", 5.0)
    content = content.model_copy(
        update={"time": content.time.model_copy(update={"output_step": 0.05})}
    )
    message, result = stopped(content, integrator=integrator, rtol=1e-6)
    passed = math.asin(math.pi / 5.0)
    assert "spring is half a turn away" in message
    time = float(message.split("t = ")[1].split(" s")[0])
    assert passed - 1e-4 < time < passed + 0.1
    assert len(result.t) == math.ceil(time / 0.05) and not result.completed
    known = result.t < passed
    exact = 5.0 * np.cos(result.t[known])
    assert result["rotor.wz"][known] == pytest.approx(exact, abs=1e-4)


def test_friction_and_dampers_turn_for_ever() -> None:
    damper = {"type": "spring_damper", "joint": "axle", "damping": 0.1}
    result = simulate(compile_scene(rotor("spatial", 20.0, forces={"d": damper})))
    exact = 20.0 * np.exp(-0.1 * result.t)
    assert result["rotor.wz"] == pytest.approx(exact, rel=1e-5)


def test_a_bushing_is_told_where_it_tumbles() -> None:
    """About an axis across: the rotation is 5 sin t, no component of it alone."""
    body = {
        "mass": 1.0,
        "inertia": [1.0, 1.0, 1.0],
        "initial": {"angular_velocity": [3.0, 0.0, 4.0]},
    }
    stiffness = [9.0, 9.0, 9.0, 1.0, 1.0, 1.0]
    mount = {"type": "bushing", "markers": ["ground", "top"], "stiffness": stiffness}
    content = scene("spatial", 8.0, bodies={"top": body}, forces={"mount": mount})
    message, _ = stopped(content)
    assert "mount is half a turn away" in message
    time = float(message.split("t = ")[1].split(" s")[0])
    assert math.asin(math.pi / 5.0) < time < math.asin(math.pi / 5.0) + 0.1


def test_an_event_before_half_a_turn_ends_the_run() -> None:
    slow = {"quantity": "rotor.wz", "value": 4.5, "action": "stop"}
    late = {"quantity": "rotor.wz", "value": -4.0, "direction": "falling"}
    events = {"slow": slow, "late": late}
    result = simulate(compile_scene(rotor("spatial", 5.0, events=events)))
    assert result.completed
    assert result.t[-1] == pytest.approx(math.acos(0.9), abs=1e-6)
    assert [event.name for event in result.events] == ["slow"]


def test_events_behind_half_a_turn_are_forgotten() -> None:
    """wz falls below 3.8 at 0.707 s, in the chunk of steps in which it turns over."""
    late = {"quantity": "rotor.wz", "value": 3.8, "action": "stop"}
    soon = {"quantity": "rotor.wz", "value": 4.5}
    events = {"late": late, "soon": soon}
    _, result = stopped(rotor("spatial", 5.0, events=events))
    assert [event.name for event in result.events] == ["soon"]


def test_a_driven_turn_is_seen_by_its_spring() -> None:
    """The frame of the rotor is eliminated, so that nothing tells its speed before."""
    function = {
        "type": "polynomial",
        "pieces": [{"from": 0.0, "coefficients": [0.0, 2.0]}],
    }
    drives = {"turn": {"joint": "axle", "function": function}}
    message, _ = stopped(rotor("spatial", 0.0, drives=drives))
    time = float(message.split("t = ")[1].split(" s")[0])
    assert time > math.pi / 2.0
