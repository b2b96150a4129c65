"""Eigenpairs and factors on several processes, by SLEPc, PETSc and MUMPS.

Every process of ``mpirun`` does the same run. It discretises the part, gives PETSc the
rows that it owns, and gets whole vectors back; the factors, most of the memory of a
large part, are spread over the processes.

Source: V. Hernandez, J. Roman, V. Vidal, "SLEPc: A scalable and flexible toolkit for
the solution of eigenvalue problems", ACM Trans. Math. Softw. 31 (3), 2005.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.errors import InputError

from .pencil import Pencil
from .running import Counter, tell

Array = NDArray[np.float64]

#: Relative residual of the eigenpairs, before the Rayleigh-Ritz step.
_TOLERANCE = 1e-12
#: Of Krylov-Schur, about.
_USUAL_RESTARTS = 10.0
#: Parallel direct solvers of PETSc and the factorisation each offers, best first.
_SOLVERS = {"mumps": "cholesky", "superlu_dist": "lu"}


class PartnerFailed(Exception):
    """Another process of this run failed and has said why."""


def check_slepc() -> None:
    """Whether slepc4py and a parallel solver are there.

    Raises
    ------
    InputError : they are not.
    """
    petsc, _ = _modules()
    _solver_name(petsc)


def _modules() -> tuple[Any, Any]:
    try:
        from petsc4py import PETSc
        from slepc4py import SLEPc
    except Exception as error:  # a build for another NumPy raises ValueError
        why = " ".join(str(error).split())[:160]
        raise InputError(
            f"the engine slepc needs slepc4py, which {sys.executable} cannot import "
            f"({why})",
            place="--engine",
            expected="slepc4py and petsc4py built for this Python and NumPy "
            "(docs/howto/large_parts.md), or another engine",
        ) from None
    if np.dtype(PETSc.ScalarType).kind != "f":
        raise InputError(
            "this PETSc computes with complex numbers",
            place="--engine",
            expected="a build for real numbers (PETSC_DIR, SLEPC_DIR)",
        )
    return PETSc, SLEPc


def _solver_name(petsc: Any) -> str:
    for name in _SOLVERS:
        if petsc.Sys.hasExternalPackage(name):
            return name
    raise InputError(
        "this PETSc has no parallel direct solver",
        place="--engine",
        expected=f"a build with {' or '.join(_SOLVERS)}",
    )


class Processes:
    """The processes of one run, which meet before they compute together."""

    def __init__(self) -> None:
        petsc, _ = _modules()
        self._petsc = petsc
        self.rank = int(petsc.COMM_WORLD.getRank())
        self.size = int(petsc.COMM_WORLD.getSize())

    def meet(self, failed: bool = False) -> int | None:
        """Wait for all; the lowest rank that failed, None if none did."""
        own = float(self.rank if failed else self.size)
        vector = self._petsc.Vec().createMPI((1, None))
        vector.set(own)
        _, lowest = vector.min()
        vector.destroy()
        return None if lowest == self.size else int(lowest)

    def go_on(self) -> None:
        """Wait for all.

        Raises
        ------
        PartnerFailed : one will not come.
        """
        if self.meet() is not None:
            raise PartnerFailed


@contextmanager
def together() -> Iterator[Processes]:
    """A run that all processes do alike; if one fails, all end.

    Raises
    ------
    PartnerFailed : this process has nothing to say about the failure.
    """
    processes = Processes()
    try:
        yield processes
    except PartnerFailed:
        raise
    except Exception:
        if processes.meet(failed=True) == processes.rank:
            raise
        raise PartnerFailed from None
    processes.go_on()


def slepc_eigenvectors(pencil: Pencil, count: int) -> Array:
    """(n, count) vectors of the lowest eigenvalues, by Krylov-Schur.

    Shift and invert with a direct solver; constraints enter with Lagrange multipliers.
    The same vectors come to every process.

    Raises
    ------
    RuntimeError : the iteration does not converge, or the matrix is singular.
    PartnerFailed : another process failed before it came here.
    """
    petsc, slepc = _modules()
    processes = Processes()
    processes.go_on()
    tell(f"eigenvectors by SLEPc, processes: {processes.size}")
    rows, rigid = pencil.constraints, pencil.rigid
    n, k = pencil.stiffness.shape[0], len(rows)
    a = _distributed(petsc, processes, _bordered(pencil.stiffness, rows))
    b = _distributed(petsc, processes, _bordered(pencil.mass, np.zeros_like(rows)))
    eps = slepc.EPS().create()
    eps.setOperators(a, b)
    eps.setProblemType(slepc.EPS.ProblemType.GHEP)
    eps.setDimensions(count - rigid.shape[1])
    eps.setTolerances(_TOLERANCE, 100)
    eps.setWhichEigenpairs(slepc.EPS.Which.TARGET_MAGNITUDE)
    eps.setTarget(pencil.shift)
    transformation = eps.getST()
    transformation.setType(slepc.ST.Type.SINVERT)
    _direct(petsc, transformation.getKSP())
    start = _own_part(a, np.random.default_rng(0).standard_normal(n + k))
    known = [_own_part(a, np.append(vector, np.zeros(k))) for vector in rigid.T]
    eps.setInitialSpace(start)
    eps.setDeflationSpace(known)
    counter = Counter("eigenvectors: {} restarts", _USUAL_RESTARTS)
    eps.setMonitor(lambda *_: counter())
    eps.solve()
    wanted, converged = count - rigid.shape[1], eps.getConverged()
    found = []
    for i in range(min(wanted, converged)):
        eps.getEigenvector(i, start)
        found.append(_everywhere(petsc, start)[:n])
    for thing in (eps, start, *known, a, b):
        thing.destroy()
    if converged < wanted:
        raise RuntimeError(f"{converged} of {wanted} eigenpairs converged")
    return np.column_stack([rigid, *found])


class PetscFactors:
    """Factors that are spread over the processes; see `factors.Factors`."""

    def __init__(self, matrix: sp.csr_matrix) -> None:
        self._petsc, _ = _modules()
        self._processes = Processes()
        self._processes.go_on()
        self._matrix = _distributed(self._petsc, self._processes, matrix)
        self._ksp = self._petsc.KSP().create()
        self._ksp.setOperators(self._matrix)
        _direct(self._petsc, self._ksp)
        self._ksp.setUp()

    def solve(self, load: Array) -> Array:
        """A^-1 b for b (n,) or (n, k), on every process."""
        self._processes.go_on()
        columns = load.reshape(len(load), -1)
        x, b = self._matrix.createVecs()
        first, last = b.getOwnershipRange()
        result = np.empty(columns.shape)
        for i, column in enumerate(columns.T):
            b.setArray(column[first:last])
            self._ksp.solve(b, x)
            result[:, i] = _everywhere(self._petsc, x)
        x.destroy()
        b.destroy()
        if not np.isfinite(result).all():
            raise RuntimeError("the matrix is singular")
        return result.reshape(load.shape)


def _bordered(matrix: sp.csr_matrix, rows: Array) -> sp.csr_matrix:
    """The matrix with further equations for multipliers; their own block is empty."""
    if not len(rows):
        return matrix
    border = sp.csr_matrix(rows)
    upper = sp.hstack([matrix, border.T])
    lower = sp.hstack([border, sp.csr_matrix((len(rows), len(rows)))])
    return sp.csr_matrix(sp.vstack([upper, lower]))


def _distributed(petsc: Any, processes: Processes, matrix: sp.csr_matrix) -> Any:
    """The matrix in PETSc, to which every process gives its rows."""
    n = matrix.shape[0]
    first, last = (n * (processes.rank + i) // processes.size for i in (0, 1))
    begin, end = matrix.indptr[first], matrix.indptr[last]
    index = petsc.IntType
    result = petsc.Mat().createAIJ(
        ((last - first, n), (last - first, n)),
        csr=(
            (matrix.indptr[first : last + 1] - begin).astype(index),
            matrix.indices[begin:end].astype(index),
            matrix.data[begin:end],
        ),
    )
    result.setOption(petsc.Mat.Option.SYMMETRIC, True)
    return result


def _own_part(matrix: Any, values: Array) -> Any:
    """A vector in PETSc, to which every process gives its part."""
    vector = matrix.createVecLeft()
    first, last = vector.getOwnershipRange()
    vector.setArray(values[first:last])
    return vector


def _direct(petsc: Any, ksp: Any) -> None:
    """Make a linear solver a parallel factorisation."""
    name = _solver_name(petsc)
    ksp.setType(petsc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(_SOLVERS[name])
    pc.setFactorSolverType(name)


def _everywhere(petsc: Any, vector: Any) -> Array:
    """The whole vector on every process."""
    scatter, whole = petsc.Scatter.toAll(vector)
    scatter.scatter(vector, whole)
    result = whole.getArray().copy()
    scatter.destroy()
    whole.destroy()
    return result
