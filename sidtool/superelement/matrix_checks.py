"""Checks of mass, stiffness and damping matrices before they are written."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

#: Relative differences and negative eigenvalues that are rounding.
_ROUNDING = 1e-9


def check_symmetric(matrix: Array, name: str) -> None:
    """Check that a matrix equals its transpose, relative to its diagonal.

    Raises
    ------
    InputError : it does not.
    """
    size = np.sqrt(np.abs(np.diag(matrix)))
    scale = np.maximum(np.outer(size, size), 1e-300)
    largest = np.abs(matrix).max(initial=0.0)
    deviation = np.abs(matrix - matrix.T)
    relative = np.minimum(deviation / scale, deviation / max(largest, 1e-300))
    if relative.max(initial=0.0) > _ROUNDING:
        raise InputError(
            f"is not symmetric, by {relative.max():.2g} of its entries",
            place=name,
            expected="a symmetric matrix",
        )


def check_definite(matrix: Array, mass: Array, name: str, *, strict: bool) -> None:
    """Check that a matrix is positive semidefinite, or positive definite.

    Parameters
    ----------
    mass : relative to which eigenvalues of a semidefinite matrix are computed
    strict : positive definite; eigenvalues are those of the matrix with unit diagonal

    Raises
    ------
    InputError : it is not.
    """
    if strict:
        size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        values = scipy.linalg.eigvalsh(matrix / np.outer(size, size))
        passed = values[0] > 0.0
    else:
        values = scipy.linalg.eigh(matrix, mass, eigvals_only=True)
        passed = values[0] >= -_ROUNDING * max(values[-1], 0.0)
    if not passed:
        kind = "definite" if strict else "semidefinite"
        raise InputError(
            f"is not positive {kind}: its least eigenvalue is {values[0]:.3g}, the "
            f"largest {values[-1]:.3g}",
            place=name,
            expected=f"a positive {kind} matrix",
        )


def check_rigid_motion(matrix: Array, rigid: Array, name: str) -> None:
    """Check that rigid motions (n, 6) cause no forces but rounding.

    Forces are compared with the root of the stiffness at that coordinate times the
    energy of the terms that cancel.

    Raises
    ------
    InputError : they do.
    """
    energies = np.einsum("ij,ik,kj->j", np.abs(rigid), np.abs(matrix), np.abs(rigid))
    scale = np.sqrt(np.outer(np.abs(np.diag(matrix)), energies))
    forces = np.abs(matrix @ rigid) / np.maximum(scale, 1e-300)
    if forces.max(initial=0.0) > _ROUNDING:
        raise InputError(
            f"rigid motions cause forces, {forces.max():.2g} of their terms",
            place=name,
            expected=f"less than {_ROUNDING:g}",
        )
