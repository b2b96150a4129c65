"""Spatial constraints c(z_I, t) = 0, their rates and right-hand sides."""

from __future__ import annotations

import math

from numba import float64, int64, types

from .compiling import inner
from .drives import drive_value
from .layout import (
    ALONG,
    ANGLE,
    C_DATA,
    C_DRIVE,
    C_GAMMA,
    C_RATE,
    C_VALUE,
    COINCIDENT,
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
    WORK,
)
from .spatial import (
    PA,
    PAL,
    PR,
    PV,
    PW,
    PX,
    VECTOR,
    cross,
    dot,
    evaluate_bodies,
    load,
    minus,
    plus,
    rotate,
    segment,
    times,
)

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


@inner(types.void(SYSTEM, WORK, int64, float64))
def _constraint(system, work, k, t):
    con = system.constraint[k]
    kind, r, data, row = con[KIND], con[ROW], con[C_DATA], work.row
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
            row[r + i, C_VALUE] = x[i]
            row[r + i, C_RATE] = v[i]
            row[r + i, C_GAMMA] = -a[i]
            e = X_AXIS if i == 0 else (Y_AXIS if i == 1 else Z_AXIS)
            _write_row(system, work, k, i, times(-1.0, e), NONE, e, NONE)
    elif kind == ALONG:
        n = rotate(A, PR, load(pool, data))
        wn = cross(wa, n)
        row[r, C_VALUE] = dot(n, x) - s - pool[data + 3]
        row[r, C_RATE] = dot(n, v) + dot(wn, x) - sd
        turn = plus(cross(load(A, PAL), n), cross(wa, wn))
        row[r, C_GAMMA] = sdd - dot(n, a) - 2.0 * dot(wn, v) - dot(turn, x)
        _write_row(system, work, k, 0, times(-1.0, n), cross(n, x), n, NONE)
    elif kind == DISTANCE:
        length = math.sqrt(dot(x, x))
        n = times(1.0 / length, x)
        along = dot(n, v)
        row[r, C_VALUE] = length - s - pool[data]
        row[r, C_RATE] = along - sd
        swing = (dot(v, v) - along * along) / length
        row[r, C_GAMMA] = sdd - dot(n, a) - swing
        _write_row(system, work, k, 0, times(-1.0, n), NONE, n, NONE)
    elif kind in (PERPENDICULAR, ANGLE):
        u, ud, udd, b = driven_direction(system, work, k, s, sd, sdd)
        bd = cross(wb, b)
        bdd = plus(cross(load(B, PAL), b), cross(wb, bd))
        torque = cross(u, b)
        row[r, C_VALUE] = dot(u, b)
        row[r, C_RATE] = dot(ud, b) + dot(u, bd)
        row[r, C_GAMMA] = -dot(udd, b) - 2.0 * dot(ud, bd) - dot(u, bdd)
        _write_row(system, work, k, 0, NONE, torque, NONE, times(-1.0, torque))


@inner(EVALUATE)
def evaluate_constraints(system, work, t, z, v):
    """Everything that eq. (3) needs at one state: M, f, C, c, dc/dt and gamma."""
    evaluate_bodies(system, work, t, z, v)
    for i in range(len(work.C)):
        work.C[i] = 0.0
    for k in range(len(system.constraint)):
        _constraint(system, work, k, t)
