"""Joints of every kind between rigid and flexible bodies, judged by another program.

The motion is that of sidtool; accelerations, forces in joints and of springs at its
states are those of `particles`, which shares no equation with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

import sidtool

from . import particles
from .particles import (
    Body,
    Constraint,
    Marker,
    State,
    across,
    along,
    angle,
    coincidence_residual,
    distance,
    parallel,
    perpendicular,
    same_axes,
    together,
)

Array = np.ndarray
#: Of accelerations and forces, relative to the largest; rates are differenced.
TOLERANCE = 2e-6
BODY = [c + x for c in ("", "v", "a", "w") for x in "xyz"]
BODY += [f"quaternion_{i}" for i in range(4)]
PUSH = {"type": "harmonic", "amplitude": 1.0, "frequency": 1.0 / np.pi, "phase": np.pi}
SPRING = {"rest": 0.4, "stiffness": [40.0, 9.0], "damping": [0.5]}
PITCH, LEAD = 0.15, 0.013
KINDS = (
    "fixed",
    "revolute",
    "prismatic",
    "cylindrical",
    "screw",
    "spherical",
    "universal",
    "planar",
    "point_on_line",
    "point_on_plane",
    "distance",
    "coincident",
)


@dataclass(frozen=True, eq=False)
class Joint:
    """A kind with its keys, what it holds, and where its second marker may stand."""

    keys: dict[str, Any]
    holds: Constraint
    turn: Array
    way: Array


def joint(kind: str, rng: np.random.Generator) -> Joint:
    axis = particles.unit(rng.standard_normal(3))
    other = particles.unit(np.cross(axis, rng.standard_normal(3)))
    about = 0.8 * rng.standard_normal()
    any_turn, fixed, away = rotation(rng), np.eye(3), 0.2 * rng.standard_normal()
    turn, none = particles.turned(about * axis), np.zeros(3)
    both = turn @ particles.turned(0.4 * other)

    def screw(*poses: Any) -> Array:
        return along(axis)(*poses) - PITCH / (2 * np.pi) * angle(axis)(*poses) - LEAD

    lead = (PITCH * about / (2.0 * np.pi) + LEAD) * axis
    holds, turns, way = {
        "fixed": (together(coincidence_residual, same_axes), fixed, none),
        "revolute": (together(coincidence_residual, parallel(axis)), turn, none),
        "prismatic": (together(across(axis), same_axes), fixed, away * axis),
        "cylindrical": (together(across(axis), parallel(axis)), turn, away * axis),
        "screw": (together(across(axis), parallel(axis), screw), turn, lead),
        "spherical": (coincidence_residual, any_turn, none),
        "coincident": (coincidence_residual, any_turn, none),
        "universal": (
            together(coincidence_residual, perpendicular(axis, other)),
            both,
            none,
        ),
        "planar": (together(along(axis), parallel(axis)), turn, away * other),
        "point_on_line": (across(axis), any_turn, away * axis),
        "point_on_plane": (along(axis), any_turn, away * other),
        "distance": (lambda *poses: distance(*poses) - 0.3, any_turn, 0.3 * axis),
    }[kind]
    keys: dict[str, Any] = {"type": kind}
    if kind not in ("fixed", "spherical", "coincident", "distance"):
        keys["axis"] = axis.tolist()
    keys |= {"second_axis": other.tolist()} if kind == "universal" else {}
    keys |= {"pitch": PITCH} if kind == "screw" else {}
    return Joint(keys, holds, turns, way)


def rotation(rng: np.random.Generator) -> Array:
    return Rotation.from_rotvec(2.0 * rng.standard_normal(3)).as_matrix()


def posed(place: Array, axes: Array) -> dict[str, Any]:
    return {"position": place.tolist(), "matrix": axes.tolist()}


class Part:
    """A body in both programs; `marker` gives it a new one, in both."""

    def __init__(self, name: str, flexible: bool, rng: np.random.Generator) -> None:
        self.name, self.rng, self.sid = name, rng, None
        if flexible:
            self.body, self.sid, self.turns = bent(rng)
            count = len(self.body.masses)
            markers = {f"n{k}": k + 1 for k in range(count)}
            self.content: dict[str, Any] = {"sid": name, "markers": markers}
            self.content["quadratic_inertia"] = True
            return
        axes, mass = rotation(rng), 0.5 + rng.random()
        inertia = axes @ np.diag([0.01, 0.015, 0.02]) @ axes.T
        inertia, centre = (inertia + inertia.T) / 2.0, 0.1 * rng.standard_normal(3)
        self.body = particles.rigid(mass, inertia, centre)
        self.content = {
            "mass": mass,
            "inertia": inertia.tolist(),
            "centre_of_mass": centre.tolist(),
            "markers": {},
        }

    def marker(self) -> tuple[str, Marker]:
        if self.sid is not None:
            k = int(self.rng.integers(len(self.body.masses)))
            place, shapes = self.body.places[k], self.body.shapes[k]
            found = Marker(self.body, place, np.eye(3), shapes, self.turns[k])
            return f"{self.name}.n{k}", found
        name = f"m{len(self.content['markers'])}"
        place, axes = 0.2 * self.rng.standard_normal(3), rotation(self.rng)
        self.content["markers"][name] = posed(place, axes)
        none = np.zeros((3, 0))
        return f"{self.name}.{name}", Marker(self.body, place, axes, none, none)

    def start(self) -> dict[str, Any]:
        q = Rotation.from_matrix(self.body.R).as_quat()[[3, 0, 1, 2]]
        return {"position": self.body.x.tolist(), "quaternion": q.tolist()}

    def state(self, result: sidtool.Result, k: int) -> State:
        def of(names: list[str]) -> Array:
            return np.array([result[f"{self.name}.{n}"][k] for n in names])

        numbers = range(1, self.body.n + 1)
        quaternion = of([f"quaternion_{i}" for i in (1, 2, 3, 0)])
        return State(
            of(["x", "y", "z"]),
            Rotation.from_quat(quaternion).as_matrix(),
            of([f"q{i}" for i in numbers]),
            of(["vx", "vy", "vz"]),
            of(["wx", "wy", "wz"]),
            of([f"vq{i}" for i in numbers]),
        )


def bent(rng: np.random.Generator) -> tuple[Body, sidtool.SID, Array]:
    """Five particles on springs that stretch, bend and twist; the modes of the body
    that is clamped at one of them, and its frame beside all of them."""
    count, modes = 5, 3
    steps = [0.15, 0.0, 0.0] + 0.06 * rng.standard_normal((count, 3))
    places = np.cumsum(steps, axis=0) + 0.1 * rng.standard_normal(3)
    masses = 0.2 + 0.3 * rng.random(count)
    K = np.zeros((6 * count, 6 * count))
    for i in range(count - 1):
        middle, B = (places[i] + places[i + 1]) / 2.0, np.zeros((6, 6 * count))
        for k, sign in ((i, -1.0), (i + 1, 1.0)):
            arm = particles.cross_matrix(middle - places[k])
            B[:3, 6 * k : 6 * k + 3] = sign * np.eye(3)
            B[:3, 6 * k + 3 : 6 * k + 6] = -sign * arm
            B[3:, 6 * k + 3 : 6 * k + 6] = sign * np.eye(3)
        own = np.append(4e5 * (1.0 + rng.random(3)), 200.0 * (1.0 + rng.random(3)))
        K += B.T @ np.diag(own) @ B
    M = np.repeat(np.column_stack([masses, np.full(count, 1e-12)]), 3, axis=1).ravel()
    clamped = int(rng.integers(count))
    free = np.setdiff1d(np.arange(6 * count), 6 * clamped + np.arange(6))
    u, r = free[free % 6 < 3], free[free % 6 > 2]
    follow = -np.linalg.solve(K[np.ix_(r, r)], K[np.ix_(r, u)])
    S = np.zeros((6 * count, modes))
    condensed = K[np.ix_(u, u)] + K[np.ix_(u, r)] @ follow
    S[u] = eigh((condensed + condensed.T) / 2.0, np.diag(M[u]))[1][:, :modes]
    S[r] = follow @ S[u]
    sid = sidtool.sid_from_shapes(
        np.diag(M), K, places, S, {k + 1: k for k in range(count)}, damping=(0.7, 1e-3)
    )
    of_nodes = S.reshape(count, 6, modes)
    stiffness = S.T @ K @ S
    damping = 0.7 * S.T @ (M[:, None] * S) + 1e-3 * stiffness
    body = Body(masses, places, of_nodes[:, :3], stiffness, damping)
    return body, sid, of_nodes[:, 3:]


def pushed(scene: particles.Scene, marker: Marker, force: Array, torque: Array) -> None:
    """By `PUSH`, in the axes of the marker."""

    def load(_: Any, when: float, states: list[State], f: Array) -> None:
        pose, size = scene.pose(marker, states), np.sin(2.0 * when + np.pi)
        f += pose.Jx.T @ (pose.R @ force) * size + pose.Jw.T @ (pose.R @ torque) * size

    scene.loads.append(load)


def sprung(scene: particles.Scene, a: Marker, b: Marker) -> None:
    """By `SPRING`."""

    def load(_: Any, when: float, states: list[State], f: Array) -> None:
        value, rate, J, _ = scene.measured(a, b, distance, when, states)
        x, v = np.real(value[0]) - 0.4, rate[0]
        f -= (40.0 * x + 9.0 * x**2 + 0.5 * v) * J[0]

    scene.loads.append(load)


def put(first: Marker, second: Marker, held: Joint, moved: Marker) -> None:
    """The body of `moved` where the joint is closed."""
    body = moved.body
    assert body is not None
    fixed = second if moved is first else first
    base = fixed.body
    x, R = fixed.place, fixed.axes
    if base is not None:
        x, R = base.x + base.R @ x, base.R @ R
    if moved is second:
        axes, place = R @ held.turn, x + R @ held.way
    else:
        axes = R @ held.turn.T
        place = x - axes @ held.way
    body.R = axes @ moved.axes.T
    body.x = place - body.R @ moved.place


@dataclass(frozen=True, eq=False)
class Pair:
    """Ground, ball joint, body, another joint, body: in this program and in that."""

    scene: sidtool.Scene
    other: particles.Scene
    parts: list[Part]


def pair(kind: str, rng: np.random.Generator) -> Pair:
    """Pushed, pulled by a spring and under gravity."""
    a, b = parts = [Part(name, rng.random() < 0.6, rng) for name in "ab"]
    none = np.zeros((3, 0))
    ground = Marker(None, 0.3 * rng.standard_normal(3), rotation(rng), none, none)
    suspended, ball = a.marker(), joint("spherical", rng)
    put(ground, suspended[1], ball, suspended[1])
    ends, held = [a.marker(), b.marker()], joint(kind, rng)
    mine = ends[1][1]
    if rng.random() < 0.5:
        ends.reverse()
    put(ends[0][1], ends[1][1], held, mine)
    gravity, force, torque = 5.0 * rng.standard_normal((3, 3))
    pushed_at, pulled_at = b.marker(), b.marker()

    other = particles.Scene([a.body, b.body], gravity)
    other.joints["ball"] = ground, suspended[1], ball.holds
    other.joints["joint"] = ends[0][1], ends[1][1], held.holds
    pushed(other, pushed_at[1], force, 0.1 * torque)
    sprung(other, ground, pulled_at[1])

    record = [f"{n}.{q}" for n in "ab" for q in BODY]
    record += [f"{p.name}.{q}*" for p in parts if p.sid for q in ("q", "vq")]
    record += [f"{j}.{c}{x}" for j in other.joints for c in "fm" for x in "xyz"]
    push = {"type": "force", "marker": pushed_at[0], "axes": "marker", "function": PUSH}
    push |= {"force": force.tolist(), "torque": (0.1 * torque).tolist()}
    spring = {"type": "spring_damper", "markers": ["ground.g", pulled_at[0]]}
    scene = sidtool.Scene(
        dimension="spatial",
        gravity=gravity.tolist(),
        time={"end": 0.3, "output_step": 0.1},
        ground={"markers": {"g": posed(ground.place, ground.axes)}},
        bodies={p.name: p.content | {"initial": p.start()} for p in parts},
        joints={
            "ball": {"type": "spherical", "markers": ["ground.g", suspended[0]]},
            "joint": held.keys | {"markers": [name for name, _ in ends]},
        },
        forces={"push": push, "spring": spring | SPRING},
        outputs={"record": record},
    )
    return Pair(scene, other, parts)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("kind", KINDS)
def test_joints_between_bodies(kind: str, seed: int) -> None:
    two = pair(kind, np.random.default_rng([KINDS.index(kind), seed]))
    sids = {part.name: part.sid for part in two.parts if part.sid is not None}
    result = two.scene.simulate(sids=sids, rtol=1e-9, accept_defects=True)

    def close(names: list[str], k: int, expected: Array) -> None:
        found = [result[name][k] for name in names]
        size = max(10.0, float(np.abs(expected).max()))
        assert_allclose(found, expected, rtol=0.0, atol=TOLERANCE * size, err_msg=names)

    for k, t in enumerate(result.t):
        states = [part.state(result, k) for part in two.parts]
        accelerations, transmitted = two.other.accelerations(t, states)
        for part in two.parts:
            i = two.other.first[part.body]
            names = [f"{part.name}.a{x}" for x in "xyz"]
            close(names, k, accelerations[i : i + 3])
        for name, both_sides in transmitted.items():
            names = [f"{name}.{c}{x}" for c in "fm" for x in "xyz"]
            close(names, k, both_sides[6:])
