"""Known motions of bodies that turn often, rub or are shaken."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import cos, sin, tanh
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sidtool.formats.base.sid import Array
from sidtool.solver.system.system import System
from tests.solver.scenes import GRAVITY, compiled, scene, slender_rod

from .motions import Case, Motion, solve


def _turned(quaternion: Array, vector: Array) -> Array:
    """Vectors of a body frame in inertial axes; quaternions (4, nt), scalar first."""
    w, x = quaternion[0], quaternion[1:].T
    cross = np.cross(x, vector)
    return vector + 2.0 * (w[:, None] * cross + np.cross(x, cross))


def top(inertia: list[float], spin: list[float], end: float, arm: float = 0.0) -> Case:
    """A rigid body in space: free, or with `arm` a heavy top on a spherical joint.

    Of mass 1; its centre of mass lies `arm` along its z axis from the joint; inertia
    about the joint.
    """
    principal, weight = np.array(inertia), np.array([0.0, 0.0, -GRAVITY])
    A, B, C = inertia
    tip = np.array([0.3, 0.2, 0.5])

    def slope(_: float, y: Array) -> list[float]:
        """Quaternion and Euler's equations in body axes; numbers, not arrays: called
        a hundred thousand times."""
        e, i, j, k, p, q, r = y.tolist()
        # the weight in body axes has the moment arm * e_z x (down_x, down_y, .)
        down_x = -GRAVITY * 2.0 * (i * k - e * j)
        down_y = -GRAVITY * 2.0 * (j * k + e * i)
        return [
            0.5 * (-i * p - j * q - k * r),
            0.5 * (e * p + j * r - k * q),
            0.5 * (e * q + k * p - i * r),
            0.5 * (e * r + i * q - j * p),
            (-arm * down_y - (C - B) * q * r) / A,
            (arm * down_x - (A - C) * r * p) / B,
            -(B - A) * p * q / C,
        ]

    @cache
    def solved(times: tuple[float, ...]) -> Array:
        return solve(slope, [np.cos(0.2), np.sin(0.2), 0, 0, *spin], np.array(times))

    def motion(t: Array) -> Motion:
        place = _turned(solved(tuple(t))[:4], tip)
        return {f"top.tip.{axis}": place[:, i] for i, axis in enumerate("xyz")}

    def make() -> System:
        about = principal - arm**2 * np.array([1.0, 1.0, 0.0])
        first = _turned(
            np.array([np.cos(0.2), np.sin(0.2), 0, 0])[:, None], np.array(spin)
        )[0]
        body = {
            "mass": 1.0,
            "inertia": about.tolist(),
            "centre_of_mass": [0.0, 0.0, arm],
            "markers": {"tip": {"position": tip.tolist()}},
            "initial": {
                "axis_angle": [0.4, 0.0, 0.0],
                "angular_velocity": first.tolist(),
            },
        }
        ball = {"type": "spherical", "markers": ["ground", "top"]}
        return compiled(
            scene(
                {"top": body},
                {"ball": ball} if arm else {},
                end=end,
                steps=50,
                record=["top.tip.x", "top.tip.y", "top.tip.z"],
                dimension="spatial",
                gravity=weight.tolist() if arm else [0.0, 0.0, 0.0],
            )
        )

    return Case(make, motion)


def symmetric_top(inertia: list[float], spin: list[float], end: float) -> Case:
    """A free top whose first two moments of inertia are equal, in closed form.

    It turns about its constant angular momentum with |L| / A and about its own axis
    with (A - C) / A of its spin (L. D. Landau, E. M. Lifshitz, Mechanics, section 33).
    """
    principal = np.array(inertia)
    case, tip = top(inertia, spin, end), np.array([0.3, 0.2, 0.5])

    def motion(t: Array) -> Motion:
        first = Rotation.from_rotvec([0.4, 0.0, 0.0])
        about = first.apply(principal * spin) / principal[0]
        own = (1.0 - principal[2] / principal[0]) * spin[2]
        turned = Rotation.from_rotvec(np.outer(t, about)) * first
        turned = turned * Rotation.from_rotvec(np.outer(t, [0.0, 0.0, own]))
        place = turned.apply(tip)
        return {f"top.tip.{axis}": place[:, i] for i, axis in enumerate("xyz")}

    return replace(case, motion=motion)


def pendulum(speed: float, end: float, friction: float = 0.0) -> Case:
    """A rod of 1 m that swings, or turns over; with friction in its bearing."""
    width = 1e-2

    def slope(_: float, y: Array) -> list[float]:
        angle, speed = y.tolist()
        torque = -0.5 * GRAVITY * cos(angle) - friction * tanh(speed / width)
        return [speed, 3.0 * torque]

    @cache
    def solved(times: tuple[float, ...]) -> Array:
        return solve(slope, [0.0, speed], np.array(times))

    def motion(t: Array) -> Motion:
        angle = solved(tuple(t))[0]
        return {"rod.angle": angle, "rod.b.x": np.cos(angle), "rod.b.y": np.sin(angle)}

    def make() -> System:
        rub = {"type": "friction", "joint": "pin", "force": friction, "speed": width}
        return compiled(
            scene(
                {"rod": slender_rod(1.0, angular_velocity=speed)},
                {"pin": {"type": "revolute", "markers": ["ground", "rod.a"]}},
                end=end,
                steps=100,
                record=["rod.angle", "rod.b.x", "rod.b.y"],
                gravity=[0.0, -GRAVITY],
                forces={"rub": rub} if friction else {},
            )
        )

    return Case(make, motion)


def sledge(
    limit: float, width: float, pull: float, omega: float, end: float = 3.0
) -> Case:
    """A sledge that a force draws to and fro, a spring holds and friction stops."""
    stiffness = 100.0

    def slope(t: float, y: Array) -> list[float]:
        x, v = y.tolist()
        force = pull * sin(omega * t) - stiffness * x
        return [v, force - limit * tanh(v / width)]

    @cache
    def solved(times: tuple[float, ...]) -> Array:
        return solve(slope, [0.0, 0.0], np.array(times))

    def motion(t: Array) -> Motion:
        return {"sledge.x": solved(tuple(t))[0]}

    def make() -> System:
        drawn = {
            "type": "harmonic",
            "amplitude": pull,
            "frequency": omega / (2.0 * np.pi),
        }
        rub = {"type": "friction", "joint": "rail", "force": limit, "speed": width}
        forces = {
            "spring": {
                "type": "spring_damper",
                "joint": "rail",
                "stiffness": stiffness,
            },
            "pull": {"type": "actuator", "joint": "rail", "function": drawn},
            "rub": rub,
        }
        return compiled(
            scene(
                {"sledge": slender_rod(1.0)},
                {"rail": {"type": "prismatic", "markers": ["ground", "sledge.a"]}},
                end=end,
                steps=60,
                record=["sledge.x"],
                forces=forces,
            )
        )

    return Case(make, motion)


def four_bars() -> Case:
    """A02 of the IFToMM library for 5 s, through singular positions: all posts turn
    alike, with (N + 1) / 3 + N times m L^2 against gravity."""
    inertia, moment = 3.0, 3.5 * GRAVITY

    def slope(_: float, y: Array) -> list[float]:
        return [y[1], moment / inertia * np.sin(y[0])]

    @cache
    def solved(times: tuple[float, ...]) -> Array:
        return solve(slope, [0.0, 1.0], np.array(times))

    def motion(t: Array) -> Motion:
        angle = solved(tuple(t))[0]
        return {"post0.b.x": np.sin(angle), "post0.b.y": np.cos(angle)}

    def make() -> System:
        bodies: dict[str, Any] = {}
        joints: dict[str, Any] = {}
        pivots = {f"p{i}": {"position": [float(i), 0.0]} for i in range(3)}
        for i in range(3):
            bodies[f"post{i}"] = slender_rod(
                1.0, position=[float(i), 0.0], angle=0.5 * np.pi, angular_velocity=-1.0
            )
            joints[f"pivot{i}"] = [f"ground.p{i}", f"post{i}.a"]
        for i in range(2):
            bodies[f"bar{i}"] = slender_rod(
                1.0, position=[float(i), 1.0], velocity=[1.0, 0.0]
            )
            joints[f"left{i}"] = [f"post{i}.b", f"bar{i}.a"]
            joints[f"right{i}"] = [f"bar{i}.b", f"post{i + 1}.b"]
        return compiled(
            scene(
                bodies,
                {k: {"type": "revolute", "markers": m} for k, m in joints.items()},
                end=5.0,
                steps=50,
                record=["post0.b.x", "post0.b.y"],
                ground={"markers": pivots},
                gravity=[0.0, -GRAVITY],
            )
        )

    return Case(make, motion)


def shaken(period: float) -> System:
    """A body that moves with 1 m/s, and faster by 0.3 m/s in the mean from a harmonic
    force of this period, for 1 s or four periods."""
    omega = 2.0 * np.pi / period
    push = {
        "type": "force",
        "marker": "rod.a",
        "force": [0.3 * omega, 0.0],
        "function": {
            "type": "harmonic",
            "amplitude": 1.0,
            "frequency": 1.0 / period,
        },
    }
    arrived = {"quantity": "rod.x", "value": 5.2 * period, "action": "stop"}
    return compiled(
        scene(
            {"rod": slender_rod(1.0, velocity=[1.0, 0.0])},
            {"rail": {"type": "prismatic", "markers": ["ground", "rod.a"]}},
            record=["rod.x"],
            forces={"push": push},
            events={"arrived": arrived},
        )
    )
