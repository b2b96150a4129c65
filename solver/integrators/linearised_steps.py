"""Linearised steps of a collocation method, one after the other, eq. (46) and (49).

With the derivative F of the slopes at the stages, a step solves

    x = b + h (A x I) F x .

Newton's matrix with the F of the middle stage, without the derivatives of the rates of
positions by positions, is the preconditioner: the error falls by a factor of 30 to 1000
in each iteration. Backwards the same equations hold with transposed matrices, for the
vectors u of (49).

==========  ==================================================================
Symbol      Meaning
==========  ==================================================================
F           [T, Z; J_z, J_v], of which the rows of the arguments are the columns
P           derivative of the projection after a step, its transpose backwards
mu          eigenvalues of A^-1 over h, of each pair one
==========  ==================================================================
"""

from numba import float64, int64, types

from ..compiler.inner_kernels import quotient
from ..compiler.kernels import entry, inner
from ..linear.block_factors import lu_factor, lu_solve
from ..spatial.system_arrays import C1, C2, F1, F2, F3, I1
from .loop_state import copy
from .radau_stages import transform

#: Error of the stages, relative to their norm: the largest of their weighted entries.
TOLERANCE = 1e-13
#: Changes that are rounding if they do not fall any more, and iterations at most.
ROUNDING, MAX_ITERATIONS = 1e-10, 50


@inner(int64(F2, int64, float64, C1, F2, C2, I1))
def _factor(F, nz, h, eigenvalues, product, blocks, pivots):
    """Factors of mu - J_v - J_z Z / mu for each eigenvalue; 1 if one is singular."""
    nv = F.shape[0] - nz
    for i in range(nv):
        for j in range(nv):
            product[i, j] = 0.0
    for j in range(nv):  # Z^T J_z^T
        row = product[j]
        for k in range(nz):
            factor, column = F[nz + j, k], F[k]
            for i in range(nv):
                row[i] += factor * column[nz + i]
    for part in range(len(eigenvalues)):
        mu = complex(eigenvalues[part].real / h, eigenvalues[part].imag / h)
        inverse, block = quotient(1.0, mu), blocks[part]
        for i in range(nv):
            for j in range(nv):
                block[i * nv + j] = -F[nz + j, nz + i] - product[j, i] * inverse
            block[i * nv + i] += mu
        if lu_factor(block, 0, nv, nv, pivots, part * nv) != 0:
            return 1
    return 0


@inner(types.void(F2, int64, float64, C1, F2, F2, C2, I1, F2, F2, C1, F2))
def _precondition(
    F, nz, h, eigenvalues, to_pairs, from_pairs, blocks, pivots, r, w, y, out
):
    """out = P^-1 r for the stages r, with factors of `_factor`."""
    N, nv = F.shape[0], F.shape[0] - nz
    transform(to_pairs, r, w)
    for part in range(len(eigenvalues)):
        mu = complex(eigenvalues[part].real / h, eigenvalues[part].imag / h)
        first, second = max(0, 2 * part - 1), 2 * part
        for k in range(N):
            imaginary = w[second, k] if part > 0 else 0.0
            y[k] = complex(w[first, k], imaginary)
        for i in range(nz, N):
            y[i] *= mu
        for k in range(nz):
            factor, column = y[k], F[k]
            for i in range(nz, N):
                y[i] += column[i] * factor
        lu_solve(blocks[part], 0, nv, nv, pivots, part * nv, y, nz)
        inverse = quotient(1.0, mu)
        for i in range(nz, N):
            factor, column = y[i] * inverse, F[i]
            for k in range(nz):
                y[k] += column[k] * factor
        for k in range(N):
            w[first, k] = y[k].real
            if part > 0:
                w[second, k] = y[k].imag
    transform(from_pairs, w, out)


@inner(types.void(F2, F1, F1))
def _apply(F, x, out):
    """out = F x, with the columns of F in its rows."""
    for j in range(len(out)):
        out[j] = 0.0
    for i in range(len(x)):
        factor, column = x[i], F[i]
        for j in range(len(out)):
            out[j] += factor * column[j]


@inner(float64(F2, F1))
def _largest(x, weights):
    """Largest entry of stages, weighted."""
    found = 0.0
    for i in range(x.shape[0]):
        for k in range(x.shape[1]):
            found = max(found, abs(x[i, k]) * weights[k])
    return found


@entry(
    int64(
        *(int64, int64, F1, F2, F2, F2, C1, F3, F3, F1),
        *(F3, F2, F2, F2, F3, F2, C2, C1, I1),
    )
)
def march(
    backward,
    nz,
    h,
    A,
    to_pairs,
    from_pairs,
    eigenvalues,
    F,
    P,
    weights,
    x,
    added,
    current,
    starts,
    scratch,
    product,
    blocks,
    y,
    pivots,
):
    """Solve linearised steps in sequence, for some columns each.

    Parameters
    ----------
    backward : 1 for the transposed equations, from the last step to the first one
    nz : number of positions
    h : (steps,) [s]
    A : (s, s) of the method, transposed backwards
    to_pairs, from_pairs : (s, s) transformation that makes the inverse of A diagonal
        but for pairs, and its inverse
    eigenvalues : of these, the real one first
    F : (steps s, N, N) columns of F as rows
    P : (steps or one less, N, N) columns of P as rows
    weights : (N,) of the entries of x in its norm
    x : (steps columns, s, N) b without the part of the state before the step, which
        the stages replace
    added : (steps columns, N) to the state after the step
    current : (columns, N) state
    starts : (steps columns, N) state before each step
    scratch, product, blocks, y, pivots : (5, s, N), (nv, nv), (pairs, nv nv), (N,),
        (pairs nv,)

    Returns 0, or 1 where the iteration does not converge.
    """
    s, n_steps, N, count = A.shape[0], len(h), len(weights), current.shape[0]
    b, r, w, f, change = scratch[0], scratch[1], scratch[2], scratch[3], scratch[4]
    for step in range(n_steps):
        k = n_steps - 1 - step if backward == 1 else step
        middle = F[k * s + s // 2]
        if _factor(middle, nz, h[k], eigenvalues, product, blocks, pivots) != 0:
            return 1
        for column in range(count):
            stages, state = x[k * count + column], current[column]
            copy(state, starts[k * count + column])
            if backward == 1 and k < len(P):
                _apply(P[k], starts[k * count + column], state)
            for i in range(s):
                weight = h[k] * A[i, s - 1] if backward == 1 else 1.0
                for j in range(N):
                    b[i, j] = r[i, j] = stages[i, j] + weight * state[j]
                    stages[i, j] = 0.0
            last, converged = 0.0, 0
            for _ in range(MAX_ITERATIONS + 1):
                _precondition(
                    middle,
                    nz,
                    h[k],
                    eigenvalues,
                    to_pairs,
                    from_pairs,
                    blocks,
                    pivots,
                    r,
                    w,
                    y,
                    change,
                )
                for i in range(s):
                    for j in range(N):
                        stages[i, j] += change[i, j]
                size, new = _largest(stages, weights), _largest(change, weights)
                if new * new <= TOLERANCE * size * last or (
                    2.0 * new > last and new <= ROUNDING * size
                ):
                    converged = 1
                    break
                last = new
                for i in range(s):
                    _apply(F[k * s + i], stages[i], f[i])
                transform(A, f, r)
                for i in range(s):
                    for j in range(N):
                        r[i, j] = b[i, j] - stages[i, j] + h[k] * r[i, j]
            if converged == 0:
                return 1
            after = added[k * count + column]
            if backward == 1:
                for i in range(s):
                    _apply(F[k * s + i], stages[i], f[i])
                    for j in range(N):
                        state[j] += f[i, j]
            elif k < len(P):
                _apply(P[k], stages[s - 1], state)
            else:
                copy(stages[s - 1], state)
            for j in range(N):
                state[j] += after[j]
    return 0
