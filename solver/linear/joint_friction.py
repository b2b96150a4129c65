"""Friction of joints as a function of their multipliers, section 14, eq. (32)-(35).

==========  ====================================================  ==========
Symbol      Meaning                                               Theory
==========  ====================================================  ==========
t           friction forces along the joint coordinates           eq. (34)
N           contact force, linear in the multipliers              eq. (33)
mu          coefficient of friction as a function of speed        eq. (32)
X, L        accelerations and multipliers of unit forces t        eq. (35)
==========  ====================================================  ==========

The coordinate of a joint with friction has a row like a constraint, in
`SystemArrays.friction_subsystem`. While the joint sticks, the row is a constraint of
velocity and position; while it slides, t follows from the multipliers of the joint. The
factors of the equations of the bodies stay symmetric; few equations for t remain.
"""

import math

from ..compiler.kernels import inner
from ..compiler.types import UniTuple, float64, int64, void
from ..spatial.system_arrays import (
    AT_LIMIT,
    C_GAMMA,
    C_RATE,
    C_VALUE,
    CONTACT_SIDE,
    F1,
    F2,
    I1,
    L_PERIOD,
    L_RADIUS,
    L_SLIDING,
    L_SPEED,
    L_STATIC,
    L_VISCOUS,
    R_CONTACTS,
    R_COUNT,
    R_LAW,
    R_LOAD,
    R_NEWTON,
    R_ROWS,
    SHARES_MOTION,
    STICK_POSITION,
    SYSTEM,
    WORK,
    is_sticking,
    slip_direction,
)
from .factor_storage import MEMORY
from .saddle_point import band_factor, band_solve

#: Newton's iterations for the forces of friction, the relative change at their end,
#: and that of which they may not shrink any more.
MAX_ITERATIONS, CONVERGED, ROUNDING = 60, 1e-13, 1e-6
#: Compliance by which joints that stick share what they hold together, and the least
#: limit of friction that counts in it, relative.
SHARED_COMPLIANCE, LEAST_LIMIT = 1e-3, 1e-6
#: How often limits are found anew for that, and the change of the compliance at the
#: end, relative to the largest one.
COMPLIANCE_ROUNDS, COMPLIANCE_CHANGE = 40, 1e-13
#: Code of a state in which friction has no solution, or not one alone.
NO_FRICTION_SOLUTION = 6


@inner(UniTuple(float64, 2)(SYSTEM, int64, float64))
def friction_limit(system, j, rate):
    """Friction of a unit load at a rate of the coordinate, and its derivative."""
    law, real_data = system.friction[j, R_LAW], system.real_data
    radius, width = real_data[law + L_RADIUS], real_data[law + L_SPEED]
    if system.friction_state[j, AT_LIMIT] > 0.0:
        return radius * real_data[law + L_STATIC], 0.0
    if width == 0.0:
        return radius * real_data[law + L_SLIDING], 0.0
    x = radius * rate / width
    stribeck = (real_data[law + L_STATIC] - real_data[law + L_SLIDING]) * math.exp(
        -x * x
    )
    size = radius * (real_data[law + L_SLIDING] + stribeck)
    return size, -2.0 * radius * radius * stribeck * x / width


@inner(UniTuple(float64, 2)(SYSTEM, int64, int64, F1))
def contact_force(system, j, contact, multiplier):
    """Contact force of a joint at one contact point, in two directions
    across its axis.
    """
    row, real_data = system.friction[j], system.real_data
    count = row[R_COUNT]
    first, a, b = row[R_LOAD] + 2 * contact * count, 0.0, 0.0
    for r in range(count):
        force = multiplier[row[R_ROWS + r]]
        a += real_data[first + r] * force
        b += real_data[first + count + r] * force
    return a, b


@inner(float64(SYSTEM, int64, F1))
def joint_load(system, j, multiplier):
    """Load of a joint: the sum of the magnitudes of its contact forces, eq. (33).

    A force with a single direction counts with the sign of the contact side, so that
    the load is smooth where the force changes its sign.
    """
    total = 0.0
    for contact in range(system.friction[j, R_CONTACTS]):
        a, b = contact_force(system, j, contact, multiplier)
        side = system.friction_state[j, CONTACT_SIDE + contact]
        total += math.sqrt(a * a + b * b) if side == 0.0 else side * a
    return total


@inner(float64(SYSTEM, int64, F1, int64))
def d_joint_load(system, j, multiplier, r):
    """The derivative of the load by multiplier r of those that make it."""
    row, real_data, total = system.friction[j], system.real_data, 0.0
    count = row[R_COUNT]
    for contact in range(row[R_CONTACTS]):
        first = row[R_LOAD] + 2 * contact * count
        a, b = contact_force(system, j, contact, multiplier)
        side, size = (
            system.friction_state[j, CONTACT_SIDE + contact],
            math.sqrt(a * a + b * b),
        )
        if side != 0.0:
            total += side * real_data[first + r]
        elif size > 0.0:
            total += (
                a * real_data[first + r] + b * real_data[first + count + r]
            ) / size
    return total


@inner(void(SYSTEM, WORK, F2))
def friction_directions(system, work, X):
    """Generalised forces of unit forces along the coordinates."""
    table = system.friction_subsystem.segment
    for j in range(len(X)):
        for i in range(X.shape[1]):
            X[j, i] = 0.0
    for k in range(len(table)):
        j, at, b = table[k].row, table[k].offset, table[k].body
        first = system.body[b].vel
        for i in range(system.body[b].nv):
            X[j, first + i] += work.C[at + i]


@inner(float64(SYSTEM, WORK, int64, F1))
def coordinate_rate(system, work, j, x):
    """The rate of a coordinate that velocities x make."""
    table, total = system.friction_subsystem.segment, 0.0
    for k in range(len(table)):
        if table[k].row == j:
            at, b = table[k].offset, table[k].body
            first = system.body[b].vel
            for i in range(system.body[b].nv):
                total += work.C[at + i] * x[first + i]
    return total


@inner(void(SYSTEM, WORK))
def stick_constraints(system, work):
    """After the constraints were evaluated: coordinates count from where they stick."""
    row = work.friction_subsystem.row
    for j in range(len(system.friction)):
        value = row[j, C_VALUE] - system.friction_state[j, STICK_POSITION]
        period = system.real_data[system.friction[j, R_LAW] + L_PERIOD]
        if period > 0.0:
            value -= period * math.floor(value / period + 0.5)
        row[j, C_VALUE] = value


@inner(void(SYSTEM, WORK))
def linearise_friction(system, work):
    """Newton rows of sliding joints, after they were linearised as sticking.

    Friction forces t obey t + sense mu(rate) N(lambda) + viscous rate = 0.
    """
    table = system.friction_subsystem.segment
    for k in range(len(table)):
        j, at, b = table[k].row, table[k].offset, table[k].body
        if is_sticking(system, j):
            continue
        _, d_limit = friction_limit(system, j, work.friction_subsystem.row[j, C_RATE])
        damping = slip_direction(system, work, j) * d_limit * work.joint_load[j]
        damping += system.real_data[system.friction[j, R_LAW] + L_VISCOUS]
        for i in range(at, at + system.body[b].nv):
            work.Gp[i] = 0.0
            work.Gv[i] = damping * work.C[i]


@inner(UniTuple(float64, 2)(SYSTEM, WORK, F1, F2))
def _set_shared_compliance(system, work, multiplier, P):
    """Set the compliance of sticking joints, into a column of P, before its last value.

    It is proportional to sqrt(P_jj) / limit: a load that one motion causes is shared in
    proportion to the limits, so that all joints start to slide together.

    Returns
    -------
    float, float
        The largest limit, and the largest change of a compliance.
    """
    n, largest, largest_compliance, change = len(P), 0.0, 0.0, 0.0
    for j in range(n):
        P[j, n + 2] = P[j, n + 1]
        law = system.friction[j, R_LAW]
        unit_limit = system.real_data[law + L_STATIC] * system.real_data[law + L_RADIUS]
        P[j, n + 1] = unit_limit * joint_load(system, j, multiplier)
        largest = max(largest, P[j, n + 1])
    for j in range(n):
        limit = max(P[j, n + 1], LEAST_LIMIT * largest, 1e-300)
        P[j, n + 1] = 0.0
        if system.friction_state[j, SHARES_MOTION] > 0.0 and P[j, j] > 0.0:
            P[j, n + 1] = 1.0 / (math.sqrt(P[j, j]) * limit)
            largest_compliance = max(largest_compliance, P[j, n + 1])
    for j in range(n):
        P[j, n + 1] *= SHARED_COMPLIANCE / max(largest_compliance, 1e-300)
        change = max(change, abs(P[j, n + 1] - P[j, n + 2]))
    return largest, change


@inner(float64(SYSTEM, WORK, int64, F1))
def _sliding_resistance(system, work, j, multiplier):
    """Resistance sense mu(rate) N(lambda) + viscous rate of a sliding joint.

    Its derivatives by the multipliers go into `work.friction_limit_derivative`.
    """
    rate = work.friction_subsystem.row[j, C_RATE]
    size, _ = friction_limit(system, j, rate)
    size *= slip_direction(system, work, j)
    for r in range(system.friction[j, R_COUNT]):
        work.friction_limit_derivative[j, r] = size * d_joint_load(
            system, j, multiplier, r
        )
    viscous = system.real_data[system.friction[j, R_LAW] + L_VISCOUS]
    return size * joint_load(system, j, multiplier) + viscous * rate


@inner(void(SYSTEM, WORK, F1, float64, F1, F1))
def friction_residual(system, work, forces, scale, p, g):
    """Right-hand sides where multipliers and friction forces t are both unknowns.

    Adds t, scaled, along the coordinates to p. The rows of friction in g are, for
    sticking joints, the distance from the position where they stick, and for sliding
    joints t + sense mu(rate) N(lambda) + viscous rate, scaled; both with the sign of a
    correction.

    Parameters
    ----------
    forces
        The multipliers, followed by t.
    """
    first = system.n_rows
    for j in range(len(system.friction)):
        row, t = system.friction[j, R_NEWTON], forces[first + j]
        g[row] = -work.friction_subsystem.row[j, C_VALUE]
        if not is_sticking(system, j):
            work.joint_load[j] = joint_load(system, j, forces)
            g[row] = -scale * (t + _sliding_resistance(system, work, j, forces))
    table = system.friction_subsystem.segment
    for k in range(len(table)):
        t = scale * forces[first + table[k].row]
        at, b = table[k].offset, table[k].body
        start = system.body[b].vel
        for i in range(system.body[b].nv):
            p[start + i] += work.C[at + i] * t


@inner(float64(SYSTEM, WORK, int64, F1, F2, F2, F2))
def _friction_equation(system, work, i, multiplier, L, P, A):
    """Residual of the friction equation of joint i, and its derivatives in row i of A.

    For a sticking joint it is the acceleration along its coordinate, in units of force;
    for a sliding one t + sense mu(rate) N(lambda) + viscous rate.
    """
    n = len(A)
    if is_sticking(system, i):
        for k in range(n):
            A[i, k] = P[i, k] / P[i, i]
        A[i, i] += P[i, n + 1]
        return (P[i, n] - work.friction_subsystem.row[i, C_GAMMA]) / P[i, i]
    resistance = _sliding_resistance(system, work, i, multiplier)
    for k in range(n):
        A[i, k] = 1.0 if i == k else 0.0
    for r in range(system.friction[i, R_COUNT]):
        change = work.friction_limit_derivative[i, r]
        for k in range(n):
            A[i, k] += change * L[k, system.friction[i, R_ROWS + r]]
    return resistance


@inner(void(WORK, MEMORY))
def _set_multipliers_with_friction(work, memory):
    """Multipliers with the friction forces of `work.friction_force`, into dmu."""
    for r in range(len(memory.dmu)):
        memory.dmu[r] = memory.multiplier[r]
        for k in range(len(work.friction_force)):
            memory.dmu[r] += work.friction_force[k] * memory.friction_L[k, r]


@inner(int64(SYSTEM, WORK, MEMORY, float64))
def _solve_newton(system, work, memory, largest_limit):
    """Newton iteration for the friction forces, from zero; returns 0 or JAMMED.

    Compliance enters the matrix only: it selects one solution for sticking joints and
    leaves no acceleration. Rounding errors are relative to the largest limit: joints
    that come to rest without a load along their coordinates need no force at all.
    """
    L, P, A, dt = (
        memory.friction_L,
        memory.friction_P,
        memory.friction_A,
        memory.friction_t,
    )
    lambda_, n, t, before = memory.dmu, len(A), work.friction_force, math.inf
    for i in range(n):
        t[i] = 0.0
    for _ in range(MAX_ITERATIONS):
        _set_multipliers_with_friction(work, memory)
        size = largest_limit
        for i in range(n):
            dt[i] = -_friction_equation(system, work, i, lambda_, L, P, A)
            size = max(size, abs(dt[i]))
            if not is_sticking(system, i):
                dt[i] -= t[i]
            else:
                for k in range(n):
                    dt[i] -= P[i, k] / P[i, i] * t[k]
        if band_factor(A, n, n, memory.friction_pivots) != 0:
            return NO_FRICTION_SOLUTION
        band_solve(A, n, n, memory.friction_pivots, dt)
        change = 0.0
        for i in range(n):
            t[i] += dt[i]
            size, change = max(size, abs(t[i])), max(change, abs(dt[i]))
        if change <= CONVERGED * size or (
            change >= before and change <= ROUNDING * size
        ):
            return 0
        before = change
    return NO_FRICTION_SOLUTION


@inner(float64(F2, I1))
def friction_determinant(A, pivots):
    """Determinant of the equations of friction from their factor; 1 without friction.

    It is not positive where there is no solution, or more than one.
    """
    determinant = 1.0
    for i in range(len(A)):
        determinant *= A[i, i] if pivots[i] == i else -A[i, i]
    return determinant


@inner(int64(SYSTEM, WORK, MEMORY))
def solve_friction(system, work, memory):
    """Friction forces, into `work.friction_force`, with the loads that cause them.

    `acceleration` and `multiplier` of `memory` are without friction; `friction_X` and
    `friction_L` are their changes by unit forces along each joint coordinate.

    Returns
    -------
    int
        0, or JAMMED where friction has no solution, or more than one.
    """
    P, n, shared = memory.friction_P, len(memory.friction_A), False
    for i in range(n):
        work.friction_force[i] = 0.0
        P[i, n] = coordinate_rate(system, work, i, memory.acceleration)
        for k in range(n):
            P[i, k] = coordinate_rate(system, work, i, memory.friction_X[k])
        if is_sticking(system, i) and system.friction_state[i, SHARES_MOTION] > 0.0:
            shared = True
    for k in range(COMPLIANCE_ROUNDS):
        if k > 0 and not shared:
            break
        _set_multipliers_with_friction(work, memory)
        largest_limit, change = _set_shared_compliance(system, work, memory.dmu, P)
        if k > 0 and change <= COMPLIANCE_CHANGE * SHARED_COMPLIANCE:
            break
        if _solve_newton(system, work, memory, largest_limit) != 0:
            return NO_FRICTION_SOLUTION
    _set_multipliers_with_friction(work, memory)
    for i in range(n):
        work.joint_load[i] = joint_load(system, i, memory.dmu)
    return (
        0
        if friction_determinant(memory.friction_A, memory.friction_pivots) > 0.0
        else NO_FRICTION_SOLUTION
    )
