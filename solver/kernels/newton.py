"""Steps that every integrator is built from: accelerations, projection, Newton.

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

from .compiling import entry, inner
from .coordinates import RATE, RETRACT, add_row_response, lift, resolve, respond
from .lapack import LAPACK, Lapack
from .layout import (
    BLOCK,
    C1,
    C2,
    C3,
    C_GAMMA,
    C_RATE,
    C_VALUE,
    COMPLETE,
    EVALUATE,
    F1,
    F2,
    I1,
    I2,
    LINEARISE,
    N_ENTRIES,
    N_ROWS,
    NV,
    S_BODY,
    S_OFFSET,
    S_ROW,
    SYSTEM,
    VEL,
    WORK,
)
from .mass import mass_factor, mass_solve
from .saddle import REGULARISATION, saddle_factor, saddle_solve
from .tables import Table, TableType

#: Most corrections of accelerations for the regularisation of the constraints.
REFINEMENTS = 8
#: They stop below this relative defect, or when they no longer halve it.
DEFECT = 1e-12


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


MEMORY = TableType(
    Memory,
    [F1, F1, F1, F2, I1, I1]
    + [C2, C2, C2, C3, I2, I2]
    + [F1, F1, F2]
    + [F1, F1, F2, F1, F1, F1, F1, F1, I1, LAPACK, LAPACK],
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
KERNELS = TableType(Kernels, [types.FunctionType(sig) for sig in SIGNATURES])

# Columns of Memory.counters
STEPS, REJECTED, EVALUATIONS, JACOBIANS, FACTORISATIONS, ITERATIONS, PROJECTIONS = (
    range(7)
)
N_COUNTERS = 7


@inner(types.void(SYSTEM, MEMORY, F1, F1))
def _solve_mass(system, memory, x, mu):
    mass_solve(system, memory.mass_A, memory.mass_W, memory.mass_S, x, mu)


@inner(int64(SYSTEM, WORK, MEMORY, float64, float64))
def _factor_mass(system, work, memory, weight, regularisation):
    """Factors the saddle-point system of M + weight tau^2 K."""
    return mass_factor(
        system,
        work.M,
        memory.metric,
        weight,
        regularisation,
        work.C,
        memory.mass_A,
        memory.mass_W,
        memory.mass_S,
    )


@inner(float64(SYSTEM, WORK, MEMORY))
def _constraint_defect(system, work, memory):
    """What gamma - C z_II' leaves, into dmu; its size relative to the terms."""
    m = system.dims[N_ROWS]
    size = 0.0
    for i in range(m):
        memory.dmu[i] = work.row[i, C_GAMMA]
    for k in range(len(system.segment)):
        row, at = system.segment[k, S_ROW], system.segment[k, S_OFFSET]
        b = system.segment[k, S_BODY]
        first = system.body[b, VEL]
        for i in range(system.body[b, NV]):
            term = work.C[at + i] * memory.acceleration[first + i]
            memory.dmu[row] -= term
            size = max(size, abs(term))
    worst = 0.0
    for i in range(m):
        worst = max(worst, abs(memory.dmu[i]))
    return worst / max(size, 1e-300)


@entry(SOLVE_ACCELERATIONS)
def solve_accelerations(system, work, memory):
    """Accelerations and multipliers of the state in `work`, into `memory`."""
    status = _factor_mass(system, work, memory, 0.0, REGULARISATION)
    if status != 0:
        return status
    for i in range(len(work.f)):
        memory.acceleration[i] = work.f[i]
    for i in range(system.dims[N_ROWS]):
        memory.multiplier[i] = work.row[i, C_GAMMA]
    _solve_mass(system, memory, memory.acceleration, memory.multiplier)
    defect = _constraint_defect(system, work, memory)
    for _ in range(REFINEMENTS):
        if defect < DEFECT:
            break
        for i in range(len(memory.dx)):
            memory.dx[i] = 0.0
        _solve_mass(system, memory, memory.dx, memory.dmu)
        for i in range(len(memory.dx)):
            memory.acceleration[i] += memory.dx[i]
        for i in range(len(memory.dmu)):
            memory.multiplier[i] += memory.dmu[i]
        before = defect
        defect = _constraint_defect(system, work, memory)
        if defect > 0.5 * before:
            break
    return 0


@entry(PROJECT_ONCE, from_python=False)
def project_once(system, work, memory, regularisation, dz, dv):
    """Smallest corrections of positions and velocities onto the linearised constraints.

    Smallest in the metric M + tau^2 K: position errors go into the rigid motion and
    not into stiff elastic coordinates. Of what is met by constraints that are less
    independent than the regularisation, relative to the Schur complement, little is
    corrected.
    """
    m = system.dims[N_ROWS]
    status = _factor_mass(system, work, memory, 1.0, regularisation)
    if status != 0:
        return status
    for x, column in ((dz, C_VALUE), (dv, C_RATE)):
        for i in range(len(x)):
            x[i] = 0.0
        for i in range(m):
            memory.multiplier[i] = -work.row[i, column]
        _solve_mass(system, memory, x, memory.multiplier)
    return 0


@entry(REMEMBER, from_python=False)
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
    in the rows of forces.
    """
    for i in range(len(A)):
        A[i] = mu * memory.M[i] + work.Rv[i]
    for i in range(len(G)):
        G[i] = work.Gv[i]
    for i in range(system.dims[N_ENTRIES]):
        G[i] += mu * memory.C[i]
    for b in range(len(system.body)):
        n, o = system.body[b, NV], system.body[b, BLOCK]
        for k in range(n):
            at = o + k * n
            add_row_response(system, memory.frame, b, mu, work.Rp, at, A, at)
    for s in range(len(system.segment)):
        b, at = system.segment[s, S_BODY], system.segment[s, S_OFFSET]
        add_row_response(system, memory.frame, b, mu, work.Gp, at, G, at)


@entry(*[FACTOR_REAL, FACTOR_COMPLEX], from_python=False)
def newton_factor(system, work, memory, lapack, mu, A, G, Y, S, pivots, row_pivots):
    """Factors mu - J; see `newton_matrix` and `saddle_factor`."""
    extended = system.newton
    newton_matrix(extended, work, memory, mu, A, G)
    memory.counters[FACTORISATIONS] += 1
    return saddle_factor(extended, lapack, A, memory.C, G, Y, S, pivots, row_pivots)


@entry(*[SOLVE_REAL, SOLVE_COMPLEX], from_python=False)
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
    for b in range(len(system.body)):
        n, o, first = system.body[b, NV], system.body[b, BLOCK], system.body[b, VEL]
        for i in range(n):
            total = memory.M[o + i * n] * s[first] - work.Rp[o + i * n] * x[first]
            for k in range(1, n):
                entry = o + i * n + k
                total += memory.M[entry] * s[first + k] - work.Rp[entry] * x[first + k]
            p[first + i] = total
    saddle_solve(system, lapack, A, G, Y, S, pivots, row_pivots, p, g)
    resolve(system, memory.frame, mu, r, x)
    for i in range(len(s)):
        s[i] = p[i]
        x[i] += p[i]
    respond(system, memory.frame, mu, x)
    lift(system, memory.frame, mu, x, r, r)
