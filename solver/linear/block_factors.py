"""LU factors of the blocks of the bodies.

Small blocks are factored by loops in the kernels, large blocks by LAPACK through the
function pointers of scipy; see `LARGE`. Elastic coordinates at the end of a block that
are weakly coupled are eliminated first.
"""

import ctypes
from functools import cache
from importlib import import_module
from typing import Annotated, Any

import numpy as np
from llvmlite import ir

from ..compiler.arrays import Pointer, PointerType
from ..compiler.inner_kernels import Intrinsic, inner, quotient
from ..compiler.tables import Table, TableType
from ..compiler.types import float64, int64, void
from ..spatial.system_arrays import C1, F1, I1, SYSTEM, Integers

#: Blocks from this size on go to LAPACK: measured, real blocks.
LARGE_BLOCK = 24

# Entries of Lapack.word: arguments that LAPACK takes by address
SIZE, ONE, INFO, TRANSPOSED = range(4)


FACTOR = void(*[int64] * 6)
SOLVE = void(*[int64] * 9)

#: Blocks below this size are factored as they are, and B is below that of LAPACK.
SMALL_BLOCK = 16
#: What may be left out, as a Frobenius norm where the diagonal of D is one. With 1e-3
#: radau9 took a fifth more steps for a rod of 120 modes, with this as many as before.
WEAK_COUPLING = 1e-4


class Lapack(Table):
    """Factorisation and solution in one precision.

    Attributes
    ----------
    factor, solve
        Pointers to getrf and getrs, whose arguments are all addresses.
    arguments
        Storage of the integer arguments, see the constants above.
    """

    factor: Annotated[Any, PointerType(FACTOR)]
    solve: Annotated[Any, PointerType(SOLVE)]
    arguments: Integers


LAPACK = TableType(Lapack)


def cython_function_address(module: str, name: str) -> int:
    """Address of a function in C that a module of Cython exports."""
    capsule = import_module(module).__pyx_capi__[name]
    get_name = ctypes.pythonapi.PyCapsule_GetName
    get_name.restype, get_name.argtypes = ctypes.c_char_p, [ctypes.py_object]
    get_pointer = ctypes.pythonapi.PyCapsule_GetPointer
    get_pointer.restype = ctypes.c_void_p
    get_pointer.argtypes = [ctypes.py_object, ctypes.c_char_p]
    return int(get_pointer(capsule, get_name(capsule)))


@cache
def lapack_routines(kind: str, largest: int) -> Lapack:
    """LAPACK routines for real ("d") or complex ("z") blocks up to a size.

    Without large blocks scipy is not imported.
    """
    module = "scipy.linalg.cython_lapack"
    names = (f"{kind}getrf", f"{kind}getrs")
    addresses = [
        cython_function_address(module, name) if largest >= LARGE_BLOCK else 0
        for name in names
    ]
    arguments = np.array([0, 1, 0, ord("T")], np.int64)
    factor, solve = Pointer(addresses[0], FACTOR), Pointer(addresses[1], SOLVE)
    return Lapack(factor=factor, solve=solve, arguments=arguments)


@Intrinsic
def address_of_entry(array: Any, index: Any) -> Any:
    """Address of one entry of a vector."""

    def generate(builder: Any, values: Any) -> Any:
        place = builder.gep(builder.extract_value(values[0], 0), [values[1]])
        return builder.ptrtoint(place, ir.IntType(64))

    return int64(array, int64), generate


@inner()
def factor_large(lapack, A, o, n, pivots, first):
    """LU of the n x n block at o, in place; 1 if singular."""
    arguments = lapack.arguments
    arguments[SIZE], arguments[INFO] = n, 0
    size = address_of_entry(arguments, SIZE)
    lapack.factor(
        size,
        size,
        address_of_entry(A, o),
        size,
        address_of_entry(pivots, first),
        address_of_entry(arguments, INFO),
    )
    return 0 if arguments[INFO] == 0 else 1


@inner()
def solve_large(lapack, A, o, n, pivots, first, x, at):
    """Solves with a factor of `factor_large`; x[at:at+n] is overwritten."""
    arguments = lapack.arguments
    arguments[SIZE] = n
    size = address_of_entry(arguments, SIZE)
    lapack.solve(
        address_of_entry(arguments, TRANSPOSED),
        size,
        address_of_entry(arguments, ONE),
        address_of_entry(A, o),
        size,
        address_of_entry(pivots, first),
        address_of_entry(x, at),
        size,
        address_of_entry(arguments, INFO),
    )


@inner(*[float64(A, int64) for A in (F1, C1)])
def _magnitude(A, at):
    """Of a number, complex ones up to a factor of the root of two."""
    return abs(A[at].real) + abs(A[at].imag)


@inner(*[int64(A, int64, int64, int64) for A in (F1, C1)])
def _weakly_coupled(A, o, n, rigid):
    """The first of the last coordinates that are coupled so weakly."""
    total = 0.0
    for i in range(n - 1, rigid - 1, -1):
        row_coupling = 0.0
        for j in range(i + 1, n):
            above, below = _magnitude(A, o + i * n + j), _magnitude(A, o + j * n + i)
            row_coupling += (above * above + below * below) / _magnitude(
                A, o + j * n + j
            )
        total += row_coupling / _magnitude(A, o + i * n + i)
        if not total <= WEAK_COUPLING * WEAK_COUPLING:
            return i + 1
    return rigid


@inner(*[int64(A, int64, int64, int64, I1, int64) for A in (F1, C1)])
def lu_factor(A, o, stride, n, pivots, first):
    """LU with partial pivoting of the n x n block at o, in place; 1 if singular."""
    for j in range(n):
        best = j
        size = abs(A[o + j * stride + j])
        for i in range(j + 1, n):
            candidate = abs(A[o + i * stride + j])
            if candidate > size:
                best, size = i, candidate
        pivots[first + j] = best
        if not size > 0.0:
            return 1
        if best != j:
            for k in range(n):
                a, b = o + j * stride + k, o + best * stride + k
                A[a], A[b] = A[b], A[a]
        inverse = quotient(1.0, A[o + j * stride + j])
        for i in range(j + 1, n):
            factor = A[o + i * stride + j] * inverse
            A[o + i * stride + j] = factor
            if factor != 0.0:
                for k in range(j + 1, n):
                    A[o + i * stride + k] -= factor * A[o + j * stride + k]
    return 0


@inner(*[void(A, int64, int64, int64, I1, int64, A, int64) for A in (F1, C1)])
def lu_solve(A, o, stride, n, pivots, first, x, at):
    """Solves with a factor of `lu_factor`; x[at:at+n] is overwritten."""
    for j in range(n):
        best = pivots[first + j]
        if best != j:
            x[at + j], x[at + best] = x[at + best], x[at + j]
    for i in range(1, n):
        total = x[at + i]
        for k in range(i):
            total -= A[o + i * stride + k] * x[at + k]
        x[at + i] = total
    for i in range(n - 1, -1, -1):
        total = x[at + i]
        for k in range(i + 1, n):
            total -= A[o + i * stride + k] * x[at + k]
        x[at + i] = quotient(total, A[o + i * stride + i])


@inner(*[void(A, int64, int64, int64) for A in (F1, C1)])
def _eliminate_weakly_coupled(A, o, n, b):
    """Replace D and L by D^-1 and D^-1 L, then B by B - U D^-1 L."""
    for i in range(b, n):
        row = o + i * n
        inverse = quotient(1.0, A[row + i])
        A[row + i] = inverse
        for k in range(b):
            A[row + k] = A[row + k] * inverse
        for j in range(b):
            factor = A[o + j * n + i]
            for k in range(b):
                A[o + j * n + k] -= factor * A[row + k]


@inner(*[int64(SYSTEM, LAPACK, A, int64, I1) for A in (F1, C1)])
def block_factor(system, lapack, A, body, pivots):
    """Factor the block of a body in place; 1 if singular.

    Parameters
    ----------
    pivots
        Pivots of all bodies, followed by the number of coordinates of each that keep
        their full rows.
    """
    row = system.body[body]
    n, o, first = row.nv, row.block, row.vel
    n_full = n
    if n >= SMALL_BLOCK:
        n_coupled = _weakly_coupled(A, o, n, row.rd)
        n_full = n_coupled if n_coupled < LARGE_BLOCK and 2 * n_coupled <= n else n
    pivots[system.n_velocities + body] = n_full
    if n_full >= LARGE_BLOCK:
        return factor_large(lapack, A, o, n, pivots, first)
    _eliminate_weakly_coupled(A, o, n, n_full)
    return lu_factor(A, o, n, n_full, pivots, first)


@inner(*[void(SYSTEM, LAPACK, A, int64, I1, A, int64) for A in (F1, C1)])
def block_solve(system, lapack, A, body, pivots, x, at):
    """Solves with a factor of `block_factor`; x[at:] is overwritten."""
    row = system.body[body]
    n, o, first = row.nv, row.block, row.vel
    n_full = pivots[system.n_velocities + body]
    if n_full >= LARGE_BLOCK:
        solve_large(lapack, A, o, n, pivots, first, x, at)
        return
    for i in range(n_full, n):
        x[at + i] = x[at + i] * A[o + i * n + i]
    for j in range(n_full):
        total = x[at + j]
        for i in range(n_full, n):
            total -= A[o + j * n + i] * x[at + i]
        x[at + j] = total
    lu_solve(A, o, n, n_full, pivots, first, x, at)
    for i in range(n_full, n):
        total = x[at + i]
        for k in range(n_full):
            total -= A[o + i * n + k] * x[at + k]
        x[at + i] = total
