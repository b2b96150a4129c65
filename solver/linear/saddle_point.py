"""Saddle-point systems of constrained bodies, eq. (17), by elimination of the bodies.

    [ A  -C^T ] [ x  ]   [ p ]
    [ G   0   ] [ mu ] = [ g ]

A is block diagonal with one block per body; C and G are stored as segments, the entries
of one row that belong to one body. Eliminating the bodies leaves the Schur complement
S = G A^-1 C^T of the multipliers; ordered along the mechanism it is a band matrix, so
that the cost of a chain grows linearly with its length. The kernels serve real and
complex systems.
"""

from ..compiler.inner_kernels import quotient
from ..compiler.kernels import inner
from ..compiler.types import int64, void
from ..spatial.system_arrays import (
    C1,
    C2,
    F1,
    F2,
    I1,
    R_COUNT,
    R_NEWTON,
    SHARES_MOTION,
    SYSTEM,
    is_sticking,
)
from .block_factors import block_factor, block_solve
from .factor_storage import COMPLEX_FACTORS, REAL_FACTORS

#: Added to the diagonal of the Schur complement, relative to it. Where constraints
#: become dependent (a singular position) it replaces what they leave open;
#: elsewhere refinement removes its effect.
REGULARISATION = 1e-13
#: The same for joints that stick and hold one motion together.
SHARED_REGULARISATION = 1e-7


@inner(*[int64(A, int64, int64, I1) for A in (F2, C2)])
def band_factor(S, m, width, pivots):
    """LU with partial pivoting of a band matrix in full storage; 1 if singular."""
    for j in range(m):
        last_row = min(m, j + width + 1)
        last_column = min(m, j + 2 * width + 1)
        best = j
        size = abs(S[j, j])
        for i in range(j + 1, last_row):
            candidate = abs(S[i, j])
            if candidate > size:
                best, size = i, candidate
        pivots[j] = best
        if not size > 0.0:
            return 1
        if best != j:
            for k in range(j, last_column):
                S[j, k], S[best, k] = S[best, k], S[j, k]
        inverse = quotient(1.0, S[j, j])
        for i in range(j + 1, last_row):
            factor = S[i, j] * inverse
            S[i, j] = factor
            if factor != 0.0:
                for k in range(j + 1, last_column):
                    S[i, k] -= factor * S[j, k]
    return 0


@inner(*[void(A, int64, int64, I1, X) for A, X in ((F2, F1), (C2, C1))])
def band_solve(S, m, width, pivots, x):
    """Solves with a factor of `band_factor`; x is overwritten."""
    for j in range(m):
        best = pivots[j]
        if best != j:
            x[j], x[best] = x[best], x[j]
        for i in range(j + 1, min(m, j + width + 1)):
            x[i] -= S[i, j] * x[j]
    for i in range(m - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, min(m, i + 2 * width + 1)):
            total -= S[i, k] * x[k]
        x[i] = quotient(total, S[i, i])


@inner(
    *[
        int64(SYSTEM, FACTORS, int64, F1, F2)
        for FACTORS in (REAL_FACTORS, COMPLEX_FACTORS)
    ]
)
def saddle_factor(system, factors, which, C, friction_derivative):
    """Factor a system in place: A becomes its factors, Y = A^-1 C^T, and S its band LU.

    Parameters
    ----------
    friction_derivative : (n_frictions, .)
        Derivatives of the friction of sliding joints by the multipliers.

    Returns
    -------
    int
        0; 1 if a block is singular; 2 if the constraints are dependent.
    """
    A, G, Y, S = factors.A[which], factors.G[which], factors.Y[which], factors.S[which]
    lapack, pivots = factors.lapack, factors.pivots[which]
    m, width, segment = system.n_rows, system.bandwidth, system.segment
    for i in range(m):
        for j in range(max(0, i - width), min(m, i + 2 * width + 1)):
            S[i, j] = 0.0
        S[i, i] += system.regularisation[i]
    for j in range(len(system.friction)):
        if not is_sticking(system, j):
            row = system.friction[j, R_NEWTON]
            S[row, row] += 1.0
            for r in range(system.friction[j, R_COUNT]):
                S[row, system.friction[j, R_NEWTON + 1 + r]] += friction_derivative[
                    j, r
                ]
    for b in range(len(system.body)):
        n = system.body[b].nv
        if n == 0:
            continue
        if block_factor(system, lapack, A, b, pivots) != 0:
            return 1
        for s in range(system.body[b].seg0, system.body[b].seg1):
            at = segment[s].offset
            for k in range(at, at + n):
                Y[k] = C[k]
            block_solve(system, lapack, A, b, pivots, Y, at)
            column = segment[s].row
            for r in range(system.body[b].seg0, system.body[b].seg1):
                g = segment[r].offset
                total = G[g] * Y[at]
                for k in range(1, n):
                    total += G[g + k] * Y[at + k]
                S[segment[r].row, column] += total
    for i in range(m):
        S[i, i] *= 1.0 + REGULARISATION
    for j in range(len(system.friction)):
        row = system.friction[j, R_NEWTON]
        S[row, row] *= (
            1.0 + SHARED_REGULARISATION * system.friction_state[j, SHARES_MOTION]
        )
    if m > 0 and band_factor(S, m, width, factors.row_pivots[which]) != 0:
        return 2
    return 0


@inner(
    void(SYSTEM, REAL_FACTORS, int64, F1, F1),
    void(SYSTEM, COMPLEX_FACTORS, int64, C1, C1),
)
def saddle_solve(system, factors, which, x, mu):
    """Solves with a factor of `saddle_factor`; (p, g) in (x, mu) are overwritten."""
    A, G, Y, S = factors.A[which], factors.G[which], factors.Y[which], factors.S[which]
    lapack, pivots = factors.lapack, factors.pivots[which]
    m, segment = system.n_rows, system.segment
    for b in range(len(system.body)):
        n, first = system.body[b].nv, system.body[b].vel
        if n == 0:
            continue
        block_solve(system, lapack, A, b, pivots, x, first)
        for s in range(system.body[b].seg0, system.body[b].seg1):
            at, row = segment[s].offset, segment[s].row
            for k in range(n):
                mu[row] -= G[at + k] * x[first + k]
    if m == 0:
        return
    band_solve(S, m, system.bandwidth, factors.row_pivots[which], mu)
    for b in range(len(system.body)):
        n, first = system.body[b].nv, system.body[b].vel
        for s in range(system.body[b].seg0, system.body[b].seg1):
            at, row = segment[s].offset, segment[s].row
            for k in range(n):
                x[first + k] += Y[at + k] * mu[row]
