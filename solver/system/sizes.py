"""What is large: sizes that make displacements, angles and deformations comparable.

Nothing is large or small by itself: a length is compared with the size of the
mechanism, an angle with a radian. So results do not depend on the unit system, and
mechanisms of micrometres are closed as well as those of kilometres.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.scene import SceneFile, as_3d
from sidtool.formats.sid import SID, Array
from sidtool.formats.storage.kept import kept

from ..space import layout as at
from .bodies.data import BodyData
from .bodies.vibration import amplitudes
from .scene import GROUND_NAME, System

_ANGLES = (at.ANGLE, at.PERPENDICULAR, at.COUPLED_ANGLE)
_TERMS = (at.COUPLED_ANGLE, at.COUPLED_ALONG)
#: Rates below this part of the size of the mechanism during the run are rest.
REST = 1e-10


def diameter(points: Array) -> float:
    """The largest distance in a set of points (n >= 1, 3), or at least half of it.

    From the point farthest from the mean to the one farthest from that: it changes
    neither with the axes nor with the order of the points.
    """
    away = points - points.sum(axis=0) / len(points)
    ways = points - points[(away * away).sum(axis=1).argmax()]
    return math.sqrt((ways * ways).sum(axis=1).max())


def mechanism_size(
    scene: SceneFile, data: Mapping[str, BodyData], markers: Iterable[tuple[str, str]]
) -> float:
    """Largest distance in a body, or between places of bodies and of the ground [m].

    A body alone that has no extent is measured by how far it flies.

    markers : (body, marker) of all that the scene uses
    """
    sizes = []
    ground = [name for body, name in markers if body == GROUND_NAME]
    places = [data[GROUND_NAME].node(name).position for name in ground]
    for name in scene.bodies:
        sizes.append(_extent(data[name].sid))
        places.append(as_3d(scene.initial_of(name).position))
    sizes.append(diameter(np.array(places)))
    return max(sizes) or _travel(scene) or 1.0


@kept
def _extent(sid: SID) -> float:
    """Largest distance between nodes, frame and centre of mass of a body [m]."""
    points = [node.position for node in sid.nodes]
    points += [np.zeros(3), sid.mdCM.m0[:, 0] / (sid.mass or 1.0)]
    return diameter(np.array(points))


@kept
def _reach(sid: SID) -> float:
    """How far the nodes of a body lie from its frame [m]."""
    places = [node.position for node in sid.nodes]
    return math.sqrt(max((place @ place for place in places), default=0.0))


def _travel(scene: SceneFile) -> float:
    """How far initial velocities and gravity carry a body at most."""
    starts = map(scene.initial_of, scene.bodies)
    speeds = [np.linalg.norm(as_3d(start.velocity)) for start in starts]
    fall = 0.5 * np.linalg.norm(as_3d(scene.gravity))
    duration = scene.time.end - scene.time.start
    return float(duration * (max(speeds) + duration * fall))


def extents(system: System) -> Array:
    """How far each body reaches from its frame, (bodies,) [m]; of one that has no
    extent, the size of the mechanism."""
    return np.array([_reach(body.sid) or system.length for body in system.bodies])


def coordinate_sizes(system: System) -> Array:
    """Of each velocity coordinate: the size of the mechanism, a radian, an elastic
    coordinate that displaces a node by the size of the mechanism; (n velocities,)."""
    lengths = system.length / system.lasting(coordinate_amplitudes)
    return np.where(system.lasting(_are_angles), 1.0, lengths)


def coordinate_amplitudes(system: System) -> Array:
    """Displacement per unit of each elastic coordinate, and 1 of others,
    (n velocities,); see `amplitudes`."""
    found, axes = np.ones(system.n_velocities), 2 if system.planar else 3
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        elastic = slice(row[at.VEL] + row[at.RD], row[at.VEL] + row[at.NV])
        found[elastic] = amplitudes(data.sid, axes)
    return found


def _are_angles(system: System) -> NDArray[np.bool_]:
    """Velocity coordinates that turn a body, (n velocities,)."""
    found, axes = np.zeros(system.n_velocities, bool), 2 if system.planar else 3
    for row in system.arrays.body:
        found[row[at.VEL] + axes : row[at.VEL] + row[at.RD]] = True
    return found


def row_sizes(system: System) -> Array:
    """Of each constraint: the size of the mechanism, a radian, or a sum of both that a
    coupling weights; (rows,)."""
    sizes = np.zeros(system.n_rows)
    point = 2 if system.planar else 3
    term = at.TERM_PLANAR if system.planar else at.TERM_SPATIAL
    for con in system.arrays.constraint.tolist():
        kind, row = con[at.KIND], con[at.ROW]
        size = 1.0 if kind in _ANGLES else system.length
        if kind in _TERMS:
            weight = system.arrays.pool[con[at.C_DATA] + term + at.W_WEIGHT]
            sizes[row] = max(sizes[row], abs(weight) * size)
            continue
        sizes[row : row + (point if kind == at.COINCIDENT else 1)] = size
    return sizes


def resting_rates(system: System) -> Array:
    """Rates of the coordinates with friction below which they rest, (frictions,)."""
    time = system.scene.time
    return REST * sliding_sizes(system) / (time.end - time.start)


def sliding_sizes(system: System) -> Array:
    """Of each coordinate with friction: the size of the mechanism, or a radian."""
    angles = [rub.primitive.kind == at.COUPLED_ANGLE for rub in system.rubbing]
    return np.where(np.array(angles, bool), 1.0, system.length)
