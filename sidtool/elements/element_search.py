"""Search for the elements of a mesh that contain given points."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.taylor import Array

from ..mesh.mesh import Mesh
from ..mesh.reference_elements import reference_element

Indices = NDArray[np.int64]
PairFilter = Callable[[Indices, Indices], NDArray[np.bool_]]

_ITERATIONS = 12
#: Tolerance of the search, relative to the radius of an element.
_INSIDE_TOLERANCE = 1e-6
#: Bound for the deviation of an element from an affine map, relative to that of its
#: nodes.
_NONLINEARITY_BOUND = 30.0
#: Number of pairs of points and elements that are examined together.
_PAIRS_PER_BATCH = 200_000


class ElementFinder:
    """Search for the elements that contain given points."""

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self.centres: list[Array] = []
        self.radii: list[Array] = []
        self._affine: list[_AffineMaps] = []
        for block in mesh.blocks:
            corners = mesh.positions[block.nodes]
            centre = corners.mean(axis=1)
            self.centres.append(centre)
            radii = np.linalg.norm(corners - centre[:, None], axis=2).max(axis=1)
            self.radii.append(radii)
            self._affine.append(
                _AffineMaps(block.kind, corners, _INSIDE_TOLERANCE * radii)
            )

    def holders(
        self,
        points: Array,
        block: int,
        rows: Indices,
        slack: float,
        is_requested: PairFilter,
    ) -> Iterator[tuple[Indices, Indices]]:
        """Yield pairs of a point and an element of a block that contains it.

        Parameters
        ----------
        rows : elements that are searched
        slack : in the parameters of the element, negative for its interior only
        is_requested : returns which pairs of points and elements need an answer
        """
        from scipy.spatial import cKDTree

        if not len(rows) or not len(points):
            return
        tree = cKDTree(points)
        reach = self.radii[block][rows] * (1 + 1e-6)
        near = tree.query_ball_point(self.centres[block][rows], reach)
        counts = np.fromiter((len(x) for x in near), np.int64, len(near))
        element = np.repeat(rows, counts)
        point = np.fromiter((i for x in near for i in x), np.int64, counts.sum())
        for start in range(0, len(point), _PAIRS_PER_BATCH):
            i, row = (
                point[start : start + _PAIRS_PER_BATCH],
                element[start : start + _PAIRS_PER_BATCH],
            )
            near = self._affine[block].may_contain(points[i], row, slack)
            i, row = i[near], row[near]
            is_wanted = is_requested(i, row)
            i, row = i[is_wanted], row[is_wanted]
            held = self._pairs_inside(points[i], block, row, slack)
            yield i[held], row[held]

    def _pairs_inside(
        self, points: Array, block: int, rows: Indices, slack: float
    ) -> NDArray[np.bool_]:
        kind = self._mesh.blocks[block].kind
        elements = self._mesh.blocks[block].nodes
        held = np.zeros(len(rows), bool)
        for i in np.array_split(np.arange(len(rows)), 1 + len(rows) // 20_000):
            nodes = self._mesh.positions[elements[rows[i]]]
            where, miss = _invert_maps(kind, nodes, points[i])
            inside = reference_element(kind).excess(where) <= slack
            close = miss < _INSIDE_TOLERANCE * self.radii[block][rows[i]]
            held[i] = inside & close
        return held


class _AffineMaps:
    """Affine maps that are tangent to elements of a kind at their centres. The
    deviation of a point of an element is bounded by that of its nodes times a factor.
    """

    def __init__(self, kind: str, nodes: Array, close: Array) -> None:
        """Make the maps of nodes (k, m, d), for points that may be `close` (k,) to
        elements.
        """
        self._element = reference_element(kind)
        self._centre = self._element.nodes.mean(axis=0)
        values, gradients = self._element.at(self._centre[None])
        self._middle = _interpolate(values, nodes)
        jacobians = np.swapaxes(nodes, 1, 2) @ gradients
        flat = ~(np.abs(np.linalg.det(jacobians)) > 0)
        jacobians[flat] = np.eye(nodes.shape[2])
        self._inverses = np.linalg.inv(jacobians)
        local_nodes = (nodes - self._middle[:, None]) @ np.swapaxes(
            self._inverses, 1, 2
        )
        off = np.abs(local_nodes + self._centre - self._element.nodes).max(axis=(1, 2))
        off += close * np.linalg.norm(self._inverses, axis=(1, 2))
        self._margins = np.where(flat, np.inf, _NONLINEARITY_BOUND * off)

    def may_contain(
        self, points: Array, rows: Indices, slack: float
    ) -> NDArray[np.bool_]:
        """Whether points (k, d) may lie in elements (k,); False if they cannot."""
        arms = points - self._middle[rows]
        where = self._centre + (self._inverses[rows] @ arms[..., None])[..., 0]
        return np.asarray(self._element.excess(where) <= slack + self._margins[rows])


def _invert_maps(kind: str, nodes: Array, points: Array) -> tuple[Array, Array]:
    """Return parameters (k, d) of points (k, d) in elements (k, m, d), and the residual
    distance.
    """
    element = reference_element(kind)
    where = np.tile(element.nodes.mean(axis=0), (len(points), 1))
    values, gradients = element.at(where[:1])
    active = np.arange(len(points))
    for _ in range(_ITERATIONS):
        corners = nodes[active]
        jacobians = np.swapaxes(corners, 1, 2) @ gradients
        safe = np.abs(np.linalg.det(jacobians)) > 0
        jacobians[~safe] = np.eye(nodes.shape[2])
        miss = points[active] - _interpolate(values, corners)
        step = np.linalg.solve(jacobians, miss[..., None])[..., 0]
        where[active] = np.clip(where[active] + step, -0.5, 1.5)
        active = active[np.abs(step).max(axis=1) > 1e-10]
        if not active.size:
            break
        values, gradients = element.at(where[active])
    values, _ = element.at(where)
    return where, np.linalg.norm(points - _interpolate(values, nodes), axis=1)


def _interpolate(values: Array, nodes: Array) -> Array:
    """(k, d) of nodes (k, m, d) by shape functions (k or 1, m)."""
    return np.asarray((values[:, None] @ nodes)[:, 0])
