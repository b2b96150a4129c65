"""Nested dissection by coordinates: an order of unknowns that keeps factors small.

Source: A. George, "Nested dissection of a regular finite element mesh", SIAM J. Numer.
Anal. 10 (2), 1973; the cuts as in M. Heath, P. Raghavan, "A Cartesian parallel nested
dissection algorithm", SIAM J. Matrix Anal. Appl. 16 (1), 1995.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Parts of so few points are not cut.
_SMALL = 3
#: Digits of base 3 that an integer of 64 bits holds.
_MOST_CUTS = 39
#: Coordinates that agree in so many digits of a part's length are equal.
_DIGITS = 7


def nested_dissection(matrix: sp.csr_matrix, places: Array) -> Indices:
    """(n,) the unknowns in an order for elimination.

    Every part is cut at the median of its longest side; the points on one side of the
    cut that touch the other side come after both. All parts of one level are cut at
    once.

    Parameters
    ----------
    matrix : (n, n) with a symmetric pattern
    places : (n, d) where each unknown is; neighbours with the same place make a point
    """
    starts = np.ones(len(places), bool)
    starts[1:] = (places[1:] != places[:-1]).any(axis=1)
    point = np.cumsum(starts) - 1
    first = np.flatnonzero(starts)
    codes = _codes(_edges(matrix, first, point, starts), places[first])
    return np.argsort(codes[point], kind="stable")


def _edges(
    matrix: sp.csr_matrix, first: Indices, point: Indices, starts: NDArray[np.bool_]
) -> Indices:
    """(2, m) pairs of neighbours, each once, by the first unknown of every point."""
    rows = matrix[first]
    counts = np.diff(rows.indptr)
    i = np.repeat(np.arange(len(first), dtype=np.int32), counts)
    j = point[rows.indices].astype(np.int32)
    kept = starts[rows.indices] & (i < j)
    return np.stack([i[kept], j[kept]])


def _codes(edges: Indices, places: Array) -> Indices:
    """(n,) numbers that rise in the order of elimination.

    Every cut gives a digit of base 3: 0 and 1 for the sides, 2 for the separator.
    """
    codes = np.zeros(len(places), np.int64)
    part = np.zeros(len(places), np.int64)
    active = np.arange(len(places))
    for power in reversed(range(_MOST_CUTS)):
        active = _large_parts(active, part)
        if not active.size:
            break
        digit = np.zeros(len(places), np.int8)
        digit[active] = _above_the_median(part[active], places[active])
        edges = edges[:, (part[edges] >= 0).all(axis=0)]
        i, j = edges
        cut = digit[i] != digit[j]
        separator = np.where(digit[i] > digit[j], i, j)[cut]
        digit[separator] = 2
        codes[active] += 3**power * digit[active].astype(np.int64)
        part[active] = 2 * part[active] + digit[active]
        part[separator] = -1
        edges = edges[:, ~cut]
        active = active[part[active] >= 0]
    return codes


def _large_parts(active: Indices, part: Indices) -> Indices:
    """The points of parts that are worth a cut, by parts, which get new numbers.

    The others get the part -1.
    """
    active = active[np.argsort(part[active], kind="stable")]
    _, number, sizes = np.unique(part[active], return_inverse=True, return_counts=True)
    large = sizes > _SMALL
    renumbered = np.where(large, np.cumsum(large) - 1, -1)[number]
    part[active] = renumbered
    return active[renumbered >= 0]


def _above_the_median(part: Indices, places: Array) -> NDArray[np.bool_]:
    """(n,) whether points, sorted by parts, lie beyond the cut of their part."""
    starts = np.flatnonzero(np.diff(part, prepend=-1))
    low = np.minimum.reduceat(places, starts)
    sides = np.maximum.reduceat(places, starts) - low
    longest = sides.argmax(axis=1)
    every = np.arange(len(part))
    along = places[every, longest[part]] - low[part, longest[part]]
    length = np.maximum(sides.max(axis=1), np.finfo(float).tiny)
    along = np.round(along / length[part], _DIGITS)
    order = np.argsort(part + along / 2, kind="stable")
    middle = starts + np.diff(starts, append=len(part)) // 2
    threshold = np.maximum(along[order[middle]], 10.0**-_DIGITS)
    return along >= threshold[part]
