"""Planar forces, and with them the complete equations of a planar scene."""

from __future__ import annotations

import math

from numba import float64, int64, types

from .compiling import entry, inner
from .dropped import drop_derivatives, drop_rows
from .forces import force_law, time_factor
from .layout import (
    EVALUATE,
    F1,
    F_A,
    F_B,
    F_DATA,
    F_KIND,
    F_SEG_A,
    F_SEG_B,
    FOLLOWING,
    LINEARISE,
    M_BODY,
    N_ENTRIES,
    NV,
    SLIDE,
    SPAN,
    SYSTEM,
    TWIST,
    VEL,
    WORK,
)
from .planar import segment
from .planar_columns import PVX, PVY, PX, PY, TH, TW
from .planar_constraints import (
    add_outer,
    direction_stiffness,
    evaluate_constraints,
    force_stiffness,
    linearise_constraints,
    torque_stiffness,
    vary_psi,
    vary_velocity,
)


@inner(types.UniTuple(float64, 6)(SYSTEM, WORK, int64))
def measure(system, work, k):
    """Measure g and its rate, and what a unit force on g does.

    That is a force (x, y) on marker B and its reverse on A, a torque on A, one on B.
    """
    row = system.force[k]
    A, B = work.point[row[F_A]], work.point[row[F_B]]
    if row[F_KIND] == TWIST:
        turned = B[TH] - A[TH] - system.pool[row[F_DATA]]
        return turned, B[TW] - A[TW], 0.0, 0.0, -1.0, 1.0
    x, y = B[PX] - A[PX], B[PY] - A[PY]
    vx, vy = B[PVX] - A[PVX], B[PVY] - A[PVY]
    if row[F_KIND] == SPAN:
        length = math.sqrt(x * x + y * y)
        ex, ey = x / max(length, 1e-300), y / max(length, 1e-300)
        return length, ex * vx + ey * vy, ex, ey, 0.0, 0.0
    angle = A[TH] + system.pool[row[F_DATA]]
    ex, ey = math.cos(angle), math.sin(angle)
    across = ex * y - ey * x
    rate = ex * vx + ey * vy + A[TW] * across
    return ex * x + ey * y, rate, ex, ey, across, 0.0


@inner(types.UniTuple(float64, 3)(SYSTEM, WORK, int64, float64))
def _given(system, work, k, t):
    """Inertial force and torque of a given force."""
    row = system.force[k]
    data, scale = row[F_DATA], time_factor(system, work, k, t)
    fx, fy = scale * system.pool[data], scale * system.pool[data + 1]
    torque = scale * system.pool[data + 2]
    if row[F_KIND] == FOLLOWING:
        angle = work.point[row[F_B]][TH]
        c, s = math.cos(angle), math.sin(angle)
        fx, fy = c * fx - s * fy, s * fx + c * fy
    return fx, fy, torque


@inner(types.void(SYSTEM, WORK, int64, float64, float64, float64))
def _push(system, work, m, fx, fy, torque):
    """Adds an inertial force and a torque at a marker to the generalised forces."""
    row = system.body[system.marker[m, M_BODY]]
    if row[NV] > 0:
        segment(system, work, work.f, row[VEL], m, fx, fy, torque)


@inner(types.void(SYSTEM, WORK, int64, float64))
def _force(system, work, k, t):
    row = system.force[k]
    if row[F_KIND] <= FOLLOWING:
        fx, fy, torque = _given(system, work, k, t)
        _push(system, work, row[F_B], fx, fy, torque)
        return
    g, rate, ex, ey, torque_a, torque_b = measure(system, work, k)
    work.measure[k, 0], work.measure[k, 1] = g, rate
    force, _, _ = force_law(system, work, k, t, g, rate)
    _push(system, work, row[F_B], force * ex, force * ey, force * torque_b)
    _push(system, work, row[F_A], -force * ex, -force * ey, force * torque_a)


@entry(EVALUATE)
def evaluate(system, work, t, z, v):
    """Everything that eq. (3) needs at one state: M, f, C, c, dc/dt and gamma."""
    evaluate_constraints(system, work, t, z, v)
    drop_rows(system, work)
    for k in range(len(system.force)):
        _force(system, work, k, t)


@inner(types.void(SYSTEM, WORK, int64, float64))
def _linearise_given(system, work, k, t):
    """Rp of a given force: its arm moves, and a following one turns."""
    row = system.force[k]
    m, fx, fy = row[F_B], 0.0, 0.0
    b = system.marker[m, M_BODY]
    if system.body[b, NV] == 0:
        return
    fx, fy, torque = _given(system, work, k, t)
    force_stiffness(system, work, m, fx, fy)
    torque_stiffness(system, work, m, torque)
    if row[F_KIND] == FOLLOWING:
        size = len(work.scratch) // 2
        for i in range(2 * size):
            work.scratch[i] = 0.0
        segment(system, work, work.scratch, 0, m, -fy, fx, 0.0)
        segment(system, work, work.scratch, size, m, 0.0, 0.0, 1.0)
        add_outer(system, work, b, 0, size, -1.0)


@inner(types.void(SYSTEM, WORK, int64, float64, F1))
def _linearise_force(system, work, k, t, v):
    """The row of a force: its direction, its stiffness and its damping."""
    row = system.force[k]
    kind = row[F_KIND]
    g, rate, ex, ey, torque_a, torque_b = measure(system, work, k)
    force, stiffness, damping = force_law(system, work, k, t, g, rate)
    A, B = work.point[row[F_A]], work.point[row[F_B]]
    vx, vy, w = B[PVX] - A[PVX], B[PVY] - A[PVY], A[TW]
    posx, posy = stiffness * ex, stiffness * ey
    turn_a, along, bend, slide = stiffness * torque_a, 0.0, 0.0, 0.0
    if kind == SPAN and g > 1e-12:
        bend = -force / g
        posx += damping * (vx - rate * ex) / g
        posy += damping * (vy - rate * ey) / g
    elif kind == SLIDE:
        along, slide = g, force
        posx -= damping * w * ey
        posy += damping * w * ex
        turn_a += damping * (ex * vy - ey * vx - w * along)
    size = len(work.scratch) // 2
    for side in range(2):
        o = row[F_SEG_A] if side == 0 else row[F_SEG_B]
        if o < 0:
            continue
        m = row[F_A] if side == 0 else row[F_B]
        sign = -1.0 if side == 0 else 1.0
        torque = torque_a if side == 0 else torque_b
        turn = turn_a if side == 0 else stiffness * torque_b
        segment(system, work, work.C, o, m, sign * ex, sign * ey, torque)
        segment(system, work, work.Gp, o, m, sign * posx, sign * posy, turn)
        segment(system, work, work.Gv, o, m, 0.0, 0.0, damping * torque)
        vary_psi(system, work, work.Gp, o, m, damping * torque, v)
        torque_stiffness(system, work, m, force * torque)
        if kind == TWIST:
            continue
        e = sign * damping
        vary_velocity(system, work, o, m, e * ex, e * ey, v)
        force_stiffness(system, work, m, sign * force * ex, sign * force * ey)
        if kind == SPAN or side == 0:
            direction_stiffness(system, work, m, size, -ey, ex, slide, along, bend)


@entry(LINEARISE)
def linearise(system, work, t, z, v, acc, lam):
    """Rp, Rv, Gp, Gv at a state that was just evaluated.

    Exact, except that Rp leaves out how the motion of one body turns the constraint
    force or the force on another; a Newton matrix may do without.
    """
    linearise_constraints(system, work, t, z, v, acc, lam)
    drop_derivatives(system, work)
    for i in range(system.dims[N_ENTRIES], len(work.C)):
        work.C[i] = 0.0
    for k in range(len(system.force)):
        if system.force[k, F_KIND] <= FOLLOWING:
            _linearise_given(system, work, k, t)
        else:
            _linearise_force(system, work, k, t, v)
