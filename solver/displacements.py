"""How far the assembly moved bodies from where the scene puts them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from formats.scene import as_3d, rotation

from . import kernel_calls
from .bodies import quaternion
from .kernels import planar
from .kernels import spatial_columns as spatial
from .kernels.layout import Work
from .scene import GROUND_NAME, System
from .start import Start
from .storage import new_work

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
    """A sentence on the bodies that the assembly moved, if there are any.

    least : what counts, relative to the size of the mechanism, and of angles [rad]
    """
    work = new_work(system)
    work.clock[0] = 0.5 * (system.scene.time.start + system.breaks[0])
    kernel_calls.evaluate(system, work, system.scene.time.start, start.z, start.v)
    ways = displacements(system, work)
    sizes = {name: max(way / system.length, a) for name, (way, a) in ways.items()}
    moved = sorted((n for n in ways if sizes[n] > least), key=lambda n: -sizes[n])
    if not moved:
        return
    parts = [
        f"{n} by {ways[n][0]:.3g} m and {ways[n][1]:.3g} rad" for n in moved[:MOST]
    ]
    if len(moved) > MOST:
        parts.append(f"{len(moved) - MOST} more by less")
    yield (
        "the assembly moved bodies from where the scene puts them, to meet joints and "
        f"drives: {', '.join(parts)}"
    )
