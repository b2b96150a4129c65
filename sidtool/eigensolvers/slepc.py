"""Eigenpairs and factors on several processes by SLEPc, PETSc and MUMPS.

Every process of ``mpirun`` does the same run. It discretises the part, passes PETSc the
rows that it owns, and gets whole vectors back. The factors, most of the memory of a
large part, are distributed over the processes.

`use_engine` sets the engine and the listener for everything inside its context, so that
the reduction methods in between need not pass them on.

Source: V. Hernandez, J. Roman, V. Vidal, "SLEPc: A scalable and flexible toolkit for
the solution of eigenvalue problems", ACM Trans. Math. Softw. 31 (3), 2005.
"""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import numpy as np
import scipy.sparse as sp

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.progress import report_stage
from sidtool.formats.base.sid import Array

from .lanczos import Pencil

#: Relative residual of the eigenpairs, before the Rayleigh-Ritz step.
_TOLERANCE = 1e-12
#: Of Krylov-Schur, about.
_USUAL_RESTARTS = 10.0
#: Parallel direct solvers of PETSc and the factorisation each offers, best first.
_SOLVERS = {"mumps": "cholesky", "superlu_dist": "lu"}

#: Counts of a loop are reported no more often than this [s].
_REPORT_INTERVAL = 0.5


class PartnerFailed(Exception):
    """Another process of this run failed and has reported why."""


def check_slepc() -> None:
    """Check that slepc4py and a parallel solver are installed.

    Raises
    ------
    InputError : one of them is missing.
    """
    petsc, _ = _import_slepc()
    _solver_name(petsc)


def _import_slepc() -> tuple[Any, Any]:
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
    """The processes of one run, which synchronise before common computations."""

    def __init__(self) -> None:
        petsc, _ = _import_slepc()
        self._petsc = petsc
        self.rank = int(petsc.COMM_WORLD.getRank())
        self.size = int(petsc.COMM_WORLD.getSize())

    def synchronise(self, failed: bool = False) -> int | None:
        """Wait for all processes; return the lowest rank that failed, or None."""
        own = float(self.rank if failed else self.size)
        vector = self._petsc.Vec().createMPI((1, None))
        vector.set(own)
        _, lowest = vector.min()
        vector.destroy()
        return None if lowest == self.size else int(lowest)

    def wait_for_all(self) -> None:
        """Wait for all.

        Raises
        ------
        PartnerFailed : another process has failed.
        """
        if self.synchronise() is not None:
            raise PartnerFailed


@contextmanager
def parallel_run() -> Iterator[Processes]:
    """Run the context on all processes; if one fails, all end.

    Raises
    ------
    PartnerFailed : this process has nothing to report about the failure.
    """
    processes = Processes()
    try:
        yield processes
    except PartnerFailed:
        raise
    except Exception:
        if processes.synchronise(failed=True) == processes.rank:
            raise
        raise PartnerFailed from None
    processes.wait_for_all()


def slepc_eigenvectors(pencil: Pencil, count: int) -> Array:
    """(n, count) vectors of the lowest eigenvalues, by Krylov-Schur.

    Shift and invert with a direct solver; constraints enter with Lagrange multipliers.
    Every process gets the same vectors.

    Raises
    ------
    RuntimeError : the iteration does not converge, or the matrix is singular.
    PartnerFailed : another process failed before this point.
    """
    petsc, slepc = _import_slepc()
    processes = Processes()
    processes.wait_for_all()
    notify(f"eigenvectors by SLEPc, processes: {processes.size}")
    rows, rigid = pencil.constraints, pencil.rigid
    n, k = pencil.stiffness.shape[0], len(rows)
    a = _distributed_matrix(
        petsc, processes, _with_multipliers(pencil.stiffness.tocsr(), rows)
    )
    b = _distributed_matrix(
        petsc, processes, _with_multipliers(pencil.mass.tocsr(), np.zeros_like(rows))
    )
    eps = slepc.EPS().create()
    eps.setOperators(a, b)
    eps.setProblemType(slepc.EPS.ProblemType.GHEP)
    eps.setDimensions(count - rigid.shape[1])
    eps.setTolerances(_TOLERANCE, 100)
    eps.setWhichEigenpairs(slepc.EPS.Which.TARGET_MAGNITUDE)
    eps.setTarget(pencil.shift)
    transformation = eps.getST()
    transformation.setType(slepc.ST.Type.SINVERT)
    _use_direct_solver(petsc, transformation.getKSP())
    start = _distributed_vector(a, np.random.default_rng(0).standard_normal(n + k))
    known = [
        _distributed_vector(a, np.append(vector, np.zeros(k))) for vector in rigid.T
    ]
    eps.setInitialSpace(start)
    eps.setDeflationSpace(known)
    counter = ProgressCounter("eigenvectors: {} restarts", _USUAL_RESTARTS)
    eps.setMonitor(lambda *_: counter())
    eps.solve()
    wanted, converged = count - rigid.shape[1], eps.getConverged()
    vectors = []
    for i in range(min(wanted, converged)):
        eps.getEigenvector(i, start)
        vectors.append(_gather_vector(petsc, start)[:n])
    for thing in (eps, start, *known, a, b):
        thing.destroy()
    if converged < wanted:
        raise RuntimeError(f"{converged} of {wanted} eigenpairs converged")
    return np.column_stack([rigid, *vectors])


class PetscFactors:
    """Factors that are distributed over the processes; see `factorisation.Factors`."""

    def __init__(self, matrix: Any) -> None:
        self._petsc, _ = _import_slepc()
        self._processes = Processes()
        self._processes.wait_for_all()
        self._matrix = _distributed_matrix(self._petsc, self._processes, matrix.tocsr())
        self._ksp = self._petsc.KSP().create()
        self._ksp.setOperators(self._matrix)
        _use_direct_solver(self._petsc, self._ksp)
        self._ksp.setUp()

    def solve(self, load: Array) -> Array:
        """A^-1 b for b (n,) or (n, k), on every process."""
        self._processes.wait_for_all()
        columns = load.reshape(len(load), -1)
        x, b = self._matrix.createVecs()
        first, last = b.getOwnershipRange()
        result = np.empty(columns.shape)
        for i, column in enumerate(columns.T):
            b.setArray(column[first:last])
            self._ksp.solve(b, x)
            result[:, i] = _gather_vector(self._petsc, x)
        x.destroy()
        b.destroy()
        if not np.isfinite(result).all():
            raise RuntimeError("the matrix is singular")
        return result.reshape(load.shape)


def _with_multipliers(matrix: sp.csr_matrix, rows: Array) -> sp.csr_matrix:
    """The matrix with further equations for multipliers; their own block is empty."""
    if not len(rows):
        return matrix
    border = sp.csr_matrix(rows)
    upper = sp.hstack([matrix, border.T])
    lower = sp.hstack([border, sp.csr_matrix((len(rows), len(rows)))])
    return sp.csr_matrix(sp.vstack([upper, lower]))


def _distributed_matrix(petsc: Any, processes: Processes, matrix: sp.csr_matrix) -> Any:
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


def _distributed_vector(matrix: Any, values: Array) -> Any:
    """A vector in PETSc, to which every process gives its part."""
    vector = matrix.createVecLeft()
    first, last = vector.getOwnershipRange()
    vector.setArray(values[first:last])
    return vector


def _use_direct_solver(petsc: Any, ksp: Any) -> None:
    """Make a linear solver a parallel factorisation."""
    name = _solver_name(petsc)
    ksp.setType(petsc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(_SOLVERS[name])
    pc.setFactorSolverType(name)


def _gather_vector(petsc: Any, vector: Any) -> Array:
    """The whole vector on every process."""
    scatter, whole = petsc.Scatter.toAll(vector)
    scatter.scatter(vector, whole)
    result = whole.getArray().copy()
    scatter.destroy()
    whole.destroy()
    return result


Listener = Callable[[str], None]


_ENGINE: ContextVar[str | None] = ContextVar("engine", default=None)
_LISTENER: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def use_engine(
    engine: str | None = None, progress: Listener | None = None
) -> Iterator[None]:
    """Set the engine, one of `factors.ENGINES`, and the progress listener inside."""
    engine_before, listener_before = _ENGINE.set(engine), _LISTENER.set(progress)
    try:
        yield
    finally:
        _ENGINE.reset(engine_before)
        _LISTENER.reset(listener_before)


def requested_engine() -> str | None:
    """Return the requested engine of this run, or None."""
    return _ENGINE.get()


def notify(text: str) -> None:
    """Report the stage that begins to the listener of this run, if there is one."""
    report_stage(text)
    _notify_listener(text)


def _notify_listener(text: str) -> None:
    listener = _LISTENER.get()
    if listener is not None:
        listener(text)


class ProgressCounter:
    """Counter that reports its count at intervals."""

    def __init__(self, text: str, expected: float) -> None:
        """`text` with a place ``{}`` for the count; about how often it will be done."""
        self._text, self._count, self._expected = text, 0, expected
        self._last = time.monotonic()

    def __call__(self) -> None:
        self._count += 1
        text = self._text.format(self._count)
        report_stage(text, self._count / self._expected)
        now = time.monotonic()
        if now - self._last > _REPORT_INTERVAL:
            self._last = now
            _notify_listener(text)
