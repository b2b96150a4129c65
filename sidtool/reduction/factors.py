"""Factors of symmetric positive definite matrices, by the fastest library there is.

CHOLMOD (scikit-sparse) and PARDISO (pypardiso) are used when they are installed;
SuperLU, which comes with SciPy, is always there. A run (`running`) or the environment
variable SIDTOOL_FACTORS names one of `ENGINES` to insist on it. PETSc is used only if
it is asked for: it is meant for several processes.
"""

from __future__ import annotations

import functools
import importlib
import os
from collections.abc import Callable
from typing import Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from sidtool.formats.errors import InputError

from .ordering import nested_dissection
from .running import asked_engine, tell
from .slepc import PetscFactors, check_slepc

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Factors(Protocol):
    """What can be solved with."""

    def solve(self, load: Array) -> Array:
        """A^-1 b for b (n,) or (n, k)."""


def symmetric_factors(matrix: sp.csr_matrix, places: Array | None = None) -> Factors:
    """Factors of a symmetric positive definite matrix.

    Parameters
    ----------
    places : (n, d) where each unknown is; helps libraries that find no good order of
        elimination themselves

    Raises
    ------
    InputError : a library is asked for that is not there.
    RuntimeError, ValueError : the matrix is singular.
    """
    name = engine_name()
    tell(f"factorising {matrix.shape[0]} equations by {name}")
    if name == "superlu":
        return _Superlu(matrix, places)
    return ENGINES[name][1](matrix)


def engine_name() -> str:
    """The library that will be used, one of `ENGINES`.

    Raises
    ------
    InputError : a library is asked for that is not there.
    """
    asked = asked_engine() or os.environ.get("SIDTOOL_FACTORS")
    if asked == "slepc":
        check_slepc()
        return asked
    if asked is None:
        return next(
            n for n, (module, _) in ENGINES.items() if not reason_unavailable(module)
        )
    missing = (
        reason_unavailable(ENGINES[asked][0]) if asked in ENGINES else "no such engine"
    )
    if missing:
        there = [
            n for n, (module, _) in ENGINES.items() if not reason_unavailable(module)
        ]
        raise InputError(
            f"the engine {asked!r} is not there ({missing})",
            place="--engine" if asked_engine() else "SIDTOOL_FACTORS",
            expected=f"one of {', '.join(there)}",
        )
    return asked


@functools.cache
def reason_unavailable(module: str) -> str:
    """Why a module cannot be used, empty if it can: some are installed, but a shared
    library that they load is not (pypardiso without MKL)."""
    try:
        importlib.import_module(module)
    except (ImportError, OSError) as error:
        return str(error).split(". ")[0]
    return ""


def _by_columns(matrix: sp.csr_matrix) -> sp.csc_matrix:
    """The same symmetric matrix by columns, without a copy."""
    return sp.csc_matrix(matrix.T)


class _Superlu:
    """LU factors with pivots on the diagonal, by nested dissection if it can be."""

    def __init__(self, matrix: sp.csr_matrix, places: Array | None = None) -> None:
        self._order: Indices | None = None
        if places is not None:
            self._order = nested_dissection(matrix, places)
            matrix = matrix[self._order][:, self._order]
        self._factors = splu(
            _by_columns(matrix),
            permc_spec="MMD_AT_PLUS_A" if places is None else "NATURAL",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )

    def solve(self, load: Array) -> Array:
        if self._order is None:
            return self._factors.solve(load)
        solution = np.empty(load.shape, order="F")
        solution[self._order] = self._factors.solve(load[self._order])
        return solution


class _Cholmod:
    """Supernodal Cholesky factors (scikit-sparse below 0.5)."""

    def __init__(self, matrix: sp.csr_matrix) -> None:
        from sksparse.cholmod import CholmodError, cholesky

        try:
            self._factor = cholesky(_by_columns(matrix), mode="supernodal")
        except CholmodError as error:
            raise RuntimeError(str(error)) from None

    def solve(self, load: Array) -> Array:
        return self._factor(load)


class _Pardiso:
    """Cholesky factors of the upper triangle (mtype 2)."""

    def __init__(self, matrix: sp.csr_matrix) -> None:
        from pypardiso import PyPardisoSolver
        from pypardiso.pardiso_wrapper import PyPardisoError

        self._solver = PyPardisoSolver(mtype=2)
        self._upper = sp.csr_matrix(sp.triu(matrix, format="csr"))
        try:
            self._solver.factorize(self._upper)
        except PyPardisoError as error:
            raise RuntimeError(str(error)) from None

    def solve(self, load: Array) -> Array:
        if not load.size:  # which PARDISO calls an inconsistent input
            return np.zeros(load.shape)
        return self._solver.solve(self._upper, load)


#: Name -> module that must be there, factorisation; the first that is there is used.
ENGINES: dict[str, tuple[str, Callable[[sp.csr_matrix], Factors]]] = {
    "cholmod": ("sksparse.cholmod", _Cholmod),
    "pardiso": ("pypardiso", _Pardiso),
    "superlu": ("scipy", _Superlu),
    "slepc": ("slepc4py", PetscFactors),
}
