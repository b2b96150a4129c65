"""Sizes of coordinates that suit every part of a mechanism.

Measured by the size of the whole mechanism, the links of a small part hardly turn: its
constraints look as if they followed from each other. Rounding of data changes entries
of the constraint Jacobian by a part of what they are, whatever the sizes are; so those
count with which all entries are about as large.
"""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import Array

from ..space import layout as at
from ..system.scene import System
from ..system.sizes import coordinate_sizes, extents
from .large_scenes import jacobian_entries

#: Rounds of the iteration, and parts of a row whose squares count as nothing.
ROUNDS, NOTHING = 30, 1e-20


def balanced_sizes(system: System, C: Array) -> Array:
    """Sizes of the velocity coordinates, (n velocities,): of each body one for its
    place, one for its turns and one for its deformation, whatever the axes are.

    C : of `Work`

    Source: A. R. Curtis, J. K. Reid, J. Inst. Maths Applics 10 (1972): the sum of the
    squared logarithms of all scaled entries is least; here for rows and columns by
    turns.
    """
    sizes, kinds = coordinate_sizes(system), system.lasting(_kinds)
    squares = _squares(system, C, sizes, kinds)
    segment, kind = np.nonzero(squares)
    row, body, _ = system.arrays.segment[segment].T
    column = 3 * body + kind
    entries = np.log(squares[segment, kind])
    of_rows = np.zeros(system.n_rows)
    of_columns = np.zeros(3 * len(system.arrays.body))
    for _ in range(ROUNDS):
        of_rows = _means(row, entries - of_columns[column], len(of_rows))
        of_columns = _means(column, entries - of_rows[row], len(of_columns))
    return sizes * np.exp(-0.5 * of_columns)[kinds]


def _means(place: np.ndarray, values: Array, count: int) -> Array:
    """Of values that share a place, (count,); 0 where there are none."""
    shares = np.maximum(np.bincount(place, minlength=count), 1)
    return np.asarray(np.bincount(place, values, count) / shares)


def _kinds(system: System) -> np.ndarray:
    """Of each velocity coordinate three times the number of its body, plus 0 of a
    place, 1 of a turn, 2 of a deformation."""
    axes = 2 if system.planar else 3
    kinds = [
        3 * b + np.repeat([0, 1, 2], np.diff([0, min(axes, rigid), rigid, n]))
        for b, (rigid, n) in enumerate(system.arrays.body[:, [at.RD, at.NV]])
    ]
    return np.concatenate(kinds)


def _squares(system: System, C: Array, sizes: Array, kinds: np.ndarray) -> Array:
    """Those of what rows have of a body, (segments, 3): of arms that are at least as
    long as the body, of points that deform as the body does."""
    _, columns, values = jacobian_entries(system, C)
    row, body, _ = system.arrays.segment.T
    segment = np.repeat(np.arange(len(body)), system.arrays.body[body, at.NV])
    places = 3 * segment + kinds[columns] % 3
    squares = np.bincount(places, (values * sizes[columns]) ** 2, 3 * len(body))
    found = np.asarray(squares, float).reshape(-1, 3)
    arms = (extents(system) / system.length)[body]
    found[:, 1] = np.maximum(found[:, 1], arms**2 * found[:, 0])
    found[:, 2] = np.maximum(found[:, 2], found[:, 0])
    rows = np.bincount(row, found.sum(axis=1), system.n_rows)
    found[found < NOTHING * rows[row, None]] = 0.0
    return found
