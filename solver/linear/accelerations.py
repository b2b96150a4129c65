"""Accelerations, multipliers, friction and projections: what the mass matrix solves."""

from __future__ import annotations

from numba import float64, int64, types

from ..compiler.compiling import entry, inner
from ..space.layout import (
    C_GAMMA,
    C_RATE,
    C_VALUE,
    F1,
    SHARED,
    SYSTEM,
    WORK,
)
from .friction import JAMMED, along, directions, solve_friction
from .grips import sticks
from .mass import independence, mass_factor, mass_solve
from .memory import MEMORY, PROJECT_ONCE, SOLVE_ACCELERATIONS
from .saddle import REGULARISATION, SHARED_SLACK, band_factor, band_solve

#: Most corrections of accelerations for the regularisation of the constraints.
REFINEMENTS = 8
#: They stop below this relative defect, or when they no longer halve it.
DEFECT = 1e-12
#: Constraints that are less independent than this, in the metric of projections, are
#: met by deformations, too: tau^2 gets so many times smaller, down to the last one.
RIGIDLY_DEPENDENT, SOFTER, SOFTEST = 0.03, 1e-2, 1e-5


@inner(float64(SYSTEM, WORK, MEMORY, F1, float64))
def _constraint_defect(system, work, memory, x, weight):
    """What weight gamma - C x leaves, into dmu; its size relative to the terms."""
    m = system.n_rows
    size = 0.0
    for i in range(m):
        memory.dmu[i] = weight * work.row[i, C_GAMMA]
    for k in range(len(system.segment)):
        row, at = system.segment[k].row, system.segment[k].offset
        b = system.segment[k].body
        first = system.body[b].vel
        for i in range(system.body[b].nv):
            term = work.C[at + i] * x[first + i]
            memory.dmu[row] -= term
            size = max(size, abs(term))
    worst = 0.0
    for i in range(m):
        worst = max(worst, abs(memory.dmu[i]))
    return worst / max(size, 1e-300)


@inner(types.void(SYSTEM, WORK, MEMORY, F1, F1, float64))
def _respond_to(system, work, memory, x, mu, weight):
    """Accelerations x and multipliers mu of the generalised forces in x.

    With C x = weight gamma; factored before.
    """
    for i in range(system.n_rows):
        mu[i] = weight * work.row[i, C_GAMMA]
    mass_solve(system, memory, x, mu)
    defect = _constraint_defect(system, work, memory, x, weight)
    for _ in range(REFINEMENTS):
        if defect < DEFECT:
            break
        for i in range(len(memory.dx)):
            memory.dx[i] = 0.0
        mass_solve(system, memory, memory.dx, memory.dmu)
        for i in range(len(memory.dx)):
            x[i] += memory.dx[i]
        for i in range(len(memory.dmu)):
            mu[i] += memory.dmu[i]
        before = defect
        defect = _constraint_defect(system, work, memory, x, weight)
        if defect > 0.5 * before:
            break


@entry(SOLVE_ACCELERATIONS)
def solve_accelerations(system, work, memory):
    """Accelerations and multipliers of the state in `work`, into `memory`."""
    status = mass_factor(system, work, memory, 0.0, REGULARISATION)
    if status != 0:
        return status
    for i in range(len(work.f)):
        memory.acceleration[i] = work.f[i]
    _respond_to(system, work, memory, memory.acceleration, memory.multiplier, 1.0)
    if len(system.friction) > 0:
        return _add_friction(system, work, memory)
    return 0


@inner(int64(SYSTEM, WORK, MEMORY))
def _add_friction(system, work, memory):
    """Adds what friction of joints does to accelerations and multipliers."""
    X, L = memory.rub_X, memory.rub_L
    directions(system, work, X)
    for j in range(len(X)):
        _respond_to(system, work, memory, X[j], L[j], 0.0)
    status = solve_friction(system, work, memory)
    for j in range(len(X)):
        for i in range(len(memory.acceleration)):
            memory.acceleration[i] += work.rub[j] * X[j, i]
        for r in range(len(memory.multiplier)):
            memory.multiplier[r] += work.rub[j] * L[j, r]
    return status


@entry(SOLVE_ACCELERATIONS)
def solve_prescribed_friction(system, work, memory):
    """Forces of friction in a motion that is known, into `work.rub`.

    `multiplier` of `memory` is without friction; row j of `rub_L` is what a unit force
    along coordinate j adds to it.
    """
    return solve_friction(system, work, memory)


@entry(PROJECT_ONCE)
def project_once(system, work, memory, regularisation, dz, dv):
    """Smallest corrections of positions and velocities onto the linearised constraints.

    Smallest in the metric M + tau^2 K: position errors go into the rigid motion and
    not into stiff elastic coordinates. Of what is met by constraints that are less
    independent than the regularisation, relative to the Schur complement, little is
    corrected.

    Where the rigid motion alone could hardly make a correction, as at the dead point of
    a mechanism, tau is made smaller, so that deformations help: else rounding and
    errors of dense output would become large motions.
    """
    m = system.n_rows
    weight = 1.0
    status = mass_factor(system, work, memory, weight, regularisation)
    while status == 0 and weight > SOFTEST:
        if independence(system, memory) > RIGIDLY_DEPENDENT:
            break
        weight *= SOFTER
        status = mass_factor(system, work, memory, weight, regularisation)
    if status != 0:
        return status
    for x, column in ((dz, C_VALUE), (dv, C_RATE)):
        for i in range(len(x)):
            x[i] = 0.0
        for i in range(m):
            memory.multiplier[i] = -work.row[i, column]
        mass_solve(system, memory, x, memory.multiplier)
    if len(system.friction) > 0:
        return _hold(system, work, memory, dz, dv)
    return 0


@inner(int64(SYSTEM, WORK, MEMORY, F1, F1))
def _hold(system, work, memory, dz, dv):
    """Corrects corrections so that coordinates that stick are held, too."""
    X, A, t, n = memory.rub_X, memory.rub_A, memory.rub_t, len(memory.rub_X)
    directions(system, work, X)
    for j in range(n):
        for r in range(system.n_rows):
            memory.multiplier[r] = 0.0
        mass_solve(system, memory, X[j], memory.multiplier)
    for i in range(n):
        for k in range(n):
            A[i, k] = along(system, work, i, X[k]) if sticks(system, k) else 0.0
        A[i, i] *= 1.0 + SHARED_SLACK * system.grip[i, SHARED]
        if not sticks(system, i):
            for k in range(n):
                A[i, k] = 1.0 if i == k else 0.0
    if band_factor(A, n, n, memory.rub_pivots) != 0:
        return JAMMED
    for x, column in ((dz, C_VALUE), (dv, C_RATE)):
        for i in range(n):
            t[i] = 0.0
            if sticks(system, i):
                t[i] = -work.sliding.row[i, column] - along(system, work, i, x)
        band_solve(A, n, n, memory.rub_pivots, t)
        for k in range(n):
            for i in range(len(x)):
                x[i] += t[k] * X[k, i]
    return 0
