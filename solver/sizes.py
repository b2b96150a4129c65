"""What is large: sizes that make displacements, angles and deformations comparable.

Nothing is large or small by itself: a length is compared with the size of the
mechanism, an angle with a radian. So results do not depend on the unit system, and
mechanisms of micrometres are closed as well as those of kilometres.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from formats.sid import Array

from .bodies import amplitudes
from .kernels import layout as at

if TYPE_CHECKING:
    from .scene import System

_ANGLES = (at.ANGLE, at.PERPENDICULAR, at.COUPLED_ANGLE)
_TERMS = (at.COUPLED_ANGLE, at.COUPLED_ALONG)


def diameter(points: Array) -> float:
    """The largest distance in a set of points (n, 3), or at least half of it.

    From the point farthest from the mean to the one farthest from that: it changes
    neither with the axes nor with the order of the points.
    """
    if len(points) == 0:
        return 0.0
    away = np.linalg.norm(points - np.mean(points, axis=0), axis=1)
    first = points[np.argmax(away)]
    return float(np.max(np.linalg.norm(points - first, axis=1)))


def coordinate_sizes(system: System) -> Array:
    """Of each velocity coordinate: the size of the mechanism, a radian, an elastic
    coordinate that displaces a node by the size of the mechanism; (n velocities,)."""
    sizes = np.full(system.n_velocities, system.length)
    axes = 2 if system.planar else 3
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        u, rd = int(row[at.VEL]), int(row[at.RD])
        sizes[u + axes : u + rd] = 1.0
        sizes[u + rd : u + row[at.NV]] = system.length / amplitudes(data.sid, axes)
    return sizes


def row_sizes(system: System) -> Array:
    """Of each constraint: the size of the mechanism, a radian, or a sum of both that a
    coupling weights; (rows,)."""
    sizes = np.zeros(system.n_rows)
    point = 2 if system.planar else 3
    term = at.TERM_PLANAR if system.planar else at.TERM_SPATIAL
    for con in system.arrays.constraint:
        kind, row = int(con[at.KIND]), int(con[at.ROW])
        size = 1.0 if kind in _ANGLES else system.length
        if kind in _TERMS:
            weight = system.arrays.pool[con[at.C_DATA] + term + at.W_WEIGHT]
            sizes[row] = max(sizes[row], abs(weight) * size)
            continue
        sizes[row : row + (point if kind == at.COINCIDENT else 1)] = size
    return sizes
