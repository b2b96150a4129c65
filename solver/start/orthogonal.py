"""B^T = Q R of sparse rows B, by fronts along the mechanism; only R is kept.

Rows stand in the order of `system.ordering`, so that each has columns in common with
few others. Velocities are taken where their first row is: QR of some leaves the rows of
R that are finished, and a small front for the next ones (A. George, M. T. Heath,
"Solution of sparse linear least squares problems using Givens rotations", 1980; here by
blocks). R has all digits of B, of which a factor of B B^T would lose half. Time and
memory grow with the rows; time with the square, memory with the number of those that
have columns in common.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.sid import Array

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Rows that are finished together.
BLOCK = 48
#: Rows of length 1 follow from others exactly when less is left of them.
EXACT = 1e-13


class OrthogonalFactor:
    """R of rows B, (rows, rows) upper triangular, in blocks of rows.

    diagonal : (rows,) magnitudes of its diagonal
    dependent : (rows,) whether a row follows from those before it up to rounding; R is
        that of B with a column more for each of these, where they are 1
    """

    def __init__(self, B: csr_array) -> None:
        T: csr_array = B.T.tocsr()
        T.eliminate_zeros()
        T.sort_indices()
        T = T[np.diff(T.indptr) > 0]
        lead: Any = T.indices[T.indptr[:-1]]
        last: Any = T.indices[T.indptr[1:] - 1]
        order = np.argsort(lead, kind="stable")
        T, lead, last = T[order], lead[order], last[order]
        self.count = B.shape[0]
        self.dependent = np.zeros(self.count, bool)
        #: first row, its own columns, and the columns behind them
        self._blocks: list[tuple[int, Array, Array]] = []
        front = np.zeros((0, 0))
        for first in range(0, self.count, BLOCK):
            end = min(first + BLOCK, self.count)
            begin, stop = np.searchsorted(lead, [first, end])
            new = slice(int(begin), int(stop))
            reach = int(max(end, first + front.shape[1], *(last[new] + 1)))
            rows = np.zeros((len(front) + new.stop - new.start, reach - first))
            rows[: len(front), : front.shape[1]] = front
            entries: Any = T[new]
            rows[len(front) :] = entries[:, first:reach].toarray()
            R, self.dependent[first:end] = _apart(rows, end - first)
            done = np.zeros((end - first, reach - first))
            done[: len(R)] = R[: end - first]
            own = done[:, : end - first]
            self._blocks.append((first, own, done[:, end - first :]))
            front = R[end - first :, end - first :]
        diagonals = [np.abs(np.diag(own)) for _, own, _ in self._blocks]
        self.diagonal = np.concatenate(diagonals) if diagonals else np.zeros(0)

    def solve(self, right: Array) -> Array:
        """x with B B^T x = R^T R x = right, (rows,), if no diagonal entry is zero."""
        from scipy.linalg import solve_triangular

        x = np.array(right, float)
        for first, own, behind in self._blocks:
            end, reach = first + len(own), first + len(own) + behind.shape[1]
            x[first:end] = solve_triangular(own, x[first:end], trans="T")
            x[end:reach] -= behind.T @ x[first:end]
        for first, own, behind in reversed(self._blocks):
            end, reach = first + len(own), first + len(own) + behind.shape[1]
            left = x[first:end] - behind @ x[end:reach]
            x[first:end] = solve_triangular(own, left)
        return x


def _apart(rows: Array, count: int) -> tuple[Array, np.ndarray]:
    """R of some rows of B^T, and which of its first columns follow from those before.

    Without a row of its own such a column would take a direction away from those behind
    it, which then seem to follow from others as well.
    """
    R, dependent = _triangle(rows), np.zeros(count, bool)
    while True:
        left = np.zeros(count)
        diagonal = np.abs(np.diag(R))[:count]
        left[: len(diagonal)] = diagonal
        follows = np.flatnonzero((left <= EXACT) & ~dependent)
        if not len(follows):
            return R, dependent
        own = np.zeros((1, R.shape[1]))
        own[0, follows[0]], dependent[follows[0]] = 1.0, True
        R = _triangle(np.concatenate([R, own]))


def _triangle(rows: Array) -> Array:
    return np.asarray(np.linalg.qr(rows, mode="r"), np.float64)
