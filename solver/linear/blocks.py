"""Factors of one body's block of a Newton matrix.

    [ B  U ] [ x ]   [ p ]
    [ L  D ] [ y ] = [ q ]

Natural modes make mass, stiffness and damping diagonal, and what a turning body couples
in them is small beside these: products of two such coordinates are left out, D is a
diagonal, and Newton's iteration makes good for it (theory, section 9). The first
coordinates, the rigid ones among them, keep their full rows and columns. A block with
no such coordinates, or a small one, is B alone.
"""

from __future__ import annotations

from numba import float64, int64, types

from ..compiler.compiling import inner
from ..compiler.quotients import quotient
from ..space.layout import C1, F1, I1, SYSTEM
from .lapack import LAPACK, LARGE, factor_large, solve_large

#: Blocks below this size are factored as they are, and B is below that of LAPACK.
SMALL = 16
#: What may be left out, as a Frobenius norm where the diagonal of D is one. With 1e-3
#: radau9 took a fifth more steps for a rod of 120 modes, with this as many as before.
WEAK = 1e-4


@inner(*[float64(A, int64) for A in (F1, C1)])
def _size(A, at):
    """Of a number, complex ones up to a factor of the root of two."""
    return abs(A[at].real) + abs(A[at].imag)


@inner(*[int64(A, int64, int64, int64) for A in (F1, C1)])
def _weakly_coupled(A, o, n, rigid):
    """The first of the last coordinates that are coupled so weakly."""
    total = 0.0
    for i in range(n - 1, rigid - 1, -1):
        part = 0.0
        for j in range(i + 1, n):
            above, below = _size(A, o + i * n + j), _size(A, o + j * n + i)
            part += (above * above + below * below) / _size(A, o + j * n + j)
        total += part / _size(A, o + i * n + i)
        if not total <= WEAK * WEAK:
            return i + 1
    return rigid


@inner(*[int64(A, int64, int64, int64, I1, int64) for A in (F1, C1)])
def _lu_factor(A, o, stride, n, pivots, first):
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


@inner(*[types.void(A, int64, int64, int64, I1, int64, A, int64) for A in (F1, C1)])
def _lu_solve(A, o, stride, n, pivots, first, x, at):
    """Solves with a factor of `_lu_factor`; x[at:at+n] is overwritten."""
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


@inner(*[types.void(A, int64, int64, int64) for A in (F1, C1)])
def _eliminate(A, o, n, b):
    """D^-1 and D^-1 L in the place of D and L, then B - U D^-1 L in that of B."""
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
    """Factors the block of a body in place; 1 if singular.

    pivots : of all bodies, then how many coordinates of each keep their full rows
    """
    row = system.body[body]
    n, o, first = row.nv, row.block, row.vel
    whole = n
    if n >= SMALL:
        found = _weakly_coupled(A, o, n, row.rd)
        whole = found if found < LARGE and 2 * found <= n else n
    pivots[system.n_vel + body] = whole
    if whole >= LARGE:
        return factor_large(lapack, A, o, n, pivots, first)
    _eliminate(A, o, n, whole)
    return _lu_factor(A, o, n, whole, pivots, first)


@inner(*[types.void(SYSTEM, LAPACK, A, int64, I1, A, int64) for A in (F1, C1)])
def block_solve(system, lapack, A, body, pivots, x, at):
    """Solves with a factor of `block_factor`; x[at:] is overwritten."""
    row = system.body[body]
    n, o, first = row.nv, row.block, row.vel
    whole = pivots[system.n_vel + body]
    if whole >= LARGE:
        solve_large(lapack, A, o, n, pivots, first, x, at)
        return
    for i in range(whole, n):
        x[at + i] = x[at + i] * A[o + i * n + i]
    for j in range(whole):
        total = x[at + j]
        for i in range(whole, n):
            total -= A[o + j * n + i] * x[at + i]
        x[at + j] = total
    _lu_solve(A, o, n, whole, pivots, first, x, at)
    for i in range(whole, n):
        total = x[at + i]
        for k in range(whole):
            total -= A[o + i * n + k] * x[at + k]
        x[at + i] = total
