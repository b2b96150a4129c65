"""Sparse constraint Jacobian of large scenes, and independence of its rows.

Rows that are clearly independent, as those of most mechanisms, need no dense
factorisation.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array

from ..spatial import system_arrays as at
from ..system.characteristic_sizes import coordinate_sizes
from ..system.system import System
from .sparse_qr import OrthogonalFactor, RowRange

if TYPE_CHECKING:
    from scipy.sparse import csc_array, csr_array

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


#: Rows that are asked together.
MAX_ROWS = 150


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
