"""Matrices of the coordinates in which the displacements of a body are given."""

from __future__ import annotations

from itertools import pairwise
from typing import Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array

#: Entries of a matrix whose magnitudes are computed at a time.
_ENTRIES_AT_A_TIME = 1_000_000


class Assembled(Protocol):
    """Protocol of a matrix that may be written out only when it is factorised."""

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""

    def tocsr(self) -> sp.csr_matrix:
        """The entries."""


class SymmetricMatrix(Assembled, Protocol):
    """Protocol of `ProjectedMatrix` and sparse matrices."""

    def __matmul__(self, vectors: Array) -> Array:
        """Products with vectors (n, ...)."""

    def diagonal(self) -> Array:
        """(n,) the diagonal."""


class ProjectedMatrix:
    """transform.T @ matrix @ transform of a symmetric matrix.

    Products are computed with the matrix that is projected. Beside the factors of a
    large body there would be no room for another one.
    """

    def __init__(self, transform: sp.csr_matrix, matrix: sp.csr_matrix) -> None:
        self._transform, self._matrix = transform, matrix

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return (self._transform.shape[1],) * 2

    def __matmul__(self, vectors: Array) -> Array:
        moved = self._matrix @ (self._transform @ vectors)
        return np.asarray(self._transform.T @ moved)

    def diagonal(self) -> Array:
        """(n,) the diagonal."""
        number, count, below = self._parts()
        plain = self._matrix.diagonal()[number >= 0]
        return np.concatenate([plain, below.diagonal(count)])

    def products_of_magnitudes(self, vectors: Array) -> Array:
        """Products of the absolute values of the entries with vectors (n, k)."""
        _, count, below = self._parts()
        below, plain = abs(below), self._transform[:, :count]
        moved = _products_of_magnitudes(self._matrix, plain @ vectors[:count])
        beside = below[:, :count].T @ vectors[count:]
        return np.vstack([plain.T @ moved + beside, below @ vectors])

    def _parts(self) -> tuple[NDArray[np.int32], int, sp.csr_matrix]:
        """(ndof,) the numbers of selected coordinates, how many there are, and the rows
        of the others.
        """
        number = _selected_numbers(self._transform)
        count = int(np.count_nonzero(number >= 0))
        rest = sp.csr_matrix(self._transform[:, count:])
        below = sp.csr_matrix(sp.csr_matrix(rest.T) @ self._matrix @ self._transform)
        return number, count, below

    def tocsr(self) -> sp.csr_matrix:
        """The entries, with sorted columns.

        Where the transformation only selects, entries are copied.
        """
        matrix, (number, count, below) = self._matrix, self._parts()
        is_kept = np.repeat(number >= 0, np.diff(matrix.indptr))
        is_kept &= (number >= 0)[matrix.indices]
        ends = np.cumsum(is_kept, dtype=matrix.indptr.dtype)
        ends = np.concatenate([ends[:1] * 0, ends])[matrix.indptr[1:][number >= 0]]
        values = matrix.data[is_kept]
        columns = number[matrix.indices[is_kept]]
        below.sort_indices()
        beside = sp.csr_matrix(below[:, :count].T)
        added = np.cumsum(np.diff(beside.indptr), dtype=ends.dtype)
        there = np.repeat(ends, np.diff(beside.indptr))
        there = np.append(there, np.full(below.nnz, len(values)))
        values = np.insert(values, there, np.append(beside.data, below.data))
        others = np.append(beside.indices + number.dtype.type(count), below.indices)
        columns = np.insert(columns, there, others)
        ends += added
        last = (ends[-1] if count else 0) + below.indptr[1:]
        starts = np.concatenate([[0], ends, last])
        return sp.csr_matrix((values, columns, starts), shape=self.shape)


def products_of_magnitudes(matrix: SymmetricMatrix, vectors: Array) -> Array:
    """Products of the absolute values of the entries with vectors (n, k)."""
    if isinstance(matrix, ProjectedMatrix):
        return matrix.products_of_magnitudes(vectors)
    return _products_of_magnitudes(matrix.tocsr(), vectors)


def _products_of_magnitudes(matrix: sp.csr_matrix, vectors: Array) -> Array:
    """The same, by groups of rows: there would be no room for all magnitudes."""
    limits = np.arange(0, matrix.nnz + _ENTRIES_AT_A_TIME, _ENTRIES_AT_A_TIME)
    rows = np.searchsorted(matrix.indptr, limits).clip(max=matrix.shape[0])
    groups = pairwise([*rows.tolist(), matrix.shape[0]])
    return np.concatenate([abs(matrix[a:b].real) @ vectors for a, b in groups])


def _selected_numbers(transform: sp.csr_matrix) -> NDArray[np.int32]:
    """(ndof,) numbers of the first coordinates that are one displacement each, in the
    same order; -1 of other displacements.
    """
    lengths = np.diff(transform.indptr)
    rows = np.flatnonzero(lengths == 1)
    entries = transform.indptr[rows]
    columns = transform.indices[entries]
    is_alone = (
        np.bincount(transform.indices, minlength=transform.shape[1])[columns] == 1
    )
    is_plain = is_alone & (transform.data[entries] == 1)
    rows, columns = rows[is_plain], columns[is_plain]
    ordered = columns == np.arange(len(columns))
    count = len(columns) if ordered.all() else int(np.argmin(ordered))
    number = np.full(transform.shape[0], -1, np.int32)
    number[rows[:count]] = np.arange(count, dtype=np.int32)
    return number
