"""Characteristic sizes, which make displacements, angles and deformations comparable.

A length is compared with the size of the mechanism, an angle with a radian. Therefore
results do not depend on the unit system, and mechanisms of micrometres close as well as
those of kilometres.
"""

import math
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.scene import SceneFile, as_3d
from sidtool.formats.storage.cache import cached_by_identity

from ..spatial import system_arrays as at
from .body_data import BodyData, displacement_amplitudes
from .system import GROUND_NAME, System

_ANGLES = (at.ANGLE, at.PERPENDICULAR, at.COUPLED_ANGLE)
_COUPLING_TERMS = (at.COUPLED_ANGLE, at.COUPLED_DISPLACEMENT)
#: Rates below this part of the size of the mechanism during the run are rest.
RESTING_RATE = 1e-10


def diameter(points: Array) -> float:
    """The largest distance in a set of points (n >= 1, 3), or at least half of it.

    From the point farthest from the mean to the one farthest from that: it changes
    neither with the axes nor with the order of the points.
    """
    from_mean = points - points.sum(axis=0) / len(points)
    differences = points - points[(from_mean * from_mean).sum(axis=1).argmax()]
    return math.sqrt((differences * differences).sum(axis=1).max())


def mechanism_size(
    scene: SceneFile, data: Mapping[str, BodyData], markers: Iterable[tuple[str, str]]
) -> float:
    """Largest distance in a body, or between places of bodies and of the ground [m].

    A body alone that has no extent is measured by how far it flies.

    Parameters
    ----------
    markers : (body, marker)
        All that the scene uses.
    """
    sizes = []
    ground = [name for body, name in markers if body == GROUND_NAME]
    positions = [data[GROUND_NAME].node(name).position for name in ground]
    for name in scene.bodies:
        sizes.append(_body_extent(data[name].sid))
        positions.append(as_3d(scene.initial_of(name).position))
    sizes.append(diameter(np.array(positions)))
    return max(sizes) or _free_flight_distance(scene) or 1.0


@cached_by_identity
def _body_extent(sid: SID) -> float:
    """Largest distance between nodes, frame and centre of mass of a body [m]."""
    points = [node.position for node in sid.nodes]
    points += [np.zeros(3), sid.mdCM.m0[:, 0] / (sid.mass or 1.0)]
    return diameter(np.array(points))


@cached_by_identity
def _frame_distance(sid: SID) -> float:
    """How far the nodes of a body lie from its frame [m]."""
    positions = [node.position for node in sid.nodes]
    return math.sqrt(max((place @ place for place in positions), default=0.0))


def _free_flight_distance(scene: SceneFile) -> float:
    """How far initial velocities and gravity carry a body at most."""
    starts = map(scene.initial_of, scene.bodies)
    speeds = [np.linalg.norm(as_3d(start.velocity)) for start in starts]
    gravity_distance = 0.5 * np.linalg.norm(as_3d(scene.gravity))
    duration = scene.time.end - scene.time.start
    return float(duration * (max(speeds) + duration * gravity_distance))


def body_extents(system: System) -> Array:
    """How far each body reaches from its frame, (bodies,) [m]; of one that has no
    extent, the size of the mechanism."""
    return np.array(
        [_frame_distance(body.sid) or system.length for body in system.bodies]
    )


def coordinate_sizes(system: System) -> Array:
    """Of each velocity coordinate: the size of the mechanism, a radian, an elastic
    coordinate that displaces a node by the size of the mechanism; (n velocities,)."""
    lengths = system.length / system.cached_by_topology(coordinate_amplitudes)
    return np.where(system.cached_by_topology(_is_rotation), 1.0, lengths)


def coordinate_amplitudes(system: System) -> Array:
    """Displacement per unit of each elastic coordinate, and 1 of others, (n
    velocities,); see `displacement_amplitudes`.
    """
    amplitudes, axes = np.ones(system.n_velocities), 2 if system.planar else 3
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        elastic = slice(row[at.VEL] + row[at.RD], row[at.VEL] + row[at.NV])
        amplitudes[elastic] = displacement_amplitudes(data.sid, axes)
    return amplitudes


def _is_rotation(system: System) -> NDArray[np.bool_]:
    """Velocity coordinates that turn a body, (n velocities,)."""
    is_rotation, axes = np.zeros(system.n_velocities, bool), 2 if system.planar else 3
    for row in system.arrays.body:
        is_rotation[row[at.VEL] + axes : row[at.VEL] + row[at.RD]] = True
    return is_rotation


def constraint_sizes(system: System) -> Array:
    """Of each constraint: the size of the mechanism, a radian, or a sum of both that a
    coupling weights; (rows,)."""
    sizes = np.zeros(system.n_rows)
    point = 2 if system.planar else 3
    term = at.TERM_PLANAR if system.planar else at.TERM_SPATIAL
    for con in system.arrays.constraint.tolist():
        kind, row = con[at.KIND], con[at.ROW]
        size = 1.0 if kind in _ANGLES else system.length
        if kind in _COUPLING_TERMS:
            weight = system.arrays.real_data[con[at.C_DATA] + term + at.W_WEIGHT]
            sizes[row] = max(sizes[row], abs(weight) * size)
            continue
        sizes[row : row + (point if kind == at.COINCIDENT else 1)] = size
    return sizes


def resting_rates(system: System) -> Array:
    """Rates of the coordinates with friction below which they rest, (frictions,)."""
    time = system.scene.time
    return RESTING_RATE * friction_coordinate_sizes(system) / (time.end - time.start)


def friction_coordinate_sizes(system: System) -> Array:
    """Of each coordinate with friction: the size of the mechanism, or a radian."""
    angles = [rub.primitive.kind == at.COUPLED_ANGLE for rub in system.friction_joints]
    return np.where(np.array(angles, bool), 1.0, system.length)
