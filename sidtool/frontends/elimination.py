"""Unknowns that follow from others by linear equations.

Gaussian elimination row by row, for equations each of which holds few unknowns.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Row = dict[int, float]

#: What is left of a coefficient below this share of the largest is rounding.
_ROUNDING = 1e-11
#: The preferred unknown is taken if its coefficient has this share of the largest.
_LARGE = 0.1


def solved(
    matrix: sp.csr_matrix, preferred: Indices, first: Collection[int] = ()
) -> dict[int, tuple[int, Row]]:
    """The unknowns that rows (k, n) of ``matrix @ u = 0`` give, by the others.

    Parameters
    ----------
    preferred : (k,) the unknown that each row gives if it can; -1 for none
    first : unknowns that are given before all others

    Returns
    -------
    number of the unknown -> its row, and {other unknown: coefficient}
    """
    matrix = sp.csr_matrix(matrix)
    found: dict[int, tuple[int, Row]] = {}
    for i in range(matrix.shape[0]):
        part = slice(matrix.indptr[i], matrix.indptr[i + 1])
        columns, values = matrix.indices[part].tolist(), matrix.data[part].tolist()
        row = dict(zip(columns, values, strict=True))
        size = max(map(abs, row.values()), default=0.0)
        row = _without_known(row, found, _ROUNDING * size)
        if not row:
            continue
        pivot = _pivot(row, int(preferred[i]), first)
        scale = -row.pop(pivot)
        found[pivot] = i, {c: v / scale for c, v in row.items()}
    for pivot in reversed(found):
        i, row = found[pivot]
        found[pivot] = i, _without_known(row, found, 0.0)
    return found


def _pivot(row: Row, preferred: int, first: Collection[int]) -> int:
    early = {c: v for c, v in row.items() if c in first}
    if early:
        row, preferred = early, -1
    largest = max(row, key=lambda c: abs(row[c]))
    if abs(row.get(preferred, 0.0)) >= _LARGE * abs(row[largest]):
        return preferred
    return largest


def _without_known(row: Row, found: dict[int, tuple[int, Row]], small: float) -> Row:
    """The row with every unknown that is found already by the others."""
    known = [c for c in row if c in found]
    while known:
        for column in known:
            share = row.pop(column)
            for c, v in found[column][1].items():
                row[c] = row.get(c, 0.0) + share * v
        known = [c for c in row if c in found]
    return {c: v for c, v in row.items() if abs(v) > small}


def eliminated(matrix: sp.csr_matrix, preferred: Indices) -> sp.csr_matrix:
    """(n, n - r) sparse T: the solutions of ``matrix @ u = 0`` are u = T y."""
    n = matrix.shape[1]
    found = solved(matrix, preferred)
    kept = np.setdiff1d(np.arange(n), np.fromiter(found, np.int64, len(found)))
    number = np.full(n, -1)
    number[kept] = np.arange(kept.size)
    rows, columns = [kept], [np.arange(kept.size)]
    values = [np.ones(kept.size)]
    for pivot, (_, row) in found.items():
        rows.append(np.full(len(row), pivot))
        columns.append(number[np.fromiter(row, np.int64, len(row))])
        values.append(np.fromiter(row.values(), float, len(row)))
    index = np.concatenate(rows), np.concatenate(columns)
    return sp.csr_matrix((np.concatenate(values), index), shape=(n, kept.size))
