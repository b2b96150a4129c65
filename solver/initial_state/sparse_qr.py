"""Sparse QR factorisation B^T = Q R by fronts along the mechanism; only R is stored.

Rows are in the order of `system.newton_pattern`, so that each has columns in common
with few others. Velocities enter a front at their first row: the QR of some rows leaves
finished rows of R and a small front for the next ones. R has all digits of B; a factor
of B B^T would lose half of them. Time and memory grow linearly with the number of rows;
time with the square, memory with the number of those that have columns in common.

References
----------
A. George, M. T. Heath: Solution of sparse linear least squares problems using Givens
rotations. Linear Algebra and its Applications 34 (1980); here by blocks.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.base.sid import Array

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Rows that are finished together.
BLOCK_ROWS = 48
#: Rows of length 1 follow from others exactly when less is left of them: rounding of
#: the many that they follow from in long mechanisms.
EXACT_DEPENDENCE = 1e-11
#: Corrections of what is met of right sides, and how many show who has a part in it.
REFINEMENTS, PROBES = 3, 8


class OrthogonalFactor:
    """R of those rows of B that do not follow from rows before them, (n, n) upper
    triangular, in blocks of rows.

    Attributes
    ----------
    dependent : (rows,)
        Whether a row follows from those before it up to rounding.
    diagonal : (n,)
        Magnitudes of the diagonal of R.
    """

    def __init__(self, B: csr_array) -> None:
        T: csr_array = B.T.tocsr()
        T.eliminate_zeros()
        T.sort_indices()
        T = T[np.diff(T.indptr) > 0]
        leading: Any = T.indices[T.indptr[:-1]]
        last: Any = T.indices[T.indptr[1:] - 1]
        order = np.argsort(leading, kind="stable")
        T, leading, last = T[order], leading[order], last[order]
        count = B.shape[0]
        self.dependent = np.zeros(count, bool)
        rows_of_R: list[tuple[int, Array]] = []
        front = np.zeros((0, 0))
        for first in range(0, count, BLOCK_ROWS):
            end = min(first + BLOCK_ROWS, count)
            begin, stop = np.searchsorted(leading, [first, end])
            new = slice(int(begin), int(stop))
            last_column = int(max(end, first + front.shape[1], *(last[new] + 1)))
            rows = np.zeros((len(front) + new.stop - new.start, last_column - first))
            rows[: len(front), : front.shape[1]] = front
            entries: Any = T[new]
            rows[len(front) :] = entries[:, first:last_column].toarray()
            R, self.dependent[first:end] = _triangularise(rows, end - first)
            n_finished = end - first - int(self.dependent[first:end].sum())
            rows_of_R.append((first, R[:n_finished]))
            front = R[n_finished:, end - first :]
        self._store_blocks(rows_of_R)

    def _store_blocks(self, rows_of_R: list[tuple[int, Array]]) -> None:
        """Blocks of R without the columns of rows that follow from others."""
        is_independent = ~self.dependent
        #: first row, its own columns, and the columns behind them
        self._blocks: list[tuple[int, Array, Array]] = []
        diagonals, begin = [np.zeros(0)], 0
        for first, R in rows_of_R:
            R = R[:, is_independent[first : first + R.shape[1]]]
            own = np.asfortranarray(R[:, : len(R)])
            self._blocks.append((begin, own, R[:, len(R) :]))
            diagonals.append(np.abs(np.diag(own)))
            begin += len(R)
        self.diagonal = np.concatenate(diagonals)

    def solve(self, right: Array) -> Array:
        """x with B B^T x = R^T R x = right, (n,) or (n, k), of the rows of R."""
        from scipy.linalg.lapack import dtrtrs

        x = np.array(right, float)
        for first, own, coupling in self._blocks:
            end, front_end = first + len(own), first + len(own) + coupling.shape[1]
            if end > first:
                x[first:end] = dtrtrs(own, x[first:end], trans=1)[0]
                x[end:front_end] -= coupling.T @ x[first:end]
        for first, own, coupling in reversed(self._blocks):
            end, front_end = first + len(own), first + len(own) + coupling.shape[1]
            if end > first:
                residual = x[first:end] - coupling @ x[end:front_end]
                x[first:end] = dtrtrs(own, residual)[0]
        return x


def _triangularise(rows: Array, count: int) -> tuple[Array, np.ndarray]:
    """R of some rows of B^T, and which of its first columns follow from those before.

    Such a column is zero below the rows of those, and has no row of its own: in that it
    would take a direction away from the columns behind it.
    """
    R: Array = np.asarray(np.linalg.qr(rows, mode="r"), np.float64)
    dependent = np.zeros(count, bool)
    diagonal = np.zeros(count)
    diagonal[: len(R)] = np.abs(np.diag(R))[:count]
    dependent_columns = np.flatnonzero(diagonal <= EXACT_DEPENDENCE)
    if not len(dependent_columns):
        return R, dependent
    k = int(dependent_columns[0])
    for j in range(k, count):
        v = R[k : j + 1, j].copy()
        size = float(np.linalg.norm(v))
        if size <= EXACT_DEPENDENCE:
            dependent[j] = True
            R[k : j + 1, j] = 0.0
            continue
        v[0] += np.copysign(size, v[0])
        part = R[k : j + 1, j:]
        part -= np.outer(v, (2.0 / (v @ v)) * (v @ part))
        k += 1
    return R, dependent


class RowRange:
    """The right sides that B x can meet, for sparse rows B.

    Attributes
    ----------
    rank
        Their dimension.
    remove_components
        Whether it is clear, see `least`.
    """

    def __init__(self, B: csr_array, least: float) -> None:
        """Parameters
        ----------
        least
            Of pivots of columns of length 1 that are clearly independent.
        """
        from scipy.sparse import diags_array

        A: csr_array = B.T.tocsr()
        A.eliminate_zeros()
        A.sort_indices()
        A = A[np.diff(A.indptr) > 0]
        leading: Any = A.indices[A.indptr[:-1]]
        A = A[np.argsort(leading, kind="stable")]
        lengths = np.sqrt(A.multiply(A).sum(axis=1))
        A = (diags_array(1.0 / lengths) @ A).tocsr()
        self._factor = OrthogonalFactor(A)
        self._A = A[~self._factor.dependent]
        self.rank = int(self._A.shape[0])
        self.remove_components = bool(self._factor.diagonal.min(initial=1.0) > least)

    def project(self, right: Array) -> Array:
        """The nearest of them to some right sides, (rows,) or (rows, k)."""
        projection = np.zeros_like(right)
        for _ in range(REFINEMENTS):
            projection += self._A.T @ self._factor.solve(self._A @ (right - projection))
        return projection

    def dependence_shares(self, count: int) -> Array:
        """How large a part each of so many rows has in what is not met, (rows,): root
        mean square over random right sides, of which it is the expectation."""
        right = np.random.default_rng(0).standard_normal((count, PROBES))
        left = right - self.project(right)
        return np.asarray(np.sqrt(np.mean(left**2, axis=1)))
