"""Spatial flexible bodies: kinematics, equations of motion.

Source: the equations of motion of one body in SID quantities (Wallrapp 1994).
Velocities and accelerations of a body frame are resolved in that frame; orientation
is a unit quaternion (scalar first).
"""

from __future__ import annotations

import math

from numba import float64, int64, types

from .compiling import inner
from .cubic import add_cubic_force
from .layout import (
    BLOCK,
    DATA,
    F1,
    FLAGS,
    FREE,
    HAS_CR1,
    HAS_CT1,
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
    STIFFENED,
    SYSTEM,
    VEL,
    WORK,
)
from .spatial_columns import (
    ALPHA,
    N_MODAL,
    N_SQUARES,
    N_VECTORS,
    OMEGA,
    P_J,
    P_MASS,
    P_MD,
    P_VECTORS,
    PA,
    PAL,
    PR,
    PV,
    PW,
    PX,
    S_CR1,
    S_CT1,
    S_DE,
    S_KE,
    S_OE1,
    V_CR,
    V_CT,
    V_J1,
    V_KSIGMA,
    V_OE0,
    A,
    D,
    R,
    T,
    U,
    V,
    X,
)
from .spatial_frames import free_frame, prescribed_frame
from .spatial_stiffened import add_stiffened
from .vectors import (
    VECTOR,
    column,
    cross,
    dot,
    inertia_times,
    load,
    minus,
    plus,
    rotate,
    rotate_back,
    store,
    times,
    turned,
)

#: Below this rotation the series of the coefficients of T are used.
SMALL_ROTATION = 0.05


@inner(types.void(F1, VECTOR, VECTOR, F1))
def _rotation_rates(point, theta, rate, out):
    """T(theta) into `point`; T rate and T' rate into out[0:3] and out[3:6].

    The rotation exp(theta~) turns with the angular velocity T theta', T = I + s2 theta~
    + s3 theta~ theta~.
    """
    n2 = dot(theta, theta)
    along = dot(theta, rate)
    if n2 < SMALL_ROTATION * SMALL_ROTATION:
        s2 = 0.5 - n2 / 24.0 + n2 * n2 / 720.0
        s3 = 1.0 / 6.0 - n2 / 120.0 + n2 * n2 / 5040.0
        d2 = (-1.0 / 12.0 + n2 / 180.0) * along
        d3 = (-1.0 / 60.0 + n2 / 1260.0) * along
    else:
        n = math.sqrt(n2)
        s2 = (1.0 - math.cos(n)) / n2
        s3 = (n - math.sin(n)) / (n2 * n)
        d2 = (math.sin(n) / n - 2.0 * s2) / n2 * along
        d3 = (s2 - 3.0 * s3) / n2 * along
    tr = cross(theta, rate)
    ttr = cross(theta, tr)
    store(out, 0, plus(rate, plus(times(s2, tr), times(s3, ttr))))
    bent = plus(times(d2, tr), times(d3, ttr))
    store(out, 3, plus(bent, times(s3, cross(rate, tr))))
    x, y, w = theta
    point[T] = 1.0 - s3 * (y * y + w * w)
    point[T + 1] = -s2 * w + s3 * x * y
    point[T + 2] = s2 * y + s3 * x * w
    point[T + 3] = s2 * w + s3 * x * y
    point[T + 4] = 1.0 - s3 * (x * x + w * w)
    point[T + 5] = -s2 * x + s3 * y * w
    point[T + 6] = -s2 * y + s3 * x * w
    point[T + 7] = s2 * x + s3 * y * w
    point[T + 8] = 1.0 - s3 * (x * x + y * y)


@inner(types.UniTuple(VECTOR, 2)(F1, int64, int64, F1, int64, F1, int64))
def _bent(pool, line, nq, z, q, v, qd):
    """What the elastic coordinates, and their rates, add to a column of Phi or Psi."""
    g, h = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(nq):
        bend = column(pool, line, nq * nq, i)
        g = plus(g, times(z[q + i], bend))
        h = plus(h, times(v[qd + i], bend))
    return g, h


@inner(types.void(SYSTEM, WORK, int64, F1, F1))
def _marker(system, work, m, z, v):
    """Position, orientation, their rates and bias accelerations of a marker."""
    b = system.marker[m, M_BODY]
    row = system.body[b]
    frame, point, pool = work.frame[b], work.point[m], system.pool
    nq = row[NQ]
    data = system.marker[m, M_DATA]
    phi, phi1 = system.marker[m, M_PHI], system.marker[m, M_PHI1]
    psi, psi1 = phi + 3 * nq, system.marker[m, M_PSI1]
    q, qd = row[POS] + row[NP] - nq, row[VEL] + row[RD]
    d, u, extra = load(pool, data), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    theta, rate, curl = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for k in range(nq):
        base = column(pool, data + 12, nq, k)
        tilt = column(pool, data + 12 + 3 * nq, nq, k)
        if phi1 >= 0:
            g, h = _bent(pool, phi1 + k * nq, nq, z, q, v, qd)
            for a in range(3):
                work.phi[phi + a * nq + k] = base[a] + g[a]
            extra = plus(extra, times(v[qd + k], h))
            base = plus(base, times(0.5, g))
        d = plus(d, times(z[q + k], base))
        u = plus(u, times(v[qd + k], column(work.phi, phi, nq, k)))
        if psi1 >= 0:
            g, h = _bent(pool, psi1 + k * nq, nq, z, q, v, qd)
            for a in range(3):
                work.phi[psi + a * nq + k] = tilt[a] + g[a]
            curl = plus(curl, times(v[qd + k], h))
            tilt = plus(tilt, times(0.5, g))
        theta = plus(theta, times(z[q + k], tilt))
        rate = plus(rate, times(v[qd + k], column(work.phi, psi, nq, k)))
    w, al = load(frame, OMEGA), load(frame, ALPHA)
    wd = cross(w, d)
    vel = plus(load(frame, V), plus(wd, u))
    acc = plus(load(frame, A), plus(cross(al, d), cross(w, wd)))
    acc = plus(acc, plus(times(2.0, cross(w, u)), extra))
    store(point, PX, plus(load(frame, X), rotate(frame, R, d)))
    store(point, PV, rotate(frame, R, vel))
    store(point, PA, rotate(frame, R, acc))
    store(point, D, d)
    store(point, U, u)
    _rotation_rates(point, theta, rate, work.scratch)
    relative, bent = load(work.scratch, 0), load(work.scratch, 3)
    if psi1 >= 0:
        bent = plus(bent, rotate(point, T, curl))
    al = plus(al, plus(cross(w, relative), bent))
    store(point, PW, rotate(frame, R, plus(w, relative)))
    store(point, PAL, rotate(frame, R, al))
    size = math.sqrt(dot(theta, theta))
    axis = (0.0, 0.0, 1.0) if size == 0.0 else times(1.0 / size, theta)
    turned(frame, R, axis, size, point, PR)
    for i in range(3):
        r = load(point, PR + 3 * i)
        store(point, PR + 3 * i, rotate_back(pool, data + 3, r))


@inner(int64(int64))
def quadratic_column(a):
    """Column of Oe that belongs to entry a of J: J has xz before yz, Oe after."""
    if a == 4:
        return 5
    if a == 5:
        return 4
    return a


@inner(float64(F1, int64, int64, VECTOR))
def omega_product(a, at, stride, w):
    """A row of Oe (columns `stride` apart) times (wx2, wy2, wz2, wxwy, wywz, wxwz)."""
    return (
        a[at] * w[0] * w[0]
        + a[at + stride] * w[1] * w[1]
        + a[at + 2 * stride] * w[2] * w[2]
        + a[at + 3 * stride] * w[0] * w[1]
        + a[at + 4 * stride] * w[1] * w[2]
        + a[at + 5 * stride] * w[0] * w[2]
    )


@inner(types.void(SYSTEM, WORK, int64, F1, F1))
def body_state(system, work, b, z, v):
    """What body and linearise_body share, into Work.modal and Work.scratch.

    Work.modal holds, per elastic coordinate: Ct (3), Cr (3), the derivative of J (6),
    Oe Omega (1), the row sum Ge q' w (1), and the Cr of the gyroscopic term (3).
    Work.scratch holds mdCM (3), J (6), J' (6), Ct^T q' (3), Cr^T q' (3).
    """
    row = system.body[b]
    nq, flags = row[NQ], row[FLAGS]
    pool, s, modal = system.pool, work.scratch, work.modal
    o = row[DATA]
    q, qd = row[POS] + row[NP] - nq, row[VEL] + row[RD]
    vec, sq, n2 = o + P_VECTORS, o + P_VECTORS + N_VECTORS * nq, nq * nq
    w = load(work.frame[b], OMEGA)
    for i in range(3):
        s[i] = pool[o + P_MD + i]
    for i in range(6):
        s[3 + i] = pool[o + P_J + i]
        s[9 + i] = 0.0
    for i in range(6):
        s[15 + i] = 0.0
    for k in range(nq):
        at = k * N_MODAL
        qk, qdk = z[q + k], v[qd + k]
        oe = omega_product(pool, vec + V_OE0 * nq + k, nq, w)
        ge = 0.0
        for a in range(3):
            modal[at + a] = pool[vec + (V_CT + a) * nq + k]
            modal[at + 3 + a] = pool[vec + (V_CR + a) * nq + k]
            modal[at + 14 + a] = pool[vec + (V_CR + a) * nq + k]
        for a in range(6):
            modal[at + 6 + a] = pool[vec + (V_J1 + a) * nq + k]
        mean = load(modal, at)
        for i in range(nq):
            e, f = k * nq + i, i * nq + k
            qi, qdi = z[q + i], v[qd + i]
            if flags & HAS_CR1:
                for a in range(3):
                    c = pool[sq + (S_CR1 + a) * n2 + e]
                    modal[at + 3 + a] += c * qi
                    ge += (c - pool[sq + (S_CR1 + a) * n2 + f]) * qdi * w[a]
            if flags & HAS_OE1:
                oe += omega_product(pool, sq + S_OE1 * n2 + e, n2, w) * qi
            if flags & HAS_CT1:
                bend = times(qi, column(pool, sq + S_CT1 * n2, n2, e))
                mean = plus(mean, times(0.5, bend))
                for a in range(3):
                    modal[at + a] += bend[a]
            if flags & HAS_QUADRATIC_J:
                for a in range(6):
                    c = pool[sq + (S_OE1 + quadratic_column(a)) * n2 + e]
                    c = -2.0 * c if a < 3 else -c
                    modal[at + 6 + a] += c * qi
        if flags & HAS_QUADRATIC_J:
            for a in range(3):
                modal[at + 14 + a] = modal[at + 3 + a]
        modal[at + 12] = oe
        modal[at + 13] = ge
        for a in range(3):
            s[a] += mean[a] * qk
            s[15 + a] += modal[at + a] * qdk
            s[18 + a] += modal[at + 14 + a] * qdk
        for a in range(6):
            constant = pool[vec + (V_J1 + a) * nq + k]
            s[3 + a] += 0.5 * (modal[at + 6 + a] + constant) * qk
            s[9 + a] += modal[at + 6 + a] * qdk


@inner(types.void(F1, int64, int64, VECTOR, F1))
def _rigid_inertia(M, block, nv, md, s):
    """The coupling md~ and the inertia J of a mass matrix."""
    r = block + 3 * nv
    for i in range(3):
        M[block + i * nv + 3 + i] = 0.0
        M[r + i * nv + i] = 0.0
    M[r + 1], M[r + 2], M[r + nv] = -md[2], md[1], md[2]
    M[r + nv + 2], M[r + 2 * nv], M[r + 2 * nv + 1] = -md[0], -md[1], md[0]
    for i in range(3):
        for j in range(3):
            if i != j:
                M[block + j * nv + 3 + i] = M[r + i * nv + j]
    M[r + 3], M[r + nv + 4], M[r + 2 * nv + 5] = s[3], s[4], s[5]
    M[r + 4] = M[r + nv + 3] = s[6]
    M[r + 5] = M[r + 2 * nv + 3] = s[7]
    M[r + nv + 5] = M[r + 2 * nv + 4] = s[8]


@inner(types.void(SYSTEM, WORK, int64, F1, F1))
def _body(system, work, b, z, v):
    """Mass matrix and generalised force of one body, eq. (3)."""
    row = system.body[b]
    nq, nv, rd = row[NQ], row[NV], row[RD]
    if nv == 0:
        return
    body_state(system, work, b, z, v)
    pool, frame, M, f = system.pool, work.frame[b], work.M, work.f
    s, modal = work.scratch, work.modal
    o, block, first = row[DATA], row[BLOCK], row[VEL]
    q, qd = row[POS] + row[NP] - nq, row[VEL] + rd
    sq, n2 = o + P_VECTORS + N_VECTORS * nq, nq * nq
    mass, md, w = pool[o + P_MASS], load(s, 0), load(frame, OMEGA)
    g = (system.gravity[0], system.gravity[1], system.gravity[2])
    a = minus(load(frame, A), rotate_back(frame, R, g))
    al = load(frame, ALPHA)
    for i in range(min(rd, 3)):
        for j in range(3):
            M[block + i * nv + j] = mass if i == j else 0.0
    if rd >= 3:
        h = plus(times(mass, a), cross(w, cross(w, md)))
        h = plus(h, times(2.0, cross(w, load(s, 15))))
        store(f, first, times(-1.0, h))
    if rd == 6:
        Jw = inertia_times(s, 3, w)
        h = plus(cross(md, a), plus(cross(w, Jw), inertia_times(s, 9, w)))
        h = plus(h, cross(w, load(s, 18)))
        store(f, first + 3, times(-1.0, h))
        _rigid_inertia(M, block, nv, md, s)
    for k in range(nq):
        at, line = k * N_MODAL, block + (rd + k) * nv
        ct, cr = load(modal, at), load(modal, at + 3)
        force = -modal[at + 12] - modal[at + 13] - dot(ct, a) - dot(cr, al)
        force -= pool[o + P_VECTORS + V_KSIGMA * nq + k]
        for i in range(nq):
            e = k * nq + i
            force -= pool[sq + S_KE * n2 + e] * z[q + i]
            force -= pool[sq + S_DE * n2 + e] * v[qd + i]
        f[qd + k] = force
        for i in range(min(rd, 3)):
            M[line + i] = M[block + i * nv + rd + k] = ct[i]
        for i in range(rd - 3):
            M[line + 3 + i] = M[block + (3 + i) * nv + rd + k] = cr[i]
    if row[FLAGS] & HAS_KE1:
        add_cubic_force(pool, sq + N_SQUARES * n2, nq, z, q, f, qd)


@inner(types.void(SYSTEM, WORK, float64, F1, F1))
def evaluate_bodies(system, work, t, z, v):
    """Frames, markers, mass matrices and forces of all bodies.

    Bodies are sorted so that a prescribed frame comes after its base; markers are
    sorted by body.
    """
    m = 0
    markers = len(system.marker)
    for b in range(len(system.body)):
        if system.body[b, MOTION] == FREE:
            free_frame(system, work, b, z, v)
        else:
            prescribed_frame(system, work, b, t)
        while m < markers and system.marker[m, M_BODY] == b:
            _marker(system, work, m, z, v)
            m += 1
        _body(system, work, b, z, v)
        if system.body[b, FLAGS] & STIFFENED:
            add_stiffened(system, work, b, z, v)
