"""Hexahedra and quadrilaterals with repeated nodes: prisms, pyramids, tetrahedra."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import permutations

import numpy as np

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
