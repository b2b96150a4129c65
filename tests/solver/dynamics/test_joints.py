"""Every joint: what it blocks, what it leaves free, and that its force does no work."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.solver import compile_scene, simulate
from sidtool.solver.initial_state.assembly import dense_jacobian
from sidtool.solver.system.joints import PLANAR, SPATIAL

from .joint_scenes import PITCH, conserved, evaluated, marker, pair, scene, turned

# What a joint holds at zero, from the position d of the second marker and its
# orientation Q seen from the first, with the default axes; and how many rows it takes.
Held = Callable[[Array, Array], Any]
LEAD = PITCH / (2.0 * np.pi)
HELD_SPATIAL: dict[str, tuple[int, Held]] = {
    "fixed": (6, lambda d, Q: [*d, *(Q - np.eye(3)).ravel()]),
    "revolute": (5, lambda d, Q: [*d, Q[2, 2] - 1]),
    "prismatic": (5, lambda d, Q: [d[1], d[2], *(Q - np.eye(3)).ravel()]),
    "cylindrical": (4, lambda d, Q: [d[0], d[1], Q[2, 2] - 1]),
    "screw": (5, lambda d, Q: [d[0], d[1], *(Q - turned(d[2] / LEAD)).ravel()]),
    "spherical": (3, lambda d, Q: d),
    "universal": (4, lambda d, Q: [*d, Q[0, 1]]),
    "planar": (3, lambda d, Q: [d[2], Q[2, 2] - 1]),
    "point_on_line": (2, lambda d, Q: [d[1], d[2]]),
    "point_on_plane": (1, lambda d, Q: [d[2]]),
    "coincident": (3, lambda d, Q: d),
    "distance": (1, lambda d, Q: [np.linalg.norm(d) - 1.5]),
}
HELD_PLANAR: dict[str, tuple[int, Held]] = {
    "fixed": (3, lambda d, Q: [*d, Q[0, 1]]),
    "revolute": (2, lambda d, Q: d),
    "prismatic": (2, lambda d, Q: [d[1], Q[0, 1]]),
    "point_on_line": (1, lambda d, Q: [d[1]]),
    "coincident": (2, lambda d, Q: d),
    "distance": (1, lambda d, Q: [np.linalg.norm(d) - 1.5]),
}
CASES = [("planar", kind) for kind in PLANAR] + [("spatial", kind) for kind in SPATIAL]


@pytest.mark.parametrize("flexible", [False, True], ids=["rigid", "flexible"])
@pytest.mark.parametrize(("dimension", "kind"), CASES)
def test_a_joint_holds_its_freedoms_and_does_no_work(
    dimension: str, kind: str, flexible: bool
) -> None:
    """Two free bodies: energy and both momenta stay, and the joint stays closed."""
    joint = {"type": kind} | ({"length": 1.5} if kind == "distance" else {})
    content, sids = pair(dimension, joint, flexible)
    system = compile_scene(content, sids=sids)
    rows, held = (HELD_PLANAR if dimension == "planar" else HELD_SPATIAL)[kind]
    assert system.n_rows == rows
    result = simulate(system, rtol=1e-9)
    before, after = (
        (result.positions[k], result.velocities[k], result.t[k]) for k in (0, -1)
    )
    kept = []
    for z, v, t in (before, after):
        work = evaluated(system, t, z, v)
        assert np.linalg.matrix_rank(dense_jacobian(system, work.C), 1e-6) == rows
        x, R = marker(system, work, ("left", "end"))
        y, S = marker(system, work, ("right", "end"))
        assert np.abs(held(R.T @ (y - x), R.T @ S)).max() < 1e-10
        kept.append(conserved(system, work, z, v))
    assert np.abs(kept[1] - kept[0]).max() < 1e-6 * np.abs(kept[0]).max()
    assert kept[0][0] > 0.1
    moved = np.abs(after[0] - before[0]).max()
    assert moved > 0.1


@pytest.mark.parametrize(
    ("pitch", "inertia", "axis"),
    [(0.05, 2e-4, [0.0, 0.0, 1.0]), (-0.3, 5e-3, [1.0, -2.0, 2.0])],
    ids=["right hand", "left hand"],
)
def test_a_nut_on_a_screw_falls_slower_by_what_it_has_to_turn(
    pitch: float, inertia: float, axis: list[float]
) -> None:
    """a = g cos / (1 + J (2 pi / p)^2 / m); the bolt bears the rest, m (g cos - a), and
    turns the nut by J a 2 pi / p about itself."""
    mass, n = 1.3, np.array(axis) / np.linalg.norm(axis)
    nut: dict[str, Any] = {"mass": mass, "inertia": 3 * [inertia]}
    bolt = {"type": "screw", "markers": ["ground", "nut"], "axis": axis}
    names = ("displacement", "angle", *(f"{c}{e}" for c in "fm" for e in "xyz"))
    content = scene(
        "spatial",
        2.0,
        gravity=[0.0, 0.0, -9.81],
        bodies={"nut": nut},
        joints={"bolt": {**bolt, "pitch": pitch}},
        outputs={"record": (*(f"bolt.{name}" for name in names), "energy.balance")},
    )
    system = compile_scene(content)
    assert system.n_rows == 5
    result = simulate(system, rtol=1e-10)
    along, per_metre = -9.81 * n[2], 2.0 * np.pi / pitch
    a = along / (1.0 + inertia * per_metre**2 / mass)
    fall = 0.5 * a * result.t**2
    assert result.values[:, 0] == pytest.approx(fall, abs=1e-8 * abs(fall[-1]))
    assert result.values[:, 1] == pytest.approx(
        per_metre * fall, abs=1e-8 * abs(per_metre * fall[-1])
    )
    assert abs(per_metre * fall[-1]) > 4.0 * np.pi
    forces, moments = result.values[:, 2:5] @ n, result.values[:, 5:8] @ n
    assert forces == pytest.approx(mass * (a - along), rel=1e-8)
    assert moments == pytest.approx(inertia * per_metre * a, rel=1e-8)
    assert np.ptp(result.values[:, 8]) < 1e-9 * mass * abs(along * fall[-1])


def test_a_screw_without_pitch_is_refused() -> None:
    with pytest.raises(InputError, match="joints.joint.pitch"):
        content, sids = pair("spatial", {"type": "screw", "pitch": 0.0}, False)
        compile_scene(content, sids=sids)


def test_every_joint_has_its_physics_stated() -> None:
    assert set(HELD_PLANAR) == set(PLANAR)
    assert set(HELD_SPATIAL) == set(SPATIAL)


def pendulum(dimension: str, joint: dict[str, Any], start: float = -1.0) -> Any:
    """R5 A01: a point mass on 1 m, released at rest, horizontal at -x."""
    plane = dimension == "planar"
    gravity = [0.0, -9.81] if plane else [0.0, -9.81, 0.0]
    place = [start, 0.0] if plane else [start, 0.0, 0.0]
    bodies: dict[str, Any] = {"bob": {"mass": 1.0, "initial": {"position": place}}}
    joints = {"rod": {"type": "distance", "markers": ["ground", "bob"], **joint}}
    if not plane:
        joints["plane"] = {"type": "point_on_plane", "markers": ["ground", "bob"]}
    outputs = {"record": ["bob.x", "bob.y", "rod.f1"]}
    return scene(
        dimension,
        10.0,
        gravity=gravity,
        bodies=bodies,
        joints=joints,
        outputs=outputs,
    )


@pytest.mark.parametrize("joint", [{"length": 1.0}, {}], ids=["given", "from start"])
@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_mass_on_a_rod_is_the_published_pendulum(
    dimension: str, joint: dict[str, Any]
) -> None:
    result = simulate(compile_scene(pendulum(dimension, joint)), rtol=1e-11)
    exact = [-0.2750874625761169, -0.9614192050991251]
    assert np.abs(result.values[-1, :2] - exact).max() < 1e-8
    # the rod pulls with m (v^2 / L - g y / L), from the energy m v^2 / 2 = -m g y
    tension = -3.0 * 9.81 * result.values[:, 1]
    assert np.abs(np.abs(result.values[:, 2]) - tension).max() < 1e-6


def test_a_rod_needs_two_points() -> None:
    content = pendulum("planar", {}, start=0.0)
    with pytest.raises(InputError, match="rod coincide at the start"):
        simulate(compile_scene(content))


@pytest.mark.parametrize("bend", [0.3, 0.9])
def test_a_universal_joint_turns_its_output_unevenly(bend: float) -> None:
    """tan(output) = tan(input) / cos(bend), for shafts at an angle."""
    along = [np.cos(bend), np.sin(bend), 0.0]
    shaft = {"mass": 1.0, "inertia": [0.1, 0.1, 0.1]}
    end = {"markers": {"end": {"position": [1.0, 0.0, 0.0]}}}
    content = scene(
        "spatial",
        2.0,
        ground={"markers": {"far": {"position": along}}},
        bodies={
            "input": shaft,
            "output": {**shaft, **end, "initial": {"axis_angle": [0.0, 0.0, bend]}},
        },
        joints={
            "bearing": {
                "type": "revolute",
                "markers": ["ground", "input"],
                "axis": [1.0, 0.0, 0.0],
            },
            "cross": {
                "type": "universal",
                "markers": ["input", "output"],
                "axis": [0.0, 1.0, 0.0],
                "second_axis": [0.0, 0.0, 1.0],
            },
            "support": {
                "type": "point_on_line",
                "markers": ["ground.far", "output.end"],
                "axis": along,
            },
        },
        drives={
            "motor": {
                "joint": "bearing",
                "function": {
                    "type": "polynomial",
                    "pieces": [{"from": 0.0, "coefficients": [0.0, 5.0]}],
                },
            }
        },
        outputs={"record": ["output.wx", "output.wy"]},
    )
    system = compile_scene(content)
    assert list(system.eliminated) == ["bearing", "motor"]
    result = simulate(system, rtol=1e-10)
    angle = 5.0 * result.t
    rate = 5.0 * np.cos(bend) / (1.0 - np.sin(bend) ** 2 * np.cos(angle) ** 2)
    exact = rate[:, None] * np.array(along[:2])
    assert np.abs(result.values - exact).max() < 1e-6


def test_slopes_accelerate_as_galilei_says() -> None:
    """A ball on a slope, and a turning puck on the same slope that keeps its spin."""
    slope, g = 0.4, 9.81
    normal = [np.sin(slope), 0.0, np.cos(slope)]
    down = np.array([np.cos(slope), 0.0, -np.sin(slope)])
    turned = {
        "axis_angle": [0.0, slope, 0.0],
        "angular_velocity": [3 * n for n in normal],
    }
    content = scene(
        "spatial",
        1.0,
        gravity=[0.0, 0.0, -g],
        bodies={
            "ball": {"mass": 2.0, "initial": {"velocity": [0.0, 1.0, 0.0]}},
            "puck": {"mass": 2.0, "inertia": [0.1, 0.2, 0.25], "initial": turned},
        },
        joints={
            "slope": {
                "type": "point_on_plane",
                "markers": ["ground", "ball"],
                "axis": normal,
            },
            "ice": {
                "type": "planar",
                "markers": ["ground.slope", "puck"],
            },
        },
        ground={"markers": {"slope": {"axis_angle": [0.0, slope, 0.0]}}},
        outputs={
            "record": [f"{b}.{q}" for b in ("ball", "puck") for q in "xyz"]
            + ["puck.wx", "puck.wz"]
        },
    )
    result = simulate(compile_scene(content), rtol=1e-10)
    path = 0.5 * g * np.sin(slope) * result.t[:, None] ** 2 * down
    side = np.outer(result.t, [0.0, 1.0, 0.0])
    assert np.abs(result.values[:, :3] - path - side).max() < 1e-8
    assert np.abs(result.values[:, 3:6] - path).max() < 1e-8
    spin = np.array([3 * normal[0], 3 * normal[2]])
    assert np.abs(result.values[:, 6:] - spin).max() < 1e-8


def slider(dimension: str) -> Any:
    """A planar mechanism with every kind of planar joint, a gear and two drives."""
    plane = dimension == "planar"

    def vector(x: float, y: float) -> list[float]:
        return [x, y] if plane else [x, y, 0.0]

    def link(mass: float, length: float, x: float, y: float) -> dict[str, Any]:
        inertia = mass * length**2 / 12.0
        return {
            "mass": mass,
            "inertia": inertia if plane else [inertia, 2 * inertia, inertia],
            "centre_of_mass": vector(length / 2, 0.0),
            "markers": {"end": {"position": vector(length, 0.0)}},
            "initial": {"position": vector(x, y)},
        }

    def joint(kind: str, *markers: str, axis: Any = None) -> dict[str, Any]:
        line = {} if axis is None else {"axis": vector(*axis)}
        return {"type": kind, "markers": list(markers), **line}

    sine = {"type": "harmonic", "amplitude": 0.2, "frequency": 1.5}
    return scene(
        dimension,
        0.5,
        gravity=vector(0.0, -9.81),
        ground={"markers": {"wall": {"position": vector(0.0, -0.6)}}},
        bodies={
            "crank": link(1.0, 0.3, 0.0, 0.0),
            "rod": link(2.0, 1.0, 0.3, 0.0),
            "block": link(3.0, 0.2, 1.3, 0.0),
            "wheel": link(0.5, 0.2, 0.0, -0.6),
            "cart": link(1.5, 0.2, 0.4, -0.6),
            "weight": {"mass": 0.7, "initial": {"position": vector(0.5, -1.1)}},
        },
        joints={
            "bearing": joint("revolute", "ground", "crank"),
            "pin": joint("coincident", "crank.end", "rod"),
            "pivot": joint("revolute", "rod.end", "block"),
            "guide": joint("prismatic", "ground", "block", axis=(1.0, 0.0)),
            "hub": joint("revolute", "ground.wall", "wheel"),
            "mesh": {"type": "gear", "joints": ["bearing", "hub"], "ratio": -2.0},
            "rail": joint("prismatic", "ground.wall", "cart", axis=(1.0, 0.0)),
            "rack": {
                "type": "coupling",
                "joints": ["hub", "rail"],
                "weights": [0.05, 1.0],
            },
            "rope": joint("distance", "cart", "weight"),
        },
        drives={
            "push": {
                "marker": "weight",
                "coordinate": "x",
                "function": {**sine, "offset": 0.5},
            }
        },
        outputs={
            "record": [
                f"{body}.{q}"
                for body in ("crank", "rod", "block", "wheel", "cart", "weight")
                for q in ("x", "y", "vx", "vy")
            ]
            + ["crank.wz", "wheel.wz", "push.f1"]
        },
    )


def test_a_planar_scene_moves_alike_in_space() -> None:
    flat = simulate(compile_scene(slider("planar")), rtol=1e-10)
    solid = simulate(compile_scene(slider("spatial")), rtol=1e-10)
    scale = np.abs(flat.values).max(axis=0) + 1e-3
    assert flat.names == solid.names
    assert np.abs((flat.values - solid.values) / scale).max() < 1e-6
    assert np.abs(flat.values[:, -3]).max() > 1.0


def test_a_body_that_starts_upside_down_is_turned_right() -> None:
    """Axes at right angles do not say which way round; the joint does."""
    content = scene(
        "spatial",
        0.1,
        bodies={
            "flap": {
                "mass": 1.0,
                "inertia": [1.0, 1.0, 1.0],
                "initial": {"axis_angle": [2.9, 0.3, 0.2]},
            }
        },
        joints={
            "hinge": {
                "type": "revolute",
                "markers": ["ground", "flap"],
                "second_axis": [0.0, 0.0, 1.0],
            }
        },
        drives={
            "motor": {
                "joint": "hinge",
                "function": {"type": "constant", "value": 3.0},
            }
        },
        outputs={"record": ["hinge.f*", "motor.f1"]},
    )
    system = compile_scene(content, keep_joints=True)
    assert not system.eliminated
    result = simulate(system)
    work = evaluated(system, 0.1, result.positions[-1], result.velocities[-1])
    _, R = marker(system, work, ("flap", ""))
    c, s = np.cos(3.0), np.sin(3.0)
    assert np.abs(R - [[c, -s, 0], [s, c, 0], [0, 0, 1]]).max() < 1e-12
