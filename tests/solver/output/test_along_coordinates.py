"""Force, torque and power along coordinates, lengths, deflections and rates."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.result import Result
from sidtool.formats.scene import known_outputs, unit_of
from sidtool.formats.scene.connections import multipliers
from sidtool.solver import compile_scene, simulate
from sidtool.solver.system.joints import PLANAR, SPATIAL

from ..dynamics.joint_scenes import scene

#: Force or torque, and its direction.
Row = tuple[str, Array]
MASS, INERTIA, G = 2.0, 0.3, 9.81
KINDS = [*((name, "planar") for name in PLANAR), *((n, "spatial") for n in SPATIAL)]
DIMENSIONS = ["planar", "spatial"]


def body(dimension: str, **more: Any) -> dict[str, Any]:
    inertia = INERTIA if dimension == "planar" else [INERTIA] * 3
    return {"mass": MASS, "inertia": inertia, **more}


def run(dimension: str, record: list[str], **parts: Any) -> Result:
    end = parts.pop("end", 0.5)
    content = scene(dimension, end, outputs={"record": record}, **parts)
    return simulate(compile_scene(content), rtol=1e-9)


def vector(dimension: str, x: float, y: float) -> list[float]:
    return [x, y] if dimension == "planar" else [x, y, 0.0]


def parabola(*coefficients: float) -> dict[str, Any]:
    piece = {"from": 0.0, "coefficients": coefficients}
    return {"type": "polynomial", "pieces": [piece]}


@pytest.mark.parametrize(("kind", "dimension"), KINDS)
def test_multipliers_are_as_many_as_constraint_rows(kind: str, dimension: str) -> None:
    pitch = {"pitch": 0.1} if kind == "screw" else {}
    place = {"initial": {"position": vector(dimension, 0.4, 0.0)}}
    needs_place = place if kind == "distance" else {}
    content = scene(
        dimension,
        bodies={"b": body(dimension, **needs_place)},
        joints={"j": {"type": kind, "markers": ["ground", "b"], **pitch}},
    )
    system = compile_scene(content).full_joint_system
    rows = sum(row.count for row in system.rows if row.name == "j")
    assert multipliers("j", content) == rows > 0


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_multipliers_of_a_fixed_point_and_of_a_driven_rod(dimension: str) -> None:
    """A point mass has no orientation; a driven length has the row of its drive."""
    end = vector(dimension, 0.4, 0.0)
    content = scene(
        dimension,
        bodies={
            "point": {"mass": 1.0},
            "end": {"mass": 1.0, "initial": {"position": end}},
        },
        joints={
            "weld": {"type": "fixed", "markers": ["ground", "point"]},
            "rod": {"type": "distance", "markers": ["ground", "end"]},
        },
        drives={"winch": {"joint": "rod", "function": parabola(0.4, 0.1)}},
    )
    system = compile_scene(content).full_joint_system
    for name in ("weld", "rod", "winch"):
        rows = sum(row.count for row in system.rows if row.name == name)
        assert multipliers(name, content) == rows, name


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_a_spring_between_markers(dimension: str) -> None:
    """A mass that hangs on it: m (a + g) is its force, upwards where it grows."""
    k, d, rest = 300.0, 4.0, 0.5
    spring = {
        "type": "spring_damper",
        "markers": ["ground", "block"],
        "stiffness": k,
        "damping": d,
        "rest": rest,
    }
    names = ["length", "deflection", "rate", "force", "power", "fy"]
    result = run(
        dimension,
        [*(f"spring.{name}" for name in names), "block.y", "block.vy", "block.ay"],
        gravity=vector(dimension, 0.0, -G),
        bodies={
            "block": body(dimension, initial={"position": vector(dimension, 0, -0.6)})
        },
        forces={"spring": spring},
    )
    length, deflection, rate, force, power, fy = (result[f"spring.{n}"] for n in names)
    assert length == pytest.approx(-result["block.y"], abs=1e-14)
    assert rate == pytest.approx(-result["block.vy"], abs=1e-13)
    assert deflection == pytest.approx(length - rest, abs=1e-14)
    assert force == pytest.approx(-k * (length - rest) - d * rate, abs=1e-11)
    assert fy == pytest.approx(-force, abs=1e-11)
    assert MASS * (result["block.ay"] + G) == pytest.approx(-force, abs=1e-9)
    assert power == pytest.approx(force * rate, abs=1e-11)


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("rubs", [False, True])
def test_a_driven_slide(dimension: str, rubs: bool) -> None:
    """Up a slope of 3 in 5 with growing speed, against friction: m (a + 0.6 g) + mu N.

    The friction of a driven joint is a part of its own force; without friction the
    frame of the body is prescribed and has no coordinates.
    """
    mu, acceleration = 0.2, 3.0
    friction = {"friction": {"coefficient": mu}} if rubs else {}
    slide = {"markers": ["ground", "block"], "axis": vector(dimension, 0.8, 0.6)}
    result = run(
        dimension,
        [f"{owner}.{q}" for owner in ("push", "slide") for q in ("force", "power")],
        gravity=vector(dimension, 0.0, -G),
        bodies={"block": body(dimension)},
        joints={"slide": {"type": "prismatic", **slide, **friction}},
        drives={
            "push": {"joint": "slide", "function": parabola(0.0, 0.1, acceleration / 2)}
        },
    )
    rate = 0.1 + acceleration * result.t
    lost = mu * MASS * 0.8 * G if rubs else 0.0
    lifted = MASS * (acceleration + 0.6 * G)
    assert result["push.force"] == pytest.approx(lifted + lost, rel=1e-9)
    assert result["push.power"] == pytest.approx((lifted + lost) * rate, rel=1e-9)
    assert result["slide.force"] == pytest.approx(lifted, rel=1e-9)
    assert result["slide.power"] == pytest.approx(lifted * rate, rel=1e-9)


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("flips", [False, True])
def test_the_torque_of_a_motor(dimension: str, flips: bool) -> None:
    """J alpha + m g l cos(angle) of an arm, whichever body its joint names first."""
    arm, alpha = 0.7, 2.0
    markers = ["ground", "arm.hinge"]
    sign = -1.0 if flips else 1.0
    hinge = {"type": "revolute", "markers": markers[::-1] if flips else markers}
    result = run(
        dimension,
        ["motor.torque", "hinge.torque", "motor.power", "arm.angle"],
        gravity=vector(dimension, 0.0, -G),
        bodies={
            "arm": body(
                dimension, markers={"hinge": {"position": vector(dimension, -arm, 0.0)}}
            )
        },
        joints={"hinge": hinge},
        drives={
            "motor": {"joint": "hinge", "function": parabola(0, 0, sign * alpha / 2)}
        },
    )
    angle = alpha * result.t**2 / 2
    torque = (INERTIA + MASS * arm**2) * alpha + MASS * G * arm * np.cos(angle)
    assert result["motor.torque"] == pytest.approx(sign * torque, rel=1e-8)
    assert result["hinge.torque"] == pytest.approx(sign * torque, rel=1e-8)
    assert result["motor.power"] == pytest.approx(torque * alpha * result.t, abs=1e-6)


def test_what_acts_in_a_joint_adds_up() -> None:
    """A spring, an actuator and friction of a constant limit in one hinge."""
    spring = {"type": "spring_damper", "joint": "hinge", "stiffness": 5.0, "rest": 0.2}
    push = {"type": "constant", "value": 3.0}
    rub = {"type": "friction", "joint": "hinge", "force": 0.5, "speed": 0.01}
    each = [
        f"{name}.{q}" for name in ("spring", "push", "rub") for q in ("torque", "power")
    ]
    result = run(
        "planar",
        ["hinge.torque", "hinge.power", *each, "spring.deflection", "push.rate"]
        + ["push.deflection", "hinge.angle", "hinge.angle_rate"],
        bodies={"wheel": body("planar", initial={"angular_velocity": 1.0})},
        joints={"hinge": {"type": "revolute", "markers": ["ground", "wheel"]}},
        forces={
            "spring": spring,
            "push": {
                "type": "actuator",
                "joint": "hinge",
                "rest": 0.3,
                "function": push,
            },
            "rub": rub,
        },
    )
    angle, rate = result["hinge.angle"], result["hinge.angle_rate"]
    assert result["spring.deflection"] == pytest.approx(angle - 0.2, abs=1e-14)
    assert result["push.deflection"] == pytest.approx(angle - 0.3, abs=1e-14)
    assert result["push.rate"] == pytest.approx(rate, abs=1e-14)
    assert result["spring.torque"] == pytest.approx(-5.0 * (angle - 0.2), abs=1e-12)
    assert result["push.torque"] == pytest.approx(3.0, abs=1e-13)
    assert result["rub.torque"] == pytest.approx(-0.5 * np.tanh(rate / 0.01), abs=1e-12)
    for quantity in ("torque", "power"):
        parts = [result[f"{name}.{quantity}"] for name in ("spring", "push", "rub")]
        total = result[f"hinge.{quantity}"]
        assert total == pytest.approx(np.sum(parts, axis=0), abs=1e-11)
    assert result["hinge.power"] == pytest.approx(
        result["hinge.torque"] * rate, abs=1e-11
    )


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_the_tension_of_a_rod(dimension: str) -> None:
    """A pendulum pulls its rod by m g cos + m v^2 / L, which is a negative force."""
    length = 0.8
    result = run(
        dimension,
        ["rod.force", "bob.y", "bob.vx", "bob.vy"],
        gravity=vector(dimension, 0.0, -G),
        bodies={
            "bob": {"mass": MASS, "initial": {"position": vector(dimension, length, 0)}}
        },
        joints={"rod": {"type": "distance", "markers": ["ground", "bob"]}},
    )
    square = result["bob.vx"] ** 2 + result["bob.vy"] ** 2
    tension = MASS * (-G * result["bob.y"] + square) / length
    assert result["rod.force"] == pytest.approx(-tension, abs=1e-6)


def test_the_thread_of_a_screw() -> None:
    """A nut on a spindle falls by its weight: force and torque of the thread are those
    that accelerate and turn it."""
    pitch = 0.2
    result = run(
        "spatial",
        ["nut.force", "nut.torque", "body.az", "nut.displacement"],
        gravity=[0.0, 0.0, -G],
        bodies={"body": body("spatial")},
        joints={
            "nut": {"type": "screw", "markers": ["ground", "body"], "pitch": pitch}
        },
    )
    turning = INERTIA * (2.0 * math.pi / pitch) ** 2
    fall = -MASS * G / (MASS + turning)
    assert result["body.az"] == pytest.approx(fall, rel=1e-9)
    assert result["nut.force"] == pytest.approx(MASS * (fall + G), rel=1e-9)
    torque = INERTIA * fall * 2.0 * math.pi / pitch
    assert result["nut.torque"] == pytest.approx(torque, rel=1e-9)


def test_the_torque_of_a_driven_orientation() -> None:
    """A drive of a marker's rotation about a tilted axis spins a ball up."""
    axis = [0.6, 0.0, 0.8]
    turn = {"marker": "ball", "coordinate": "rotation", "axis": axis}
    result = run(
        "spatial",
        ["turn.torque", "turn.power"],
        bodies={"ball": body("spatial")},
        drives={"turn": {**turn, "function": parabola(0.0, 0.0, 2.0)}},
    )
    assert result["turn.torque"] == pytest.approx(4.0 * INERTIA, rel=1e-9)
    assert result["turn.power"] == pytest.approx(16.0 * INERTIA * result.t, abs=1e-9)


def test_events_look_at_a_spring() -> None:
    """A harmonic motion of amplitude a: the force passes k a / 2 after a sixth."""
    spring = {"type": "spring_damper", "markers": ["ground", "b"], "stiffness": 50.0}
    event = {"quantity": "spring.force", "value": -50.0 * 0.5, "direction": "rising"}
    result = run(
        "planar",
        ["spring.deflection"],
        bodies={"b": body("planar", initial={"position": [1.0, 0.0]})},
        forces={"spring": spring},
        events={"half": event},
    )
    omega = math.sqrt(50.0 / MASS)
    assert result.events[0].t == pytest.approx(math.pi / 3.0 / omega, rel=1e-7)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("hinge.force", "torque"),
        ("spring.torque", "force"),
        ("load.length", "power"),
        ("b.force", "joint, drive or force"),
        ("sprung.force", "spring"),
        ("hinge.f3", "f1 to f2"),
        ("spring.value", "deflection"),
    ],
)
def test_what_there_is_not_is_refused(name: str, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        scene(
            "planar",
            bodies={"b": body("planar")},
            joints={"hinge": {"type": "revolute", "markers": ["ground", "b"]}},
            forces={
                "spring": {
                    "type": "spring_damper",
                    "markers": ["ground", "b"],
                    "stiffness": 1,
                },
                "load": {"type": "force", "marker": "b", "force": [1.0, 0.0]},
            },
            outputs={"record": [name]},
        )


def test_wildcards_mean_the_same_for_all_parts() -> None:
    """What `PART.f*` stands for does not depend on the kind of the part."""
    content = scene(
        "planar",
        bodies={
            "b": body("planar"),
            "c": body("planar", initial={"position": [1.0, 0.0]}),
        },
        joints={
            "pin": {"type": "revolute", "markers": ["ground", "b"]},
            "d1": {"type": "distance", "markers": ["ground", "c"]},
            "d2": {"type": "distance", "markers": ["b", "c"]},
        },
        drives={"motor": {"joint": "pin", "function": parabola(0.0, 1.0)}},
        forces={
            "mount": {"type": "bushing", "markers": ["b", "c"], "stiffness": [1, 1, 1]}
        },
    )
    wanted = {
        "pin.f*": ["pin.fx", "pin.fy", "pin.f1", "pin.f2"],
        "mount.f*": ["mount.fx", "mount.fy"],
        "d*.f1": ["d1.f1", "d2.f1"],
        "motor.f*": ["motor.fx", "motor.fy", "motor.f1"],
        "*.torque": ["pin.torque", "motor.torque"],
    }
    for pattern, names in wanted.items():
        recorded = content.with_({"outputs.record": [pattern]})
        assert list(simulate(compile_scene(recorded)).names) == names
    every = [
        n for n in known_outputs(content, {}) if n.rpartition(".")[2].startswith("f")
    ]
    recorded = content.with_({"outputs.record": ["*.f*"]})
    assert list(simulate(compile_scene(recorded)).names) == every
    assert all(unit_of(name, content) for name in every)


def directions(kind: str, dimension: str, axis: Array, second: Array) -> list[Row]:
    """What f1, f2, ... of a joint with aligned markers are, as docs/howto/scenes.md
    says: force or torque, and its direction."""
    x, y, z = np.eye(3)
    left = np.cross(z, axis)
    n1 = np.cross(np.eye(3)[int(np.argmin(np.abs(axis)))], axis)
    n1 /= np.linalg.norm(n1)
    n2 = np.cross(axis, n1)
    across: list[Row] = [("f", n1), ("f", n2)]
    about: list[Row] = [("m", n2), ("m", -n1)]
    held: list[Row] = [("m", -z), ("m", -x), ("m", -y)]
    if dimension == "planar":
        place: list[Row] = [("f", x), ("f", y)]
        return {
            "fixed": [*place, ("m", z)],
            "prismatic": [("f", left), ("m", z)],
            "point_on_line": [("f", left)],
        }.get(kind, place)
    place = [("f", x), ("f", y), ("f", z)]
    return {
        "fixed": [*place, *held],
        "revolute": [*place, *about],
        "prismatic": [*across, *held],
        "cylindrical": [*across, *about],
        "universal": [*place, ("m", np.cross(second, axis))],
        "planar": [("f", axis), *about],
        "point_on_line": across,
        "point_on_plane": [("f", axis)],
    }.get(kind, place)


@pytest.mark.parametrize(
    ("kind", "dimension"),
    [pair for pair in KINDS if pair[0] not in ("distance", "screw")],
)
def test_multipliers_are_along_the_documented_directions(
    kind: str, dimension: str
) -> None:
    """Of a body at rest under a force and a torque; a held reaction has all parts."""
    plane = dimension == "planar"
    axis, second = np.array([0.6, 0.8, 0.0]), np.array([0.8, -0.6, 0.0])
    if not plane:
        turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, -0.8], [0.0, 0.8, 0.6]])
        axis, second = turn @ axis, turn @ second
    more: dict[str, Any] = {}
    if kind not in ("fixed", "spherical", "coincident") and not (
        plane and kind == "revolute"
    ):
        more["axis"] = axis[:2].tolist() if plane else axis.tolist()
    if kind == "universal":
        more["second_axis"] = second.tolist()
    force, torque = [2.0, -3.0, 5.0], [0.7, 1.1, -1.3]
    load = {"force": force[:2], "torque": torque[2]} if plane else {}
    load = load or {"force": force, "torque": torque}
    words = ("fx", "fy", "fz", "mx", "my", "mz")
    known = ("fx", "fy", "mz") if plane else words
    rows = directions(kind, dimension, axis, second)
    result = run(
        dimension,
        [f"j.{word}" for word in known] + [f"j.f{k + 1}" for k in range(len(rows))],
        end=0.01,
        bodies={"b": body(dimension)},
        joints={"j": {"type": kind, "markers": ["ground", "b"], **more}},
        forces={"load": {"type": "force", "marker": "b", **load}},
    )
    total = {"f": np.zeros(3), "m": np.zeros(3)}
    for k, (word, direction) in enumerate(rows):
        total[word] += result[f"j.f{k + 1}"][0] * direction
    parts = [*total["f"], *total["m"]]
    for word in known:
        expected = parts[words.index(word)]
        assert result[f"j.{word}"][0] == pytest.approx(expected, abs=1e-9), word
    assert np.abs(parts).max() > 1.0
