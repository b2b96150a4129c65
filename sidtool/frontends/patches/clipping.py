"""Where the faces of two surfaces lie over each other, in the parameters of one."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ..elements.quadrature_rules import quadrature_rule
from ..faces import Faces

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Polygon = list[tuple[float, float]]

#: Degree to which integrals over a common part are exact where faces are flat.
_DEGREE = 5
#: Common parts of a smaller share of the face are rounding.
_SLIVER = 1e-9
#: Half-planes u a + v b + c >= 0 that bound a face.
_BOX = ((1, 0, 0), (-1, 0, 1), (0, 1, 0), (0, -1, 1))
_SIMPLEX = ((1, 0, 0), (0, 1, 0), (-1, -1, 1))


def common_parts(slave: Faces, master: Faces) -> Iterator[tuple[int, int, Array]]:
    """Faces that lie over each other, and the simplices (n, d, d - 1) they share.

    These are in the parameters of the slave; edges of the master are straight there.
    """
    from scipy.spatial import cKDTree

    centres = (slave.points.mean(axis=1), master.points.mean(axis=1))
    reach = slave.radii.max() + master.radii.max()
    near = cKDTree(centres[0]).query_ball_tree(cKDTree(centres[1]), reach)
    pairs = [(i, j) for i, found in enumerate(near) for j in found]
    if not pairs:
        return
    rows, others = np.array(pairs).T
    gap = np.linalg.norm(centres[0][rows] - centres[1][others], axis=1)
    close = gap <= slave.radii[rows] + master.radii[others]
    rows, others = rows[close], others[close]
    m = master.corners
    corners = master.points[others][:, :m].reshape(len(rows) * m, -1)
    placed = slave.nearest(np.repeat(rows, m), corners, inside=False)
    placed = placed.reshape(len(rows), m, -1)
    for i, j, outline in zip(rows, others, placed, strict=True):
        parts = _shared(slave.kind, outline)
        if len(parts):
            yield int(i), int(j), parts


def _shared(kind: str, outline: Array) -> Array:
    if outline.shape[1] == 1:
        a, b = np.clip(sorted(outline[:, 0]), 0.0, 1.0)
        return np.array([[[a], [b]]]) if b - a > _SLIVER else np.zeros((0, 2, 1))
    polygon: Polygon = [(u, v) for u, v in outline.tolist()]
    for bound in _SIMPLEX if kind.startswith("tri") else _BOX:
        polygon = _cut(polygon, bound)
        if len(polygon) < 3:
            return np.zeros((0, 3, 2))
    first, *rest = polygon
    parts = np.array([[first, a, b] for a, b in zip(rest, rest[1:], strict=False)])
    sizes = np.abs(np.linalg.det(parts[:, 1:] - parts[:, :1]))
    return parts[sizes > _SLIVER]


def _cut(polygon: Polygon, bound: tuple[int, int, int]) -> Polygon:
    """The part of a convex polygon on the positive side of a line."""
    a, b, c = bound
    kept: Polygon = []
    sides = [a * u + b * v + c for u, v in polygon]
    for i, (point, side) in enumerate(zip(polygon, sides, strict=True)):
        before, other = polygon[i - 1], sides[i - 1]
        if (side >= 0) != (other >= 0):
            t = other / (other - side)
            kept.append(
                (
                    before[0] + t * (point[0] - before[0]),
                    before[1] + t * (point[1] - before[1]),
                )
            )
        if side >= 0:
            kept.append(point)
    return kept


def quadrature_of(parts: Array) -> tuple[Array, Array]:
    """Points (n g, k) and weights (n g,) in parameters of simplices (n, k + 1, k)."""
    k = parts.shape[2]
    points, weights = _rule("line" if k == 1 else "tri")
    edges = parts[:, 1:] - parts[:, :1]
    placed = parts[:, :1] + np.einsum("gk,nkd->ngd", points, edges)
    sizes = np.abs(np.linalg.det(edges))
    return placed.reshape(-1, k), (sizes[:, None] * weights).ravel()


@cache
def _rule(shape: str) -> tuple[Array, Array]:
    return quadrature_rule(shape, _DEGREE)
