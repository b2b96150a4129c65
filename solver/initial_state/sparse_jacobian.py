"""Sparse constraint Jacobian of large scenes, and independence of its rows.

Rows that are clearly independent, as those of most mechanisms, need no dense
factorisation.

Sparse QR factorisation B^T = Q R by fronts along the mechanism; only R is stored.

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

from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array

from ..spatial import system_arrays as at
from ..system.characteristic_sizes import coordinate_sizes
from ..system.system import System

if TYPE_CHECKING:
    from scipy.sparse import csc_array, csr_array


#: Rows that are finished together.
BLOCK_ROWS = 48
#: Rows of length 1 follow from others exactly when less is left of them: rounding of
#: the many that they follow from in long mechanisms.
EXACT_DEPENDENCE = 1e-11
#: Corrections of what is met of right sides, and how many show who has a part in it.
SOLVE_REFINEMENTS, PROBES = 3, 8

#: Rows from which on scenes are large.
LARGE_SCENE_ROWS = 300
#: Singular values below this part of the largest one are not separated from those of
#: dependent rows.
CLEARLY_INDEPENDENT = 1e-11
#: Right sides follow from others as their rows do when they are met up to this part.
CONSISTENT = 1e-12
#: How many of the least singular values are looked at.
VALUE_COUNTS = (6, 12, 24, 48)
#: Inverse iteration ends when the least singular value changes by less than this part,
#: which is known then up to a factor.
VALUE_TOLERANCE, MAX_ITERATIONS, VALUE_FACTOR = 0.01, 50, 1.5
#: What is added to G where rows may depend on each other, and how well directions of
#: its least values are met, relative to them.
EIGENVALUE_SHIFT, DIRECTION_TOLERANCE = 1e-7, 1e-6
#: Corrections of a solution, until it is met up to rounding.
REFINEMENTS, SOLVED = 5, 1e-15
#: Rows that are asked together.
MAX_ROWS = 150


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
        for _ in range(SOLVE_REFINEMENTS):
            projection += self._A.T @ self._factor.solve(self._A @ (right - projection))
        return projection

    def dependence_shares(self, count: int) -> Array:
        """How large a part each of so many rows has in what is not met, (rows,): root
        mean square over random right sides, of which it is the expectation."""
        right = np.random.default_rng(0).standard_normal((count, PROBES))
        left = right - self.project(right)
        return np.asarray(np.sqrt(np.mean(left**2, axis=1)))


def jacobian_entries(system: System, C: Array) -> tuple[np.ndarray, np.ndarray, Array]:
    """Rows, columns and values (..., n) of the constraint Jacobian, to be added up.

    Parameters
    ----------
    C : (..., .)
        `WorkArrays`.
    """
    rows, columns, entries = system.cached_by_topology(_jacobian_indices)
    return rows, columns, C[..., entries]


def _jacobian_indices(system: System) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows and columns of its entries, and where their values stand."""
    row, body, offset = system.arrays.segment.T
    counts = system.arrays.body[body, at.NV]
    offsets = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    columns = np.repeat(system.arrays.body[body, at.VEL], counts) + offsets
    return np.repeat(row, counts), columns, np.repeat(offset, counts) + offsets


def sparse_constraint_jacobian(system: System, C: Array) -> csr_array:
    """The constraint Jacobian (rows, velocities)."""
    from scipy.sparse import csr_array  # a sixth of a second that few scenes need

    rows, columns, values = jacobian_entries(system, C)
    return csr_array(
        (values, (rows, columns)), shape=(system.n_rows, system.n_velocities)
    )


def scaled_sparse_jacobian(system: System, C: Array) -> csr_array:
    """The constraint Jacobian for relative changes of the coordinates."""
    sizes = coordinate_sizes(system)
    return sparse_constraint_jacobian(system, C).multiply(sizes[None, :]).tocsr()


def normalised_sparse_rows(B: csr_array) -> csr_array:
    """The rows divided by their lengths, those of nothing as they are."""
    from scipy.sparse import diags_array

    lengths = np.sqrt(B.multiply(B).sum(axis=1))
    return (diags_array(1.0 / np.where(lengths > 0.0, lengths, 1.0)) @ B).tocsr()


def least_independent_combination(B: csr_array, redundant: int) -> tuple[Array, float]:
    """The combination of rows that comes nearest to nothing, and what remains of it.

    A left singular vector (rows,) of B and its singular value, the least but for those
    of so many redundant rows; by Lanczos' method with a factor of G. Values below 1e-7
    of the largest one are those of rounding.
    """
    from scipy.sparse.linalg import eigsh

    G = (B @ B.T).tocsc()
    begin = np.random.default_rng(0).standard_normal(G.shape[0])
    squares, directions = eigsh(
        G, redundant + 1, sigma=-EIGENVALUE_SHIFT, tol=DIRECTION_TOLERANCE, v0=begin
    )
    last = int(np.argmax(squares))
    return directions[:, last], float(np.sqrt(max(0.0, squares[last])))


class IndependentRows:
    """Rows B, factored, if they are clearly independent.

    Attributes
    ----------
    smallest_singular_value
        Of their singular values, those of rows of length 1, relative to the largest.
    dependent : (rows,)
        Whether a row follows from those before it up to rounding.
    matrix, lengths
        B, and those of its rows, (rows,), 1 of those of nothing.
    """

    def __init__(
        self,
        B: csr_array,
        factor: OrthogonalFactor | None = None,
        is_dependent: np.ndarray | None = None,
    ) -> None:
        """Parameters
        ----------
        factor
            Of these rows, none of which follows from others.
        is_dependent : (rows,)
            Those that are known to follow from others.
        """
        self.matrix = B
        lengths = np.sqrt(B.multiply(B).sum(axis=1))
        self.lengths = np.where(lengths > 0.0, lengths, 1.0)
        self._scale, self._B = 1.0 / self.lengths, normalised_sparse_rows(B)
        self.smallest_singular_value, self.dependent = 0.0, np.zeros(B.shape[0], bool)
        if is_dependent is not None:
            self.dependent |= is_dependent
        candidates = ~self.dependent
        self._factor = factor or OrthogonalFactor(self._B[candidates])
        if factor is None:
            self.dependent[candidates] = self._factor.dependent
        is_clear = self._factor.diagonal.min(initial=1.0) > CLEARLY_INDEPENDENT
        if is_clear and not self.dependent.any():
            self.smallest_singular_value = self._least_singular_value()

    @cached_property
    def independent_part(self) -> IndependentRows:
        """The rows, of length 1, without those that follow from others."""
        return IndependentRows(self._B[~self.dependent], self._factor)

    @cached_property
    def column_range(self) -> RowRange:
        """The right sides that rows of length 1 can meet."""
        return RowRange(self._B, CLEARLY_INDEPENDENT)

    def are_clear(self, bound: float) -> bool:
        """True if rows follow from others exactly or are independent of them by more
        than a part.
        """
        if self.dependent.any():
            return bool(self.independent_part.smallest_singular_value > bound)
        return self.smallest_singular_value > bound

    def solve_independent(self, right: Array) -> Array:
        """The x of least length with B x = right, in the rows that follow from no
        others."""
        if not self.dependent.any():
            return self.minimum_norm_solution(right)
        return self.independent_part.minimum_norm_solution(
            (self._scale * right)[~self.dependent]
        )

    def least_squares(self, right: Array, independent: float) -> Array | None:
        """The x of least length that meets B x = right best, with rows of length 1,
        where some rows follow from others that are independent by more than a part;
        of other rows None.
        """
        if not self.dependent.any() or not self.are_clear(independent):
            return None
        x = self.solve_independent(right)
        scaled = self._scale * right
        residual = np.abs(self._B @ x - scaled).max(initial=0.0)
        if residual <= CONSISTENT * np.abs(scaled).max(initial=0.0):
            return x
        if not self.has_clear_columns:
            return None
        return self.independent_part.minimum_norm_solution(
            self.column_range.project(scaled)[~self.dependent]
        )

    @property
    def has_clear_columns(self) -> bool:
        """True if as many columns as rows are clearly independent."""
        rank = int(np.sum(~self.dependent))
        return self.column_range.remove_components and self.column_range.rank == rank

    def _least_singular_value(self) -> float:
        if not self._B.shape[0]:
            return 1.0
        x = np.random.default_rng(0).standard_normal(self._B.shape[0])
        least = 0.0
        for _ in range(MAX_ITERATIONS):
            x /= np.linalg.norm(x)
            x, before = self._factor.solve(x), least
            square = 1.0 / max(float(np.linalg.norm(x)), 1e-300)
            least = square**0.5
            if abs(least - before) <= VALUE_TOLERANCE * least:
                break
        largest = float(abs(self._B @ self._B.T).sum(axis=1).max()) ** 0.5
        relative = least / VALUE_FACTOR / max(1.0, largest)
        return relative if relative > CLEARLY_INDEPENDENT else 0.0

    def minimum_norm_solution(
        self, right: Array, excluded: Array | None = None
    ) -> Array:
        """The x of least length with B x = right.

        Parameters
        ----------
        excluded
            Directions (rows, n) in which the rows need not be met, see `small`.
        """
        if excluded is None:
            excluded = np.zeros((len(right), 0))

        def project(rows: Array) -> Array:
            return np.asarray(rows - excluded @ (excluded.T @ rows))

        right = project(self._scale * right)
        x = np.zeros(self._B.shape[1])
        for _ in range(REFINEMENTS):
            residual = project(right - self._B @ x)
            if np.abs(residual).max(initial=0.0) <= SOLVED * np.abs(right).max(
                initial=0.0
            ):
                break
            x += self._B.T @ project(self._factor.solve(residual))
        return x

    def small_singular_vectors(self, bound: float) -> Array | None:
        """Left singular vectors (rows, n) of values below a part of the largest one;
        None where they are many, or not clear."""
        if self.smallest_singular_value == 0.0:
            return None
        largest = self._largest()
        for squares, directions in self._smallest_values():
            if squares.max() > (bound * largest) ** 2:
                return directions[:, squares < (bound * largest) ** 2]
        return None

    def have_remainder(self, bound: float) -> bool:
        """True if of each row more than a part is left without the others.

        That is 1 / sqrt((G^-1)_ii). Long mechanisms have small singular values in which
        all of their rows have a part, and which determine none of them. Rows that
        follow from others exactly are no matter of rounding. False where it is not
        clear.
        """
        if self.dependent.any():
            others = self.independent_part
            return not others.dependent.any() and others.have_remainder(bound)
        if self.smallest_singular_value > bound:
            return True
        if self.smallest_singular_value == 0.0:
            return False
        for squares, directions in self._smallest_values():
            remainder = (directions**2 / squares).sum(axis=1).max()
            if remainder + 1.0 / squares.max() < bound**-2:
                return True
            if remainder > bound**-2:
                return False
        return False

    def _largest(self) -> float:
        from scipy.sparse.linalg import eigsh

        G, begin = self._B @ self._B.T, np.ones(self._B.shape[0])
        squares = eigsh(G, 1, tol=VALUE_TOLERANCE, v0=begin, return_eigenvectors=False)
        return float(np.sqrt(squares[-1]))

    def _smallest_values(self) -> Iterator[tuple[Array, Array]]:
        """Squares of more and more of the least singular values; their directions."""
        from scipy.sparse.linalg import LinearOperator, eigsh

        rows = self._B.shape[0]
        inverse = LinearOperator((rows, rows), matvec=self._factor.solve, dtype=float)
        begin = np.random.default_rng(0).standard_normal(rows)
        for count in VALUE_COUNTS:
            if count >= rows:
                return
            inverses, directions = eigsh(
                inverse, count, tol=DIRECTION_TOLERANCE**2, v0=begin
            )
            yield 1.0 / inverses, directions


def candidate_dependent_rows(
    system: System, B: csr_array, requested: NDArray[np.bool_], bound: float
) -> NDArray[np.bool_]:
    """Those of the rows that are asked which may follow from each other, (rows,).

    Parameters
    ----------
    B : (rows, velocities)
        Its rows of length 1.
    bound
        Rows are independent by more than this singular value.
    """
    candidates, columns = requested.copy(), B.tocsc()
    rows_of_body: dict[int, list[int]] = {}
    for row, body, _ in system.arrays.segment.tolist():
        rows_of_body.setdefault(body, []).append(row)
    order = sorted(rows_of_body, key=lambda body: min(rows_of_body[body]))
    for bodies in (order, order[::-1]):
        _exclude_independent_rows(
            system, columns, ((b, rows_of_body[b]) for b in bodies), candidates, bound
        )
    return candidates


def _exclude_independent_rows(
    system: System,
    B: csc_array,
    rows_of_bodies: Iterable[tuple[int, list[int]]],
    candidates: NDArray[np.bool_],
    bound: float,
) -> None:
    """Takes from the rows that are left those that hold some bodies in a sequence."""
    rows: set[int] = set()
    columns: list[int] = []
    for body, body_rows in rows_of_bodies:
        first, n = system.arrays.body[body, [at.VEL, at.NV]].tolist()
        rows.update(row for row in body_rows if candidates[row])
        columns += range(first, first + n)
        if len(rows) > MAX_ROWS:
            rows, columns = set(), []
        if not rows or len(rows) > len(columns):
            continue
        part = B[:, columns][sorted(rows)].toarray()
        if np.linalg.svd(part, compute_uv=False)[-1] > bound:
            candidates[list(rows)] = False
            rows, columns = set(), []
