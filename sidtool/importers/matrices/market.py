"""MatrixMarket files of real matrices, coordinate and array format.

Source: R. Boisvert, R. Pozo, K. Remington, "The Matrix Market exchange formats", NISTIR
5935, 1996. (SciPy's reader trusts the indices of a file, and dies of wrong ones.)
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.errors import InputError

from ..imported import integers, number_table, read_lines

Array = NDArray[np.float64]

_HEADER = "%%MatrixMarket matrix, coordinate or array, real or integer, general or "
_SYMMETRIES = ("general", "symmetric")


def is_matrix_market(line: str) -> bool:
    """Whether a file that begins with this line is one."""
    return line.lower().startswith("%%matrixmarket")


def read_matrix_market(path: str) -> sp.csr_matrix:
    """A square matrix.

    Raises
    ------
    InputError : names file and line.
    """
    try:
        return _matrix(read_lines(path))
    except InputError as error:
        raise error.located(path) from None


def _matrix(lines: list[str]) -> sp.csr_matrix:
    words = lines[0].lower().split()
    if (
        len(words) != 5
        or words[1] != "matrix"
        or words[2] not in ("coordinate", "array")
        or words[3] not in ("real", "integer", "double")
        or words[4] not in _SYMMETRIES
    ):
        raise InputError(
            f"found {lines[0][:80]!r}", place="line 1", expected=f"{_HEADER}symmetric"
        )
    rows = [
        (f"line {number}", line.split())
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.startswith("%")
    ]
    if not rows:
        raise InputError("has no line of sizes", expected="rows, columns, entries")
    sparse = words[2] == "coordinate"
    place, sizes = rows[0]
    size = _sizes(sizes, place, sparse)
    symmetric = words[4] == "symmetric"
    if not sparse:
        return _dense(rows[1:], size[0], symmetric)
    if len(rows) - 1 != size[2]:
        raise InputError(
            f"has {len(rows) - 1} entries",
            expected=f"{size[2]}, as the line of sizes says (is the file cut off?)",
        )
    return _sparse(number_table(rows[1:], 3), size[0], symmetric)


def _sizes(words: list[str], place: str, sparse: bool) -> list[int]:
    size = integers(words, place, "sizes")
    if len(size) != 2 + sparse or size[0] != size[1] or size[0] < 1:
        raise InputError(
            f"has sizes {' '.join(words)[:60]}",
            place=place,
            expected="a square matrix" + (" and its number of entries" * sparse),
        )
    return size


def _sparse(table: Array, size: int, symmetric: bool) -> sp.csr_matrix:
    index = table[:, :2]
    wrong = (index != np.round(index)) | (index < 1) | (index > size)
    if wrong.any():
        row = int(np.flatnonzero(wrong.any(axis=1))[0])
        raise InputError(
            f"entry {row + 1} is in row {index[row, 0]:g}, column {index[row, 1]:g}",
            expected=f"rows and columns from 1 to {size}",
        )
    i, j = index.astype(np.int64).T - 1
    matrix = sp.csr_matrix((table[:, 2], (i, j)), shape=(size, size))
    if not symmetric:
        return matrix
    below = sp.tril(matrix, -1) + sp.triu(matrix, 1)
    return sp.csr_matrix(matrix + below.T)


def _dense(
    rows: list[tuple[str, list[str]]], size: int, symmetric: bool
) -> sp.csr_matrix:
    values = number_table(rows, 1)[:, 0]
    count = size * (size + 1) // 2 if symmetric else size * size
    if len(values) != count:
        raise InputError(f"has {len(values)} entries", expected=f"{count} entries")
    matrix = np.zeros((size, size))
    if not symmetric:
        return sp.csr_matrix(values.reshape(size, size).T)
    columns, lines = np.triu_indices(size)
    matrix[lines, columns] = values
    matrix[columns, lines] = values
    return sp.csr_matrix(matrix)
