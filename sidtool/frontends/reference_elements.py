"""Shape functions and quadrature of the solid elements, taken from scikit-fem.

The reference elements are the unit cube, the unit simplex and their product; nodes are
numbered as in Abaqus, CalculiX and Nastran: corners first, then the middles of edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SQUARE = ((0, 1), (1, 2), (2, 3), (3, 0))
_CUBE = (
    _SQUARE
    + tuple((a + 4, b + 4) for a, b in _SQUARE)
    + tuple((i, i + 4) for i in range(4))
)
_TRIANGLE = ((0, 1), (1, 2), (2, 0))
_TETRAHEDRON = (*_TRIANGLE, (0, 3), (1, 3), (2, 3))
_PRISM = (
    *_TRIANGLE,
    *((a + 3, b + 3) for a, b in _TRIANGLE),
    *((i, i + 3) for i in range(3)),
)
#: By the name without its number: pairs of corners that are edges, and in space faces.
_EDGES = {
    "tri": _TRIANGLE,
    "quad": _SQUARE,
    "tet": _TETRAHEDRON,
    "hex": _CUBE,
    "wedge": _PRISM,
}
_FACES: dict[str, tuple[tuple[int, ...], ...]] = {
    "tet": ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)),
    "hex": (
        (0, 1, 2, 3),
        (4, 5, 6, 7),
        *((a, b, b + 4, a + 4) for a, b in _SQUARE),
    ),
    "wedge": (
        (0, 1, 2),
        (3, 4, 5),
        *((a, b, b + 3, a + 3) for a, b in _TRIANGLE),
    ),
}
_QUAD = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
_SIMPLEX = np.vstack([np.zeros((1, 3)), np.eye(3)])
_HEX = np.vstack([np.hstack([_QUAD, np.full((4, 1), z)]) for z in (0.0, 1.0)])
_WEDGE = np.vstack(
    [np.hstack([_SIMPLEX[:3, :2], np.full((3, 1), z)]) for z in (0.0, 1.0)]
)

#: Name -> scikit-fem element, corners, edges with a node in the middle, degree up to
#: which the quadrature is exact.
_DEFINITIONS: dict[str, tuple[str, Array, tuple[tuple[int, int], ...], int]] = {
    "tri3": ("ElementTriP1", _SIMPLEX[:3, :2], (), 2),
    "tri6": ("ElementTriP2", _SIMPLEX[:3, :2], _TRIANGLE, 4),
    "quad4": ("ElementQuad1", _QUAD, (), 3),
    "quad8": ("ElementQuadS2", _QUAD, _SQUARE, 5),
    "tet4": ("ElementTetP1", _SIMPLEX, (), 2),
    "tet10": ("ElementTetP2", _SIMPLEX, _TETRAHEDRON, 4),
    "hex8": ("ElementHex1", _HEX, (), 3),
    "hex20": ("ElementHexS2", _HEX, _CUBE, 5),
    "wedge6": ("ElementWedge1", _WEDGE, (), 3),
}
ELEMENT_KINDS = tuple(_DEFINITIONS)


@dataclass(frozen=True, eq=False)
class ReferenceElement:
    """An element at its quadrature points and anywhere else.

    Attributes
    ----------
    nodes : (m, d) where the nodes are
    corners : number of corner nodes, the first ones
    points, weights : (g, d), (g,) of the quadrature
    values, gradients : (g, m), (g, m, d) at those points
    """

    name: str
    nodes: Array
    corners: int
    points: Array
    weights: Array
    values: Array
    gradients: Array

    @property
    def dimension(self) -> int:
        """Of the element itself."""
        return self.nodes.shape[1]

    def at(self, points: Array) -> tuple[Array, Array]:
        """Values (g, m) and gradients (g, m, d) at other points (g, d)."""
        return _tabulated(self.name, points)

    def inside(self, point: Array, slack: float) -> bool:
        """Whether a reference point lies in the element."""
        if point.min() < -slack:
            return False
        if self.name.startswith(("tri", "tet")):
            return bool(point.sum() <= 1 + slack)
        if self.name.startswith("wedge"):
            return bool(point[:2].sum() <= 1 + slack and point[2] <= 1 + slack)
        return bool(point.max() <= 1 + slack)


def all_edges(kind: str) -> list[tuple[int, int, int]]:
    """The corners of every edge and the node in its middle, -1 for none."""
    corners = len(_DEFINITIONS[kind][1])
    middle = {edge: corners + i for i, edge in enumerate(_DEFINITIONS[kind][2])}
    edges = _EDGES[kind.rstrip("0123456789")]
    return [(a, b, middle.get((a, b), -1)) for a, b in edges]


def faces(kind: str, corners: int) -> list[tuple[int, ...]]:
    """The faces of a solid element with so many corners, by their corners."""
    found = _FACES.get(kind.rstrip("0123456789"), ())
    return [face for face in found if len(face) == corners]


def edge_nodes(kind: str) -> tuple[tuple[int, int], ...]:
    """The pairs of corners between which the further nodes of an element lie."""
    return _DEFINITIONS[kind][2]


@cache
def reference_element(kind: str) -> ReferenceElement:
    """The element of that name, one of `ELEMENT_KINDS`."""
    from skfem.quadrature import get_quadrature

    _, corners, edges, degree = _DEFINITIONS[kind]
    middles = [(corners[a] + corners[b]) / 2 for a, b in edges]
    nodes = np.vstack([corners, *middles])
    points, weights = get_quadrature(_skfem(kind).refdom, degree)
    values, gradients = _tabulated(kind, points.T)
    return ReferenceElement(
        kind, nodes, len(corners), points.T, weights, values, gradients
    )


def _skfem(kind: str):  # type: ignore[no-untyped-def]  # noqa: ANN202
    import skfem.element

    return getattr(skfem.element, _DEFINITIONS[kind][0])()


@cache
def _order(kind: str) -> tuple[int, ...]:
    """For each of our nodes, its number in scikit-fem."""
    _, corners, edges, _ = _DEFINITIONS[kind]
    nodes = [*corners, *((corners[a] + corners[b]) / 2 for a, b in edges)]
    theirs = _skfem(kind).doflocs
    return tuple(int(np.argmin(((theirs - x) ** 2).sum(1))) for x in nodes)


def _tabulated(kind: str, points: Array) -> tuple[Array, Array]:
    element = _skfem(kind)
    pairs = [element.lbasis(points.T, i) for i in _order(kind)]
    count = len(points)
    values = [np.broadcast_to(value, count) for value, _ in pairs]
    slopes = [np.broadcast_to(slope, (points.shape[1], count)) for _, slope in pairs]
    return np.stack(values, axis=1), np.stack([s.T for s in slopes], axis=1)
