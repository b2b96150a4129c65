"""Momenta and orientations among the outputs, against sums over particles."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sidtool.formats.base.sid import Array
from sidtool.formats.result import Result
from sidtool.solver import simulate
from tests.bodies import Cloud, particle_cloud
from tests.solver.scenes import compiled, scene, slender_rod

NQ, GRAVITY = 3, np.array([0.4, -9.81, 1.3])
NAMES = [
    f"{kind}_{axis}" for kind in ("momentum", "angular_momentum") for axis in "xyz"
]


def summed(cloud: Cloud, result: Result, planar: bool) -> Array:
    """(nt, 6) momentum and angular momentum of the particles, one by one."""
    found = []
    for z, v in zip(result.positions, result.velocities, strict=True):
        if planar:
            x, R = np.append(z[:2], 0.0), Rotation.from_rotvec([0, 0, z[2]]).as_matrix()
            V, W = np.append(v[:2], 0.0), np.array([0.0, 0.0, v[2]])
        else:
            x, R = z[:3], Rotation.from_quat(np.roll(z[3:7], -1)).as_matrix()
            V, W = v[:3], v[3:6]
        q, qd = z[-NQ:], v[-NQ:]
        place, flow = cloud.c + cloud.phi @ q, cloud.phi @ qd
        where = x + place @ R.T
        speed = (V + np.cross(W, place) + flow) @ R.T
        p = cloud.masses @ speed
        found.append([*p, *(cloud.masses @ np.cross(where, speed))])
    return np.array(found)


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("seed", [1, 2])
def test_momenta_are_the_sums_over_the_particles(planar: bool, seed: int) -> None:
    """Of a body that flies, turns and vibrates; and m g t is what gravity adds."""
    cloud, _ = particle_cloud(NQ, 9, planar, seed, stiffening=False)
    sid = cloud.sid(np.diag([900.0, 2500.0, 6400.0]), np.zeros((NQ, NQ)), 2)
    place, spin = [0.5, -0.3, 0.2], [0.7, -1.1, 2.0]
    initial: dict[str, Any] = {
        "position": place[: 2 if planar else 3],
        "velocity": [1.0, 2.0, -0.5][: 2 if planar else 3],
        "angular_velocity": spin[2] if planar else spin,
        "elastic_velocity": [0.3, -0.2, 0.1],
    }
    body = {"sid": "-", "quadratic_inertia": True, "initial": initial}
    gravity = GRAVITY[: 2 if planar else 3]
    described = scene(
        {"body": body},
        end=1.0,
        steps=8,
        dimension="planar" if planar else "spatial",
        gravity=list(gravity),
        record=[f"body.{name}" for name in NAMES],
        accuracy={"rtol": 1e-8},
    )
    result = simulate(compiled(described, body=sid))
    expected = summed(cloud, result, planar)
    size = np.abs(expected).max()
    assert result.values == pytest.approx(expected, abs=1e-11 * size)
    gained = result.values[:, : len(gravity)] - result.values[0, : len(gravity)]
    weight = sid.mass * np.outer(result.t, gravity)
    assert gained == pytest.approx(weight, abs=1e-8 * size)


def test_momenta_of_the_scene_are_those_of_its_bodies() -> None:
    """A driven rod, which needs no coordinates, and one that hangs on it; the ground
    takes no part."""
    joints = {
        "pin": {"type": "revolute", "markers": ["ground", "one.a"]},
        "elbow": {"type": "revolute", "markers": ["one.b", "two.a"]},
    }
    function = {"type": "harmonic", "amplitude": 1.0, "frequency": 1.0}
    bodies = {"one": slender_rod(1.0, 2.0), "two": slender_rod(0.5, position=[1, 0])}
    whole = [
        f"{kind}.{axis}" for kind in ("momentum", "angular_momentum") for axis in "xyz"
    ]
    record = [*whole, *(f"{b}.{n}" for b in bodies for n in NAMES)]
    described = scene(
        bodies,
        joints,
        {"motor": {"joint": "pin", "function": function}},
        record=[
            *record,
            "one.wz",
            "two.wz",
            "two.vx",
            "two.vy",
            "two.x",
            "two.y",
            "two.angle",
        ],
        gravity=[0.0, -9.81],
    )
    result = simulate(compiled(described))
    of = result.values
    assert of[:, :6] == pytest.approx(of[:, 6:12] + of[:, 12:18], abs=1e-12)
    assert result["one.angular_momentum_z"] == pytest.approx(2.0 / 3 * result["one.wz"])
    x, y, w = result["two.x"], result["two.y"], result["two.wz"]
    c, s = np.cos(result["two.angle"]), np.sin(result["two.angle"])
    arm, m = np.column_stack([c, s]) / 4.0, 1.0
    vx, vy = result["two.vx"] - w * arm[:, 1], result["two.vy"] + w * arm[:, 0]
    turn = m * ((x + arm[:, 0]) * vy - (y + arm[:, 1]) * vx) + m * 0.25 / 12 * w
    assert result["two.momentum_x"] == pytest.approx(m * vx, abs=1e-12)
    assert result["two.momentum_y"] == pytest.approx(m * vy, abs=1e-12)
    assert result["two.angular_momentum_z"] == pytest.approx(turn, abs=1e-12)


def test_marker_rotations_turn_at_the_angular_velocity_of_the_marker() -> None:
    """d(rotation)/dt by differences of the recorded orientation, of a marker that is
    turned in a rigid body, and of a node of a flexible one; quaternion and rotation
    vector say the same orientation."""
    cloud, _ = particle_cloud(NQ, 9, False, 5, stiffening=False)
    sid = cloud.sid(np.diag([900.0, 2500.0, 6400.0]), np.zeros((NQ, NQ)), 2)
    rigid = {
        "mass": 1.0,
        "inertia": [1.0, 2.0, 2.5],
        "markers": {"m": {"position": [1, 0, 0], "axis_angle": [0, 0.4, 0]}},
        "initial": {"angular_velocity": [1.0, 2.0, -1.5]},
    }
    flexible = {
        "sid": "-",
        "markers": {"m": 2},
        "initial": {
            "angular_velocity": [0.5, -1.0, 2.0],
            "elastic_velocity": [0.02, -0.01, 0.03],
        },
    }
    marks = ("rigid.m", "body.m", "rigid", "body")
    words = [f"rotation_{a}" for a in "xyz"] + [f"quaternion_{k}" for k in range(4)]
    words += ["wx", "wy", "wz", "angle"]
    described = scene(
        {"rigid": rigid, "body": flexible},
        end=0.2,
        steps=2000,
        dimension="spatial",
        record=[f"{mark}.{word}" for mark in marks for word in words],
        accuracy={"rtol": 1e-9},
    )
    result = simulate(compiled(described, body=sid))
    h = result.t[1] - result.t[0]
    for mark in marks:
        of = np.column_stack([result[f"{mark}.{word}"] for word in words])
        R = Rotation.from_rotvec(of[:, :3])
        same = Rotation.from_quat(np.roll(of[:, 3:7], -1, axis=1))
        assert (R * same.inv()).magnitude().max() < 1e-12
        assert of[:, 3].min() >= 0.0
        assert of[:, 10] == pytest.approx(R.magnitude(), abs=1e-12)
        rate = (R[2:] * R[:-2].inv()).as_rotvec() / (2 * h)
        assert rate == pytest.approx(of[1:-1, 7:10], abs=2e-4)


def test_a_planar_marker_has_an_angle_over_many_turns() -> None:
    body = slender_rod(1.0, angular_velocity=7.0)
    body["markers"]["b"]["angle"] = 0.3
    described = scene({"rod": body}, end=5.0, record=["rod.b.angle", "rod.b.wz"])
    result = simulate(compiled(described))
    assert result["rod.b.angle"] == pytest.approx(0.3 + 7.0 * result.t, abs=1e-6)
    assert result["rod.b.wz"] == pytest.approx(7.0)
