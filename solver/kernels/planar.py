"""Planar flexible bodies: kinematics, equations of motion, constraints.

Source: the equations of motion of one body in SID quantities (Wallrapp 1994),
restricted to translations in x and y and the rotation about z. Velocities and
accelerations of a body frame are resolved in that frame.
"""

from __future__ import annotations

import math

from numba import float64, int64, types

from .compiling import inner
from .cubic import add_cubic_force
from .drives import drive_value
from .layout import (
    BASE,
    BLOCK,
    DATA,
    DRIVE,
    EVALUATE,
    F1,
    FIXED,
    FLAGS,
    FRAME,
    FREE,
    GROUND,
    HAS_CR1,
    HAS_CT1,
    HAS_GE,
    HAS_KE1,
    HAS_OE1,
    HAS_QUADRATIC_J,
    M_BODY,
    M_DATA,
    M_PHI,
    M_PHI1,
    M_PSI1,
    MOTION,
    NP,
    NQ,
    NV,
    POS,
    RD,
    REVOLUTE,
    STIFFENED,
    SYSTEM,
    TIP,
    VEL,
    WORK,
)
from .planar_columns import (
    AL,
    ANGLE,
    AX,
    AY,
    COS,
    DX,
    DY,
    N_FRAME,
    N_SQUARES,
    N_VECTORS,
    P_J,
    P_MASS,
    P_MDX,
    P_MDY,
    P_VECTORS,
    PAX,
    PAY,
    PVX,
    PVY,
    PX,
    PY,
    S_CR1,
    S_CT1X,
    S_CT1Y,
    S_DE,
    S_GE,
    S_J2,
    S_KE,
    S_OE1,
    SIN,
    TA,
    TH,
    TW,
    UX,
    UY,
    V_CR,
    V_CTX,
    V_CTY,
    V_J1,
    V_KSIGMA,
    V_OE0,
    VX,
    VY,
    W,
    X,
    Y,
)
from .planar_stiffened import add_stiffened


@inner(types.void(SYSTEM, WORK, int64, float64, F1, F1))
def _free_frame(system, work, b, t, z, v):
    """Body frame from the coordinates, eq. (1) and (2)."""
    row = system.body[b]
    p = row[POS]
    u = row[VEL]
    frame = work.frame[b]
    frame[X] = z[p]
    frame[Y] = z[p + 1]
    frame[VX] = v[u]
    frame[VY] = v[u + 1]
    if row[RD] == 3:
        frame[ANGLE] = z[p + 2]
        frame[W] = v[u + 2]
    else:
        frame[ANGLE] = system.pool[row[FRAME]]
        frame[W] = 0.0
    frame[COS] = math.cos(frame[ANGLE])
    frame[SIN] = math.sin(frame[ANGLE])
    frame[AX] = -frame[W] * frame[VY]
    frame[AY] = frame[W] * frame[VX]
    frame[AL] = 0.0


@inner(types.void(SYSTEM, WORK, int64, float64))
def _prescribed_frame(system, work, b, t):
    """Body frame that hangs on a marker of a prescribed body by a driven joint."""
    row = system.body[b]
    frame = work.frame[b]
    pool = system.pool
    if row[MOTION] == GROUND:
        for i in range(N_FRAME):
            frame[i] = 0.0
        frame[COS] = 1.0
        return
    base = work.point[row[BASE]]
    tip = system.marker[row[TIP], M_DATA]
    s, sd, sdd = 0.0, 0.0, 0.0
    if row[DRIVE] >= 0:
        s, sd, sdd = drive_value(system, row[DRIVE], work.clock[0], t)
    angle, w, al = base[TH], base[TW], base[TA]
    px, py = base[PX], base[PY]
    vx, vy = base[PVX], base[PVY]
    ax, ay = base[PAX], base[PAY]
    if row[MOTION] == REVOLUTE:
        angle += s
        w += sd
        al += sdd
    elif row[MOTION] != FIXED:
        slide = angle + pool[row[FRAME]]
        ex, ey = math.cos(slide), math.sin(slide)
        px += s * ex
        py += s * ey
        vx += sd * ex - s * w * ey
        vy += sd * ey + s * w * ex
        ax += (sdd - s * w * w) * ex - (2.0 * sd * w + s * al) * ey
        ay += (sdd - s * w * w) * ey + (2.0 * sd * w + s * al) * ex
    angle += pool[row[FRAME] + 1] - pool[tip + 2]
    c, sn = math.cos(angle), math.sin(angle)
    dx, dy = pool[tip], pool[tip + 1]
    rx, ry = c * dx - sn * dy, sn * dx + c * dy
    frame[ANGLE], frame[COS], frame[SIN] = angle, c, sn
    frame[X], frame[Y] = px - rx, py - ry
    vx += w * ry
    vy -= w * rx
    ax += al * ry + w * w * rx
    ay += -al * rx + w * w * ry
    frame[W], frame[AL] = w, al
    frame[VX], frame[VY] = c * vx + sn * vy, -sn * vx + c * vy
    frame[AX], frame[AY] = c * ax + sn * ay, -sn * ax + c * ay


@inner(types.void(SYSTEM, WORK, int64, F1, F1))
def _marker(system, work, m, z, v):
    """Position, velocity and bias acceleration of a marker, eq. (1) differentiated."""
    b = system.marker[m, M_BODY]
    row = system.body[b]
    frame = work.frame[b]
    point = work.point[m]
    pool = system.pool
    nq = row[NQ]
    data = system.marker[m, M_DATA]
    phi = system.marker[m, M_PHI]
    psi0, psi = data + 3 + 2 * nq, phi + 2 * nq
    phi1, psi1 = system.marker[m, M_PHI1], system.marker[m, M_PSI1]
    q = row[POS] + row[NP] - nq
    qd = row[VEL] + row[RD]
    dx, dy, th = pool[data], pool[data + 1], pool[data + 2]
    ux, uy, thd = 0.0, 0.0, 0.0
    sx, sy, thdd = 0.0, 0.0, 0.0
    for k in range(nq):
        fx, fy = pool[data + 3 + k], pool[data + 3 + nq + k]
        if phi1 >= 0:
            gx, gy, hx, hy = 0.0, 0.0, 0.0, 0.0
            for i in range(nq):
                kx = pool[phi1 + k * nq + i]
                ky = pool[phi1 + nq * nq + k * nq + i]
                gx += kx * z[q + i]
                gy += ky * z[q + i]
                hx += kx * v[qd + i]
                hy += ky * v[qd + i]
            work.phi[phi + k] = fx + gx
            work.phi[phi + nq + k] = fy + gy
            sx += hx * v[qd + k]
            sy += hy * v[qd + k]
            dx += (fx + 0.5 * gx) * z[q + k]
            dy += (fy + 0.5 * gy) * z[q + k]
        else:
            dx += fx * z[q + k]
            dy += fy * z[q + k]
        ux += work.phi[phi + k] * v[qd + k]
        uy += work.phi[phi + nq + k] * v[qd + k]
        turn = pool[psi0 + k]
        if psi1 >= 0:
            g, h = 0.0, 0.0
            for i in range(nq):
                g += pool[psi1 + k * nq + i] * z[q + i]
                h += pool[psi1 + k * nq + i] * v[qd + i]
            work.phi[psi + k] = turn + g
            turn += 0.5 * g
            thdd += h * v[qd + k]
        th += turn * z[q + k]
        thd += work.phi[psi + k] * v[qd + k]
    c, s, w, al = frame[COS], frame[SIN], frame[W], frame[AL]
    vx, vy = frame[VX] - w * dy + ux, frame[VY] + w * dx + uy
    ax = frame[AX] - al * dy - w * w * dx - 2.0 * w * uy + sx
    ay = frame[AY] + al * dx - w * w * dy + 2.0 * w * ux + sy
    point[PX], point[PY] = frame[X] + c * dx - s * dy, frame[Y] + s * dx + c * dy
    point[PVX], point[PVY] = c * vx - s * vy, s * vx + c * vy
    point[PAX], point[PAY] = c * ax - s * ay, s * ax + c * ay
    point[TH], point[TW], point[TA] = frame[ANGLE] + th, w + thd, al + thdd
    point[DX], point[DY], point[UX], point[UY] = dx, dy, ux, uy


@inner(types.void(SYSTEM, WORK, int64, F1, F1))
def _body(system, work, b, z, v):
    """Mass matrix and generalised force of one body, eq. (3)."""
    row = system.body[b]
    nq, nv, rd, flags = row[NQ], row[NV], row[RD], row[FLAGS]
    if nv == 0:
        return
    pool, frame, M, f = system.pool, work.frame[b], work.M, work.f
    o, block, first = row[DATA], row[BLOCK], row[VEL]
    q, qd = row[POS] + row[NP] - nq, row[VEL] + rd
    vec, sq, n2 = o + P_VECTORS, o + P_VECTORS + N_VECTORS * nq, nq * nq
    mass, mdx, mdy, J = (
        pool[o + P_MASS],
        pool[o + P_MDX],
        pool[o + P_MDY],
        pool[o + P_J],
    )
    c, s, w, al = frame[COS], frame[SIN], frame[W], frame[AL]
    ax = frame[AX] - c * system.gravity[0] - s * system.gravity[1]
    ay = frame[AY] + s * system.gravity[0] - c * system.gravity[1]
    Jd, hx, hy = 0.0, 0.0, 0.0
    for k in range(nq):
        qk, qdk = z[q + k], v[qd + k]
        ctx, cty = pool[vec + V_CTX * nq + k], pool[vec + V_CTY * nq + k]
        j1 = pool[vec + V_J1 * nq + k]
        mean_x, mean_y = ctx, cty
        cr = pool[vec + V_CR * nq + k]
        force = -(pool[vec + V_OE0 * nq + k] * w * w + pool[vec + V_KSIGMA * nq + k])
        line = k * nq
        for i in range(nq):
            qi, qdi = z[q + i], v[qd + i]
            e = line + i
            force -= pool[sq + S_KE * n2 + e] * qi + pool[sq + S_DE * n2 + e] * qdi
            if flags & HAS_CR1:
                cr += pool[sq + S_CR1 * n2 + e] * qi
            if flags & HAS_GE:
                force -= pool[sq + S_GE * n2 + e] * qdi * w
            if flags & HAS_OE1:
                force -= pool[sq + S_OE1 * n2 + e] * qi * w * w
            if flags & HAS_CT1:
                kx, ky = (
                    pool[sq + S_CT1X * n2 + e] * qi,
                    pool[sq + S_CT1Y * n2 + e] * qi,
                )
                ctx += kx
                cty += ky
                mean_x += 0.5 * kx
                mean_y += 0.5 * ky
            if flags & HAS_QUADRATIC_J:
                J += qk * pool[sq + S_J2 * n2 + e] * qi
                Jd += 2.0 * qk * pool[sq + S_J2 * n2 + e] * qdi
        J += j1 * qk
        Jd += j1 * qdk
        mdx += mean_x * qk
        mdy += mean_y * qk
        hx += ctx * qdk
        hy += cty * qdk
        f[qd + k] = force - ctx * ax - cty * ay - cr * al
        if rd >= 2:
            M[block + (rd + k) * nv] = ctx
            M[block + (rd + k) * nv + 1] = cty
            M[block + rd + k] = ctx
            M[block + nv + rd + k] = cty
        if rd == 3:
            M[block + (rd + k) * nv + 2] = cr
            M[block + 2 * nv + rd + k] = cr
    if flags & HAS_KE1:
        add_cubic_force(pool, sq + N_SQUARES * n2, nq, z, q, f, qd)
    if rd >= 2:
        M[block] = mass
        M[block + 1] = 0.0
        M[block + nv] = 0.0
        M[block + nv + 1] = mass
        f[first] = -mass * ax + w * w * mdx + 2.0 * w * hy
        f[first + 1] = -mass * ay + w * w * mdy - 2.0 * w * hx
    if rd == 3:
        M[block + 2] = -mdy
        M[block + 2 * nv] = -mdy
        M[block + nv + 2] = mdx
        M[block + 2 * nv + 1] = mdx
        M[block + 2 * nv + 2] = J
        f[first + 2] = -(mdx * ay - mdy * ax) - Jd * w


@inner(EVALUATE)
def evaluate_bodies(system, work, t, z, v):
    """Frames, markers, mass matrices and forces of all bodies.

    Bodies are sorted so that a prescribed frame comes after its base; markers are
    sorted by body.
    """
    m = 0
    markers = len(system.marker)
    for b in range(len(system.body)):
        if system.body[b, MOTION] == FREE:
            _free_frame(system, work, b, t, z, v)
        else:
            _prescribed_frame(system, work, b, t)
        while m < markers and system.marker[m, M_BODY] == b:
            _marker(system, work, m, z, v)
            m += 1
        _body(system, work, b, z, v)
        if system.body[b, FLAGS] & STIFFENED:
            add_stiffened(system, work, b, z, v)
