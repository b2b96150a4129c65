"""Newton's matrix of the index-1 equations, and what a run keeps of factors.

A force between two bodies would couple their blocks of the Newton matrix. It gets a row
among the constraints instead, with its change phi as unknown beside the multipliers:
with s the direction of the force in the generalised coordinates, and its stiffness k
and damping d,

    R' - s phi = 0,    (d s + k s (mu - E)^-1) . dz_II + phi = ...,

so that such a row has d s and k s as Gv and Gp, and 1 on the diagonal of the Schur
complement.

`Memory` holds the factors and vectors that these steps need.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import complex128, float64, int64, types

from sidtool.formats.sid import Array

from ..compiler.compiling import entry, inner
from ..compiler.lanes import row_times
from ..compiler.tables import Table, TableType
from ..compiler.views import PointerType
from ..space.coordinates import RATE, RETRACT, add_row_response, lift, resolve, respond
from ..space.layout import (
    BLOCK,
    C1,
    C2,
    C3,
    COMPLETE,
    EVALUATE,
    F1,
    F2,
    I1,
    I2,
    LINEARISE,
    N_ENTRIES,
    NV,
    R_NEWTON,
    S_BODY,
    S_OFFSET,
    S_ROW,
    SYSTEM,
    VEL,
    WORK,
)
from .grips import sticks
from .lapack import LAPACK, Lapack
from .mass import mass_row_times
from .saddle import saddle_factor, saddle_solve


class Memory(Table):
    """Factors and vectors of one run.

    real_* : a factored saddle-point system, see `saddle_factor`
    complex_* : the same, one for each pair of complex eigenvalues of a method
    mass_* : factors for accelerations and projections, see `mass_factor`
    M, C, frame : the mass matrix, constraint Jacobian and body frames at the state
        where the Newton matrix was made
    metric : blocks of tau^2 K, the stiffness part of the projection metric
    acceleration, multiplier : solution of eq. (3) at the last evaluated state
    dx, dmu : scratch of one entry per velocity and per constraint row
    counters : see `N_COUNTERS`
    real_lapack, complex_lapack : for large blocks
    rub_* : scratch for friction of joints, see `friction`
    """

    real_A: Array
    real_G: Array
    real_Y: Array
    real_S: Array
    real_pivots: np.ndarray
    real_row_pivots: np.ndarray
    complex_A: np.ndarray
    complex_G: np.ndarray
    complex_Y: np.ndarray
    complex_S: np.ndarray
    complex_pivots: np.ndarray
    complex_row_pivots: np.ndarray
    mass_A: Array
    mass_W: Array
    mass_S: Array
    M: Array
    C: Array
    frame: Array
    metric: Array
    acceleration: Array
    multiplier: Array
    dx: Array
    dmu: Array
    counters: np.ndarray
    real_lapack: Lapack
    complex_lapack: Lapack
    rub_X: Array
    rub_L: Array
    rub_P: Array
    rub_A: Array
    rub_t: Array
    rub_pivots: np.ndarray


MEMORY = TableType(
    Memory,
    [F1, F1, F1, F2, I1, I1]
    + [C2, C2, C2, C3, I2, I2]
    + [F1, F1, F2]
    + [F1, F1, F2, F1, F1, F1, F1, F1, I1, LAPACK, LAPACK]
    + [F2] * 4
    + [F1, I1],
)

SOLVE_ACCELERATIONS = int64(SYSTEM, WORK, MEMORY)
PROJECT_ONCE = int64(SYSTEM, WORK, MEMORY, float64, F1, F1)
REMEMBER = types.void(SYSTEM, WORK, MEMORY)
FACTOR_REAL = int64(SYSTEM, WORK, MEMORY, LAPACK, float64, F1, F1, F1, F2, I1, I1)
FACTOR_COMPLEX = int64(SYSTEM, WORK, MEMORY, LAPACK, complex128, C1, C1, C1, C2, I1, I1)
SOLVE_REAL = types.void(
    SYSTEM, WORK, MEMORY, LAPACK, float64, F1, F1, F1, F2, I1, I1, F1, F1, F1, F1, F1
)
SOLVE_COMPLEX = types.void(
    SYSTEM, WORK, MEMORY, LAPACK, complex128, C1, C1, C1, C2, I1, I1, C1, C1, C1, C1, C1
)


class Kernels(Table):
    """Pointers to the kernels of a run, so that each is compiled once and alone."""

    evaluate: Any
    linearise: Any
    solve_accelerations: Any
    project_once: Any
    remember: Any
    factor_real: Any
    factor_complex: Any
    solve_real: Any
    solve_complex: Any
    rate: Any
    retract: Any
    complete: Any


SIGNATURES = (
    EVALUATE,
    LINEARISE,
    SOLVE_ACCELERATIONS,
    PROJECT_ONCE,
    REMEMBER,
    FACTOR_REAL,
    FACTOR_COMPLEX,
    SOLVE_REAL,
    SOLVE_COMPLEX,
    RATE,
    RETRACT,
    COMPLETE,
)
KERNELS = TableType(Kernels, [PointerType(sig) for sig in SIGNATURES])

# Columns of Memory.counters
STEPS, REJECTED, EVALUATIONS, JACOBIANS, FACTORISATIONS, ITERATIONS, PROJECTIONS = (
    range(7)
)
N_COUNTERS = 7


@entry(REMEMBER)
def remember(system, work, memory):
    """Keeps M, C and the frames of the state that was just linearised."""
    for i in range(len(work.M)):
        memory.M[i] = work.M[i]
    for i in range(len(work.C)):
        memory.C[i] = work.C[i]
    for i in range(work.frame.shape[0]):
        for k in range(work.frame.shape[1]):
            memory.frame[i, k] = work.frame[i, k]


@inner(
    *[
        types.void(SYSTEM, WORK, MEMORY, float64, F1, F1),
        types.void(SYSTEM, WORK, MEMORY, complex128, C1, C1),
    ]
)
def newton_matrix(system, work, memory, mu, A, G):
    """Blocks of mu - J of the index-1 equations, J their Jacobian, in saddle form.

    With dz_I = (mu - E)^-1 (r_I + dz_II) inserted, what is left for dz_II is
    A = mu M + Rv + Rp (mu - E)^-1 and G = mu C + Gv + Gp (mu - E)^-1, without mu C
    in the rows of forces and of friction.
    """
    for i in range(len(A)):
        A[i] = mu * memory.M[i] + work.Rv[i]
    for i in range(len(G)):
        G[i] = work.Gv[i]
    for i in range(system.dims[N_ENTRIES]):
        G[i] += mu * memory.C[i]
    stuck = system.sliding.segment
    for k in range(len(stuck)):
        if sticks(system, stuck[k, S_ROW]):
            at = stuck[k, S_OFFSET]
            for i in range(at, at + system.body[stuck[k, S_BODY], NV]):
                G[i] += mu * memory.C[i]
    for b in range(len(system.body)):
        n, o = system.body[b, NV], system.body[b, BLOCK]
        for k in range(n):
            at = o + k * n
            add_row_response(system, memory.frame, b, mu, work.Rp, at, A, at)
    for s in range(len(system.segment)):
        b, at = system.segment[s, S_BODY], system.segment[s, S_OFFSET]
        add_row_response(system, memory.frame, b, mu, work.Gp, at, G, at)


@entry(*[FACTOR_REAL, FACTOR_COMPLEX])
def newton_factor(system, work, memory, lapack, mu, A, G, Y, S, pivots, row_pivots):
    """Factors mu - J; see `newton_matrix` and `saddle_factor`."""
    extended = system.newton
    newton_matrix(extended, work, memory, mu, A, G)
    memory.counters[FACTORISATIONS] += 1
    rubbing = work.rubbing
    return saddle_factor(
        extended, lapack, A, memory.C, G, Y, S, pivots, row_pivots, rubbing
    )


@entry(*[SOLVE_REAL, SOLVE_COMPLEX])
def newton_solve(
    system, work, memory, lapack, mu, A, G, Y, S, pivots, row_pivots, r, s, x, p, g
):
    """Solves (mu - J) (dz_I, dz_II) = (r, s) in place; x, p and g are scratch.

    x and p have one entry per velocity, g one per row of the Newton matrix.
    """
    system = system.newton
    resolve(system, memory.frame, mu, r, x)
    respond(system, memory.frame, mu, x)
    for i in range(len(g)):
        g[i] = 0.0
    for k in range(len(system.segment)):
        row, at = system.segment[k, S_ROW], system.segment[k, S_OFFSET]
        b = system.segment[k, S_BODY]
        first = system.body[b, VEL]
        for i in range(system.body[b, NV]):
            g[row] -= work.Gp[at + i] * x[first + i]
            if at < system.dims[N_ENTRIES]:
                g[row] += memory.C[at + i] * s[first + i]
    stuck = system.sliding.segment
    for k in range(len(stuck)):
        j, at, b = stuck[k, S_ROW], stuck[k, S_OFFSET], stuck[k, S_BODY]
        if sticks(system, j):
            row, first = system.friction[j, R_NEWTON], system.body[b, VEL]
            for i in range(system.body[b, NV]):
                g[row] += memory.C[at + i] * s[first + i]
    for b in range(len(system.body)):
        n, o, first = system.body[b, NV], system.body[b, BLOCK], system.body[b, VEL]
        for i in range(n):
            p[first + i] = mass_row_times(system, memory.M, b, i, s)
            p[first + i] -= row_times(work.Rp, o + i * n, x, first, n)
    saddle_solve(system, lapack, A, G, Y, S, pivots, row_pivots, p, g)
    resolve(system, memory.frame, mu, r, x)
    for i in range(len(s)):
        s[i] = p[i]
        x[i] += p[i]
    respond(system, memory.frame, mu, x)
    lift(system, memory.frame, mu, x, r, r)
