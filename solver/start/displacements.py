"""What the assembly changed of the start that the scene gives: places, velocities."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sidtool.formats.scene import as_3d, rotation
from sidtool.formats.sid import Array

from ..kernels import planar
from ..kernels import spatial_columns as spatial
from ..kernels.layout import Work
from ..system import kernel_calls
from ..system.bodies import quaternion
from ..system.scene import GROUND_NAME, System
from ..system.storage import new_work
from .consistent import Start

#: Bodies that are told of, those that moved most.
MOST = 3


def displacements(system: System, work: Work) -> dict[str, tuple[float, float]]:
    """How far bodies lie from where the scene file puts them, by name: of the origin
    [m], and the angle [rad]; `work` holds the frames."""
    found = {}
    for b, data in enumerate(system.bodies):
        if data.name == GROUND_NAME:
            continue
        initial, frame = system.scene.bodies[data.name].initial, work.frame[b]
        if system.planar:
            place = as_3d(tuple(frame[[planar.X, planar.Y]]))
            angle = abs(frame[planar.ANGLE] - (initial.angle or 0.0))
        else:
            place = frame[spatial.X : spatial.X + 3]
            R = frame[spatial.R : spatial.R + 9].reshape(3, 3)
            q = quaternion(rotation(initial).T @ R)
            angle = 2.0 * np.arctan2(np.linalg.norm(q[1:]), q[0])
        way = np.linalg.norm(place - as_3d(initial.position))
        found[data.name] = float(way), float(angle)
    return found


def told_displacements(system: System, start: Start, least: float) -> Iterator[str]:
    """Sentences on bodies that the assembly moved or gave other velocities, if any.

    least : what counts, relative to the size of the mechanism, and of angles [rad]
    """
    work = new_work(system)
    work.clock[0] = 0.5 * (system.scene.time.start + system.breaks[0])
    kernel_calls.evaluate(system, work, system.scene.time.start, start.z, start.v)
    ways = displacements(system, work)
    sizes = {name: max(way / system.length, a) for name, (way, a) in ways.items()}
    if moved := _largest(ways, sizes, least, "m", "rad"):
        yield (
            "the assembly moved bodies from where the scene puts them, to meet joints "
            f"and drives: {moved}"
        )
    changes, sizes = _replaced_velocities(system, work)
    if changed := _largest(changes, sizes, least, "m/s", "rad/s"):
        yield (
            "joints and drives replace initial velocities that the scene gives: "
            f"{changed}"
        )


def _replaced_velocities(
    system: System, work: Work
) -> tuple[dict[str, tuple[float, float]], dict[str, float]]:
    """Changes of velocities [m/s] and [rad/s] that the scene states, and how large they
    are relative to the velocities."""
    changes, sizes = {}, {}
    for b, data in enumerate(system.bodies):
        if data.name == GROUND_NAME:
            continue
        initial = system.scene.bodies[data.name].initial
        found = _velocities(system, work.frame[b])
        stated = initial.velocity, initial.angular_velocity
        pairs = [
            (np.zeros(3), 0.0) if given is None else _change(given, now)
            for given, now in zip(stated, found, strict=True)
        ]
        (dv, _), (dw, _) = pairs
        changes[data.name] = float(np.linalg.norm(dv)), float(np.linalg.norm(dw))
        sizes[data.name] = max(size for _, size in pairs)
    return changes, sizes


def _velocities(system: System, frame: Array) -> tuple[Array, Array]:
    """Of the origin of a frame and angular, in inertial axes, (3,) each."""
    if system.planar:
        c, s = frame[planar.COS], frame[planar.SIN]
        vx, vy = frame[planar.VX], frame[planar.VY]
        turn = np.array([0.0, 0.0, frame[planar.W]])
        return np.array([c * vx - s * vy, s * vx + c * vy, 0.0]), turn
    R = frame[spatial.R : spatial.R + 9].reshape(3, 3)
    return R @ frame[spatial.V : spatial.V + 3], R @ frame[spatial.OMEGA :][:3]


def _change(given: object, now: Array) -> tuple[Array, float]:
    """The change of a vector, and its size relative to the larger of the two."""
    values = np.ravel(np.asarray(given, float))
    wanted = np.array([0.0, 0.0, values[0]]) if len(values) == 1 else np.zeros(3)
    if len(values) > 1:
        wanted[: len(values)] = values
    largest = max(np.linalg.norm(wanted), np.linalg.norm(now))
    change = now - wanted
    return change, float(np.linalg.norm(change) / (largest or 1.0))


def _largest(
    ways: dict[str, tuple[float, float]],
    sizes: dict[str, float],
    least: float,
    *units: str,
) -> str:
    """ "rod by 0.1 m and 0.2 rad, ..." of the bodies whose sizes are above `least`."""
    chosen = sorted((n for n in ways if sizes[n] > least), key=lambda n: -sizes[n])
    parts = [
        f"{n} by {ways[n][0]:.3g} {units[0]} and {ways[n][1]:.3g} {units[1]}"
        for n in chosen[:MOST]
    ]
    if len(chosen) > MOST:
        parts.append(f"{len(chosen) - MOST} more by less")
    return ", ".join(parts)
