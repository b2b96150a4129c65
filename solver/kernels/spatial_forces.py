"""Spatial forces, and with them the complete equations of a spatial scene."""

from __future__ import annotations

import math

from numba import float64, int64, types

from .compiling import entry, inner
from .dropped import drop_derivatives, drop_rows
from .forces import force_law, time_factor
from .layout import (
    BLOCK,
    EVALUATE,
    F1,
    F_A,
    F_B,
    F_DATA,
    F_KIND,
    F_SEG_A,
    F_SEG_B,
    F_TURN,
    FOLLOWING,
    GIVEN,
    LEAN,
    LINEARISE,
    M_BODY,
    N_ENTRIES,
    N_TURNS,
    NV,
    RD,
    SLIDE,
    SPAN,
    SYSTEM,
    T_A,
    T_B,
    T_DATA,
    T_ENTRY,
    T_KIND,
    TILT,
    TURN_AXIS,
    TURN_RATE,
    TURNED,
    TWIST,
    VEL,
    WORK,
)
from .spatial import segment
from .spatial_columns import PR, PV, PW, PX, R
from .spatial_constraints import NONE, evaluate_constraints
from .spatial_constraints_linear import (
    bending_stiffness,
    force_stiffness,
    line_stiffness,
    linearise_constraints,
    swing_stiffness,
    vary_psi,
    vary_velocity,
)
from .spatial_linear import add_skew
from .vectors import (
    VECTOR,
    cross,
    dot,
    load,
    minus,
    plus,
    rotate,
    rotate_back,
    store,
    times,
)

#: Below this rotation the series of the coefficient of the inverse of T is used.
SMALL_ROTATION = 0.05
#: Largest rotation vector that is known [rad]; torques on its components grow without
#: bound towards a full turn.
FULL_TURN = 6.0


@inner(VECTOR(F1, F1))
def relative_rotation(A, B):
    """Rotation vector from marker A to marker B, in the axes of A; at most pi.

    Near half a turn its direction is a column of R + R^T - 2 cos, else that of the
    skew part of R.
    """
    x = rotate_back(A, PR, (B[PR], B[PR + 3], B[PR + 6]))
    y = rotate_back(A, PR, (B[PR + 1], B[PR + 4], B[PR + 7]))
    z = rotate_back(A, PR, (B[PR + 2], B[PR + 5], B[PR + 8]))
    axis = (0.5 * (y[2] - z[1]), 0.5 * (z[0] - x[2]), 0.5 * (x[1] - y[0]))
    sine, cosine = math.sqrt(dot(axis, axis)), 0.5 * (x[0] + y[1] + z[2] - 1.0)
    angle = math.atan2(sine, cosine)
    if cosine > -0.9:
        return axis if sine < 1e-8 else times(angle / sine, axis)
    if x[0] >= y[1] and x[0] >= z[2]:
        n = (2.0 * (x[0] - cosine), x[1] + y[0], x[2] + z[0])
    elif y[1] >= z[2]:
        n = (x[1] + y[0], 2.0 * (y[1] - cosine), y[2] + z[1])
    else:
        n = (x[2] + z[0], y[2] + z[1], 2.0 * (z[2] - cosine))
    return times(math.copysign(angle, dot(n, axis)) / math.sqrt(dot(n, n)), n)


@inner(VECTOR(VECTOR, VECTOR))
def _continued(theta, known):
    """The rotation vector of the same rotation that is nearest to a known one."""
    n = math.sqrt(dot(theta, theta))
    if n < 1e-8:
        return theta
    turn = 2.0 * math.pi
    size = n + turn * math.floor(0.5 + (dot(theta, known) / n - n) / turn)
    return times(size / n, theta) if abs(size) < FULL_TURN else theta


@inner(VECTOR(VECTOR, VECTOR))
def tilt_direction(theta, e):
    """T^-T e: the torque that works on the component of the rotation vector along e."""
    n2 = dot(theta, theta)
    if n2 < SMALL_ROTATION * SMALL_ROTATION:
        c = 1.0 / 12.0 + n2 / 720.0 + n2 * n2 / 30240.0
    else:
        n = math.sqrt(n2)
        c = 1.0 / n2 - 0.5 / (n * math.tan(0.5 * n))
    turned = cross(theta, e)
    return plus(e, plus(times(0.5, turned), times(c, cross(theta, turned))))


@inner(types.Tuple([float64, VECTOR])(SYSTEM, WORK, int64, float64))
def _angle(system, work, k, known):
    """Value of TWIST, the nearest to a known one, or of LEAN; and the torque that works
    on it, in the axes of A. Of TWIST that is the axis, but for what B is tilted."""
    row, pool = system.turn[k], system.pool
    leans, data = row[T_KIND] == LEAN, row[T_DATA]
    first, second = load(pool, data), load(pool, data + 3)
    b = rotate(work.point[row[T_B]], PR, second if leans else first)
    b = rotate_back(work.point[row[T_A]], PR, b)
    if leans:
        return dot(first, b), cross(b, first)
    axis, turn = cross(first, second), 2.0 * math.pi
    angle = math.atan2(dot(second, b), dot(first, b))
    off = dot(axis, b)
    flat = minus(b, times(off, axis))
    tilt = times(off / max(dot(flat, flat), 1e-300), flat)
    return angle - turn * math.floor(0.5 + (angle - known) / turn), minus(axis, tilt)


@inner(types.void(WORK, int64, int64, float64, VECTOR, VECTOR))
def _keep_turn(work, to, a, value, axis, w):
    """An entry of Work.turn; its axis is given in the axes of marker a."""
    axis = rotate(work.point[a], PR, axis)
    work.turn[to, TURNED] = value
    work.turn[to, TURN_RATE] = dot(axis, w)
    store(work.turn[to], TURN_AXIS, axis)


@inner(types.void(SYSTEM, WORK, F1))
def _turns(system, work, z):
    """Rotations between markers, those that are counted near their values in z."""
    counted = system.dims[N_TURNS]
    for k in range(len(system.turn)):
        row = system.turn[k]
        a, to = row[T_A], row[T_ENTRY]
        A, B = work.point[a], work.point[row[T_B]]
        known = len(z) - counted + to
        w = minus(load(B, PW), load(A, PW))
        if row[T_KIND] != TILT:
            near = z[known] if to < counted else 0.0
            value, axis = _angle(system, work, k, near)
            _keep_turn(work, to, a, value, axis, w)
            continue
        theta = _continued(relative_rotation(A, B), load(z, known))
        for i in range(3):
            e = (
                1.0 if i == 0 else 0.0,
                1.0 if i == 1 else 0.0,
                1.0 if i == 2 else 0.0,
            )
            axis = tilt_direction(theta, e)
            _keep_turn(work, to + i, a, theta[i], axis, w)


@inner(types.Tuple([float64, float64, VECTOR, VECTOR, VECTOR])(SYSTEM, WORK, int64))
def measure(system, work, k):
    """Measure g and its rate, and what a unit force on g does.

    That is a force on marker B and its reverse on A, a torque on A, and one on B.
    """
    row = system.force[k]
    A, B = work.point[row[F_A]], work.point[row[F_B]]
    if row[F_KIND] >= TWIST:
        turn = work.turn[row[F_TURN]]
        axis = load(turn, TURN_AXIS)
        return turn[TURNED], turn[TURN_RATE], NONE, times(-1.0, axis), axis
    x = minus(load(B, PX), load(A, PX))
    v = minus(load(B, PV), load(A, PV))
    if row[F_KIND] == SPAN:
        length = math.sqrt(dot(x, x))
        n = times(1.0 / max(length, 1e-300), x)
        return length, dot(n, v), n, NONE, NONE
    n = rotate(A, PR, load(system.pool, row[F_DATA]))
    arm = cross(n, x)
    return dot(n, x), dot(n, v) + dot(arm, load(A, PW)), n, arm, NONE


@inner(types.UniTuple(VECTOR, 2)(SYSTEM, WORK, int64, float64))
def _given(system, work, k, t):
    """Inertial force and torque of a given force."""
    row = system.force[k]
    data, scale = row[F_DATA], time_factor(system, work, k, t)
    force = times(scale, load(system.pool, data))
    torque = times(scale, load(system.pool, data + 3))
    if row[F_KIND] == FOLLOWING:
        point = work.point[row[F_B]]
        return rotate(point, PR, force), rotate(point, PR, torque)
    return force, torque


@inner(types.void(SYSTEM, WORK, int64, VECTOR, VECTOR))
def _push(system, work, m, force, torque):
    """Adds an inertial force and a torque at a marker to the generalised forces."""
    row = system.body[system.marker[m, M_BODY]]
    if row[NV] > 0:
        segment(system, work, work.f, row[VEL], m, force, torque)


@inner(types.void(SYSTEM, WORK, int64, float64))
def _force(system, work, k, t):
    row = system.force[k]
    if row[F_KIND] <= FOLLOWING:
        force, torque = _given(system, work, k, t)
        _push(system, work, row[F_B], force, torque)
        return
    g, rate, n, torque_a, torque_b = measure(system, work, k)
    work.measure[k, 0], work.measure[k, 1] = g, rate
    size, _, _ = force_law(system, work, k, t, g, rate)
    _push(system, work, row[F_B], times(size, n), times(size, torque_b))
    _push(system, work, row[F_A], times(-size, n), times(size, torque_a))


@entry(EVALUATE)
def evaluate(system, work, t, z, v):
    """Everything that eq. (3) needs at one state: M, f, C, c, dc/dt and gamma."""
    evaluate_constraints(system, work, t, z, v)
    drop_rows(system, work)
    _turns(system, work, z)
    for k in range(len(system.force)):
        _force(system, work, k, t)


@inner(types.void(SYSTEM, WORK, int64, float64))
def _linearise_given(system, work, k, t):
    """Rp of a given force; if it keeps its direction, its arm moves, the body turns."""
    row = system.force[k]
    m = row[F_B]
    body = system.body[system.marker[m, M_BODY]]
    if body[NV] == 0:
        return
    force, torque = _given(system, work, k, t)
    if row[F_KIND] != GIVEN:
        bending_stiffness(system, work, m, force, torque)
        return
    force_stiffness(system, work, m, force)
    bending_stiffness(system, work, m, NONE, torque)
    if body[RD] == 6:
        torque = rotate_back(work.frame[system.marker[m, M_BODY]], R, torque)
        at = body[BLOCK] + 3 * body[NV] + 3
        add_skew(work.Rp, at, body[NV], torque, -1.0)


@inner(types.void(SYSTEM, WORK, int64, float64, F1))
def _linearise_force(system, work, k, t, v):
    """The row of a force: its direction, its stiffness and its damping."""
    row = system.force[k]
    kind = row[F_KIND]
    ma, mb = row[F_A], row[F_B]
    A, B = work.point[ma], work.point[mb]
    g, rate, n, torque_a, torque_b = measure(system, work, k)
    force, stiffness, damping = force_law(system, work, k, t, g, rate)
    x, vel = minus(load(B, PX), load(A, PX)), minus(load(B, PV), load(A, PV))
    position, turn_a = times(stiffness, n), times(stiffness, torque_a)
    turn_b = times(stiffness, torque_b)
    if kind == SPAN and g > 1e-12:
        across = minus(vel, times(rate, n))
        position = plus(position, times(damping / g, across))
    elif kind == SLIDE:
        wn = cross(load(A, PW), n)
        position = plus(position, times(damping, wn))
        turn = plus(cross(n, vel), cross(wn, x))
        turn_a = plus(turn_a, times(damping, turn))
    elif kind >= TWIST:
        turn_a = plus(turn_a, times(damping, cross(torque_b, load(B, PW))))
        turn_b = plus(turn_b, times(damping, cross(load(B, PW), torque_b)))
    for side in range(2):
        o = row[F_SEG_A] if side == 0 else row[F_SEG_B]
        if o < 0:
            continue
        m = ma if side == 0 else mb
        sign = -1.0 if side == 0 else 1.0
        torque = torque_a if side == 0 else torque_b
        turn = turn_a if side == 0 else turn_b
        segment(system, work, work.C, o, m, times(sign, n), torque)
        segment(system, work, work.Gp, o, m, times(sign, position), turn)
        segment(system, work, work.Gv, o, m, NONE, times(damping, torque))
        vary_psi(system, work, work.Gp, o, m, times(damping, torque), v)
        if kind >= TWIST:
            bending_stiffness(system, work, m, NONE, times(force, torque))
            continue
        vary_velocity(system, work, o, m, times(sign * damping, n), v)
        if kind == SPAN:
            force_stiffness(system, work, m, times(sign * force, n))
            if g > 1e-12:
                swing_stiffness(system, work, m, n, -force / g)
    if kind == SLIDE:
        line_stiffness(system, work, ma, mb, n, x, force)


@entry(LINEARISE)
def linearise(system, work, t, z, v, acc, lam):
    """Rp, Rv, Gp, Gv at a state that was just evaluated.

    Exact for rigid bodies, except that Rp leaves out how the motion of one body turns
    the constraint force or the force on another, and how forces turn that follow their
    body; for flexible ones the turning of a marker by the elastic coordinates is
    linearised. A Newton matrix may do with that.
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
