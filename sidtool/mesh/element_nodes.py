"""Nodes of elements: repeated ones and missing mid-side nodes.

Hexahedra and quadrilaterals with repeated nodes are prisms, pyramids, tetrahedra and
triangles. The displacement along an edge without its mid-side node is linear, as that
of a linear neighbour: a node is placed midway between the corners and moves by their
mean.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import permutations

import numpy as np

from sidtool.formats.diagnostics import Diagnostic, diagnose

from .connections import RawEquation
from .reference_elements import edge_nodes, quadratic_kind, reference_element, shape_of

#: Corners of a cube in the order of hex8, and how nodes of one that collapses repeat:
#: the collapsed shape and which of its corners these are.
_CUBE = np.array(
    [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    + [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
)
_PATTERNS = {
    "wedge6": ((0, 1, 2, 2, 4, 5, 6, 6), (0, 1, 2, 4, 5, 6)),
    "pyramid5": ((0, 1, 2, 3, 4, 4, 4, 4), (0, 1, 2, 3, 4)),
    "tet4": ((0, 1, 2, 2, 4, 4, 4, 4), (0, 1, 2, 4)),
}


def collapse_element(kind: str, nodes: Sequence[int]) -> tuple[str, list[int]]:
    """Return the element with coinciding nodes merged; others are unchanged.

    A hexahedron may repeat them at any of its edges and faces.
    """
    listed = list(nodes)
    distinct = len(set(listed))
    if kind == "quad4" and distinct == 3:
        cyclic = [n for i, n in enumerate(listed) if n != listed[i - 1]]
        return ("tri3", cyclic) if len(cyclic) == 3 else (kind, listed)
    if kind != "hex8" or distinct == len(listed):
        return kind, listed
    for order in _cube_rotations():
        turned = [listed[i] for i in order]
        for shape, (pattern, corners) in _PATTERNS.items():
            same = all(turned[i] == turned[k] for i, k in enumerate(pattern))
            if same and distinct == len(corners):
                return shape, [turned[i] for i in corners]
    return kind, listed


@cache
def _cube_rotations() -> tuple[tuple[int, ...], ...]:
    """The orders of a cube's corners that its 24 rotations make."""
    number = {tuple(corner): i for i, corner in enumerate((2 * _CUBE - 1).tolist())}
    rotations = []
    for axes in permutations(range(3)):
        for signs in np.ndindex(2, 2, 2):
            turn = np.zeros((3, 3), int)
            turn[range(3), axes] = 1 - 2 * np.array(signs)
            if round(float(np.linalg.det(turn))) == 1:
                places = (2 * _CUBE - 1) @ turn.T
                rotations.append(tuple(number[tuple(p)] for p in places.tolist()))
    return tuple(rotations)


Point = tuple[float, float, float]


class MidsideNodes:
    """Inserted mid-side nodes, and the equations that define their motion.

    Attributes
    ----------
    nodes : label -> position of all nodes, including added ones
    added : their labels by the corners at their sides
    equations : three (or two) for every added node
    """

    def __init__(self, nodes: Mapping[int, Point]) -> None:
        self.nodes = dict(nodes)
        self.added: dict[tuple[int, int], int] = {}
        self.equations: list[RawEquation] = []
        self._next = min(0, *nodes, 0) - 1  # labels that no file can have

    def completed(
        self, kind: str, nodes: Sequence[int], place: str
    ) -> tuple[str, list[int]]:
        """The element with all its nodes; the linear one if it has no middle.

        Parameters
        ----------
        nodes : 0 where there is none
        """
        element = reference_element(kind)
        corners = element.corners
        if 0 not in nodes or not all(nodes[:corners]):
            return kind, list(nodes)
        if not any(nodes[corners:]):
            return linear_kind(kind), list(nodes[:corners])
        full = list(nodes)
        for i, (a, b) in enumerate(edge_nodes(kind), start=corners):
            if not full[i] and {nodes[a], nodes[b]} <= self.nodes.keys():
                full[i] = self._middle(nodes[a], nodes[b], element.dimension, place)
        return kind, full

    def _middle(self, a: int, b: int, dimension: int, place: str) -> int:
        key = (min(a, b), max(a, b))
        if key not in self.added:
            label = self._next
            self._next -= 1
            x, y, z = (np.add(self.nodes[a], self.nodes[b]) / 2).tolist()
            self.nodes[label] = (x, y, z)
            self.added[key] = label
            for axis in np.eye(3)[:dimension].tolist():
                x, y, z = axis
                half = (-x / 2, -y / 2, -z / 2)
                terms = ((label, (x, y, z)), (a, half), (b, half))
                self.equations.append(RawEquation(terms, place))
        return self.added[key]

    def note(self) -> list[Diagnostic]:
        """N131 on the nodes that were added, if there are some."""
        return [diagnose("N131", count=len(self.added))] if self.added else []


def linear_kind(kind: str) -> str:
    """The linear element with the corners of a quadratic one."""
    shape, corners = shape_of(kind), reference_element(kind).corners
    linear = f"{shape}{corners}"
    assert quadratic_kind(linear) == kind
    return linear
