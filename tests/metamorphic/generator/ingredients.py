"""Bodies, joints and functions of time of random scenes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.base.sid import Array
from tests.bodies import Cloud, orthonormal
from tests.metamorphic.generator.case import Table
from tests.metamorphic.generator.poses import Pose, turned

Random = np.random.Generator
#: Node "1" of a flexible body is the origin of its frame, which it touches.
NODES = 4
JOINTS = {
    "planar": ("fixed", "revolute", "prismatic", "point_on_line", "coincident"),
    "spatial": (
        "fixed",
        "revolute",
        "prismatic",
        "cylindrical",
        "spherical",
        "universal",
        "planar",
        "point_on_line",
        "point_on_plane",
        "coincident",
    ),
}


def cloud(rng: Random, planar: bool) -> Cloud:
    """A slender body with smooth shape functions that are flat at its origin.

    The displacement is quadratic in the position, the rotation half its curl.
    """
    nq = int(rng.integers(1, 4))
    c = rng.uniform(-0.1, 0.1, (12, 3)) + np.linspace(0.0, 0.8, 12)[:, None] * [1, 0, 0]
    c[0] = 0.0
    c[:NODES] = c[[0, 11, 6, 8]]
    c[11] = [0.5, 0.05, 0.02]
    masses = rng.uniform(0.1, 0.4, 12)
    # u_a = second_abc c_b c_c for each shape function l
    second = rng.normal(size=(nq, 3, 3, 3))
    second = second + np.swapaxes(second, 2, 3)
    second[:, 1:, 0, 0] += 6.0 * rng.normal(size=(nq, 2))
    if planar:
        c[:, 2] = 0.0
    phi, psi = _fields(second, c, planar)
    mix = orthonormal(masses, phi)
    return Cloud(masses, c, phi @ mix, psi @ mix)


def _fields(second: Array, c: Array, planar: bool) -> tuple[Array, Array]:
    """Displacements second_labc c_b c_c and half their curls, (n, 3, l) each."""
    if planar:
        second = second.copy()
        second[:, 2] = 0.0
    slope = 2.0 * np.einsum("labc,pc->plab", second, c)
    phi = np.einsum("labc,pb,pc->pal", second, c, c)
    psi = 0.5 * np.stack(
        [
            slope[..., (k + 2) % 3, (k + 1) % 3] - slope[..., (k + 1) % 3, (k + 2) % 3]
            for k in range(3)
        ],
        axis=1,
    )
    if planar:
        psi[:, :2] = 0.0
    return phi, psi


def second_order(cloud: Cloud, rng: Random, planar: bool) -> Cloud:
    """The cloud with a displacement of second order that is flat at the origin."""
    nq = cloud.phi.shape[-1]
    second = 0.1 * rng.normal(size=(nq, nq, 3, 3, 3))
    second = second + np.swapaxes(second, 0, 1)
    second = second + np.swapaxes(second, 3, 4)
    flat = second.reshape(nq * nq, 3, 3, 3)
    phi, psi = (
        field.reshape(*field.shape[:2], nq, nq)
        for field in _fields(flat, cloud.c, planar)
    )
    return replace(cloud, phi1=phi, psi1=psi)


def rigid_body(rng: Random, planar: bool) -> Table:
    """Mass, inertia that is possible, and centre of mass."""
    mass = float(rng.uniform(0.5, 3.0))
    points = rng.normal(size=(4, 3)) * [0.25, 0.15, 0.1]
    points -= points.mean(axis=0)
    moment = 0.25 * mass * (np.sum(points**2) * np.eye(3) - points.T @ points)
    moment += 0.005 * mass * np.eye(3)
    centre = rng.uniform(-0.2, 0.2, 3)
    return {
        "mass": mass,
        "inertia": float(moment[2, 2]) if planar else moment.tolist(),
        "centre_of_mass": centre[: 2 if planar else 3].tolist(),
        "markers": {},
    }


def unit(rng: Random) -> Array:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def any_pose(rng: Random, planar: bool, size: float) -> Pose:
    axis = np.array([0.0, 0.0, 1.0]) if planar else unit(rng)
    x = rng.uniform(-size, size, 3) * ([1.0, 1.0, 0.0] if planar else 1.0)
    return Pose(x, turned(axis, float(rng.uniform(-2.5, 2.5))))


def joint(rng: Random, kind: str, planar: bool) -> tuple[Table, Pose, dict[str, float]]:
    """A joint, a pose of its second marker in the first, and its coordinates."""
    angle, way = rng.uniform(-0.7, 0.7), rng.uniform(-0.3, 0.3)
    table: Table = {"type": kind}
    if planar:
        return _planar_joint(rng, table, angle, way)
    axis, second, loose = unit(rng), unit(rng), turned(unit(rng), 0.6)
    second = np.cross(axis, second) / np.linalg.norm(np.cross(axis, second))
    beside = way * second + rng.uniform(-0.3, 0.3) * np.cross(axis, second)
    if kind not in ("fixed", "spherical", "coincident"):
        table["axis"] = axis.tolist()
    if kind == "universal":
        table["second_axis"] = second.tolist()
        other = rng.uniform(-0.7, 0.7)
        R = turned(axis, angle) @ turned(second, other)
        return table, Pose(np.zeros(3), R), {"angle_1": angle, "angle_2": other}
    x = {
        "prismatic": way * axis,
        "cylindrical": way * axis,
        "point_on_line": way * axis,
        "planar": beside,
        "point_on_plane": beside,
    }.get(kind, np.zeros(3))
    if kind in ("fixed", "prismatic"):
        R = np.eye(3)
    elif kind in ("revolute", "cylindrical", "planar"):
        R = turned(axis, angle)
    else:
        R = loose
    found = {}
    if kind in ("revolute", "cylindrical", "planar"):
        found["angle"] = angle
    if kind in ("prismatic", "cylindrical", "point_on_line"):
        found["displacement"] = way
    return table, Pose(x, R), found


def _planar_joint(
    rng: Random, table: Table, angle: float, way: float
) -> tuple[Table, Pose, dict[str, float]]:
    kind, axis = table["type"], unit(rng) * [1.0, 1.0, 0.0]
    axis /= np.linalg.norm(axis)
    x, R = np.zeros(3), turned(np.array([0.0, 0.0, 1.0]), angle)
    found = {"angle": angle} if kind == "revolute" else {}
    if kind in ("prismatic", "point_on_line"):
        table["axis"] = axis[:2].tolist()
        x, found = way * axis, {"displacement": way}
    if kind in ("fixed", "prismatic"):
        R = np.eye(3)
    return table, Pose(x, R), found


def function(rng: Random, start: float, size: float, end: float) -> Table:
    """A smooth function of time on [0, end] that begins at `start`."""
    kind = rng.choice(["polynomial", "harmonic", "smooth_step", "table", "hermite"])
    if kind == "polynomial":
        rest = (size * rng.normal(size=3) / [1.0, 2.0, 3.0]).tolist()
        pieces = [{"from": 0.0, "coefficients": [start, *rest]}]
        return {"type": "polynomial", "pieces": pieces}
    if kind == "harmonic":
        phase = float(rng.uniform(-3.0, 3.0))
        return {
            "type": "harmonic",
            "offset": start - size * float(np.sin(phase)),
            "amplitude": size,
            "angular_frequency": float(rng.uniform(1.0, 6.0)),
            "phase": phase,
        }
    if kind == "smooth_step":
        steps = {"from": 0.1 * end, "to": 0.8 * end, "continuity": 3}
        return {"type": kind, "start": start, "end": start + size, **steps}
    if kind == "table":
        times = np.linspace(0.0, end, 6)
        values = start + size * np.append(0.0, rng.uniform(-1.0, 1.0, 5))
        table = {"times": times.tolist(), "values": values.tolist()}
        return {"type": kind, "interpolation": "smooth", **table}
    half = 0.5 * end
    middle = [start + 0.5 * size, 0.3 * size, 0.0]
    last = [start + size, 0.0, 0.0]
    return {
        "type": "polynomial",
        "pieces": [
            {"from": 0.0, "to": half, "start": [start, 0.0, 0.0], "end": middle},
            {"from": half, "to": end, "start": middle, "end": last},
        ],
    }


def coordinates_of(kind: str) -> tuple[str, ...]:
    """Names of the coordinates of a joint in a scene."""
    found: dict[str, tuple[str, ...]] = {
        "revolute": ("angle",),
        "prismatic": ("displacement",),
        "cylindrical": ("angle", "displacement"),
        "universal": ("angle_1", "angle_2"),
        "planar": ("angle",),
        "point_on_line": ("displacement",),
        "distance": ("length",),
    }
    return found.get(kind, ())
