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
#: Rows of length 1 follow from others exactly when less is left of them: rounding of
#: the many that they follow from in long mechanisms.
EXACT = 1e-11
#: Corrections of what is met of right sides, and how many show who has a part in it.
REFINEMENTS, PROBES = 3, 8


class OrthogonalFactor:
    """R of those rows of B that do not follow from rows before them, (n, n) upper
    triangular, in blocks of rows.

    dependent : (rows,) whether a row follows from those before it up to rounding
    diagonal : (n,) magnitudes of the diagonal of R
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
        count = B.shape[0]
        self.dependent = np.zeros(count, bool)
        rows_of_R: list[tuple[int, Array]] = []
        front = np.zeros((0, 0))
        for first in range(0, count, BLOCK):
            end = min(first + BLOCK, count)
            begin, stop = np.searchsorted(lead, [first, end])
            new = slice(int(begin), int(stop))
            reach = int(max(end, first + front.shape[1], *(last[new] + 1)))
            rows = np.zeros((len(front) + new.stop - new.start, reach - first))
            rows[: len(front), : front.shape[1]] = front
            entries: Any = T[new]
            rows[len(front) :] = entries[:, first:reach].toarray()
            R, self.dependent[first:end] = _stairs(rows, end - first)
            done = end - first - int(self.dependent[first:end].sum())
            rows_of_R.append((first, R[:done]))
            front = R[done:, end - first :]
        self._keep(rows_of_R)

    def _keep(self, rows_of_R: list[tuple[int, Array]]) -> None:
        """Blocks of R without the columns of rows that follow from others."""
        kept = ~self.dependent
        #: first row, its own columns, and the columns behind them
        self._blocks: list[tuple[int, Array, Array]] = []
        diagonals, begin = [np.zeros(0)], 0
        for first, R in rows_of_R:
            R = R[:, kept[first : first + R.shape[1]]]
            own = np.asfortranarray(R[:, : len(R)])
            self._blocks.append((begin, own, R[:, len(R) :]))
            diagonals.append(np.abs(np.diag(own)))
            begin += len(R)
        self.diagonal = np.concatenate(diagonals)

    def solve(self, right: Array) -> Array:
        """x with B B^T x = R^T R x = right, (n,) or (n, k), of the rows of R."""
        from scipy.linalg.lapack import dtrtrs

        x = np.array(right, float)
        for first, own, behind in self._blocks:
            end, reach = first + len(own), first + len(own) + behind.shape[1]
            if end > first:
                x[first:end] = dtrtrs(own, x[first:end], trans=1)[0]
                x[end:reach] -= behind.T @ x[first:end]
        for first, own, behind in reversed(self._blocks):
            end, reach = first + len(own), first + len(own) + behind.shape[1]
            if end > first:
                left = x[first:end] - behind @ x[end:reach]
                x[first:end] = dtrtrs(own, left)[0]
        return x


def _stairs(rows: Array, count: int) -> tuple[Array, np.ndarray]:
    """R of some rows of B^T, and which of its first columns follow from those before.

    Such a column is zero below the rows of those, and has no row of its own: in that it
    would take a direction away from the columns behind it.
    """
    R: Array = np.asarray(np.linalg.qr(rows, mode="r"), np.float64)
    dependent = np.zeros(count, bool)
    diagonal = np.zeros(count)
    diagonal[: len(R)] = np.abs(np.diag(R))[:count]
    follow = np.flatnonzero(diagonal <= EXACT)
    if not len(follow):
        return R, dependent
    k = int(follow[0])
    for j in range(k, count):
        v = R[k : j + 1, j].copy()
        size = float(np.linalg.norm(v))
        if size <= EXACT:
            dependent[j] = True
            R[k : j + 1, j] = 0.0
            continue
        v[0] += np.copysign(size, v[0])
        part = R[k : j + 1, j:]
        part -= np.outer(v, (2.0 / (v @ v)) * (v @ part))
        k += 1
    return R, dependent


class Reached:
    """The right sides that B x can meet, for sparse rows B.

    rank : their dimension
    clear : whether it is clear, see `least`
    """

    def __init__(self, B: csr_array, least: float) -> None:
        """least : of pivots of columns of length 1 that are clearly independent"""
        from scipy.sparse import diags_array

        A: csr_array = B.T.tocsr()
        A.eliminate_zeros()
        A.sort_indices()
        A = A[np.diff(A.indptr) > 0]
        lead: Any = A.indices[A.indptr[:-1]]
        A = A[np.argsort(lead, kind="stable")]
        lengths = np.sqrt(A.multiply(A).sum(axis=1))
        A = (diags_array(1.0 / lengths) @ A).tocsr()
        self._factor = OrthogonalFactor(A)
        self._A = A[~self._factor.dependent]
        self.rank = int(self._A.shape[0])
        self.clear = bool(self._factor.diagonal.min(initial=1.0) > least)

    def part(self, right: Array) -> Array:
        """The nearest of them to some right sides, (rows,) or (rows, k)."""
        found = np.zeros_like(right)
        for _ in range(REFINEMENTS):
            found += self._A.T @ self._factor.solve(self._A @ (right - found))
        return found

    def shares(self, count: int) -> Array:
        """How large a part each of so many rows has in what is not met, (rows,): root
        mean square over random right sides, of which it is the expectation."""
        right = np.random.default_rng(0).standard_normal((count, PROBES))
        left = right - self.part(right)
        return np.asarray(np.sqrt(np.mean(left**2, axis=1)))
