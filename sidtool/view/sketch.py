"""Bodies of which no surface is known: hulls, bars between points, boxes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import ConvexHull, KDTree
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
#: Points that are looked at for the neighbours of each, and of a distance what counts
#: as equal.
_NEAR, _TIE = 32, 1e-9
#: Of points that fill a volume the least spread to the largest; see `hull`.
_THIN, _BENT = 0.01, 0.01


def skeleton(places: Array, phi: Array, psi: Array, width: float) -> Parts:
    """Bars between neighbours, with their shape functions.

    Between two points with rotations displacements follow the cubic Hermite polynomials
    of their displacements and rotations, as in a beam; others are joined by straight
    lines.

    Parameters
    ----------
    places : (k, 3)
    phi, psi : (k, 3, nq) displacement and rotation of each point; a rotation of 0 is
        not known, but where the displacement is 0, too
    width : of the bars [m]

    Returns
    -------
    positions (n, 3), triangles (m, 3), shapes (n, 3, nq)
    """
    nq = phi.shape[2]
    turned = np.asarray(psi.any(axis=(1, 2)))
    resting = ~turned & ~np.asarray(phi.any(axis=(1, 2)))
    turning = turned | (resting & turned.any())  # the body frame turns with the latter
    positions, triangles, shapes, count = [], [], [], 0
    for i, j in _neighbours(places):
        bent = bool(turning[i] and turning[j])
        pieces = _PIECES if bent else 1
        way = places[j] - places[i]
        s = np.linspace(0, 1, pieces + 1)
        arms = 0.5 * width * CORNERS @ _across(way)
        line = places[i] + s[:, None] * way
        positions.append((line[:, None] + arms).reshape(-1, 3))
        straight = (1 - s)[:, None, None] * phi[i] + s[:, None, None] * phi[j]
        moved = _hermite(s, way, phi[[i, j]], psi[[i, j]]) if bent else straight
        shapes.append(np.repeat(moved, 4, axis=0))
        triangles.append(tube(pieces + 1) + count)
        count += 4 * (pieces + 1)
    if not positions:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros((0, 3, nq))
    return np.concatenate(positions), np.concatenate(triangles), np.concatenate(shapes)


def hull(places: Array, phi: Array) -> Parts | None:
    """The convex hull of points, of all that lie on it; None where they fill no volume.

    Faces are bent outwards by a hundredth for the search, so that points in their
    middle are corners, too, and move with the body.
    """
    if len(places) < 4:
        return None
    middle = places.mean(axis=0)
    _, sizes, axes = np.linalg.svd(places - middle, full_matrices=False)
    if sizes[2] < _THIN * sizes[0]:
        return None
    round_ = (places - middle) @ axes.T / sizes
    square = (round_**2).sum(axis=1, keepdims=True)
    faces = ConvexHull(round_ * (1 - _BENT * square / square.max())).simplices
    a, b, c = np.moveaxis(places[faces], 1, 0)
    inwards = np.einsum("fa,fa->f", np.cross(b - a, c - a), a + b + c - 3 * middle) < 0
    faces = np.where(inwards[:, None], faces[:, ::-1], faces)
    used, rows = np.unique(faces, return_inverse=True)
    return places[used], rows.reshape(-1, 3), phi[used]


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


def _neighbours(places: Array) -> list[tuple[int, int]]:
    """Pairs of points with no other in the ball between them, so that a grid keeps its
    edges without diagonals (K. Gabriel, R. Sokal, "A new statistical approach to
    geographic variation analysis", 1969), among points that are near each other, and
    the shortest tree, which joins all."""
    if len(places) > _MOST:
        return [(i, i + 1) for i in range(len(places) - 1)]
    tree = KDTree(places)
    near = tree.query(places, min(_NEAR, len(places)))[1].reshape(len(places), -1)
    pairs = np.column_stack([np.repeat(np.arange(len(near)), near.shape[1]), near.flat])
    pairs = np.unique(np.sort(pairs, axis=1), axis=0)
    ends = places[pairs]
    radius = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2
    inside = tree.query_ball_point(
        ends.mean(axis=1), radius * (1 + _TIE), return_length=True
    )
    free = pairs[(inside == 2) & (radius > 0)]
    shortest = minimum_spanning_tree(cdist(places, places)).tocoo()
    joined = np.sort(np.column_stack([shortest.row, shortest.col]), axis=1)
    found = np.unique(np.concatenate([free, joined]), axis=0)
    return [(int(i), int(j)) for i, j in found]


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
    corners, triangles = box(edges)
    return centre + corners @ axes.T, triangles, np.zeros((8, 3, 0))


def box(edges: Array) -> tuple[Array, Indices]:
    """Corners (8, 3) and triangles of a box about the origin.

    edges : (3,)
    """
    ring = np.column_stack([np.zeros(4), CORNERS / 2])
    ends = np.concatenate([ring - [0.5, 0, 0], ring + [0.5, 0, 0]])
    return ends * edges, tube(2)
