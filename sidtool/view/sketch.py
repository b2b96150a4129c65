"""Bodies of which no surface is known: bent lines between points, boxes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.distance import cdist

from sidtool.formats.sid import SID, symmetric_3x3

from ..field.beam_field import CORNERS, tube

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Parts = tuple[Array, Indices, Array]

#: Pieces of a line between two points of a body that bends.
_PIECES = 16
#: More points than these are joined in their order: a tree of all would take long.
_MOST = 2000


def skeleton(places: Array, phi: Array, psi: Array, width: float) -> Parts:
    """Bars along the shortest tree between points, with their shape functions.

    Between two points displacements follow the cubic Hermite polynomials of their
    displacements and rotations, as in a beam.

    Parameters
    ----------
    places : (k, 3)
    phi, psi : (k, 3, nq) displacement and rotation of each point
    width : of the bars [m]

    Returns
    -------
    positions (n, 3), triangles (m, 3), shapes (n, 3, nq)
    """
    nq = phi.shape[2]
    pieces = _PIECES if nq else 1
    positions, triangles, shapes, count = [], [], [], 0
    for i, j in _tree(places):
        way = places[j] - places[i]
        s = np.linspace(0, 1, pieces + 1)
        arms = 0.5 * width * CORNERS @ _across(way)
        line = places[i] + s[:, None] * way
        positions.append((line[:, None] + arms).reshape(-1, 3))
        moved = _hermite(s, way, phi[[i, j]], psi[[i, j]])
        shapes.append(np.repeat(moved, 4, axis=0))
        triangles.append(tube(pieces + 1) + count)
        count += 4 * (pieces + 1)
    if not positions:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros((0, 3, nq))
    return np.concatenate(positions), np.concatenate(triangles), np.concatenate(shapes)


def _hermite(s: Array, way: Array, phi: Array, psi: Array) -> Array:
    """(len(s), 3, nq) between two points: way is the vector from one to the other."""
    turned = np.moveaxis(np.cross(np.moveaxis(psi, 1, 2), way), 1, 2)
    length = np.linalg.norm(way)
    along = np.outer(way, way) / length**2
    s = s[:, None, None]
    cubic = (
        (1 + 2 * s) * (1 - s) ** 2 * phi[0]
        + s**2 * (3 - 2 * s) * phi[1]
        + s * (1 - s) ** 2 * turned[0]
        - s**2 * (1 - s) * turned[1]
    )
    linear = (1 - s) * phi[0] + s * phi[1]
    return cubic + along @ (linear - cubic)


def _tree(places: Array) -> list[tuple[int, int]]:
    if len(places) > _MOST:
        return [(i, i + 1) for i in range(len(places) - 1)]
    found = minimum_spanning_tree(cdist(places, places)).tocoo()
    return sorted(zip(found.row.tolist(), found.col.tolist(), strict=True))


def _across(way: Array) -> Array:
    """(2, 3) unit vectors perpendicular to a vector; the second along z if it can."""
    along = way / np.linalg.norm(way)
    helper = np.array([0.0, 0.0, 1.0]) if abs(along[2]) < 0.9 else np.array([1.0, 0, 0])
    first = np.cross(helper, along)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(along, first)])


def boxed(sid: SID, centre: Array, size: float) -> Parts:
    """The box with a body's moments of inertia, at most 15 % of the mechanism."""
    inertia = symmetric_3x3(sid.J.m0[:, 0])
    inertia = inertia - sid.mass * (
        centre @ centre * np.eye(3) - np.outer(centre, centre)
    )
    moments, axes = np.linalg.eigh(inertia)
    squares = np.clip(6 / sid.mass * (moments.sum() - 2 * moments), 0, None)
    edges = np.sqrt(squares)
    edges = (
        np.clip(edges, 0.05 * size, 0.15 * size)
        if edges.any()
        else np.full(3, 0.06 * size)
    )
    if np.linalg.det(axes) < 0:
        axes = -axes
    ring = np.column_stack([np.zeros(4), CORNERS / 2])
    ends = np.concatenate([ring - [0.5, 0, 0], ring + [0.5, 0, 0]])
    positions = centre + (ends * edges) @ axes.T
    return positions, tube(2), np.zeros((8, 3, 0))
