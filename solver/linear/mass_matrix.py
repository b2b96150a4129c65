"""Saddle-point systems with the mass matrix, for accelerations and projections.

    [ M  -C^T ] [ x  ]   [ p ]
    [ C   0   ] [ mu ] = [ g ]

They are symmetric, unlike Newton's (see `saddle_point`): every block of M is factored
as L^T D L, its elastic coordinates first. Where Me is diagonal, as for natural modes,
the cost is that of the rigid coordinates times the elastic ones. With W = L^-T C^T the
Schur complement S = W^T D^-1 W is a symmetric band matrix.
"""

import math

from ..compiler.inner_kernels import row_dot
from ..compiler.kernels import inner
from ..compiler.types import boolean, complex128, float64, int64, void
from ..spatial.system_arrays import C1, DIAGONAL_ME, F1, F2, I1, SYSTEM, WORK
from .factor_storage import MEMORY

#: A constraint depends on others when this many slacks are left of it.
CLEAR_OF_REGULARISATION = 10.0


@inner(void(F1, F1, float64, F1, int64, int64, int64))
def _copy_block(M, K, weight, A, o, n, n_coupled):
    """Lower triangle of M + weight K, without its zeros."""
    for i in range(n):
        for j in range(min(i, n_coupled)):
            A[o + i * n + j] = M[o + i * n + j] + weight * K[o + i * n + j]
        A[o + i * n + i] = M[o + i * n + i] + weight * K[o + i * n + i]


@inner(int64(F1, int64, int64, int64))
def _block_factor(A, o, n, n_coupled):
    """L^T D L of the n x n block at o, in place with 1 / D; 1 if not positive.

    The rows beyond `n_coupled` are coupled with columns before it only.
    """
    for j in range(n - 1, -1, -1):
        row = o + j * n
        if not A[row + j] > 0.0:
            return 1
        inverse = 1.0 / A[row + j]
        A[row + j] = inverse
        for i in range(min(j, n_coupled)):
            factor = A[row + i] * inverse
            target = o + i * n
            for k in range(i + 1):
                A[target + k] -= factor * A[row + k]
        for i in range(min(j, n_coupled)):
            A[row + i] *= inverse
    return 0


@inner(void(F1, int64, int64, int64, F1, int64))
def _forward(A, o, n, n_coupled, x, at):
    """x = L^-T x."""
    for j in range(n - 1, 0, -1):
        for i in range(min(j, n_coupled)):
            x[at + i] -= A[o + j * n + i] * x[at + j]


@inner(void(F1, int64, int64, int64, F1, int64))
def _backward(A, o, n, n_coupled, x, at):
    """x = L^-1 D^-1 x."""
    for i in range(n):
        total = x[at + i] * A[o + i * n + i]
        for k in range(min(i, n_coupled)):
            total -= A[o + i * n + k] * x[at + k]
        x[at + i] = total


@inner(int64(SYSTEM, int64))
def _coupled_columns(system, b):
    row = system.body[b]
    return row.rd if row.flags & DIAGONAL_ME else row.nv


@inner(
    *[float64(SYSTEM, F1, int64, int64, F1), complex128(SYSTEM, F1, int64, int64, C1)]
)
def mass_row_product(system, M, b, i, x):
    """Row i of the block of a body in M, times x."""
    n, first, n_coupled = (
        system.body[b].nv,
        system.body[b].vel,
        _coupled_columns(system, b),
    )
    row = system.body[b].block + i * n
    if i < n_coupled:
        return row_dot(M, row, x, first, n)
    total = M[row + i] * x[first + i]
    for k in range(n_coupled):
        total += M[row + k] * x[first + k]
    return total


@inner(void(SYSTEM, F1, F1, F1, F2, int64))
def _schur_of_body(system, A, C, W, S, b):
    """W of one body, and its contribution to the lower triangle of S."""
    segment, n_coupled = system.segment, _coupled_columns(system, b)
    n, o = system.body[b].nv, system.body[b].block
    for s in range(system.body[b].seg0, system.body[b].seg1):
        at = segment[s].offset
        for k in range(at, at + n):
            W[k] = C[k]
        _forward(A, o, n, n_coupled, W, at)
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


@inner(void(F2, int64, int64, F1))
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
    """Factor the system of M + weight tau^2 K: A, W and S of the module docstring.

    Parameters
    ----------
    regularisation
        Added to the diagonal of S, relative to it.

    Returns
    -------
    int
        0; 1 if a block is not positive; 2 if constraints are dependent.
    """
    A, W, S = memory.mass_A, memory.mass_W, memory.mass_S
    m, width = system.n_rows, system.bandwidth
    for i in range(m):
        for j in range(max(0, i - width), i):
            S[i, j] = 0.0
        S[i, i] = system.regularisation[i]
    for b in range(len(system.body)):
        n, o, n_coupled = (
            system.body[b].nv,
            system.body[b].block,
            _coupled_columns(system, b),
        )
        _copy_block(work.M, memory.metric, weight, A, o, n, n_coupled)
        if _block_factor(A, o, n, n_coupled) != 0:
            return 1
        _schur_of_body(system, A, work.C, W, S, b)
    for i in range(m):
        S[i, i] *= 1.0 + regularisation
    return 0 if _band_factor(S, m, width) else 2


@inner(float64(SYSTEM, MEMORY))
def constraint_independence(system, memory):
    """Sine of the smallest angle between a constraint and those before it.

    Angles are measured in the metric of the last `mass_factor`. The value passes zero
    linearly where a mechanism passes a singular configuration. Redundant constraints do
    not count.
    """
    smallest = 1.0
    for i in range(system.n_rows):
        smallest = min(smallest, row_independence(system, memory, i))
    return smallest


@inner(float64(SYSTEM, MEMORY, int64))
def row_independence(system, memory, i):
    """Sine of the angle between constraint i and those before it, see
    `constraint_independence`; 1 for a redundant one.
    """
    pivot = 1.0 / memory.mass_S[i, i]
    if pivot < CLEAR_OF_REGULARISATION * system.regularisation[i]:
        return 1.0
    return math.sqrt(abs(pivot)) / constraint_scale(system, memory, i)


@inner(void(SYSTEM, MEMORY, I1))
def constraint_blocks(system, memory, block):
    """Number the blocks of constraints that do not act on each other through masses.

    Parameters
    ----------
    block : (n_rows,) is filled with the first row of the block of each row
    """
    S, width = memory.mass_S, system.bandwidth
    for i in range(system.n_rows):
        block[i] = i
        for k in range(max(0, i - width), i):
            one, other = min(block[i], block[k]), max(block[i], block[k])
            if S[i, k] != 0.0 and one != other:
                for j in range(i + 1):
                    if block[j] == other:
                        block[j] = one


@inner(float64(SYSTEM, MEMORY, int64))
def constraint_scale(system, memory, i):
    """Norm of the acceleration by a unit multiplier of row i, in the metric of the last
    `mass_factor`.
    """
    S, width = memory.mass_S, system.bandwidth
    total = 1.0 / S[i, i]
    for k in range(max(0, i - width), i):
        total += S[i, k] * S[i, k] / S[k, k]
    return math.sqrt(abs(total))


@inner(void(SYSTEM, MEMORY, F1, F1))
def mass_solve(system, memory, x, mu):
    """Solves with a factor of `mass_factor`; (p, g) in (x, mu) are overwritten."""
    A, W, S = memory.mass_A, memory.mass_W, memory.mass_S
    segment = system.segment
    for b in range(len(system.body)):
        n, o = system.body[b].nv, system.body[b].block
        first = system.body[b].vel
        _forward(A, o, n, _coupled_columns(system, b), x, first)
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
        _backward(A, system.body[b].block, n, _coupled_columns(system, b), x, first)
