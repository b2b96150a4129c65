"""Accelerations and projections: saddle-point systems with the mass matrix.

    [ M  -C^T ] [ x  ]   [ p ]
    [ C   0   ] [ mu ] = [ g ]

They are symmetric, unlike Newton's (see `saddle`): every block of M is factored as
L^T D L, its elastic coordinates first. Where Me is diagonal, as that of a body with
natural modes is, this costs as much as the rigid coordinates times the elastic ones.
With W = L^-T C^T the Schur complement S = W^T D^-1 W is a symmetric band matrix.
"""

from __future__ import annotations

import math

from numba import boolean, complex128, float64, int64, types

from ..compiler.compiling import inner
from ..compiler.lanes import row_times
from ..space.layout import (
    C1,
    DIAGONAL_ME,
    F1,
    F2,
    SYSTEM,
    WORK,
)
from .memory import MEMORY

#: A constraint depends on others when this many slacks are left of it.
CLEAR_OF_SLACK = 10.0


@inner(types.void(F1, F1, float64, F1, int64, int64, int64))
def _copy_block(M, K, weight, A, o, n, reach):
    """The lower triangle of M + weight K, without what is zero."""
    for i in range(n):
        for j in range(min(i, reach)):
            A[o + i * n + j] = M[o + i * n + j] + weight * K[o + i * n + j]
        A[o + i * n + i] = M[o + i * n + i] + weight * K[o + i * n + i]


@inner(int64(F1, int64, int64, int64))
def _block_factor(A, o, n, reach):
    """L^T D L of the n x n block at o, in place with 1 / D; 1 if not positive.

    reach : rows beyond it are coupled with columns before it only
    """
    for j in range(n - 1, -1, -1):
        row = o + j * n
        if not A[row + j] > 0.0:
            return 1
        inverse = 1.0 / A[row + j]
        A[row + j] = inverse
        for i in range(min(j, reach)):
            factor = A[row + i] * inverse
            target = o + i * n
            for k in range(i + 1):
                A[target + k] -= factor * A[row + k]
        for i in range(min(j, reach)):
            A[row + i] *= inverse
    return 0


@inner(types.void(F1, int64, int64, int64, F1, int64))
def _forward(A, o, n, reach, x, at):
    """x = L^-T x."""
    for j in range(n - 1, 0, -1):
        for i in range(min(j, reach)):
            x[at + i] -= A[o + j * n + i] * x[at + j]


@inner(types.void(F1, int64, int64, int64, F1, int64))
def _backward(A, o, n, reach, x, at):
    """x = L^-1 D^-1 x."""
    for i in range(n):
        total = x[at + i] * A[o + i * n + i]
        for k in range(min(i, reach)):
            total -= A[o + i * n + k] * x[at + k]
        x[at + i] = total


@inner(int64(SYSTEM, int64))
def _reach(system, b):
    row = system.body[b]
    return row.rd if row.flags & DIAGONAL_ME else row.nv


@inner(
    *[float64(SYSTEM, F1, int64, int64, F1), complex128(SYSTEM, F1, int64, int64, C1)]
)
def mass_row_times(system, M, b, i, x):
    """Row i of the block of a body in M, times x."""
    n, first, reach = system.body[b].nv, system.body[b].vel, _reach(system, b)
    row = system.body[b].block + i * n
    if i < reach:
        return row_times(M, row, x, first, n)
    total = M[row + i] * x[first + i]
    for k in range(reach):
        total += M[row + k] * x[first + k]
    return total


@inner(types.void(SYSTEM, F1, F1, F1, F2, int64))
def _schur_of_body(system, A, C, W, S, b):
    """W of one body, and what it adds to the lower triangle of S."""
    segment, reach = system.segment, _reach(system, b)
    n, o = system.body[b].nv, system.body[b].block
    for s in range(system.body[b].seg0, system.body[b].seg1):
        at = segment[s].offset
        for k in range(at, at + n):
            W[k] = C[k]
        _forward(A, o, n, reach, W, at)
        for r in range(system.body[b].seg0, s + 1):
            g, total = segment[r].offset, 0.0
            for k in range(n):
                total += W[g + k] * W[at + k] * A[o + k * n + k]
            i, j = segment[s].row, segment[r].row
            S[max(i, j), min(i, j)] += 2.0 * total if i == j and r < s else total


@inner(boolean(F2, int64, int64))
def _band_factor(S, m, width):
    """L D L^T of the band in the lower triangle, with 1 / D; false if singular."""
    for j in range(m):
        if not abs(S[j, j]) > 0.0:
            return False
        inverse = 1.0 / S[j, j]
        S[j, j] = inverse
        last = min(m, j + width + 1)
        for i in range(j + 1, last):
            factor = S[i, j] * inverse
            for k in range(j + 1, i + 1):
                S[i, k] -= factor * S[k, j]
        for i in range(j + 1, last):
            S[i, j] *= inverse
    return True


@inner(types.void(F2, int64, int64, F1))
def _band_solve(S, m, width, x):
    for i in range(m):
        for k in range(max(0, i - width), i):
            x[i] -= S[i, k] * x[k]
    for i in range(m - 1, -1, -1):
        x[i] *= S[i, i]
        for k in range(i + 1, min(m, i + width + 1)):
            x[i] -= S[k, i] * x[k]


@inner(int64(SYSTEM, WORK, MEMORY, float64, float64))
def mass_factor(system, work, memory, weight, regularisation):
    """Factors the system of M + weight tau^2 K: A, W and S as above.

    regularisation : added to the diagonal of S, relative to it

    Returns 0, or 1 when a block is not positive, or 2 when constraints are dependent.
    """
    A, W, S = memory.mass_A, memory.mass_W, memory.mass_S
    m, width = system.n_rows, system.bandwidth
    for i in range(m):
        for j in range(max(0, i - width), i):
            S[i, j] = 0.0
        S[i, i] = system.slack[i]
    for b in range(len(system.body)):
        n, o, reach = system.body[b].nv, system.body[b].block, _reach(system, b)
        _copy_block(work.M, memory.metric, weight, A, o, n, reach)
        if _block_factor(A, o, n, reach) != 0:
            return 1
        _schur_of_body(system, A, work.C, W, S, b)
    for i in range(m):
        S[i, i] *= 1.0 + regularisation
    return 0 if _band_factor(S, m, width) else 2


@inner(float64(SYSTEM, MEMORY))
def independence(system, memory):
    """Sine of the smallest angle between a constraint and those before it.

    Angles in the metric of the last `mass_factor`. It passes zero linearly where a
    mechanism passes a singular position. Redundant constraints do not count.
    """
    S, width, least = memory.mass_S, system.bandwidth, 1.0
    for i in range(system.n_rows):
        pivot = 1.0 / S[i, i]
        if pivot < CLEAR_OF_SLACK * system.slack[i]:
            continue
        total = pivot
        for k in range(max(0, i - width), i):
            total += S[i, k] * S[i, k] / S[k, k]
        least = min(least, abs(pivot / total))
    return math.sqrt(least)


@inner(types.void(SYSTEM, MEMORY, F1, F1))
def mass_solve(system, memory, x, mu):
    """Solves with a factor of `mass_factor`; (p, g) in (x, mu) are overwritten."""
    A, W, S = memory.mass_A, memory.mass_W, memory.mass_S
    segment = system.segment
    for b in range(len(system.body)):
        n, o = system.body[b].nv, system.body[b].block
        first = system.body[b].vel
        _forward(A, o, n, _reach(system, b), x, first)
        for s in range(system.body[b].seg0, system.body[b].seg1):
            at, row = segment[s].offset, segment[s].row
            for k in range(n):
                mu[row] -= W[at + k] * x[first + k] * A[o + k * n + k]
    _band_solve(S, system.n_rows, system.bandwidth, mu)
    for b in range(len(system.body)):
        n, first = system.body[b].nv, system.body[b].vel
        for s in range(system.body[b].seg0, system.body[b].seg1):
            at, row = segment[s].offset, segment[s].row
            for k in range(n):
                x[first + k] += W[at + k] * mu[row]
        _backward(A, system.body[b].block, n, _reach(system, b), x, first)
