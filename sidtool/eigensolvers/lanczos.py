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

from .projected_matrix import SymmetricMatrix

#: Equal eigenvalues come in pairs and triples, by symmetry. A solution for four vectors
#: takes 1.1 to 1.5 times as long as for two, and half as many are needed.
BLOCK_SIZE = 4
#: Residual of an eigenvector relative to its value.
RESIDUAL = 1e-12
#: Relative error of a value that only has to differ from the others, by so much.
_ERROR_OF_NEXT = 1e-6
_DIFFERENT = 1e-4
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


@dataclass(frozen=True)
class Accuracy:
    """Accuracy at which a search for eigenpairs ends.

    Attributes
    ----------
    residual : of the eigenvectors, relative to their values
    value_error : relative error of the eigenvalues below which residuals do not matter
    next_is_distinct : the last pair is not needed. It shows that the values before are
        not those of a group of equal ones that goes on
    """

    residual: float = RESIDUAL
    value_error: float = 0.0
    next_is_distinct: bool = False

    def reached(self, values: Array, residuals: Array, count: int) -> bool:
        """Return whether the first `count` of all Ritz pairs are accurate.

        Parameters
        ----------
        values : (n,) falling
        residuals : (n,) norms
        """
        sizes = np.abs(values[:count])
        errors = _value_errors(values, residuals, count) / sizes
        accurate = residuals[:count] <= self.residual * sizes
        accurate |= errors <= self.value_error
        if self.next_is_distinct and count > 1:
            gap = sizes[-2] / sizes[-1] - 1.0
            accurate[-1] |= gap > _DIFFERENT and errors[-1] <= _ERROR_OF_NEXT
        return bool(accurate.all())


#: Eigenvectors to rounding.
ACCURATE = Accuracy()


def _value_errors(values: Array, residuals: Array, count: int) -> Array:
    """(count,) bounds of the errors of the first Ritz values.

    Squares of residuals over the gap to other eigenvalues. Values whose intervals
    overlap count as one group, and their squares are added.

    Source: B. Parlett, "The Symmetric Eigenvalue Problem", SIAM 1998, theorems 11.7.1
    and 11.7.2.
    """
    distances = np.abs(values[:count, None] - values)
    in_group = distances <= residuals[:count, None] + residuals
    gaps = np.where(in_group, np.inf, distances - residuals).min(axis=1)
    squares = np.where(in_group, residuals**2, 0.0).sum(axis=1)
    return np.minimum(residuals[:count], squares / gaps)


def dominant_vectors(
    operator: Callable[[Array], Array],
    mass: SymmetricMatrix,
    count: int,
    rigid: Array,
    accuracy: Accuracy = ACCURATE,
) -> Array:
    """(n, count) eigenvectors of the largest eigenvalues of an operator.

    Parameters
    ----------
    operator : (n, b) -> (n, b) ``A^-1 M x`` from ``M x``; with M self-adjoint in the
        metric of M
    mass : (n, n) M, positive definite on the range of the operator
    rigid : (n, r) eigenvectors that are known

    Raises
    ------
    RuntimeError : they do not converge, or the operator is not positive.
    """
    space = _KrylovSpace(operator, mass, count, rigid)
    while True:
        space.extend()
        vectors = space.converged(count, accuracy)
        if vectors is not None:
            return vectors


class _KrylovSpace:
    """M-orthonormal Lanczos vectors, and the operator in their space.

    M times the vectors is kept of the last two blocks only: beside the factors, that of
    all would take as much memory as the vectors.
    """

    def __init__(
        self,
        operator: Callable[[Array], Array],
        mass: SymmetricMatrix,
        count: int,
        rigid: Array,
    ) -> None:
        n = mass.shape[0]
        self._operator, self._mass = operator, mass
        self._random = np.random.default_rng(0)
        self._limit = min(n, 20 * count + 200)
        self._vectors = np.empty((n, min(n, 4 * count + 12 * BLOCK_SIZE)), order="F")
        self._momenta_before = np.empty((n, 0))
        self._size = 0
        self._small = np.zeros((self._limit,) * 2)
        self._coupling = np.zeros((0, 0))
        self._converged_values = np.zeros(0)
        self._next, self._momenta = self._first(rigid)

    def extend(self) -> None:
        """Add the next block and apply the operator to it.

        The image has components along this block and the one before, and rounding
        along all others.

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
        self._size = last
        image = self._operator(self._momenta)
        near = np.hstack([self._momenta_before, self._momenta])
        self._momenta_before = self._momenta
        self._next, self._momenta, self._coupling, column = self._orthonormal(
            image, near
        )
        self._small[:last, first:last] = column
        self._small[first:last, :last] = column.T
        if not self._next.shape[1]:
            self._next, self._momenta = self._random_directions()

    def converged(self, count: int, accuracy: Accuracy) -> Array | None:
        """The Ritz vectors of the largest values if they are accurate."""
        if self._size < count:
            return None
        values, mixing = np.linalg.eigh(self._small[: self._size, : self._size])
        if values[0] < -_NEGATIVE_TOLERANCE * np.abs(values).max():
            raise RuntimeError(_MECHANISM_TEXT)
        values, mixing = values[::-1], mixing[:, ::-1]
        ends = mixing[self._size - self._coupling.shape[1] :]
        remainders = self._coupling @ ends
        residuals = np.linalg.norm(remainders, axis=0)
        if not accuracy.reached(values, residuals, count):
            return None
        if not self._coupling.shape[0] and self._has_found_more(values[:count]):
            return None
        return self._purified(values[:count], mixing[:, :count], remainders[:, :count])

    def _purified(self, values: Array, mixing: Array, remainders: Array) -> Array:
        """The images of Ritz vectors over their values: Ritz vectors without much of
        the highest modes, which have a large share in Rayleigh quotients.

        Source: T. Ericsson, A. Ruhe, "The spectral transformation Lanczos method for
        the numerical solution of large sparse generalized symmetric eigenvalue
        problems", Mathematics of Computation 35, 1980.
        """
        vectors = _combined(self._vectors[:, : self._size], mixing)
        if remainders.size:
            vectors += _combined(self._next, remainders / values)
        return vectors

    def _has_found_more(self, values: Array) -> bool:
        """Return whether random directions found more eigenvectors after the space was
        exhausted.
        """
        before, self._converged_values = self._converged_values, values
        return not before.size or not np.allclose(before, values, rtol=1e-9)

    def _reserve_columns(self, size: int) -> None:
        n, capacity = self._vectors.shape
        if size > capacity:
            larger = np.empty((n, min(n, 2 * capacity)), order="F")
            larger[:, : self._size] = self._vectors[:, : self._size]
            self._vectors = larger

    def _first(self, rigid: Array) -> tuple[Array, Array]:
        return (
            self._new_directions(rigid) if rigid.shape[1] else self._random_directions()
        )

    def _random_directions(self) -> tuple[Array, Array]:
        """Random directions that the operator leads to, orthonormal to all.

        The first ones are smooth, by loads that the mass weights. Eigenvectors of light
        nodes beside a heavy one are in these by rounding only, and the square root of
        the mass acts on all alike.
        """
        load = self._random.standard_normal((self._mass.shape[0], BLOCK_SIZE))
        if self._size:
            load *= np.sqrt(np.abs(self._mass.diagonal()))[:, None]
        else:
            load = self._mass @ load
        return self._new_directions(self._operator(load))

    def _new_directions(self, block: Array) -> tuple[Array, Array]:
        return self._orthonormal(block, block[:, :0])[:2]

    def _orthonormal(
        self, block: Array, near: Array
    ) -> tuple[Array, Array, Array, Array]:
        """Return new directions in a block, M times them, and the block in terms of
        them and of the known vectors.

        Directions that are not new are omitted. Components along the last vectors are
        subtracted first, so that rounding errors in them do not stay.

        Parameters
        ----------
        near : (n, m) M times the last m vectors
        """
        vectors = self._vectors[:, : self._size]
        column = np.zeros((self._size, block.shape[1]))
        change = np.eye(block.shape[1])
        last = slice(self._size - near.shape[1], self._size)
        column[last] = near.T @ block
        block = block - _combined(vectors[:, last], column[last])
        block_momenta = self._mass @ block
        size = 0.0
        for _ in range(_MAX_PASSES):
            known = vectors.T @ block_momenta
            block = block - _combined(vectors, known)
            column += known @ change
            block_momenta = self._mass @ block
            gram = block.T @ block_momenta
            rest = ((known**2).sum(axis=0) + np.diag(gram)).max()
            size = size or ((column**2).sum(axis=0) + np.diag(gram)).max()
            values, axes = np.linalg.eigh(gram)
            is_new = values > _NEW_DIRECTION_TOLERANCE * size
            scale = np.sqrt(values[is_new])
            axes = axes[:, is_new]
            block, block_momenta = (x @ (axes / scale) for x in (block, block_momenta))
            change = (scale[:, None] * axes.T) @ change
            size = 1.0
            lost = np.finfo(float).eps * rest
            if not (lost > _ORTHOGONALITY_TOLERANCE * values[is_new]).any():
                break
        return block, block_momenta, change, column


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

    stiffness: SymmetricMatrix
    mass: SymmetricMatrix
    shift: float
    constraints: Array
    rigid: Array

    @property
    def shifted(self) -> sp.csr_matrix:
        """K - shift M."""
        if self.shift == 0.0:
            return self.stiffness.tocsr()
        return self.stiffness.tocsr() - self.shift * self.mass.tocsr()
