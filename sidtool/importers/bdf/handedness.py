"""Solid elements that count their nodes left-handed, which Nastran takes, too."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ...frontends.elements.reference import edge_nodes, reference_element, shape_of
from .content import BulkData

Position = tuple[float, float, float]

#: Shape of a solid -> its corners, seen in a mirror.
_MIRRORED = {
    "tet": (0, 2, 1, 3),
    "pyramid": (0, 3, 2, 1, 4),
    "wedge": (0, 2, 1, 3, 5, 4),
    "hex": (0, 3, 2, 1, 4, 7, 6, 5),
}


def count_right_handed(content: BulkData) -> tuple[str, ...]:
    """Give the nodes of left-handed solids in the order of right-handed ones.

    An element counts as left-handed if all its quadrature points are mirrored; others
    that are not right are refused elsewhere.

    Returns
    -------
    a sentence on the elements that were turned, if there are some
    """
    by_kind: dict[str, list[int]] = {}
    for row, (_, _, kind, nodes, _) in enumerate(content.elements):
        if shape_of(kind) in _MIRRORED and all(n in content.nodes for n in nodes):
            by_kind.setdefault(kind, []).append(row)
    turned = []
    for kind, rows in by_kind.items():
        listed = [content.elements[row][3] for row in rows]
        turned += [rows[k] for k in _left_handed(kind, listed, content.nodes)]
    for row in turned:
        label, property_, kind, nodes, place = content.elements[row]
        order = [nodes[k] for k in mirrored(kind)]
        content.elements[row] = label, property_, kind, order, place
    if not turned:
        return ()
    first = content.elements[min(turned)][0]
    return (
        f"nodes are counted left-handed in {len(turned)} solid elements (the first is "
        f"{first}); they are the same bodies counted right-handed",
    )


def _left_handed(
    kind: str, elements: list[list[int]], positions: Mapping[int, Position]
) -> NDArray[np.int64]:
    corners = np.array([[positions[n] for n in nodes] for nodes in elements])
    slopes = reference_element(kind).gradients
    jacobians = np.einsum("emd,gmk->egdk", corners, slopes)
    return np.flatnonzero((np.linalg.det(jacobians) < 0).all(axis=1))


@cache
def mirrored(kind: str) -> tuple[int, ...]:
    """The right-handed order of the nodes of a solid that counts them left-handed."""
    corners = _MIRRORED[shape_of(kind)]
    edges = edge_nodes(kind)
    number = {frozenset(edge): len(corners) + k for k, edge in enumerate(edges)}
    middles = [number[frozenset((corners[a], corners[b]))] for a, b in edges]
    return (*corners, *middles)
