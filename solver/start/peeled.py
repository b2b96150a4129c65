"""Which constraints of a large scene may nearly follow from others, asked part by part.

A combination of rows that vanishes, but for rounding of data, vanishes on each body. So
the rows that hold some bodies alone have no part in one if they are independent there,
and the rest can be asked without them. Singular values of all rows do not tell: they
fall with the length of a mechanism whose parts are held well.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..space import layout as at
from ..system.scene import System

if TYPE_CHECKING:
    from scipy.sparse import csc_array, csr_array

#: Rows that are asked together.
WIDEST = 150


def rows_left(
    system: System, B: csr_array, asked: NDArray[np.bool_], bound: float
) -> NDArray[np.bool_]:
    """Those of the rows that are asked which may follow from each other, (rows,).

    B : (rows, velocities), its rows of length 1
    bound : rows are independent by more than this singular value
    """
    left, columns = asked.copy(), B.tocsc()
    holding: dict[int, list[int]] = {}
    for row, body, _ in system.arrays.segment.tolist():
        holding.setdefault(body, []).append(row)
    order = sorted(holding, key=lambda body: min(holding[body]))
    for bodies in (order, order[::-1]):
        _peel(system, columns, ((b, holding[b]) for b in bodies), left, bound)
    return left


def _peel(
    system: System,
    B: csc_array,
    holding: Iterable[tuple[int, list[int]]],
    left: NDArray[np.bool_],
    bound: float,
) -> None:
    """Takes from the rows that are left those that hold some bodies in a sequence."""
    rows: set[int] = set()
    columns: list[int] = []
    for body, own in holding:
        first, n = system.arrays.body[body, [at.VEL, at.NV]].tolist()
        rows.update(row for row in own if left[row])
        columns += range(first, first + n)
        if len(rows) > WIDEST:
            rows, columns = set(), []
        if not rows or len(rows) > len(columns):
            continue
        part = B[:, columns][sorted(rows)].toarray()
        if np.linalg.svd(part, compute_uv=False)[-1] > bound:
            left[list(rows)] = False
            rows, columns = set(), []
