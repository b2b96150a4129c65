"""Lowest deformation by quadratic displacement fields; permutation symbol."""

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

Indices = NDArray[np.int64]


def softest_deformation(
    stiffness: sp.csr_matrix, mass: sp.csr_matrix, positions: Array, table: Indices
) -> tuple[float, Array]:
    """The lowest Ritz value [1/s^2] of a deformation among quadratic fields.

    Parameters
    ----------
    positions : (n, d)
    table : (n, 6) degrees of freedom by node as in `FiniteElementModel.table`

    Returns
    -------
    value, and its mass-normalised vector (ndof,)

    Raises
    ------
    InputError : rigid motions alone have inertia.
    """
    d = positions.shape[1]
    ansatz = quadratic_fields(positions, table, stiffness.shape[0])
    small = [ansatz.T @ (matrix @ ansatz) for matrix in (stiffness, mass)]
    values, vectors = scipy.linalg.eigh(small[1])
    is_independent = values > 1e-12 * values[-1]
    basis = vectors[:, is_independent] / np.sqrt(values[is_independent])
    values, mixing = scipy.linalg.eigh(basis.T @ small[0] @ basis)
    first = d * (d + 1) // 2
    if len(values) <= first:
        raise InputError(
            "no deformation of the free body has inertia",
            expected="a density above zero, or masses at more nodes",
        )
    return float(values[first]), ansatz @ (basis @ mixing[:, first])


def quadratic_fields(positions: Array, table: Indices, ndof: int) -> Array:
    """(ndof, count) all quadratic displacement fields and their rotations."""
    d = positions.shape[1]
    length = np.ptp(positions, axis=0).max() or 1.0
    x = (positions - positions.mean(axis=0)) / length
    pairs = [(a, b) for a in range(d) for b in range(a, d)]
    values = np.column_stack(
        [np.ones(len(x)), x, *(x[:, a] * x[:, b] for a, b in pairs)]
    )
    count = values.shape[1]
    fields = np.zeros((ndof, count * d))
    for axis in range(d):
        there = table[:, axis] >= 0
        fields[table[there, axis], axis::d] = values[there]
    if (table[:, 3:] < 0).all():
        return fields
    slopes = np.zeros((len(x), count, 3))
    slopes[:, range(1, d + 1), range(d)] = 1.0 / length
    for k, (a, b) in enumerate(pairs, d + 1):
        slopes[:, k, a] += x[:, b] / length
        slopes[:, k, b] += x[:, a] / length
    for turn in range(3):
        there = table[:, 3 + turn] >= 0
        for axis in range(d):
            curl = slopes[there] @ LEVI_CIVITA[turn, :, axis] / 2
            fields[table[there, 3 + turn], axis::d] = curl
    return fields


#: (3, 3, 3) permutation symbol: (a x b)_i = LEVI_CIVITA[i, j, k] a_j b_k.
LEVI_CIVITA: Array = np.zeros((3, 3, 3))
LEVI_CIVITA[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1
LEVI_CIVITA[[0, 2, 1], [2, 1, 0], [1, 0, 2]] = -1
LEVI_CIVITA.setflags(write=False)
