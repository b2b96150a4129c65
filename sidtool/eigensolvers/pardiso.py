"""Cholesky factors by PARDISO, of Intel's oneMKL that pypardiso finds.

The C interface of the library is called directly: the wrapper of pypardiso copies the
matrix and its indices, and compares them with those of the factors in every solution.

Source: oneMKL Developer Reference for C, section "oneMKL PARDISO - Parallel Direct
Sparse Solver Interface".
"""

import ctypes
import importlib
import importlib.metadata
import os
import weakref
from contextlib import suppress
from pathlib import PurePath
from types import ModuleType
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.interruptible import call_interruptibly
from sidtool.formats.base.sid import Array
from sidtool.formats.storage.operating_system import release_free_memory

from .projected_matrix import Assembled

#: A positive definite symmetric matrix of real numbers.
_MATRIX_TYPE = 2
#: Phases: analysis and factorisation, solution, release of all memory.
_FACTORISE, _SOLVE, _RELEASE = 12, 33, -1
#: Parameters by their number in the manual: not the defaults (1), nested dissection of
#: METIS (2), no iterative refinement (8), which triples the time of a solution of three
#: loads and does not reduce the residual of a positive definite matrix; factors in two
#: levels (24), which blocks need; indices count from zero (35); rows whose columns
#: agree to 90 %, as those of one node, form blocks (37), which orders nodes instead of
#: unknowns: the analysis takes 0.4 of the time and memory.
_PARAMETERS = {1: 1, 2: 2, 8: 0, 24: 1, 35: 1, 37: -90}
_LOCATION = "PYPARDISO_MKL_RT"
#: How long MKL's threads wait busily after a solution [ms], by default 200: the work
#: between solutions is that of one thread, and takes 1.1 times as long beside them.
_WAITING = "KMP_BLOCKTIME", "1"
#: Numbers and indices.
_Numbers = NDArray[Any]


def import_pypardiso() -> ModuleType:
    """Import pypardiso with the place of the library.

    It would search all folders of the environment twice, which takes 0.4 s.

    Raises
    ------
    ImportError, OSError : it is not installed, or its library cannot be loaded.
    """
    os.environ.setdefault(*_WAITING)
    path = None if _LOCATION in os.environ else _installed_library()
    if path is None:
        return importlib.import_module("pypardiso")
    os.environ[_LOCATION] = path
    try:
        return importlib.import_module("pypardiso")
    finally:
        del os.environ[_LOCATION]


def _installed_library() -> str | None:
    """The library of the distribution `mkl`; None if it is installed otherwise."""
    files: list[importlib.metadata.PackagePath] = []
    with suppress(importlib.metadata.PackageNotFoundError):
        files = importlib.metadata.files("mkl") or []
    found = [f for f in files if PurePath(f).name.startswith(("libmkl_rt.", "mkl_rt."))]
    return next((str(f.locate()) for f in found if ".lib" not in f.suffixes), None)


class PardisoFactors:
    """Cholesky factors of the upper triangle of a symmetric matrix."""

    def __init__(self, matrix: Assembled) -> None:
        self._function = import_pypardiso().ps.libmkl["pardiso"]
        self._function.restype = None
        self._matrix = _upper_triangle(matrix.tocsr())
        self._handle = np.zeros(64, np.intp)
        self._parameters = np.zeros(64, np.int32)
        for number, value in _PARAMETERS.items():
            self._parameters[number - 1] = value
        state = self._handle, self._parameters
        weakref.finalize(self, _release, self._function, *state).atexit = False
        nothing = np.zeros(0)
        release_free_memory()
        call_interruptibly(lambda: self._call(_FACTORISE, nothing, nothing))
        release_free_memory()
        # solutions without refinement read the factors only
        _, starts, columns = self._matrix
        self._matrix = np.zeros(1), starts, columns[:1].copy()

    def solve(self, load: Array) -> Array:
        if not load.size:  # which PARDISO calls an inconsistent input
            return np.zeros(load.shape)
        columns = np.asfortranarray(load, float)
        solution = np.empty_like(columns)
        self._call(_SOLVE, columns, solution)
        return np.ascontiguousarray(solution)

    def _call(self, phase: int, load: Array, solution: Array) -> None:
        """Call PARDISO for one phase.

        Raises
        ------
        RuntimeError : it reports an error.
        """
        error = _call_library(
            self._function,
            (self._handle, self._parameters),
            phase,
            self._matrix,
            load,
            solution,
        )
        if error:
            raise RuntimeError(f"PARDISO reports the error {error}")


def _upper_triangle(matrix: sp.csr_matrix) -> tuple[_Numbers, _Numbers, _Numbers]:
    """Values, starts of the rows and columns of the upper triangle, in order.

    Raises
    ------
    RuntimeError : it has no positive diagonal; PARDISO does not return from empty rows.
    """
    if not (matrix.diagonal() > 0).all():
        raise RuntimeError("the matrix is not positive definite")
    if not matrix.has_canonical_format:
        matrix = matrix.copy()
        matrix.sum_duplicates()
    rows = np.repeat(
        np.arange(matrix.shape[0], dtype=matrix.indices.dtype), np.diff(matrix.indptr)
    )
    is_upper = matrix.indices >= rows
    lengths = matrix.indptr[1:] - np.flatnonzero(matrix.indices == rows)
    starts = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
    columns = matrix.indices[is_upper].astype(np.int32, copy=False)
    return matrix.data[is_upper], starts, columns


def _call_library(
    function: Any,
    state: tuple[_Numbers, _Numbers],
    phase: int,
    matrix: tuple[_Numbers, _Numbers, _Numbers],
    load: Array,
    solution: Array,
) -> int:
    """Call `pardiso` of the library and return the number of its error.

    Parameters
    ----------
    state : handle and parameters
    matrix : values, starts of the rows, columns
    """
    handle, parameters = state
    values, starts, columns = matrix
    error = ctypes.c_int32(0)

    def number(value: int) -> Any:
        return ctypes.byref(ctypes.c_int32(value))

    def array(values: _Numbers) -> ctypes.c_void_p:
        return values.ctypes.data_as(ctypes.c_void_p)

    function(
        array(handle),
        number(1),  # most factors with this pattern
        number(1),  # those that are used
        number(_MATRIX_TYPE),
        number(phase),
        number(len(starts) - 1),
        array(values),
        array(starts),
        array(columns),
        None,  # no permutation of the user
        number(1 if load.ndim == 1 else load.shape[1]),
        array(parameters),
        number(0),  # prints nothing
        array(load),
        array(solution),
        ctypes.byref(error),
    )
    return error.value


def _release(function: Any, handle: _Numbers, parameters: _Numbers) -> None:
    """Free the memory of the library."""
    nothing, none = np.zeros(0), np.zeros(0, np.int32)
    matrix = (nothing, none, none)
    _call_library(function, (handle, parameters), _RELEASE, matrix, nothing, nothing)
