"""Surfaces for pictures: plane bodies with their thickness, fewer triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Surface:
    """positions (n, 3), triangles (m, 3), and the given points that they copy (n,)."""

    positions: Array
    triangles: Indices
    copies: Indices


def plate(positions: Array, triangles: Indices, thickness: float) -> Surface:
    """A plane surface with thickness as a plate: two sides and a rim."""
    n = len(positions)
    if not thickness:
        return Surface(positions, triangles, np.arange(n))
    shift = np.array([0.0, 0.0, thickness / 2])
    rim = border(triangles)
    a, b = rim.T
    sides = np.concatenate(
        [np.column_stack([a, b, b + n]), np.column_stack([a, b + n, a + n])]
    )
    # Lower side first: its triangles look down, the upper ones up.
    return Surface(
        np.concatenate([positions - shift, positions + shift]),
        np.concatenate([triangles[:, ::-1], triangles + n, sides]),
        np.tile(np.arange(n), 2),
    )


def border(triangles: Indices) -> Indices:
    """(k, 2) directed edges that belong to one triangle."""
    edges = np.concatenate([triangles[:, [i, (i + 1) % 3]] for i in range(3)])
    _, inverse, counts = np.unique(
        np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return edges[(counts == 1)[inverse.ravel()]]


def thinned(positions: Array, triangles: Indices, most: int) -> Indices:
    """At most about so many triangles between some of the same points.

    Points in a cell of a grid become one of them, the one nearest to their middle
    (J. Rossignac, P. Borrel, "Multi-resolution 3D approximations for rendering complex
    scenes", 1993). The grid is made coarser until few enough triangles are left.
    """
    if len(triangles) <= most:
        return triangles
    low = positions.min(axis=0)
    extent = float(np.ptp(positions, axis=0).max()) or 1.0
    cells = 2.0 * np.sqrt(most)
    found = triangles
    while len(found) > most:
        keys = np.floor((positions - low) / extent * cells).astype(np.int64)
        _, group = np.unique(keys, axis=0, return_inverse=True)
        found = _merged(positions, triangles, group.ravel())
        cells *= 0.8
    return found


def _merged(positions: Array, triangles: Indices, group: Indices) -> Indices:
    counts = np.bincount(group)
    middles = np.column_stack(
        [np.bincount(group, positions[:, axis]) / counts for axis in range(3)]
    )
    distance = np.linalg.norm(positions - middles[group], axis=1)
    order = np.lexsort((distance, group))
    first = np.searchsorted(group[order], np.arange(len(counts)))
    found = order[first][group[triangles]]
    a, b, c = found.T
    found = found[(a != b) & (b != c) & (c != a)]
    _, kept = np.unique(np.sort(found, axis=1), axis=0, return_index=True)
    return found[np.sort(kept)]
