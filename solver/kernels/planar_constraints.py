"""Planar constraints c(z_I, t) = 0, their rates, right-hand sides and derivatives."""

from __future__ import annotations

import math

from numba import float64, int64, types

from .compiling import inner
from .drives import drive_value
from .layout import (
    ALONG,
    ANGLE,
    BLOCK,
    C_DATA,
    C_DRIVE,
    COINCIDENT,
    COUPLED_ALONG,
    COUPLED_ANGLE,
    DISTANCE,
    EVALUATE,
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
    TERM_PLANAR,
    VEL,
    W_WEIGHT,
    WORK,
)
from .planar import evaluate_bodies, segment
from .planar_columns import (
    AL,
    COS,
    DX,
    DY,
    PAX,
    PAY,
    PVX,
    PVY,
    PX,
    PY,
    SIN,
    TA,
    TH,
    TW,
    UX,
    UY,
    VX,
    VY,
    W,
)
from .planar_linear import linearise_body
from .rows import add_term, is_coupled, write_row


@inner(types.void(SYSTEM, WORK, int64, float64))
def _constraint(system, work, k, t):
    con = system.constraint[k]
    kind, r = con[KIND], con[ROW]
    ma, mb = con[MARKER_A], con[MARKER_B]
    A, B = work.point[ma], work.point[mb]
    s, sd, sdd = 0.0, 0.0, 0.0
    if con[C_DRIVE] >= 0:
        s, sd, sdd = drive_value(system, con[C_DRIVE], work.clock[0], t)
    data = con[C_DATA]
    x, y = B[PX] - A[PX], B[PY] - A[PY]
    vx, vy = B[PVX] - A[PVX], B[PVY] - A[PVY]
    ax, ay = B[PAX] - A[PAX], B[PAY] - A[PAY]
    ex, ey, torque_a, torque_b = 1.0, 0.0, 0.0, 0.0
    value, rate, gamma = x, vx, -ax
    if kind == COINCIDENT:
        write_row(work, r + 1, y, vy, -ay)
    elif kind in (ALONG, COUPLED_ALONG):
        angle = A[TH] + system.pool[data]
        w, al = A[TW], A[TA]
        ex, ey = math.cos(angle), math.sin(angle)
        along, across = ex * x + ey * y, ex * y - ey * x
        torque_a = across
        value = along - s - system.pool[data + 1]
        rate = ex * vx + ey * vy + w * across - sd
        bias = ex * ax + ey * ay + 2.0 * w * (ex * vy - ey * vx)
        gamma = sdd - bias - al * across + w * w * along
    elif kind in (ANGLE, COUPLED_ANGLE):
        ex, torque_a, torque_b = 0.0, -1.0, 1.0
        value = B[TH] - A[TH] - s - system.pool[data]
        rate = B[TW] - A[TW] - sd
        gamma = sdd - (B[TA] - A[TA])
    elif kind == DISTANCE:
        length = math.sqrt(x * x + y * y)
        ex, ey = x / length, y / length
        along = ex * vx + ey * vy
        value = length - s - system.pool[data]
        rate = along - sd
        bias = ex * ax + ey * ay + (vx * vx + vy * vy - along * along) / length
        gamma = sdd - bias
    if is_coupled(kind):
        term = data + TERM_PLANAR
        add_term(system, work, r, term, value, rate, gamma)
        weight = system.pool[term + W_WEIGHT]
        ex, ey = weight * ex, weight * ey
        torque_a, torque_b = weight * torque_a, weight * torque_b
    else:
        write_row(work, r, value, rate, gamma)
    if con[SEG_A] >= 0:
        o = system.segment[con[SEG_A], S_OFFSET]
        segment(system, work, work.C, o, ma, -ex, -ey, torque_a)
        if kind == COINCIDENT:
            o = system.segment[con[SEG_A] + 1, S_OFFSET]
            segment(system, work, work.C, o, ma, 0.0, -1.0, 0.0)
    if con[SEG_B] >= 0:
        o = system.segment[con[SEG_B], S_OFFSET]
        segment(system, work, work.C, o, mb, ex, ey, torque_b)
        if kind == COINCIDENT:
            o = system.segment[con[SEG_B] + 1, S_OFFSET]
            segment(system, work, work.C, o, mb, 0.0, 1.0, 0.0)


@inner(EVALUATE)
def evaluate_constraints(system, work, t, z, v):
    """Everything that eq. (3) needs at one state: M, f, C, c, dc/dt and gamma."""
    evaluate_bodies(system, work, t, z, v)
    for i in range(len(work.C)):
        work.C[i] = 0.0
    for k in range(len(system.constraint)):
        _constraint(system, work, k, t)


@inner(types.void(SYSTEM, WORK, int64, float64, float64))
def force_stiffness(system, work, m, fx, fy):
    """Adds to Rp what an inertial force at a marker changes when its body moves."""
    b = system.marker[m, M_BODY]
    row = system.body[b]
    nv, nq, rd = row[NV], row[NQ], row[RD]
    frame, point, P, block = work.frame[b], work.point[m], work.Rp, row[BLOCK]
    c, s = frame[COS], frame[SIN]
    gx, gy = c * fx + s * fy, -s * fx + c * fy
    phi, phi1 = system.marker[m, M_PHI], system.marker[m, M_PHI1]
    if rd == 3:
        P[block + 2] -= gy
        P[block + nv + 2] += gx
        P[block + 2 * nv + 2] += point[DX] * gx + point[DY] * gy
    for k in range(nq):
        px, py = work.phi[phi + k], work.phi[phi + nq + k]
        if rd == 3:
            P[block + 2 * nv + rd + k] -= px * gy - py * gx
            P[block + (rd + k) * nv + 2] += py * gx - px * gy
        if phi1 >= 0:
            for i in range(nq):
                kx = system.pool[phi1 + k * nq + i]
                ky = system.pool[phi1 + nq * nq + k * nq + i]
                P[block + (rd + k) * nv + rd + i] -= kx * gx + ky * gy


@inner(types.void(SYSTEM, WORK, int64, float64))
def torque_stiffness(system, work, m, torque):
    """Adds to Rp what a torque at a marker changes when its body deforms."""
    psi1 = system.marker[m, M_PSI1]
    if psi1 < 0:
        return
    row = system.body[system.marker[m, M_BODY]]
    nv, nq, rd = row[NV], row[NQ], row[RD]
    for k in range(nq):
        line = row[BLOCK] + (rd + k) * nv + rd
        for i in range(nq):
            work.Rp[line + i] -= system.pool[psi1 + k * nq + i] * torque


@inner(types.void(SYSTEM, WORK, F1, int64, int64, float64, F1))
def vary_psi(system, work, out, offset, m, weight, rates):
    """Adds weight times the derivative by q of Psi(q) times elastic rates."""
    psi1 = system.marker[m, M_PSI1]
    if psi1 < 0:
        return
    row = system.body[system.marker[m, M_BODY]]
    nq, rd, first = row[NQ], row[RD], row[VEL] + row[RD]
    for k in range(nq):
        for i in range(nq):
            change = weight * system.pool[psi1 + k * nq + i]
            out[offset + rd + k] += change * rates[first + i]


@inner(types.void(SYSTEM, WORK, int64, int64, float64, F1, F1))
def vary_turning(system, work, offset, m, weight, v, acc):
    """Adds to Gp and Gv the derivatives of weight times a marker's TA."""
    vary_psi(system, work, work.Gp, offset, m, weight, acc)
    vary_psi(system, work, work.Gv, offset, m, 2.0 * weight, v)


@inner(types.void(SYSTEM, WORK, int64, int64, float64, float64, F1))
def vary_velocity(system, work, offset, m, ex, ey, v):
    """Adds to Gp and Gv the derivatives of a marker's velocity along e."""
    b = system.marker[m, M_BODY]
    row = system.body[b]
    frame, point = work.frame[b], work.point[m]
    c, s, w = frame[COS], frame[SIN], frame[W]
    hx, hy = c * ex + s * ey, -s * ex + c * ey
    nq, rd = row[NQ], row[RD]
    phi, phi1 = system.marker[m, M_PHI], system.marker[m, M_PHI1]
    qd = row[VEL] + rd
    if rd == 3:
        work.Gp[offset + 2] += ey * point[PVX] - ex * point[PVY]
    for k in range(nq):
        px, py = work.phi[phi + k], work.phi[phi + nq + k]
        work.Gp[offset + rd + k] += w * (hy * px - hx * py)
        if phi1 >= 0:
            for i in range(nq):
                kx = system.pool[phi1 + k * nq + i]
                ky = system.pool[phi1 + nq * nq + k * nq + i]
                work.Gp[offset + rd + k] += (hx * kx + hy * ky) * v[qd + i]
    segment(system, work, work.Gv, offset, m, ex, ey, 0.0)


@inner(types.UniTuple(float64, 3)(SYSTEM, WORK, int64, F1))
def marker_acceleration(system, work, m, acc):
    """Inertial acceleration (x, y) and angular acceleration of a marker."""
    b = system.marker[m, M_BODY]
    row = system.body[b]
    frame, point = work.frame[b], work.point[m]
    first, nq, rd = row[VEL], row[NQ], row[RD]
    phi = system.marker[m, M_PHI]
    psi = phi + 2 * nq
    ax, ay, al = 0.0, 0.0, 0.0
    if rd >= 2:
        ax, ay = acc[first], acc[first + 1]
    if rd == 3:
        al = acc[first + 2]
        ax -= al * point[DY]
        ay += al * point[DX]
    twist = 0.0
    for k in range(nq):
        ax += work.phi[phi + k] * acc[first + rd + k]
        ay += work.phi[phi + nq + k] * acc[first + rd + k]
        twist += work.phi[psi + k] * acc[first + rd + k]
    c, s = frame[COS], frame[SIN]
    return (
        point[PAX] + c * ax - s * ay,
        point[PAY] + s * ax + c * ay,
        point[TA] + al + twist,
    )


@inner(types.void(SYSTEM, WORK, int64, int64, float64, float64, F1, F1))
def vary_acceleration(system, work, offset, m, ex, ey, v, acc):
    """Adds to Gp and Gv the derivatives of a marker's acceleration along e."""
    b = system.marker[m, M_BODY]
    row = system.body[b]
    frame, point = work.frame[b], work.point[m]
    c, s, w = frame[COS], frame[SIN], frame[W]
    hx, hy = c * ex + s * ey, -s * ex + c * ey
    nq, rd, first = row[NQ], row[RD], row[VEL]
    phi, phi1 = system.marker[m, M_PHI], system.marker[m, M_PHI1]
    ax, ay, _ = marker_acceleration(system, work, m, acc)
    al = frame[AL] + (acc[first + 2] if rd == 3 else 0.0)
    if rd >= 2:
        work.Gv[offset] += w * hy
        work.Gv[offset + 1] -= w * hx
    if rd == 3:
        dx, dy, ux, uy = point[DX], point[DY], point[UX], point[UY]
        work.Gp[offset + 2] += ey * ax - ex * ay
        work.Gv[offset + 2] += hx * (-frame[VY] - 2.0 * w * dx - 2.0 * uy)
        work.Gv[offset + 2] += hy * (frame[VX] - 2.0 * w * dy + 2.0 * ux)
    for k in range(nq):
        px, py = work.phi[phi + k], work.phi[phi + nq + k]
        work.Gp[offset + rd + k] += al * (hy * px - hx * py) - w * w * (
            hx * px + hy * py
        )
        work.Gv[offset + rd + k] += 2.0 * w * (hy * px - hx * py)
        if phi1 >= 0:
            for i in range(nq):
                kx = system.pool[phi1 + k * nq + i]
                ky = system.pool[phi1 + nq * nq + k * nq + i]
                rate, curvature = v[first + rd + i], acc[first + rd + i]
                work.Gp[offset + rd + k] += (hx * kx + hy * ky) * curvature
                work.Gp[offset + rd + k] += 2.0 * w * (hy * kx - hx * ky) * rate
                work.Gv[offset + rd + k] += 2.0 * (hx * kx + hy * ky) * rate


@inner(types.void(SYSTEM, WORK, int64, int64, int64, float64))
def add_outer(system, work, b, left, right, weight):
    """Rp of a body += weight * scratch[left] scratch[right]^T."""
    nv, block = system.body[b, NV], system.body[b, BLOCK]
    for i in range(nv):
        for j in range(nv):
            work.Rp[block + i * nv + j] += (
                weight * work.scratch[left + i] * work.scratch[right + j]
            )


@inner(
    types.void(SYSTEM, WORK, int64, int64, float64, float64, float64, float64, float64)
)
def direction_stiffness(system, work, m, size, ex, ey, force, along, bend):
    """Rp from a force whose direction depends on the motion of its own body.

    `force` weighs the coupling of direction and angle (ALONG, marker A), `bend` the
    turning of a connecting line (DISTANCE); e is the unit vector across the force.
    """
    b = system.marker[m, M_BODY]
    for i in range(2 * size):
        work.scratch[i] = 0.0
    segment(system, work, work.scratch, 0, m, ex, ey, 0.0)
    segment(system, work, work.scratch, size, m, 0.0, 0.0, 1.0)
    if bend != 0.0:
        add_outer(system, work, b, 0, 0, bend)
    if force != 0.0:
        add_outer(system, work, b, 0, size, force)
        add_outer(system, work, b, size, 0, force)
        add_outer(system, work, b, size, size, force * along)


@inner(types.void(SYSTEM, WORK, int64, F1, F1, F1))
def _linearise_angle(system, work, k, v, acc, lam):
    """ANGLE and COUPLED_ANGLE: linear but for Psi that depends on q."""
    con = system.constraint[k]
    weight = 1.0
    if con[KIND] == COUPLED_ANGLE:
        weight = system.pool[con[C_DATA] + TERM_PLANAR + W_WEIGHT]
    for side in range(2):
        first = con[SEG_A] if side == 0 else con[SEG_B]
        if first < 0:
            continue
        m = con[MARKER_A] if side == 0 else con[MARKER_B]
        part = -weight if side == 0 else weight
        o = system.segment[first, S_OFFSET]
        vary_turning(system, work, o, m, part, v, acc)
        torque_stiffness(system, work, m, part * lam[con[ROW]])


@inner(types.void(SYSTEM, WORK, int64, F1, F1, F1))
def _linearise_constraint(system, work, k, v, acc, lam):
    con = system.constraint[k]
    kind, r = con[KIND], con[ROW]
    if kind in (ANGLE, COUPLED_ANGLE):
        _linearise_angle(system, work, k, v, acc, lam)
        return
    weight = 1.0
    if kind == COUPLED_ALONG:
        weight = system.pool[con[C_DATA] + TERM_PLANAR + W_WEIGHT]
    ma, mb = con[MARKER_A], con[MARKER_B]
    A, B = work.point[ma], work.point[mb]
    size = len(work.scratch) // 2
    rows = 2 if kind == COINCIDENT else 1
    x, y = B[PX] - A[PX], B[PY] - A[PY]
    vx, vy = B[PVX] - A[PVX], B[PVY] - A[PVY]
    aax, aay, al = marker_acceleration(system, work, ma, acc)
    bax, bay, _ = marker_acceleration(system, work, mb, acc)
    ax, ay = bax - aax, bay - aay
    ex, ey = 1.0, 0.0
    load = weight * lam[r]
    fx, fy = load, 0.0
    velx, vely, posx, posy = 0.0, 0.0, 0.0, 0.0
    turn, spin, force, along, across, bend = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if kind == COINCIDENT:
        fy = lam[r + 1]
    elif kind in (ALONG, COUPLED_ALONG):
        angle, w = A[TH] + system.pool[con[C_DATA]], A[TW]
        ex, ey = math.cos(angle), math.sin(angle)
        along = ex * x + ey * y
        velx, vely = -2.0 * w * ey, 2.0 * w * ex
        posx, posy = -al * ey - w * w * ex, al * ex - w * w * ey
        across = ex * y - ey * x
        turn = ex * ay - ey * ax - 2.0 * w * (ex * vx + ey * vy)
        turn -= al * along + w * w * across
        spin = 2.0 * (ex * vy - ey * vx) - 2.0 * w * along
        fx, fy, force = load * ex, load * ey, load
    elif kind == DISTANCE:
        length = math.sqrt(x * x + y * y)
        ex, ey = x / length, y / length
        rate = ex * vx + ey * vy
        tx, ty = vx - rate * ex, vy - rate * ey
        velx, vely = 2.0 * tx / length, 2.0 * ty / length
        pull = ex * ax + ey * ay
        swing = (tx * tx + ty * ty) / length
        posx = (ax - pull * ex - velx * rate - swing * ex) / length
        posy = (ay - pull * ey - vely * rate - swing * ey) / length
        fx, fy, bend = load * ex, load * ey, -load / length
    for side in range(2):
        first = con[SEG_A] if side == 0 else con[SEG_B]
        if first < 0:
            continue
        m = ma if side == 0 else mb
        sign = -1.0 if side == 0 else 1.0
        part = sign * weight
        for i in range(rows):
            o = system.segment[first + i, S_OFFSET]
            hx, hy = (ex, ey) if i == 0 else (0.0, 1.0)
            vary_acceleration(system, work, o, m, part * hx, part * hy, v, acc)
        o = system.segment[first, S_OFFSET]
        if velx != 0.0 or vely != 0.0:
            vary_velocity(system, work, o, m, part * velx, part * vely, v)
        if posx != 0.0 or posy != 0.0:
            segment(system, work, work.Gp, o, m, part * posx, part * posy, 0.0)
        force_stiffness(system, work, m, sign * fx, sign * fy)
        if side == 0 and (kind in (ALONG, COUPLED_ALONG)):
            segment(system, work, work.Gp, o, m, 0.0, 0.0, weight * turn)
            segment(system, work, work.Gv, o, m, 0.0, 0.0, weight * spin)
            vary_psi(system, work, work.Gp, o, m, weight * spin, v)
            vary_turning(system, work, o, m, weight * across, v, acc)
            torque_stiffness(system, work, m, load * across)
            direction_stiffness(system, work, m, size, -ey, ex, force, along, 0.0)
        if kind == DISTANCE:
            direction_stiffness(system, work, m, size, -ey, ex, 0.0, 0.0, bend)


@inner(LINEARISE)
def linearise_constraints(system, work, t, z, v, acc, lam):
    """Rp, Rv, Gp, Gv at a state that was just evaluated.

    Exact, except that Rp leaves out what the motion of one body changes in the
    constraint force on another; a Newton matrix may do without.
    """
    for b in range(len(system.body)):
        linearise_body(system, work, b, z, v, acc)
    for i in range(len(work.Gp)):
        work.Gp[i] = 0.0
        work.Gv[i] = 0.0
    for k in range(len(system.constraint)):
        _linearise_constraint(system, work, k, v, acc, lam)
