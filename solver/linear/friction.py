"""Friction of joints from their multipliers: theory, section 14, eq. (32) to (35).

The coordinate of a joint with friction has a row like a constraint, in the tables of
`System.sliding`. While the joint sticks the row is one, at velocity and position. While
it slides its force follows from the multipliers of the joint. Both are found beside the
equations of the bodies, which keep their symmetric factors: with X, L the accelerations
and multipliers of unit forces along the coordinates, a few equations for the forces t
are left.
"""

from __future__ import annotations

import math

from numba import float64, int64, types

from ..compiler.compiling import inner
from ..space.layout import (
    C_GAMMA,
    C_RATE,
    C_VALUE,
    F1,
    F2,
    HELD,
    I1,
    L_ARM,
    L_PERIOD,
    L_SLIDING,
    L_SPEED,
    L_STATIC,
    L_VISCOUS,
    R_COUNT,
    R_LAW,
    R_LOAD,
    R_NEWTON,
    R_PLACES,
    R_ROWS,
    SHARED,
    SIDE,
    SYSTEM,
    WORK,
)
from .grips import sense_of, sticks
from .memory import MEMORY
from .saddle import band_factor, band_solve

#: Newton's iterations for the forces of friction, the relative change at their end,
#: and that of which they may not shrink any more.
ITERATIONS, SETTLED, ROUNDING = 60, 1e-13, 1e-6
#: Compliance by which joints that stick share what they hold together, and the least
#: limit of friction that counts in it, relative.
SHARE, LEAST_LIMIT = 1e-3, 1e-6
#: How often limits are found anew for that.
ROUNDS = 4
#: Code of a state in which friction has no solution, or not one alone.
JAMMED = 6


@inner(types.UniTuple(float64, 2)(SYSTEM, int64, float64))
def limit(system, j, rate):
    """Friction of a unit load at a rate of the coordinate, and its derivative."""
    law, pool = system.friction[j, R_LAW], system.pool
    arm, width = pool[law + L_ARM], pool[law + L_SPEED]
    if width == 0.0:
        return arm * pool[law + L_SLIDING], 0.0
    x = arm * rate / width
    more = (pool[law + L_STATIC] - pool[law + L_SLIDING]) * math.exp(-x * x)
    size = arm * (pool[law + L_SLIDING] + more)
    return size, -2.0 * arm * arm * more * x / width


@inner(types.UniTuple(float64, 2)(SYSTEM, int64, int64, F1))
def pressure(system, j, place, multiplier):
    """The force at a place of contact of a joint, in two directions across its axis."""
    row, pool = system.friction[j], system.pool
    count = row[R_COUNT]
    first, a, b = row[R_LOAD] + 2 * place * count, 0.0, 0.0
    for r in range(count):
        force = multiplier[row[R_ROWS + r]]
        a += pool[first + r] * force
        b += pool[first + count + r] * force
    return a, b


@inner(float64(SYSTEM, int64, F1))
def load_of(system, j, multiplier):
    """The load of a joint: the sizes of the forces at its places of contact.

    A force that has a single direction counts with the sign of the side on which the
    place is pressed, so that the load is smooth where it turns round.
    """
    total = 0.0
    for place in range(system.friction[j, R_PLACES]):
        a, b = pressure(system, j, place, multiplier)
        side = system.grip[j, SIDE + place]
        total += math.sqrt(a * a + b * b) if side == 0.0 else side * a
    return total


@inner(float64(SYSTEM, int64, F1, int64))
def load_by(system, j, multiplier, r):
    """The derivative of the load by multiplier r of those that make it."""
    row, pool, total = system.friction[j], system.pool, 0.0
    count = row[R_COUNT]
    for place in range(row[R_PLACES]):
        first = row[R_LOAD] + 2 * place * count
        a, b = pressure(system, j, place, multiplier)
        side, size = system.grip[j, SIDE + place], math.sqrt(a * a + b * b)
        if side != 0.0:
            total += side * pool[first + r]
        elif size > 0.0:
            total += (a * pool[first + r] + b * pool[first + count + r]) / size
    return total


@inner(types.void(SYSTEM, WORK, F2))
def directions(system, work, X):
    """Generalised forces of unit forces along the coordinates."""
    table = system.sliding.segment
    for j in range(len(X)):
        for i in range(X.shape[1]):
            X[j, i] = 0.0
    for k in range(len(table)):
        j, at, b = table[k].row, table[k].offset, table[k].body
        first = system.body[b].vel
        for i in range(system.body[b].nv):
            X[j, first + i] += work.C[at + i]


@inner(float64(SYSTEM, WORK, int64, F1))
def along(system, work, j, x):
    """The rate of a coordinate that velocities x make."""
    table, total = system.sliding.segment, 0.0
    for k in range(len(table)):
        if table[k].row == j:
            at, b = table[k].offset, table[k].body
            first = system.body[b].vel
            for i in range(system.body[b].nv):
                total += work.C[at + i] * x[first + i]
    return total


@inner(types.void(SYSTEM, WORK))
def hold_rows(system, work):
    """After the constraints were evaluated: coordinates count from where they stick."""
    row = work.sliding.row
    for j in range(len(system.friction)):
        value = row[j, C_VALUE] - system.grip[j, HELD]
        period = system.pool[system.friction[j, R_LAW] + L_PERIOD]
        if period > 0.0:
            value -= period * math.floor(value / period + 0.5)
        row[j, C_VALUE] = value


@inner(types.void(SYSTEM, WORK))
def linearise_friction(system, work):
    """Rows of sliding joints in Newton matrices, after they were linearised as stuck.

    Forces of friction t obey t + sense mu(rate) N(lambda) + viscous rate = 0.
    """
    table = system.sliding.segment
    for k in range(len(table)):
        j, at, b = table[k].row, table[k].offset, table[k].body
        if sticks(system, j):
            continue
        _, limited = limit(system, j, work.sliding.row[j, C_RATE])
        damping = sense_of(system, work, j) * limited * work.load[j]
        damping += system.pool[system.friction[j, R_LAW] + L_VISCOUS]
        for i in range(at, at + system.body[b].nv):
            work.Gp[i] = 0.0
            work.Gv[i] = damping * work.C[i]


@inner(types.void(SYSTEM, WORK, F1, F2))
def _share(system, work, multiplier, P):
    """How compliant joints that stick are, into the last column of P.

    In proportion to sqrt(P_jj) / limit: what one motion takes is then shared in
    proportion to what each can hold, so that all break loose together.
    """
    n, largest, stiffest = len(P), 0.0, 0.0
    for j in range(n):
        law = system.friction[j, R_LAW]
        limit_ = system.pool[law + L_STATIC] * system.pool[law + L_ARM]
        P[j, n + 1] = limit_ * load_of(system, j, multiplier)
        largest = max(largest, P[j, n + 1])
    for j in range(n):
        held = max(P[j, n + 1], LEAST_LIMIT * largest, 1e-300)
        P[j, n + 1] = 0.0
        if system.grip[j, SHARED] > 0.0 and P[j, j] > 0.0:
            P[j, n + 1] = 1.0 / (math.sqrt(P[j, j]) * held)
            stiffest = max(stiffest, P[j, n + 1])
    for j in range(n):
        P[j, n + 1] *= SHARE / max(stiffest, 1e-300)


@inner(float64(SYSTEM, WORK, int64, F1))
def _opposed(system, work, j, multiplier):
    """sense mu(rate) N(lambda) + viscous rate of a joint that slides, with its
    derivatives by the multipliers in `work.rubbing`."""
    rate = work.sliding.row[j, C_RATE]
    size, _ = limit(system, j, rate)
    size *= sense_of(system, work, j)
    for r in range(system.friction[j, R_COUNT]):
        work.rubbing[j, r] = size * load_by(system, j, multiplier, r)
    viscous = system.pool[system.friction[j, R_LAW] + L_VISCOUS]
    return size * load_of(system, j, multiplier) + viscous * rate


@inner(types.void(SYSTEM, WORK, F1, float64, F1, F1))
def friction_residual(system, work, forces, scale, p, g):
    """Right-hand sides where multipliers and forces of friction t are both unknowns.

    Adds t, scaled, along the coordinates to p. Into the rows of friction in g: of what
    sticks how far it is from where it is held, of what slides t + sense mu(rate)
    N(lambda) + viscous rate, scaled; both with the sign of a correction.

    forces : the multipliers, and behind them t
    """
    first = system.n_rows
    for j in range(len(system.friction)):
        row, t = system.friction[j, R_NEWTON], forces[first + j]
        g[row] = -work.sliding.row[j, C_VALUE]
        if not sticks(system, j):
            work.load[j] = load_of(system, j, forces)
            g[row] = -scale * (t + _opposed(system, work, j, forces))
    table = system.sliding.segment
    for k in range(len(table)):
        t = scale * forces[first + table[k].row]
        at, b = table[k].offset, table[k].body
        start = system.body[b].vel
        for i in range(system.body[b].nv):
            p[start + i] += work.C[at + i] * t


@inner(float64(SYSTEM, WORK, int64, F1, F2, F2, F2))
def _equation(system, work, i, multiplier, L, P, A):
    """What is left of the equation of joint i, and its derivatives in row i of A.

    The acceleration along a coordinate that sticks, in units of force, or t + sense
    mu(rate) N(lambda) + viscous rate; less what all t add to the first and t to the
    other.
    """
    n = len(A)
    if sticks(system, i):
        for k in range(n):
            A[i, k] = P[i, k] / P[i, i]
        A[i, i] += P[i, n + 1]
        return (P[i, n] - work.sliding.row[i, C_GAMMA]) / P[i, i]
    opposed = _opposed(system, work, i, multiplier)
    for k in range(n):
        A[i, k] = 1.0 if i == k else 0.0
    for r in range(system.friction[i, R_COUNT]):
        change = work.rubbing[i, r]
        for k in range(n):
            A[i, k] += change * L[k, system.friction[i, R_ROWS + r]]
    return opposed


@inner(types.void(WORK, MEMORY))
def _multipliers(work, memory):
    """The multipliers with friction as it is in `work.rub`, into dmu."""
    for r in range(len(memory.dmu)):
        memory.dmu[r] = memory.multiplier[r]
        for k in range(len(work.rub)):
            memory.dmu[r] += work.rub[k] * memory.rub_L[k, r]


@inner(int64(SYSTEM, WORK, MEMORY))
def _iterate(system, work, memory):
    """Newton's iteration for the forces of friction, from none; 0 or JAMMED.

    Compliance stands in the matrix alone: of what sticks it chooses one solution, and
    leaves no acceleration.
    """
    L, P, A, dt = memory.rub_L, memory.rub_P, memory.rub_A, memory.rub_t
    lam, n, t, before = memory.dmu, len(A), work.rub, math.inf
    for i in range(n):
        t[i] = 0.0
    for _ in range(ITERATIONS):
        _multipliers(work, memory)
        size = 0.0
        for i in range(n):
            dt[i] = -_equation(system, work, i, lam, L, P, A)
            size = max(size, abs(dt[i]))
            if not sticks(system, i):
                dt[i] -= t[i]
            else:
                for k in range(n):
                    dt[i] -= P[i, k] / P[i, i] * t[k]
        if band_factor(A, n, n, memory.rub_pivots) != 0:
            return JAMMED
        band_solve(A, n, n, memory.rub_pivots, dt)
        change = 0.0
        for i in range(n):
            t[i] += dt[i]
            size, change = max(size, abs(t[i])), max(change, abs(dt[i]))
        if change <= SETTLED * size or (change >= before and change <= ROUNDING * size):
            return 0
        before = change
    return JAMMED


@inner(float64(F2, I1))
def solvability(A, pivots):
    """Determinant of the equations of friction from their factor: 1 without friction,
    not positive where they have no solution, or not one alone."""
    whole = 1.0
    for i in range(len(A)):
        whole *= A[i, i] if pivots[i] == i else -A[i, i]
    return whole


@inner(int64(SYSTEM, WORK, MEMORY))
def solve_friction(system, work, memory):
    """Forces of friction, into `work.rub`, with the loads that make them.

    acceleration, multiplier of `memory` are without friction; rub_X, rub_L what a unit
    force along each coordinate adds to them.

    Returns 0, or JAMMED where friction has no solution, or not one alone.
    """
    P, n, shared = memory.rub_P, len(memory.rub_A), False
    for i in range(n):
        work.rub[i] = 0.0
        P[i, n] = along(system, work, i, memory.acceleration)
        for k in range(n):
            P[i, k] = along(system, work, i, memory.rub_X[k])
        if sticks(system, i) and system.grip[i, SHARED] > 0.0:
            shared = True
    for k in range(ROUNDS):
        if k > 0 and not shared:
            break
        _multipliers(work, memory)
        _share(system, work, memory.dmu, P)
        if _iterate(system, work, memory) != 0:
            return JAMMED
    _multipliers(work, memory)
    for i in range(n):
        work.load[i] = load_of(system, i, memory.dmu)
    return 0 if solvability(memory.rub_A, memory.rub_pivots) > 0.0 else JAMMED
