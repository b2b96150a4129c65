"""Accelerations, multipliers, friction forces and projections, eq. (3) and (18)."""

from ..compiler.kernels import entry, inner
from ..compiler.types import float64, int64, void
from ..spatial.system_arrays import (
    C_GAMMA,
    C_RATE,
    C_VALUE,
    F1,
    SHARES_MOTION,
    SYSTEM,
    WORK,
    is_sticking,
)
from .factor_storage import MEMORY, PROJECT_ONCE, SOLVE_ACCELERATIONS
from .joint_friction import (
    NO_FRICTION_SOLUTION,
    coordinate_rate,
    friction_directions,
    solve_friction,
)
from .mass_matrix import constraint_independence, mass_factor, mass_solve
from .saddle_point import REGULARISATION, SHARED_REGULARISATION, band_factor, band_solve

#: Most corrections of accelerations for the regularisation of the constraints.
REFINEMENTS = 8
#: They stop below this relative defect, or when they no longer halve it.
RELATIVE_DEFECT = 1e-12
#: Constraints that are less independent than this, in the metric of projections, are
#: met by deformations, too: tau^2 gets so many times smaller, down to the last one.
RIGID_DEPENDENCE, SOFTENING_FACTOR, LEAST_STIFFNESS_WEIGHT = 0.03, 1e-2, 1e-5


@inner(float64(SYSTEM, WORK, MEMORY, F1, float64))
def _constraint_residual(system, work, memory, x, weight):
    """Residual weight gamma - C x, into dmu; returns its size relative to the terms."""
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
    largest = 0.0
    for i in range(m):
        largest = max(largest, abs(memory.dmu[i]))
    return largest / max(size, 1e-300)


@inner(void(SYSTEM, WORK, MEMORY, F1, F1, float64))
def solve_with_constraints(system, work, memory, x, mu, weight):
    """Solve for accelerations x and multipliers mu of the generalised forces in x.

    The constraint is C x = weight gamma; the system must be factored before.
    """
    for i in range(system.n_rows):
        mu[i] = weight * work.row[i, C_GAMMA]
    mass_solve(system, memory, x, mu)
    defect = _constraint_residual(system, work, memory, x, weight)
    for _ in range(REFINEMENTS):
        if defect < RELATIVE_DEFECT:
            break
        for i in range(len(memory.dx)):
            memory.dx[i] = 0.0
        mass_solve(system, memory, memory.dx, memory.dmu)
        for i in range(len(memory.dx)):
            x[i] += memory.dx[i]
        for i in range(len(memory.dmu)):
            mu[i] += memory.dmu[i]
        before = defect
        defect = _constraint_residual(system, work, memory, x, weight)
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
    solve_with_constraints(
        system, work, memory, memory.acceleration, memory.multiplier, 1.0
    )
    if len(system.friction) > 0:
        return _add_friction(system, work, memory)
    return 0


@inner(int64(SYSTEM, WORK, MEMORY))
def _add_friction(system, work, memory):
    """Add the effect of joint friction to accelerations and multipliers."""
    X, L = memory.friction_X, memory.friction_L
    friction_directions(system, work, X)
    for j in range(len(X)):
        solve_with_constraints(system, work, memory, X[j], L[j], 0.0)
    status = solve_friction(system, work, memory)
    for j in range(len(X)):
        for i in range(len(memory.acceleration)):
            memory.acceleration[i] += work.friction_force[j] * X[j, i]
        for r in range(len(memory.multiplier)):
            memory.multiplier[r] += work.friction_force[j] * L[j, r]
    return status


@entry(SOLVE_ACCELERATIONS)
def solve_prescribed_friction(system, work, memory):
    """Friction forces in a known motion, into `work.friction_force`.

    `memory.multiplier` is without friction; row j of `memory.friction_L` is the change
    of the multipliers by a unit force along joint coordinate j.
    """
    return solve_friction(system, work, memory)


@entry(PROJECT_ONCE)
def project_once(system, work, memory, regularisation, dz, dv):
    """Smallest corrections of positions and velocities onto the linearised constraints.

    Smallest in the metric M + tau^2 K: position errors go into the rigid motion and not
    into stiff elastic coordinates. Residuals of constraints that are less independent
    than the regularisation, relative to the Schur complement, are hardly corrected.
    Where the rigid motion alone could hardly make a correction, as at the dead point of
    a mechanism, tau is reduced, so that deformations contribute; otherwise rounding and
    errors of dense output would become large motions.
    """
    m = system.n_rows
    weight = 1.0
    status = mass_factor(system, work, memory, weight, regularisation)
    while status == 0 and weight > LEAST_STIFFNESS_WEIGHT:
        if constraint_independence(system, memory) > RIGID_DEPENDENCE:
            break
        weight *= SOFTENING_FACTOR
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
        return _constrain_sticking(system, work, memory, dz, dv)
    return 0


@inner(int64(SYSTEM, WORK, MEMORY, F1, F1))
def _constrain_sticking(system, work, memory, dz, dv):
    """Constrain the corrections so that coordinates of sticking joints stay
    constant.
    """
    X, A, t, n = (
        memory.friction_X,
        memory.friction_A,
        memory.friction_t,
        len(memory.friction_X),
    )
    friction_directions(system, work, X)
    for j in range(n):
        for r in range(system.n_rows):
            memory.multiplier[r] = 0.0
        mass_solve(system, memory, X[j], memory.multiplier)
    for i in range(n):
        for k in range(n):
            A[i, k] = (
                coordinate_rate(system, work, i, X[k])
                if is_sticking(system, k)
                else 0.0
            )
        A[i, i] *= 1.0 + SHARED_REGULARISATION * system.friction_state[i, SHARES_MOTION]
        if not is_sticking(system, i):
            for k in range(n):
                A[i, k] = 1.0 if i == k else 0.0
    if band_factor(A, n, n, memory.friction_pivots) != 0:
        return NO_FRICTION_SOLUTION
    for x, column in ((dz, C_VALUE), (dv, C_RATE)):
        for i in range(n):
            t[i] = 0.0
            if is_sticking(system, i):
                t[i] = -work.friction_subsystem.row[i, column] - coordinate_rate(
                    system, work, i, x
                )
        band_solve(A, n, n, memory.friction_pivots, t)
        for k in range(n):
            for i in range(len(x)):
                x[i] += t[k] * X[k, i]
    return 0
