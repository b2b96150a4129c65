"""The lowest eigenpairs of K v = lambda M v."""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, eigsh, splu

from formats.errors import InputError

Array = NDArray[np.float64]

#: Up to this size LAPACK is faster than factorisation and Lanczos.
_DENSE = 300


def lowest_eigenpairs(
    stiffness: sp.csr_matrix, mass: sp.csr_matrix, count: int, *, shift: float = 0.0
) -> tuple[Array, Array]:
    """The `count` lowest eigenvalues, rising, and M-orthonormal eigenvectors.

    Shift-invert Lanczos (ARPACK) with a symmetric-mode LU factorisation, then one
    Rayleigh-Ritz step, which makes the vectors orthonormal to rounding. The start
    vector is fixed, so that the same matrices give the same result.

    Parameters
    ----------
    stiffness, mass : (n, n); mass positive definite, stiffness semidefinite
    shift : negative for a singular stiffness, see `free_body_shift` [1/s^2]

    Returns
    -------
    (count,) and (n, count)

    Raises
    ------
    InputError : more eigenpairs than degrees of freedom are asked for, or the matrices
        are no stiffness and mass.
    """
    n = stiffness.shape[0]
    if count > n:
        raise InputError(
            f"{count} modes of a model with {n} free degrees of freedom",
            expected=f"at most {n}",
        )
    solve = _dense if n <= _DENSE or count > n // 3 else _shift_invert
    try:
        return solve(stiffness, mass, count, shift)
    except (ValueError, RuntimeError, np.linalg.LinAlgError) as error:
        raise InputError(
            f"the eigenproblem has no solution ({error})",
            expected="a body with positive mass and stiffness of ordinary size",
        ) from error


def _dense(
    stiffness: sp.csr_matrix, mass: sp.csr_matrix, count: int, _: float
) -> tuple[Array, Array]:
    return scipy.linalg.eigh(
        stiffness.toarray(), mass.toarray(), subset_by_index=[0, count - 1]
    )


def _shift_invert(
    stiffness: sp.csr_matrix, mass: sp.csr_matrix, count: int, shift: float
) -> tuple[Array, Array]:
    n = stiffness.shape[0]
    factors = splu(
        sp.csc_matrix(stiffness - shift * mass),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    _, vectors = eigsh(
        stiffness,
        k=count,
        M=mass,
        sigma=shift,
        OPinv=LinearOperator((n, n), matvec=factors.solve, dtype=float),
        v0=np.random.default_rng(0).standard_normal(n),
    )
    small = [vectors.T @ (matrix @ vectors) for matrix in (stiffness, mass)]
    values, mixing = scipy.linalg.eigh(*small)
    return values, vectors @ mixing


def free_body_shift(
    stiffness: sp.csr_matrix, mass: sp.csr_matrix, positions: Array
) -> float:
    """A negative shift of the size of the first elastic eigenvalue [1/s^2].

    The Ritz value of the lowest deformation among quadratic displacement fields: it
    depends on the body, not on the mesh.

    Parameters
    ----------
    positions : (n, d); the matrices are (d n, d n)
    """
    d = positions.shape[1]
    x = (positions - positions.mean(axis=0)) / np.ptp(positions, axis=0).max()
    squares = [x[:, a] * x[:, b] for a in range(d) for b in range(a, d)]
    fields = np.column_stack([np.ones(len(x)), x, *squares])
    ansatz = np.kron(fields, np.eye(d))
    small = [ansatz.T @ (matrix @ ansatz) for matrix in (stiffness, mass)]
    values = scipy.linalg.eigvalsh(*small)
    rigid = d * (d + 1) // 2
    return -float(values[rigid])
