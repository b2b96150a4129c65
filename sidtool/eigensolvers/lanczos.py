"""Block Lanczos in shift-invert mode with full reorthogonalisation.

A block finds multiple eigenvalues (a square shaft bends alike in two planes), of which
a single vector finds one each. A factor is read once for all vectors of a block.

Source: R. Grimes, J. Lewis, H. Simon, "A shifted block Lanczos algorithm for solving
sparse symmetric generalized eigenproblems", SIAM J. Matrix Anal. Appl. 15 (1), 1994.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from sidtool.formats.base.sid import Array

#: Equal eigenvalues come in pairs and triples, by symmetry. A solution for four vectors
#: takes 1.1 to 1.5 times as long as for two, and half as many are needed.
BLOCK_SIZE = 4
#: Residual of a Ritz pair relative to its value.
RESIDUAL = 1e-12
#: A direction is dependent if this fraction of its squared norm is left.
_NEW_DIRECTION_TOLERANCE = 1e-24
#: Negative values beside the largest one that are no rounding.
_NEGATIVE_TOLERANCE = 1e-9
#: Products of two Lanczos vectors that count as zero; how often they are made so.
_ORTHOGONALITY_TOLERANCE = 1e-12
_MAX_PASSES = 3
_MECHANISM_TEXT = "the stiffness does not resist every deformation"


def expected_blocks(count: int) -> float:
    """About how many blocks a search for so many vectors takes."""
    return count + 7.0


def dominant_vectors(
    operator: Callable[[Array], Array],
    mass: sp.csr_matrix,
    count: int,
    rigid: Array,
    residual: float = RESIDUAL,
) -> Array:
    """(n, count) eigenvectors of the largest eigenvalues of an operator.

    Parameters
    ----------
    operator : (n, b) -> (n, b) ``A^-1 M x`` from ``M x``; with M self-adjoint in the
        metric of M
    mass : (n, n) M, positive definite on the range of the operator
    rigid : (n, r) eigenvectors that are known
    residual : of the eigenvectors, relative to their values

    Raises
    ------
    RuntimeError : they do not converge, or the operator is not positive.
    """
    space = _KrylovSpace(operator, mass, count, rigid, residual)
    while True:
        space.extend()
        vectors = space.converged(count)
        if vectors is not None:
            return vectors


class _KrylovSpace:
    """M-orthonormal Lanczos vectors, M times them, and the operator in their space."""

    def __init__(
        self,
        operator: Callable[[Array], Array],
        mass: sp.csr_matrix,
        count: int,
        rigid: Array,
        residual: float,
    ) -> None:
        n = mass.shape[0]
        self._residual = residual
        self._operator, self._mass = operator, mass
        self._random = np.random.default_rng(0)
        self._limit = min(n, 20 * count + 200)
        self._vectors = np.empty((n, min(n, 4 * count + 12 * BLOCK_SIZE)), order="F")
        self._vector_momenta = np.empty_like(self._vectors)
        self._size = 0
        self._small = np.zeros((self._limit,) * 2)
        self._coupling = np.zeros((0, 0))
        self._converged_values = np.zeros(0)
        self._next, self._momenta = self._first(rigid)

    def extend(self) -> None:
        """Add the next block and apply the operator to it.

        Raises
        ------
        RuntimeError : the space is as large as it may be, or the operator is singular.
        """
        first, last = self._size, self._size + self._next.shape[1]
        if first == last:  # one response dominates all others
            raise RuntimeError(_MECHANISM_TEXT)
        if last > self._limit:
            raise RuntimeError("the eigenvectors do not converge")
        self._reserve_columns(last)
        self._vectors[:, first:last] = self._next
        self._vector_momenta[:, first:last] = self._momenta
        self._size = last
        image = self._operator(self._momenta)
        column = self._vector_momenta[:, :last].T @ image
        self._small[:last, first:last] = column
        self._small[first:last, :last] = column.T
        self._next, self._momenta, self._coupling = self._orthonormal(image, column)
        if not self._next.shape[1]:
            self._next, self._momenta = self._random_directions()

    def converged(self, count: int) -> Array | None:
        """The Ritz vectors of the largest values if their residuals are small."""
        if self._size < count:
            return None
        values, mixing = np.linalg.eigh(self._small[: self._size, : self._size])
        if values[0] < -_NEGATIVE_TOLERANCE * np.abs(values).max():
            raise RuntimeError(_MECHANISM_TEXT)
        mixing = mixing[:, ::-1][:, :count]
        ends = mixing[self._size - self._coupling.shape[1] :]
        residuals = np.linalg.norm(self._coupling @ ends, axis=0)
        largest = values[::-1][:count]
        if (residuals > self._residual * np.abs(largest)).any():
            return None
        if not self._coupling.shape[0] and self._has_found_more(largest):
            return None
        return _combined(self._vectors[:, : self._size], mixing)

    def _has_found_more(self, values: Array) -> bool:
        """Return whether random directions found more eigenvectors after the space was
        exhausted.
        """
        before, self._converged_values = self._converged_values, values
        return not before.size or not np.allclose(before, values, rtol=1e-9)

    def _reserve_columns(self, size: int) -> None:
        n, capacity = self._vectors.shape
        if size > capacity:
            shape, kept = (n, min(n, 2 * capacity)), slice(self._size)
            for name in ("_vectors", "_vector_momenta"):
                larger = np.empty(shape, order="F")
                larger[:, kept] = getattr(self, name)[:, kept]
                setattr(self, name, larger)

    def _first(self, rigid: Array) -> tuple[Array, Array]:
        return (
            self._new_directions(rigid) if rigid.shape[1] else self._random_directions()
        )

    def _random_directions(self) -> tuple[Array, Array]:
        """Random directions that the operator leads to, orthonormal to all."""
        random = self._random.standard_normal((self._mass.shape[0], BLOCK_SIZE))
        return self._new_directions(self._operator(self._mass @ random))

    def _new_directions(self, block: Array) -> tuple[Array, Array]:
        known = self._vector_momenta[:, : self._size].T @ block
        block, momenta, _ = self._orthonormal(block, known)
        return block, momenta

    def _orthonormal(self, block: Array, known: Array) -> tuple[Array, Array, Array]:
        """Return new directions in a block, M times them, and the block in terms of
        them.

        Directions that are not new are omitted. If the first pass leaves rounding
        errors along the `known` share, further passes follow.
        """
        vectors, momenta_known = (
            x[:, : self._size] for x in (self._vectors, self._vector_momenta)
        )
        size = 0.0
        change = np.eye(block.shape[1])
        for _ in range(_MAX_PASSES):
            block = block - _combined(vectors, known)
            momenta = self._mass @ block
            gram = block.T @ momenta
            size = size or ((known**2).sum(axis=0) + np.diag(gram)).max()
            values, axes = np.linalg.eigh(gram)
            is_new = values > _NEW_DIRECTION_TOLERANCE * size
            scale = np.sqrt(values[is_new])
            axes = axes[:, is_new]
            block, momenta = (x @ (axes / scale) for x in (block, momenta))
            change = (scale[:, None] * axes.T) @ change
            size = 1.0
            known = momenta_known.T @ block
            if not known.size or np.abs(known).max() < _ORTHOGONALITY_TOLERANCE:
                break
        return block, momenta, change


def _combined(vectors: Array, mixing: Array) -> Array:
    """vectors @ mixing for columns (n, k) in memory: BLAS takes a third of the time if
    the result is stored by columns as well."""
    return (mixing.T @ vectors.T).T


@dataclass(frozen=True, eq=False)
class Pencil:
    """K v = lambda M v with conditions on v.

    Attributes
    ----------
    stiffness, mass : (n, n)
    shift : about which the spectrum is inverted [1/s^2]
    constraints : (k, n) ``constraints @ v = 0``
    rigid : (n, r) known vectors of the eigenvalue 0
    """

    stiffness: sp.csr_matrix
    mass: sp.csr_matrix
    shift: float
    constraints: Array
    rigid: Array

    @property
    def shifted(self) -> sp.csr_matrix:
        """K - shift M."""
        if self.shift == 0.0:
            return self.stiffness
        return self.stiffness - self.shift * self.mass
