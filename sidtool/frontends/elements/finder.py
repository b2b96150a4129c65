"""Which elements of a mesh hold given points, for many points at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ..mesh.data import Mesh
from .reference import reference_element

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Asked = Callable[[Indices, Indices], NDArray[np.bool_]]

_ITERATIONS = 12
#: Pairs of points and elements that are looked at together.
_PAIRS = 200_000


class ElementFinder:
    """Finds elements that hold given points."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self.centres: list[Array] = []
        self.radii: list[Array] = []
        self.boxes: list[tuple[Array, Array]] = []
        for block in mesh.blocks:
            corners = mesh.positions[block.nodes]
            centre = corners.mean(axis=1)
            low, high = corners.min(axis=1), corners.max(axis=1)
            extent = high - low
            margin = 0.1 * extent + 1e-5 * extent.max(axis=1, keepdims=True)
            self.boxes.append((low - margin, high + margin))
            self.centres.append(centre)
            self.radii.append(
                np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
            )

    def holders(
        self, points: Array, block: int, rows: Indices, slack: float, asked: Asked
    ) -> Iterator[tuple[Indices, Indices]]:
        """Yield pairs of a point and an element of a block that holds it.

        Parameters
        ----------
        rows : the elements that are asked
        slack : in the parameters of the element, below zero for its inside only
        asked : which pairs of points and elements need an answer
        """
        if not len(rows) or not len(points):
            return
        tree = cKDTree(points)
        reach = self.radii[block][rows] * (1 + 1e-6)
        near = tree.query_ball_point(self.centres[block][rows], reach)
        counts = np.fromiter((len(x) for x in near), np.int64, len(near))
        element = np.repeat(rows, counts)
        point = np.fromiter((i for x in near for i in x), np.int64, counts.sum())
        for start in range(0, len(point), _PAIRS):
            i, row = point[start : start + _PAIRS], element[start : start + _PAIRS]
            boxed = self._boxed(points[i], block, row)
            i, row = i[boxed], row[boxed]
            kept = asked(i, row)
            i, row = i[kept], row[kept]
            held = self._held(points[i], block, row, slack)
            yield i[held], row[held]

    def _boxed(self, points: Array, block: int, rows: Indices) -> NDArray[np.bool_]:
        low, high = self.boxes[block]
        boxed = np.ones(len(rows), bool)
        for axis in range(points.shape[1]):
            x = points[:, axis]
            boxed &= (x >= low[rows, axis]) & (x <= high[rows, axis])
        return boxed

    def _held(
        self, points: Array, block: int, rows: Indices, slack: float
    ) -> NDArray[np.bool_]:
        kind = self._mesh.blocks[block].kind
        elements = self._mesh.blocks[block].nodes
        held = np.zeros(len(rows), bool)
        for i in np.array_split(np.arange(len(rows)), 1 + len(rows) // 20_000):
            nodes = self._mesh.positions[elements[rows[i]]]
            where, miss = _located(kind, nodes, points[i])
            inside = reference_element(kind).excess(where) <= slack
            close = miss < 1e-6 * self.radii[block][rows[i]]
            held[i] = inside & close
        return held


def _located(kind: str, nodes: Array, points: Array) -> tuple[Array, Array]:
    """Parameters (k, d) of points (k, d) in elements (k, m, d), and what is missed."""
    element = reference_element(kind)
    where = np.tile(element.nodes.mean(axis=0), (len(points), 1))
    values, gradients = element.at(where[:1])
    active = np.arange(len(points))
    for _ in range(_ITERATIONS):
        corners = nodes[active]
        jacobians = np.swapaxes(corners, 1, 2) @ gradients
        safe = np.abs(np.linalg.det(jacobians)) > 0
        jacobians[~safe] = np.eye(nodes.shape[2])
        miss = points[active] - _interpolated(values, corners)
        step = np.linalg.solve(jacobians, miss[..., None])[..., 0]
        where[active] = np.clip(where[active] + step, -0.5, 1.5)
        active = active[np.abs(step).max(axis=1) > 1e-10]
        if not active.size:
            break
        values, gradients = element.at(where[active])
    values, _ = element.at(where)
    return where, np.linalg.norm(points - _interpolated(values, nodes), axis=1)


def _interpolated(values: Array, nodes: Array) -> Array:
    """(k, d) of nodes (k, m, d) by shape functions (k or 1, m)."""
    return np.asarray((values[:, None] @ nodes)[:, 0])
