"""Constraints of large scenes, whose Jacobian is sparse.

Rows that are clearly independent, as those of most mechanisms are, need no dense
matrix: with G = B B^T of the rows B, factored sparsely, inverse iteration bounds their
least singular value, and B^T G^-1 b is the smallest solution of B x = b. Whatever is
not clear is left to dense matrices, which see dependencies down to rounding.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.sid import Array

from ..space import layout as at
from ..system.scene import System
from ..system.sizes import coordinate_sizes

if TYPE_CHECKING:
    from scipy.sparse import csr_array

#: Rows from which on scenes are large.
MANY = 300
#: G keeps half of the digits: singular values below this part of the largest one are
#: not told from those of dependent rows.
CLEAR = 1e-5
#: Inverse iteration ends when the least singular value changes by less than this part,
#: which is known then up to a factor.
SETTLED, MOST, FACTOR = 0.01, 50, 1.5
#: What is added to G where rows may depend on each other, and how well directions of
#: its least values are met, relative to them.
SHIFT, DIRECTED = 1e-7, 1e-6
#: Corrections of a solution, until it is met up to rounding.
REFINEMENTS, MET = 5, 1e-15


def jacobian_entries(system: System, C: Array) -> tuple[np.ndarray, np.ndarray, Array]:
    """Rows, columns and values of the constraint Jacobian, to be added up."""
    row, body, offset = system.arrays.segment.T
    counts = system.arrays.body[body, at.NV]
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    columns = np.repeat(system.arrays.body[body, at.VEL], counts) + within
    return np.repeat(row, counts), columns, C[np.repeat(offset, counts) + within]


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
    """

    def __init__(self, B: csr_array) -> None:
        from scipy.sparse import diags_array
        from scipy.sparse.linalg import splu

        lengths = np.sqrt(B.multiply(B).sum(axis=1))
        self.least = 0.0
        if not (lengths > 0.0).all():
            return
        self._scale = 1.0 / lengths
        self._B = (diags_array(self._scale) @ B).tocsr()
        G = (self._B @ self._B.T).tocsc()
        try:
            self._lu = splu(G, "MMD_AT_PLUS_A", 0.0, options={"SymmetricMode": True})
        except RuntimeError:  # exactly singular
            return
        self.least = self._least_singular_value(G)

    def _least_singular_value(self, G: Any) -> float:
        x = np.random.default_rng(0).standard_normal(G.shape[0])
        least = 0.0
        for _ in range(MOST):
            x /= np.linalg.norm(x)
            x, before = self._lu.solve(x), least
            square = 1.0 / max(float(np.linalg.norm(x)), 1e-300)
            least = square**0.5
            if abs(least - before) <= SETTLED * least:
                break
        largest = float(abs(G).sum(axis=1).max()) ** 0.5
        found = least / FACTOR / max(1.0, largest)
        return found if found > CLEAR else 0.0

    def smallest(self, right: Array) -> Array:
        """The x of least length with B x = right."""
        right = self._scale * right
        x = np.zeros(self._B.shape[1])
        for _ in range(REFINEMENTS):
            left = right - self._B @ x
            if np.abs(left).max(initial=0.0) <= MET * np.abs(right).max(initial=0.0):
                break
            x += self._B.T @ self._lu.solve(left)
        return x
