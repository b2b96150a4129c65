"""Constraints of large scenes, whose Jacobian is sparse.

Rows that are clearly independent, as those of most mechanisms are, need no dense
matrix: with the factor R^T R = G = B B^T of the rows B, which has the digits of B,
inverse iteration bounds their least singular value, and B^T G^-1 b is the smallest
solution of B x = b. Whatever is not clear is left to dense matrices, which see
dependencies down to rounding.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from sidtool.formats.sid import Array

from ..space import layout as at
from ..system.scene import System
from ..system.sizes import coordinate_sizes
from .orthogonal import OrthogonalFactor, Reached

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Rows from which on scenes are large.
MANY = 300
#: Singular values below this part of the largest one are not told from those of
#: dependent rows.
CLEAR = 1e-11
#: Right sides follow from others as their rows do when they are met up to this part.
ALSO_MET = 1e-12
#: How many of the least singular values are looked at.
COUNTS = (6, 12, 24, 48)
#: Inverse iteration ends when the least singular value changes by less than this part,
#: which is known then up to a factor.
SETTLED, MOST, FACTOR = 0.01, 50, 1.5
#: What is added to G where rows may depend on each other, and how well directions of
#: its least values are met, relative to them.
SHIFT, DIRECTED = 1e-7, 1e-6
#: Corrections of a solution, until it is met up to rounding.
REFINEMENTS, MET = 5, 1e-15


def jacobian_entries(system: System, C: Array) -> tuple[np.ndarray, np.ndarray, Array]:
    """Rows, columns and values (..., n) of the constraint Jacobian, to be added up.

    C : (..., .) of `Work`
    """
    rows, columns, entries = system.lasting(_jacobian_places)
    return rows, columns, C[..., entries]


def _jacobian_places(system: System) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows and columns of its entries, and where their values stand."""
    row, body, offset = system.arrays.segment.T
    counts = system.arrays.body[body, at.NV]
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    columns = np.repeat(system.arrays.body[body, at.VEL], counts) + within
    return np.repeat(row, counts), columns, np.repeat(offset, counts) + within


def sparse_jacobian(system: System, C: Array) -> csr_array:
    """The constraint Jacobian (rows, velocities)."""
    from scipy.sparse import csr_array  # a sixth of a second that few scenes need

    rows, columns, values = jacobian_entries(system, C)
    return csr_array(
        (values, (rows, columns)), shape=(system.n_rows, system.n_velocities)
    )


def scaled_jacobian(system: System, C: Array) -> csr_array:
    """The constraint Jacobian for relative changes of the coordinates."""
    sizes = coordinate_sizes(system)
    return sparse_jacobian(system, C).multiply(sizes[None, :]).tocsr()


def of_length_one(B: csr_array) -> csr_array:
    """The rows divided by their lengths, those of nothing as they are."""
    from scipy.sparse import diags_array

    lengths = np.sqrt(B.multiply(B).sum(axis=1))
    return (diags_array(1.0 / np.where(lengths > 0.0, lengths, 1.0)) @ B).tocsr()


def least_independent(B: csr_array, redundant: int) -> tuple[Array, float]:
    """The combination of rows that comes nearest to nothing, and what remains of it.

    A left singular vector (rows,) of B and its singular value, the least but for those
    of so many redundant rows; by Lanczos' method with a factor of G. Values below 1e-7
    of the largest one are those of rounding.
    """
    from scipy.sparse.linalg import eigsh

    G = (B @ B.T).tocsc()
    begin = np.random.default_rng(0).standard_normal(G.shape[0])
    squares, directions = eigsh(G, redundant + 1, sigma=-SHIFT, tol=DIRECTED, v0=begin)
    last = int(np.argmax(squares))
    return directions[:, last], float(np.sqrt(max(0.0, squares[last])))


class IndependentRows:
    """Rows B, factored, if they are clearly independent.

    least : of their singular values, those of rows of length 1, relative to the largest
    dependent : (rows,) whether a row follows from those before it up to rounding
    given, lengths : B, and those of its rows, (rows,), 1 of those of nothing
    """

    def __init__(
        self,
        B: csr_array,
        factor: OrthogonalFactor | None = None,
        follow: np.ndarray | None = None,
    ) -> None:
        """factor : of these rows, none of which follows from others
        follow : (rows,) those that are known to follow from others
        """
        self.given = B
        lengths = np.sqrt(B.multiply(B).sum(axis=1))
        self.lengths = np.where(lengths > 0.0, lengths, 1.0)
        self._scale, self._B = 1.0 / self.lengths, of_length_one(B)
        self.least, self.dependent = 0.0, np.zeros(B.shape[0], bool)
        if follow is not None:
            self.dependent |= follow
        asked = ~self.dependent
        self._factor = factor or OrthogonalFactor(self._B[asked])
        if factor is None:
            self.dependent[asked] = self._factor.dependent
        clear = self._factor.diagonal.min(initial=1.0) > CLEAR
        if clear and not self.dependent.any():
            self.least = self._least_singular_value()

    @cached_property
    def others(self) -> IndependentRows:
        """The rows, of length 1, without those that follow from others."""
        return IndependentRows(self._B[~self.dependent], self._factor)

    @cached_property
    def reached(self) -> Reached:
        """The right sides that rows of length 1 can meet."""
        return Reached(self._B, CLEAR)

    def are_clear(self, independent: float) -> bool:
        """Whether rows follow from others exactly or are independent of them by more
        than a part."""
        if self.dependent.any():
            return bool(self.others.least > independent)
        return self.least > independent

    def meeting(self, right: Array) -> Array:
        """The x of least length with B x = right, in the rows that follow from no
        others."""
        if not self.dependent.any():
            return self.smallest(right)
        return self.others.smallest((self._scale * right)[~self.dependent])

    def least_squares(self, right: Array, independent: float) -> Array | None:
        """The x of least length that meets B x = right best, with rows of length 1,
        where some rows follow from others that are independent by more than a part; of
        other rows None."""
        if not self.dependent.any() or not self.are_clear(independent):
            return None
        x = self.meeting(right)
        scaled = self._scale * right
        left = np.abs(self._B @ x - scaled).max(initial=0.0)
        if left <= ALSO_MET * np.abs(scaled).max(initial=0.0):
            return x
        if not self.has_clear_columns:
            return None
        return self.others.smallest(self.reached.part(scaled)[~self.dependent])

    @property
    def has_clear_columns(self) -> bool:
        """Whether as many columns as rows are clearly independent."""
        rank = int(np.sum(~self.dependent))
        return self.reached.clear and self.reached.rank == rank

    def _least_singular_value(self) -> float:
        if not self._B.shape[0]:
            return 1.0
        x = np.random.default_rng(0).standard_normal(self._B.shape[0])
        least = 0.0
        for _ in range(MOST):
            x /= np.linalg.norm(x)
            x, before = self._factor.solve(x), least
            square = 1.0 / max(float(np.linalg.norm(x)), 1e-300)
            least = square**0.5
            if abs(least - before) <= SETTLED * least:
                break
        largest = float(abs(self._B @ self._B.T).sum(axis=1).max()) ** 0.5
        found = least / FACTOR / max(1.0, largest)
        return found if found > CLEAR else 0.0

    def smallest(self, right: Array, without: Array | None = None) -> Array:
        """The x of least length with B x = right.

        without : directions (rows, n) in which the rows need not be met, see `small`
        """
        if without is None:
            without = np.zeros((len(right), 0))

        def wanted(rows: Array) -> Array:
            return np.asarray(rows - without @ (without.T @ rows))

        right = wanted(self._scale * right)
        x = np.zeros(self._B.shape[1])
        for _ in range(REFINEMENTS):
            left = wanted(right - self._B @ x)
            if np.abs(left).max(initial=0.0) <= MET * np.abs(right).max(initial=0.0):
                break
            x += self._B.T @ wanted(self._factor.solve(left))
        return x

    def small(self, bound: float) -> Array | None:
        """Left singular vectors (rows, n) of values below a part of the largest one;
        None where they are many, or not clear."""
        if self.least == 0.0:
            return None
        largest = self._largest()
        for squares, directions in self._smallest_values():
            if squares.max() > (bound * largest) ** 2:
                return directions[:, squares < (bound * largest) ** 2]
        return None

    def stand_apart(self, bound: float) -> bool:
        """Whether of each row more than a part is left without the others.

        That is 1 / sqrt((G^-1)_ii). Long mechanisms have small singular values in
        which all of their rows have a part, and which tell nothing of any of them.
        Rows that follow from others exactly are no matter of rounding. False where it
        is not clear.
        """
        if self.dependent.any():
            others = self.others
            return not others.dependent.any() and others.stand_apart(bound)
        if self.least > bound:
            return True
        if self.least == 0.0:
            return False
        for squares, directions in self._smallest_values():
            found = (directions**2 / squares).sum(axis=1).max()
            if found + 1.0 / squares.max() < bound**-2:
                return True
            if found > bound**-2:
                return False
        return False

    def _largest(self) -> float:
        from scipy.sparse.linalg import eigsh

        G, begin = self._B @ self._B.T, np.ones(self._B.shape[0])
        squares = eigsh(G, 1, tol=SETTLED, v0=begin, return_eigenvectors=False)
        return float(np.sqrt(squares[-1]))

    def _smallest_values(self) -> Iterator[tuple[Array, Array]]:
        """Squares of more and more of the least singular values; their directions."""
        from scipy.sparse.linalg import LinearOperator, eigsh

        rows = self._B.shape[0]
        inverse = LinearOperator((rows, rows), matvec=self._factor.solve, dtype=float)
        begin = np.random.default_rng(0).standard_normal(rows)
        for count in COUNTS:
            if count >= rows:
                return
            inverses, directions = eigsh(inverse, count, tol=DIRECTED**2, v0=begin)
            yield 1.0 / inverses, directions
