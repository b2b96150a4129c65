"""Surfaces for pictures: plates, decimation, hulls, bars, inertia boxes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial import ConvexHull, KDTree
from scipy.spatial.distance import cdist

from sidtool.formats.base.sid import SID, Array, symmetric_3x3

from .body_field import CORNERS, tube

Indices = NDArray[np.int64]

Parts = tuple[Array, Indices, Array]
#: Pieces of a line between two points of a body that bends.
_PIECES_PER_BAR = 16
#: More points than this are joined in their order: a spanning tree would take too long.
_MAX_TREE_POINTS = 2000
#: Number of candidates for the neighbours of a point; relative tolerance for equal
#: distances.
_CANDIDATE_NEIGHBOURS, _EQUAL_DISTANCE_TOLERANCE = 32, 1e-9
#: Smallest ratio of the spreads of points that fill a volume; see `convex_hull`.
_MIN_SPREAD_RATIO, _MIN_CURVATURE_RATIO = 0.01, 0.01


@dataclass(frozen=True, eq=False)
class PictureSurface:
    """positions (n, 3), triangles (m, 3), and the given points that they copy (n,)."""

    positions: Array
    triangles: Indices
    copies: Indices


def plate_surface(
    positions: Array, triangles: Indices, thickness: float
) -> PictureSurface:
    """A plane surface with thickness as a plate: two sides and a rim."""
    n = len(positions)
    if not thickness:
        return PictureSurface(positions, triangles, np.arange(n))
    shift = np.array([0.0, 0.0, thickness / 2])
    rim = border_edges(triangles)
    a, b = rim.T
    sides = np.concatenate(
        [np.column_stack([a, b, b + n]), np.column_stack([a, b + n, a + n])]
    )
    # lower side first: its triangles face down, the upper ones up
    return PictureSurface(
        np.concatenate([positions - shift, positions + shift]),
        np.concatenate([triangles[:, ::-1], triangles + n, sides]),
        np.tile(np.arange(n), 2),
    )


def border_edges(triangles: Indices) -> Indices:
    """(k, 2) directed edges that belong to one triangle."""
    edges = np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    _, inverse, counts = np.unique(
        np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return edges[(counts == 1)[inverse.ravel()]]


def decimate(positions: Array, triangles: Indices, most: int) -> Indices:
    """Reduce a surface to about `most` triangles between some of the same points.

    Points in a cell of a grid become one of them, the one nearest to their mean
    (J. Rossignac, P. Borrel, "Multi-resolution 3D approximations for rendering complex
    scenes", 1993). The grid is coarsened until few enough triangles are left.
    """
    if len(triangles) <= most:
        return triangles
    low = positions.min(axis=0)
    extent = float(np.ptp(positions, axis=0).max()) or 1.0
    cells = 2.0 * np.sqrt(most)
    decimated = triangles
    while len(decimated) > most:
        keys = np.floor((positions - low) / extent * cells).astype(np.int64)
        _, group = np.unique(keys, axis=0, return_inverse=True)
        decimated = _merge_points(positions, triangles, group.ravel())
        cells *= 0.8
    return decimated


def _merge_points(positions: Array, triangles: Indices, group: Indices) -> Indices:
    counts = np.bincount(group)
    middles = np.column_stack(
        [np.bincount(group, positions[:, axis]) / counts for axis in range(3)]
    )
    distance = np.linalg.norm(positions - middles[group], axis=1)
    order = np.lexsort((distance, group))
    first = np.searchsorted(group[order], np.arange(len(counts)))
    merged = order[first][group[triangles]]
    a, b, c = merged.T
    merged = merged[(a != b) & (b != c) & (c != a)]
    _, first_copies = np.unique(np.sort(merged, axis=1), axis=0, return_index=True)
    return merged[np.sort(first_copies)]


def node_bars(places: Array, phi: Array, psi: Array, width: float) -> Parts:
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
    for i, j in _neighbour_pairs(places):
        bent = bool(turning[i] and turning[j])
        pieces = _PIECES_PER_BAR if bent else 1
        way = places[j] - places[i]
        s = np.linspace(0, 1, pieces + 1)
        arms = 0.5 * width * CORNERS @ _perpendicular_vectors(way)
        line = places[i] + s[:, None] * way
        positions.append((line[:, None] + arms).reshape(-1, 3))
        straight = (1 - s)[:, None, None] * phi[i] + s[:, None, None] * phi[j]
        moved = _hermite_curve(s, way, phi[[i, j]], psi[[i, j]]) if bent else straight
        shapes.append(np.repeat(moved, 4, axis=0))
        triangles.append(tube(pieces + 1) + count)
        count += 4 * (pieces + 1)
    if not positions:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros((0, 3, nq))
    return np.concatenate(positions), np.concatenate(triangles), np.concatenate(shapes)


def convex_hull(places: Array, phi: Array) -> Parts | None:
    """The convex hull of points, of all that lie on it; None where they fill no volume.

    Faces are bent outwards by a hundredth for the search, so that points in their
    middle are corners, too, and move with the body.
    """
    if len(places) < 4:
        return None
    middle = places.mean(axis=0)
    _, sizes, axes = np.linalg.svd(places - middle, full_matrices=False)
    if sizes[2] < _MIN_SPREAD_RATIO * sizes[0]:
        return None
    round_ = (places - middle) @ axes.T / sizes
    square = (round_**2).sum(axis=1, keepdims=True)
    faces = ConvexHull(
        round_ * (1 - _MIN_CURVATURE_RATIO * square / square.max())
    ).simplices
    a, b, c = np.moveaxis(places[faces], 1, 0)
    inwards = np.einsum("fa,fa->f", np.cross(b - a, c - a), a + b + c - 3 * middle) < 0
    faces = np.where(inwards[:, None], faces[:, ::-1], faces)
    used, rows = np.unique(faces, return_inverse=True)
    return places[used], rows.reshape(-1, 3), phi[used]


def _hermite_curve(s: Array, way: Array, phi: Array, psi: Array) -> Array:
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


def _neighbour_pairs(places: Array) -> list[tuple[int, int]]:
    """Return pairs of neighbouring points: the Gabriel graph, and the shortest tree.

    Pairs of the graph have no other point in the ball between them, so that a grid
    keeps its edges without diagonals (K. Gabriel, R. Sokal, "A new statistical approach
    to geographic variation analysis", 1969). Only points that are near each other are
    examined; the tree joins all.
    """
    if len(places) > _MAX_TREE_POINTS:
        return [(i, i + 1) for i in range(len(places) - 1)]
    tree = KDTree(places)
    near = tree.query(places, min(_CANDIDATE_NEIGHBOURS, len(places)))[1].reshape(
        len(places), -1
    )
    pairs = np.column_stack([np.repeat(np.arange(len(near)), near.shape[1]), near.flat])
    pairs = np.unique(np.sort(pairs, axis=1), axis=0)
    ends = places[pairs]
    radius = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2
    inside = tree.query_ball_point(
        ends.mean(axis=1), radius * (1 + _EQUAL_DISTANCE_TOLERANCE), return_length=True
    )
    free = pairs[(inside == 2) & (radius > 0)]
    shortest = minimum_spanning_tree(cdist(places, places)).tocoo()
    joined = np.sort(np.column_stack([shortest.row, shortest.col]), axis=1)
    neighbours = np.unique(np.concatenate([free, joined]), axis=0)
    return [(int(i), int(j)) for i, j in neighbours]


def _perpendicular_vectors(way: Array) -> Array:
    """(2, 3) unit vectors perpendicular to a vector; the second along z if it can."""
    along = way / np.linalg.norm(way)
    helper = np.array([0.0, 0.0, 1.0]) if abs(along[2]) < 0.9 else np.array([1.0, 0, 0])
    first = np.cross(helper, along)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(along, first)])


def inertia_box(sid: SID, centre: Array, size: float) -> Parts:
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
