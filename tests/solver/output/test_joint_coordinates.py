"""Coordinates of joints as outputs and in events, against analytic motions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sidtool.formats.base.errors import InputError
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene, simulate

from ..dynamics.joint_scenes import scene

#: Gravity; distance from the hinge, mass and moment of inertia of pendulums.
G, L, M, J = 9.81, 0.5, 2.0, 0.1
#: Square of the angular frequency of small oscillations.
W2 = M * G * L / (M * L**2 + J)


def ran(content: SceneFile, **settings: Any) -> Result:
    return simulate(compile_scene(content), **{"rtol": 1e-9, **settings})


def plane(dimension: str, x: float, y: float) -> list[float]:
    """A vector in the plane of the motion."""
    return [x, y] if dimension == "planar" else [x, y, 0.0]


def rod(
    dimension: str, height: float, spin: float = 0.0, mass: float = M
) -> dict[str, Any]:
    """A hanging body with a hinge at the distance L above and one at its centre."""
    flat = dimension == "planar"
    ends = {"top": (0.0, L), "foot": (0.0, 0.0)}
    return {
        "mass": mass,
        "inertia": J if flat else [0.3, 0.2, J],
        "markers": {
            name: {"position": plane(dimension, *p)} for name, p in ends.items()
        },
        "initial": {
            "position": plane(dimension, 0.0, height),
            "velocity": plane(dimension, spin * L, 0.0),
            "angular_velocity": spin if flat else [0.0, 0.0, spin],
        },
    }


def pendulum(dimension: str, spin: float, **tables: Any) -> SceneFile:
    content: dict[str, Any] = {
        "gravity": plane(dimension, 0.0, -G),
        "bodies": {"bob": rod(dimension, -L, spin)},
        "joints": {"hinge": {"type": "revolute", "markers": ["ground", "bob.top"]}},
        "outputs": {"record": ["hinge.angle", "hinge.angle_rate"]},
    }
    return scene(dimension, 4.0, **(content | tables))


def swing(spin: float, t: np.ndarray) -> np.ndarray:
    """Angle and angular velocity of a pendulum, (2, nt)."""
    found = solve_ivp(
        lambda _, y: [y[1], -W2 * math.sin(y[0])],
        (0.0, t[-1]),
        [0.0, spin],
        method="DOP853",
        t_eval=t,
        rtol=1e-12,
        atol=1e-12,
    )
    return np.asarray(found.y)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize("spin", [3.0, 12.0], ids=["swings", "turns over"])
def test_the_angle_of_a_pendulum(dimension: str, spin: float) -> None:
    result = ran(pendulum(dimension, spin))
    angle, rate = swing(spin, result.t)
    assert (angle.max() > 6.0 * np.pi) == (spin > 10.0)
    assert result["hinge.angle"] == pytest.approx(angle, abs=1e-6)
    assert result["hinge.angle_rate"] == pytest.approx(rate, abs=1e-5)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_an_event_in_the_third_turn(dimension: str) -> None:
    """The time from an angle to the rate there is that of the energy."""
    there = 5.5 * np.pi
    stop = {"quantity": "hinge.angle", "value": there, "action": "stop"}
    result = ran(pendulum(dimension, 12.0, events={"there": stop}))
    assert result["hinge.angle"][-1] == pytest.approx(there, abs=1e-8)
    rate = math.sqrt(12.0**2 - 2.0 * W2 * (1.0 - math.cos(there)))
    assert result["hinge.angle_rate"][-1] == pytest.approx(rate, rel=1e-7)
    assert swing(12.0, result.t)[0, -1] == pytest.approx(there, abs=1e-6)


def double_pendulum(dimension: str, **tables: Any) -> SceneFile:
    content: dict[str, Any] = {
        "gravity": plane(dimension, 0.0, -G),
        "bodies": {
            "a": rod(dimension, -L, mass=20.0 * M),
            "b": rod(dimension, -2 * L, 25.0),
        },
        "joints": {
            "upper": {"type": "revolute", "markers": ["ground", "a.top"]},
            "lower": {"type": "revolute", "markers": ["a.foot", "b.top"]},
        },
        "outputs": {"record": ["upper.angle", "lower.angle", "lower.angle_rate"]},
    }
    return scene(dimension, 1.0, **(content | tables))


def test_the_relative_angle_of_a_double_pendulum() -> None:
    """In the plane a difference of coordinates; in space what it is in the plane."""
    flat, space = (ran(double_pendulum(d)) for d in ("planar", "spatial"))
    angles = {n: flat.position_names.index(f"{n}.angle") for n in "ab"}
    relative = flat.positions[:, angles["b"]] - flat.positions[:, angles["a"]]
    assert np.ptp(relative) > 4.0 * np.pi
    assert flat["lower.angle"] == pytest.approx(relative, abs=1e-12)
    for name in flat.names:
        size = np.abs(flat[name]).max()
        assert space[name] == pytest.approx(flat[name], abs=1e-6 * size)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_an_event_between_two_moving_bodies(dimension: str) -> None:
    """The lower rod makes a full turn against the upper one."""
    stop = {"quantity": "lower.angle", "value": 2.0 * np.pi, "action": "stop"}
    result = ran(double_pendulum(dimension, events={"turned": stop}))
    assert result.events[-1].name == "turned"
    assert result["lower.angle"][-1] == pytest.approx(2.0 * np.pi, abs=1e-8)
    whole = ran(double_pendulum(dimension))
    before = whole.t < result.t[-1]
    assert (whole["lower.angle"][before] < 2.0 * np.pi).all()
    assert whole["lower.angle"][~before][0] > 2.0 * np.pi


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize("kind", ["prismatic", "point_on_line"])
def test_the_displacement_of_a_slider(dimension: str, kind: str) -> None:
    """On a spring along an axis across the frames: x = 0.2 cos(3 t) from rest."""
    body = {"mass": 2.0, "inertia": 1.0 if dimension == "planar" else [1.0] * 3}
    body["initial"] = {"position": plane(dimension, 0.18, 0.24)}
    axis = plane(dimension, 0.6, 0.8)
    joint = {"type": kind, "markers": ["ground", "slider"], "axis": axis}
    spring = {"type": "spring_damper", "joint": "guide", "stiffness": 18.0, "rest": 0.1}
    tables = {
        "bodies": {"slider": body},
        "joints": {"guide": joint},
        "forces": {"spring": spring},
        "outputs": {"record": ["guide.displacement", "guide.displacement_rate"]},
    }
    result = ran(scene(dimension, 3.0, **tables))
    exact = 0.1 + 0.2 * np.cos(3.0 * result.t), -0.6 * np.sin(3.0 * result.t)
    for column, values in zip(result.values.T, exact, strict=True):
        assert column == pytest.approx(values, abs=1e-7)


def test_a_cylindrical_joint_has_two_coordinates() -> None:
    """A screw without thread, about an axis across, on a ground that is turned."""
    axis, spin, speed = np.array([2.0, -1.0, 2.0]) / 3.0, 9.0, 0.7
    initial = {
        "velocity": (speed * axis).tolist(),
        "angular_velocity": (spin * axis).tolist(),
    }
    body = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "initial": initial}
    joint = {"type": "cylindrical", "markers": ["ground", "nut"], "axis": axis.tolist()}
    words = ("angle", "angle_rate", "displacement", "displacement_rate")
    tables = {
        "bodies": {"nut": body},
        "joints": {"bolt": joint},
        "outputs": {"record": [f"bolt.{word}" for word in words]},
    }
    result = ran(scene("spatial", 5.0, **tables))
    t = result.t
    exact = spin * t, spin + 0.0 * t, speed * t, speed + 0.0 * t
    for column, values in zip(result.values.T, exact, strict=True):
        assert column == pytest.approx(values, abs=1e-7)


def test_a_universal_joint_has_two_angles() -> None:
    """What drives prescribe, beyond a turn about both axes."""
    speeds = {"angle_1": 7.0, "angle_2": -5.0}
    drives = {}
    for name, speed in speeds.items():
        pieces = [{"from": 0.0, "coefficients": [0.0, speed]}]
        function = {"type": "polynomial", "pieces": pieces}
        drives[name] = {"joint": "cross", "coordinate": name, "function": function}
    body = {"mass": 1.0, "inertia": [1.0, 2.0, 3.0]}
    record = [f"cross.{name}{end}" for name in speeds for end in ("", "_rate")]
    tables = {
        "bodies": {"shaft": body},
        "joints": {"cross": {"type": "universal", "markers": ["ground", "shaft"]}},
        "drives": drives,
        "outputs": {"record": record},
    }
    result = ran(scene("spatial", 4.0, **tables))
    for name, speed in speeds.items():
        assert result[f"cross.{name}"] == pytest.approx(speed * result.t, abs=1e-8)
        assert result[f"cross.{name}_rate"] == pytest.approx(
            speed + 0.0 * result.t, abs=1e-8
        )


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_the_length_of_a_rod_that_grows_and_of_one_that_does_not(
    dimension: str,
) -> None:
    """A load on a boom of 2 + t / 2 metres, whose angular momentum stays: it turns by
    3 - 6 / (2 + t / 2) rad at 0.75 rad/s; behind it a rod of 1.3 m as it was mounted.
    """
    load = {"mass": 2.0, "initial": {"position": plane(dimension, 2.0, 0.0)}}
    load["initial"]["velocity"] = plane(dimension, 0.5, 1.5)
    tail = {"mass": 1e-9, "initial": {"position": plane(dimension, 2.5, 1.2)}}
    tail["initial"]["velocity"] = plane(dimension, 0.5, 1.5)
    joints = {
        "boom": {"type": "distance", "markers": ["ground", "load"]},
        "rope": {"type": "distance", "markers": ["load", "tail"]},
    }
    pieces = [{"from": 0.0, "coefficients": [2.0, 0.5]}]
    function = {"type": "polynomial", "pieces": pieces}
    words = [f"{joint}.length{end}" for joint in joints for end in ("", "_rate")]
    tables = {
        "bodies": {"load": load, "tail": tail},
        "joints": joints,
        "drives": {"winch": {"joint": "boom", "function": function}},
        "events": {"long": {"quantity": "boom.length", "value": 3.0}},
        "outputs": {"record": [*words, "load.x", "load.y", "tail.x", "tail.y"]},
    }
    result = ran(scene(dimension, 4.0, **tables))
    length = 2.0 + 0.5 * result.t
    angle = 3.0 - 6.0 / length
    assert result["load.x"] == pytest.approx(length * np.cos(angle), abs=1e-6)
    assert result["load.y"] == pytest.approx(length * np.sin(angle), abs=1e-6)
    exact = length, 0.5 + 0.0 * length, 1.3 + 0.0 * length, 0.0 * length
    for name, values in zip(words, exact, strict=True):
        assert result[name] == pytest.approx(values, abs=1e-9)
    gap = [result[f"tail.{axis}"] - result[f"load.{axis}"] for axis in "xy"]
    assert np.hypot(*gap) == pytest.approx(1.3, abs=1e-9)
    assert [event.t for event in result.events] == pytest.approx([2.0], abs=1e-9)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("hinge.displacement", "has no coordinate 'displacement'"),
        ("hinge.displacement_rate", "has no coordinate 'displacement'"),
        ("bob.angle_rate", "there is no joint 'bob'"),
        ("hinge.angle_3", "the joint hinge has no 'angle_3'"),
        ("bob.top.angle_3", "found 'bob.top.angle_3'"),
    ],
)
def test_coordinates_that_do_not_exist(name: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        pendulum("planar", 1.0, outputs={"record": [name]})


def test_an_angle_that_is_looked_at_changes_no_motion() -> None:
    """It is no coordinate that errors are measured in."""
    plain = ran(pendulum("spatial", 12.0, outputs={"record": []}))
    watched = ran(pendulum("spatial", 12.0))
    assert watched.position_names[-1] == "hinge.angle"
    assert np.array_equal(watched.positions[:, :-1], plain.positions)
