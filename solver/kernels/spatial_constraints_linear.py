"""Derivatives of spatial constraints: Gp, Gv, and Rp from the constraint forces."""

from __future__ import annotations

import math

from numba import float64, int64, types

from .compiling import inner
from .drives import drive_value
from .layout import (
    ALONG,
    BLOCK,
    C_DATA,
    C_DRIVE,
    COINCIDENT,
    COUPLED_ALONG,
    COUPLED_ANGLE,
    DISTANCE,
    F1,
    KIND,
    LINEARISE,
    M_BODY,
    M_PHI,
    M_PHI1,
    M_PSI1,
    MARKER_A,
    MARKER_B,
    NQ,
    NV,
    RD,
    ROW,
    S_OFFSET,
    SEG_A,
    SEG_B,
    SYSTEM,
    TERM_SPATIAL,
    VEL,
    W_WEIGHT,
    WORK,
)
from .spatial import segment
from .spatial_columns import ALPHA, OMEGA, PA, PAL, PR, PV, PW, PX, D, R, T, U, V
from .spatial_constraints import (
    NONE,
    X_AXIS,
    Y_AXIS,
    Z_AXIS,
    driven_direction,
    turned_angle,
)
from .spatial_linear import (
    add_column,
    add_row,
    add_skew,
    add_skew_product,
    linearise_body,
)
from .vectors import (
    VECTOR,
    column,
    cross,
    dot,
    load,
    minus,
    plus,
    rotate,
    rotate_back,
    times,
)


@inner(types.UniTuple(VECTOR, 2)(SYSTEM, WORK, int64, F1))
def marker_acceleration(system, work, m, acc):
    """Inertial acceleration and angular acceleration of a marker."""
    b = system.marker[m, M_BODY]
    row = system.body[b]
    frame, point, phi = work.frame[b], work.point[m], system.marker[m, M_PHI]
    nq, rd, first = row[NQ], row[RD], row[VEL]
    psi = phi + 3 * nq
    a, al, twist = NONE, NONE, NONE
    if rd >= 3:
        a = load(acc, first)
    if rd == 6:
        al = load(acc, first + 3)
        a = plus(a, cross(al, load(point, D)))
    for k in range(nq):
        a = plus(a, times(acc[first + rd + k], column(work.phi, phi, nq, k)))
        twist = plus(twist, times(acc[first + rd + k], column(work.phi, psi, nq, k)))
    if nq > 0:
        al = plus(al, rotate(point, T, twist))
    a = plus(load(point, PA), rotate(frame, R, a))
    return a, plus(load(point, PAL), rotate(frame, R, al))


@inner(types.void(SYSTEM, WORK, int64, int64, VECTOR, F1, F1))
def _vary_acceleration(system, work, o, m, e, v, acc):
    """Adds to Gp and Gv the derivatives of a marker's acceleration along e."""
    b = system.marker[m, M_BODY]
    row = system.body[b]
    frame, point, pool = work.frame[b], work.point[m], system.pool
    nq, rd, first = row[NQ], row[RD], row[VEL]
    h, w = rotate_back(frame, R, e), load(frame, OMEGA)
    al = load(frame, ALPHA)
    hw = cross(h, w)
    if rd >= 3:
        add_row(work.Gv, o, hw)
    if rd == 6:
        al = plus(al, load(acc, first + 3))
        a, _ = marker_acceleration(system, work, m, acc)
        d, u = load(point, D), load(point, U)
        add_row(work.Gp, o + 3, cross(rotate_back(frame, R, a), h))
        g = plus(cross(load(frame, V), h), cross(cross(w, d), h))
        g = plus(g, plus(cross(d, hw), times(2.0, cross(u, h))))
        add_row(work.Gv, o + 3, g)
    phi, phi1 = system.marker[m, M_PHI], system.marker[m, M_PHI1]
    weight = plus(cross(h, al), cross(cross(h, w), w))
    for k in range(nq):
        p = column(work.phi, phi, nq, k)
        work.Gp[o + rd + k] += dot(weight, p)
        work.Gv[o + rd + k] += 2.0 * dot(hw, p)
        if phi1 >= 0:
            for i in range(nq):
                bend = column(pool, phi1 + k * nq, nq * nq, i)
                rate, curvature = v[first + rd + i], acc[first + rd + i]
                work.Gp[o + rd + k] += dot(h, bend) * curvature
                work.Gp[o + rd + k] += 2.0 * dot(hw, bend) * rate
                work.Gv[o + rd + k] += 2.0 * dot(h, bend) * rate


@inner(types.void(SYSTEM, WORK, int64, int64, VECTOR, F1))
def vary_velocity(system, work, o, m, e, v):
    """Adds to Gp and Gv the derivatives of a marker's velocity along e."""
    b = system.marker[m, M_BODY]
    row = system.body[b]
    frame, point = work.frame[b], work.point[m]
    nq, rd, phi = row[NQ], row[RD], system.marker[m, M_PHI]
    qd, phi1 = row[VEL] + rd, system.marker[m, M_PHI1]
    h = rotate_back(frame, R, e)
    if rd == 6:
        speed = rotate_back(frame, R, load(point, PV))
        add_row(work.Gp, o + 3, cross(speed, h))
    hw = cross(h, load(frame, OMEGA))
    for k in range(nq):
        work.Gp[o + rd + k] += dot(hw, column(work.phi, phi, nq, k))
        if phi1 >= 0:
            for i in range(nq):
                bend = column(system.pool, phi1 + k * nq, nq * nq, i)
                work.Gp[o + rd + k] += dot(h, bend) * v[qd + i]
    segment(system, work, work.Gv, o, m, e, NONE)


@inner(types.void(SYSTEM, WORK, F1, int64, int64, VECTOR, F1))
def vary_psi(system, work, out, o, m, torque, rates):
    """Adds, along an inertial torque, the derivative by q of T Psi(q) elastic rates.

    T stays constant.
    """
    psi1 = system.marker[m, M_PSI1]
    if psi1 < 0:
        return
    b = system.marker[m, M_BODY]
    row = system.body[b]
    nq, rd, first = row[NQ], row[RD], row[VEL] + row[RD]
    t = rotate_back(work.point[m], T, rotate_back(work.frame[b], R, torque))
    for k in range(nq):
        for i in range(nq):
            change = dot(t, column(system.pool, psi1 + k * nq, nq * nq, i))
            out[o + rd + k] += change * rates[first + i]


@inner(types.void(SYSTEM, WORK, int64, int64, VECTOR, VECTOR, F1, F1))
def _vary_turning(system, work, o, m, by_rate, by_acceleration, v, acc):
    """Adds to Gp and Gv what Psi(q) changes in the turning of a marker.

    by_rate, by_acceleration : derivatives of the constraint acceleration by the angular
        velocity and by the angular acceleration of the marker
    """
    frame = work.frame[system.marker[m, M_BODY]]
    w = rotate(frame, R, load(frame, OMEGA))
    by_rate = plus(by_rate, cross(by_acceleration, w))
    vary_psi(system, work, work.Gp, o, m, by_rate, v)
    vary_psi(system, work, work.Gp, o, m, by_acceleration, acc)
    vary_psi(system, work, work.Gv, o, m, times(2.0, by_acceleration), v)


@inner(types.void(SYSTEM, WORK, int64, VECTOR, VECTOR))
def bending_stiffness(system, work, m, force, torque):
    """Rp from what inertial loads at a marker change as Phi and Psi depend on q."""
    b = system.marker[m, M_BODY]
    row = system.body[b]
    nv, nq, rd, block, P = row[NV], row[NQ], row[RD], row[BLOCK], work.Rp
    phi1, psi1 = system.marker[m, M_PHI1], system.marker[m, M_PSI1]
    if phi1 < 0 and psi1 < 0:
        return
    frame, pool = work.frame[b], system.pool
    f = rotate_back(frame, R, force)
    t = rotate_back(work.point[m], T, rotate_back(frame, R, torque))
    for k in range(nq):
        line = block + (rd + k) * nv + rd
        for i in range(nq):
            if phi1 >= 0:
                P[line + i] -= dot(column(pool, phi1 + k * nq, nq * nq, i), f)
            if psi1 >= 0:
                P[line + i] -= dot(column(pool, psi1 + k * nq, nq * nq, i), t)


@inner(types.void(SYSTEM, WORK, int64, VECTOR))
def force_stiffness(system, work, m, force):
    """Adds to Rp what an inertial force at a marker changes when its body moves."""
    bending_stiffness(system, work, m, force, NONE)
    b = system.marker[m, M_BODY]
    row = system.body[b]
    nv, nq, rd, block = row[NV], row[NQ], row[RD], row[BLOCK]
    if rd != 6:
        return
    frame, point, P = work.frame[b], work.point[m], work.Rp
    f, phi = rotate_back(frame, R, force), system.marker[m, M_PHI]
    add_skew(P, block + 3, nv, f, -1.0)
    add_skew_product(P, block + 3 * nv + 3, nv, load(point, D), f, -1.0)
    for k in range(nq):
        moment = times(-1.0, cross(column(work.phi, phi, nq, k), f))
        add_column(P, block + 3 * nv + rd + k, nv, moment)
        add_row(P, block + (rd + k) * nv + 3, moment)


@inner(types.void(SYSTEM, WORK, int64, int64, VECTOR, VECTOR, float64))
def line_stiffness(system, work, a, b, n, x, force):
    """Rp of ALONG: the direction n turns with marker A, which the other body pulls."""
    force_stiffness(system, work, b, times(force, n))
    bending_stiffness(system, work, a, times(-force, n), times(force, cross(n, x)))
    row = system.body[system.marker[a, M_BODY]]
    if row[NV] == 0:
        return
    frame, point, P = work.frame[system.marker[a, M_BODY]], work.point[a], work.Rp
    nv, block = row[NV], row[BLOCK]
    direction = rotate_back(frame, R, n)
    if row[RD] == 6:
        y = plus(rotate_back(frame, R, x), load(point, D))
        add_skew_product(P, block + 3 * nv + 3, nv, direction, y, -force)
        add_skew(P, block + 3 * nv, nv, direction, force)


@inner(types.void(SYSTEM, WORK, int64, VECTOR, VECTOR, float64))
def _torque_stiffness(system, work, m, own, other, torque):
    """Rp of the torque * (own x other), where `own` turns with the marker's body."""
    bending_stiffness(system, work, m, NONE, times(torque, cross(own, other)))
    b = system.marker[m, M_BODY]
    row = system.body[b]
    nv, nq, rd, block = row[NV], row[NQ], row[RD], row[BLOCK]
    if rd != 6:
        return
    frame, psi = work.frame[b], system.marker[m, M_PHI] + 3 * nq
    p, o = rotate_back(frame, R, own), rotate_back(frame, R, other)
    add_skew_product(work.Rp, block + 3 * nv + 3, nv, p, o, -torque)
    for k in range(nq):
        arm = cross(cross(column(work.phi, psi, nq, k), p), o)
        add_row(work.Rp, block + (rd + k) * nv + 3, times(-torque, arm))


@inner(types.void(SYSTEM, WORK, int64, VECTOR, float64))
def swing_stiffness(system, work, m, n, weight):
    """Rp += weight * sum of p p^T over two directions across n (DISTANCE)."""
    row = system.body[system.marker[m, M_BODY]]
    nv, block, s = row[NV], row[BLOCK], work.scratch
    helper = X_AXIS if abs(n[0]) < 0.6 else Y_AXIS
    first = cross(n, helper)
    first = times(1.0 / math.sqrt(dot(first, first)), first)
    for side in range(2):
        e = first if side == 0 else cross(n, first)
        for i in range(nv):
            s[i] = 0.0
        segment(system, work, s, 0, m, e, NONE)
        for i in range(nv):
            for j in range(nv):
                work.Rp[block + i * nv + j] += weight * s[i] * s[j]


@inner(types.void(SYSTEM, WORK, int64, float64, F1, F1, F1))
def _linearise_turn(system, work, k, t, v, acc, lam):
    """PERPENDICULAR and ANGLE: u . b = 0."""
    con = system.constraint[k]
    ma, mb = con[MARKER_A], con[MARKER_B]
    A, B = work.point[ma], work.point[mb]
    s, sd, sdd = 0.0, 0.0, 0.0
    if con[C_DRIVE] >= 0:
        s, sd, sdd = drive_value(system, con[C_DRIVE], work.clock[0], t)
    u, ud, udd, b = driven_direction(system, work, k, s, sd, sdd)
    _, al_a = marker_acceleration(system, work, ma, acc)
    _, al_b = marker_acceleration(system, work, mb, acc)
    wa, wb = load(A, PW), load(B, PW)
    udd = plus(udd, cross(minus(al_a, load(A, PAL)), u))
    bd = cross(wb, b)
    bdd = plus(cross(al_b, b), cross(wb, bd))
    turn = plus(cross(udd, b), plus(times(2.0, cross(ud, bd)), cross(u, bdd)))
    wu = cross(wa, u)
    spin_a = plus(cross(wu, b), cross(u, cross(b, wa)))
    spin_a = plus(spin_a, times(2.0, cross(u, bd)))
    drift = minus(wu, ud)
    spin_a = minus(spin_a, times(2.0, cross(drift, b)))
    spin_b = plus(times(2.0, cross(b, ud)), plus(cross(bd, u), cross(b, cross(u, wb))))
    force, axis = lam[con[ROW]], cross(u, b)
    if con[SEG_A] >= 0:
        o = system.segment[con[SEG_A], S_OFFSET]
        segment(system, work, work.Gp, o, ma, NONE, turn)
        segment(system, work, work.Gv, o, ma, NONE, spin_a)
        _vary_turning(system, work, o, ma, spin_a, axis, v, acc)
        _torque_stiffness(system, work, ma, u, b, force)
    if con[SEG_B] >= 0:
        o = system.segment[con[SEG_B], S_OFFSET]
        segment(system, work, work.Gp, o, mb, NONE, times(-1.0, turn))
        segment(system, work, work.Gv, o, mb, NONE, spin_b)
        _vary_turning(system, work, o, mb, spin_b, times(-1.0, axis), v, acc)
        _torque_stiffness(system, work, mb, b, u, force)


@inner(types.void(SYSTEM, WORK, int64, F1, F1, F1))
def _linearise_place(system, work, k, v, acc, lam):
    """COINCIDENT, ALONG and DISTANCE, and a displacement that is coupled."""
    con = system.constraint[k]
    kind, r = con[KIND], con[ROW]
    ma, mb = con[MARKER_A], con[MARKER_B]
    A, B = work.point[ma], work.point[mb]
    x = minus(load(B, PX), load(A, PX))
    vel = minus(load(B, PV), load(A, PV))
    aa, al = marker_acceleration(system, work, ma, acc)
    ba, _ = marker_acceleration(system, work, mb, acc)
    a = minus(ba, aa)
    rows = 3 if kind == COINCIDENT else 1
    weight = 1.0
    if kind == COUPLED_ALONG:
        weight = system.pool[con[C_DATA] + TERM_SPATIAL + W_WEIGHT]
    single = weight * lam[r]
    n, by_v, by_x, turn, spin, length, force = X_AXIS, NONE, NONE, NONE, NONE, 1.0, NONE
    if kind == COINCIDENT:
        force = load(lam, r)
    elif kind in (ALONG, COUPLED_ALONG):
        n = rotate(A, PR, load(system.pool, con[C_DATA]))
        w = load(A, PW)
        wn = cross(w, n)
        by_v = times(2.0, wn)
        by_x = plus(cross(al, n), cross(w, wn))
        turn = plus(cross(n, a), plus(cross(by_v, vel), cross(by_x, x)))
        spin = plus(times(2.0, cross(n, vel)), cross(wn, x))
        spin = plus(spin, cross(n, cross(x, w)))
    else:
        length = math.sqrt(dot(x, x))
        n = times(1.0 / length, x)
        along, pull = dot(n, vel), dot(n, a)
        across = minus(vel, times(along, n))
        by_v = times(2.0 / length, across)
        by_x = minus(a, plus(times(pull, n), times(along, by_v)))
        by_x = minus(by_x, times(dot(across, across) / length, n))
        by_x = times(1.0 / length, by_x)
        force = times(single, n)
    for side in range(2):
        first = con[SEG_A] if side == 0 else con[SEG_B]
        if first < 0:
            continue
        m, sign = (ma, -1.0) if side == 0 else (mb, 1.0)
        for i in range(rows):
            e = n if i == 0 else (Y_AXIS if i == 1 else Z_AXIS)
            o = system.segment[first + i, S_OFFSET]
            _vary_acceleration(system, work, o, m, times(sign * weight, e), v, acc)
        if kind == COINCIDENT:
            force_stiffness(system, work, m, times(sign, force))
            continue
        o = system.segment[first, S_OFFSET]
        vary_velocity(system, work, o, m, times(sign * weight, by_v), v)
        segment(system, work, work.Gp, o, m, times(sign * weight, by_x), NONE)
        if kind == DISTANCE:
            force_stiffness(system, work, m, times(sign, force))
            swing_stiffness(system, work, m, n, -lam[r] / length)
        elif side == 0:
            segment(system, work, work.Gp, o, m, NONE, times(weight, turn))
            spin, arm = times(weight, spin), times(weight, cross(n, x))
            segment(system, work, work.Gv, o, m, NONE, spin)
            _vary_turning(system, work, o, m, spin, arm, v, acc)
    if kind in (ALONG, COUPLED_ALONG):
        line_stiffness(system, work, ma, mb, n, x, single)


@inner(types.void(SYSTEM, WORK, int64, F1, F1, F1))
def _linearise_angle(system, work, k, v, acc, lam):
    """A coupled angle: acceleration n . (al_B - al_A) + (w_A x n) . w_B."""
    con = system.constraint[k]
    ma, mb = con[MARKER_A], con[MARKER_B]
    A, B = work.point[ma], work.point[mb]
    weight = system.pool[con[C_DATA] + TERM_SPATIAL + W_WEIGHT]
    n, _ = turned_angle(system, work, k)
    _, al_b = marker_acceleration(system, work, mb, acc)
    wb, wn = load(B, PW), cross(load(A, PW), n)
    turn = times(weight, plus(cross(n, al_b), cross(wn, wb)))
    axis, torque_b = times(weight, n), times(weight * lam[con[ROW]], n)
    if con[SEG_A] >= 0:
        o = system.segment[con[SEG_A], S_OFFSET]
        spin = times(weight, cross(n, wb))
        segment(system, work, work.Gp, o, ma, NONE, turn)
        segment(system, work, work.Gv, o, ma, NONE, spin)
        _vary_turning(system, work, o, ma, spin, times(-1.0, axis), v, acc)
        bending_stiffness(system, work, ma, NONE, times(-1.0, torque_b))
    if con[SEG_B] < 0:
        return
    o = system.segment[con[SEG_B], S_OFFSET]
    segment(system, work, work.Gp, o, mb, NONE, times(-1.0, turn))
    segment(system, work, work.Gv, o, mb, NONE, times(weight, wn))
    _vary_turning(system, work, o, mb, times(weight, wn), axis, v, acc)
    bending_stiffness(system, work, mb, NONE, torque_b)
    b = system.marker[mb, M_BODY]
    row = system.body[b]
    nv, nq, rd, block = row[NV], row[NQ], row[RD], row[BLOCK]
    if rd != 6:
        return
    torque = rotate_back(work.frame[b], R, torque_b)
    add_skew(work.Rp, block + 3 * nv + 3, nv, torque, -1.0)
    psi = system.marker[mb, M_PHI] + 3 * nq
    for i in range(nq):
        arm = cross(column(work.phi, psi, nq, i), torque)
        add_row(work.Rp, block + (rd + i) * nv + 3, times(-1.0, arm))


@inner(LINEARISE)
def linearise_constraints(system, work, t, z, v, acc, lam):
    """Rp, Rv, Gp, Gv at a state that was just evaluated.

    Exact for rigid bodies, except that Rp leaves out what the motion of one body
    changes in the constraint force on another; for flexible ones the turning of a
    marker by the elastic coordinates is linearised. A Newton matrix may do with that.
    """
    for b in range(len(system.body)):
        linearise_body(system, work, b, z, v, acc)
    for i in range(len(work.Gp)):
        work.Gp[i] = 0.0
        work.Gv[i] = 0.0
    for k in range(len(system.constraint)):
        kind = system.constraint[k, KIND]
        if kind in (COINCIDENT, ALONG, COUPLED_ALONG, DISTANCE):
            _linearise_place(system, work, k, v, acc, lam)
        elif kind == COUPLED_ANGLE:
            _linearise_angle(system, work, k, v, acc, lam)
        else:
            _linearise_turn(system, work, k, t, v, acc, lam)
