"""Spatial constraints c(z_I, t) = 0, their rates and right-hand sides."""

from __future__ import annotations

import math

from numba import float64, int64, types

from .compiling import inner
from .drives import drive_value
from .layout import (
    ALONG,
    C_DATA,
    C_DRIVE,
    COINCIDENT,
    COUPLED_ALONG,
    COUPLED_ANGLE,
    DISTANCE,
    EVALUATE,
    KIND,
    MARKER_A,
    MARKER_B,
    PERPENDICULAR,
    ROW,
    S_OFFSET,
    SEG_A,
    SEG_B,
    SYSTEM,
    TERM_SPATIAL,
    W_WEIGHT,
    WORK,
)
from .rows import add_term, is_coupled, write_row
from .spatial import evaluate_bodies, segment
from .spatial_columns import PA, PAL, PR, PV, PW, PX
from .vectors import VECTOR, cross, dot, load, minus, plus, rotate, times

NONE = (0.0, 0.0, 0.0)
X_AXIS, Y_AXIS, Z_AXIS = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@inner(types.void(SYSTEM, WORK, int64, int64, VECTOR, VECTOR, VECTOR, VECTOR))
def _write_row(system, work, k, i, fa, ta, fb, tb):
    """Row i of constraint k in C: force and torque at marker A and at marker B."""
    con = system.constraint[k]
    if con[SEG_A] >= 0:
        o = system.segment[con[SEG_A] + i, S_OFFSET]
        segment(system, work, work.C, o, con[MARKER_A], fa, ta)
    if con[SEG_B] >= 0:
        o = system.segment[con[SEG_B] + i, S_OFFSET]
        segment(system, work, work.C, o, con[MARKER_B], fb, tb)


@inner(types.UniTuple(VECTOR, 4)(SYSTEM, WORK, int64, float64, float64, float64))
def driven_direction(system, work, k, s, sd, sdd):
    """Direction u of marker A in u . b = 0, its rate and acceleration, and b of B.

    PERPENDICULAR: u is fixed in A. ANGLE: u = cos s second - sin s first, so that u . b
    is the sine of the angle beyond s, with b the first direction of B.
    """
    con = system.constraint[k]
    pool, data = system.pool, con[C_DATA]
    A, B = work.point[con[MARKER_A]], work.point[con[MARKER_B]]
    first = rotate(A, PR, load(pool, data))
    w, al = load(A, PW), load(A, PAL)
    if con[KIND] == PERPENDICULAR:
        u, p = first, (0.0, 0.0, 0.0)
        b = rotate(B, PR, load(pool, data + 3))
    else:
        second = rotate(A, PR, load(pool, data + 3))
        b = rotate(B, PR, load(pool, data))
        c, sn = math.cos(s), math.sin(s)
        u = minus(times(c, second), times(sn, first))
        p = plus(times(c, first), times(sn, second))
    wu = cross(w, u)
    rate = minus(wu, times(sd, p))
    acc = plus(cross(al, u), cross(w, wu))
    acc = minus(acc, plus(times(2.0 * sd, cross(w, p)), times(sdd, p)))
    acc = minus(acc, times(sd * sd, u))
    return u, rate, acc, b


@inner(types.Tuple((VECTOR, float64))(SYSTEM, WORK, int64))
def turned_angle(system, work, k):
    """Axis of a coupled angle, and the angle in (-pi, pi].

    It is measured from the first direction of marker A to that of marker B about the
    axis fixed in A. Its rate is the axis times the relative angular velocity as long
    as the direction in B stays at right angles to the axis.
    """
    con = system.constraint[k]
    A, B = work.point[con[MARKER_A]], work.point[con[MARKER_B]]
    first = load(system.pool, con[C_DATA])
    u = rotate(A, PR, first)
    w = rotate(A, PR, load(system.pool, con[C_DATA] + 3))
    b = rotate(B, PR, first)
    return cross(u, w), math.atan2(dot(w, b), dot(u, b))


@inner(types.void(SYSTEM, WORK, int64, float64))
def _constraint(system, work, k, t):
    con = system.constraint[k]
    kind, r, data = con[KIND], con[ROW], con[C_DATA]
    A, B, pool = work.point[con[MARKER_A]], work.point[con[MARKER_B]], system.pool
    s, sd, sdd = 0.0, 0.0, 0.0
    if con[C_DRIVE] >= 0:
        s, sd, sdd = drive_value(system, con[C_DRIVE], work.clock[0], t)
    x = minus(load(B, PX), load(A, PX))
    v = minus(load(B, PV), load(A, PV))
    a = minus(load(B, PA), load(A, PA))
    wa, wb = load(A, PW), load(B, PW)
    if kind == COINCIDENT:
        for i in range(3):
            write_row(work, r + i, x[i], v[i], -a[i])
            e = X_AXIS if i == 0 else (Y_AXIS if i == 1 else Z_AXIS)
            _write_row(system, work, k, i, times(-1.0, e), NONE, e, NONE)
        return
    value, rate, gamma = 0.0, 0.0, 0.0
    fa, ta, fb, tb = NONE, NONE, NONE, NONE
    if kind in (ALONG, COUPLED_ALONG):
        n = rotate(A, PR, load(pool, data))
        wn = cross(wa, n)
        value = dot(n, x) - s - pool[data + 3]
        rate = dot(n, v) + dot(wn, x) - sd
        turn = plus(cross(load(A, PAL), n), cross(wa, wn))
        gamma = sdd - dot(n, a) - 2.0 * dot(wn, v) - dot(turn, x)
        fa, ta, fb = times(-1.0, n), cross(n, x), n
    elif kind == DISTANCE:
        length = math.sqrt(dot(x, x))
        n = times(1.0 / length, x)
        along = dot(n, v)
        value = length - s - pool[data]
        rate = along - sd
        swing = (dot(v, v) - along * along) / length
        gamma = sdd - dot(n, a) - swing
        fa, fb = times(-1.0, n), n
    elif kind == COUPLED_ANGLE:
        n, value = turned_angle(system, work, k)
        rate = dot(n, minus(wb, wa))
        gamma = dot(n, minus(load(A, PAL), load(B, PAL))) - dot(cross(wa, n), wb)
        ta, tb = times(-1.0, n), n
    else:
        u, ud, udd, b = driven_direction(system, work, k, s, sd, sdd)
        bd = cross(wb, b)
        bdd = plus(cross(load(B, PAL), b), cross(wb, bd))
        ta = cross(u, b)
        tb = times(-1.0, ta)
        value = dot(u, b)
        rate = dot(ud, b) + dot(u, bd)
        gamma = -dot(udd, b) - 2.0 * dot(ud, bd) - dot(u, bdd)
    if is_coupled(kind):
        term = data + TERM_SPATIAL
        weight = pool[term + W_WEIGHT]
        add_term(system, work, r, term, value, rate, gamma)
        fa, ta = times(weight, fa), times(weight, ta)
        fb, tb = times(weight, fb), times(weight, tb)
    else:
        write_row(work, r, value, rate, gamma)
    _write_row(system, work, k, 0, fa, ta, fb, tb)


@inner(EVALUATE)
def evaluate_constraints(system, work, t, z, v):
    """Everything that eq. (3) needs at one state: M, f, C, c, dc/dt and gamma."""
    evaluate_bodies(system, work, t, z, v)
    for i in range(len(work.C)):
        work.C[i] = 0.0
    for k in range(len(system.constraint)):
        _constraint(system, work, k, t)
