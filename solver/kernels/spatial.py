"""Spatial flexible bodies: kinematics, equations of motion.

Source: the equations of motion of one body in SID quantities (Wallrapp 1994).
Velocities and accelerations of a body frame are resolved in that frame; orientation
is a unit quaternion (scalar first).
"""

from __future__ import annotations

import math

from numba import float64, int64, types

from .compiling import inner
from .drives import drive_value
from .layout import (
    BASE,
    BLOCK,
    DATA,
    DRIVE,
    F1,
    FIXED,
    FLAGS,
    FRAME,
    FREE,
    GROUND,
    HAS_CR1,
    HAS_CT1,
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
    PRISMATIC,
    RD,
    REVOLUTE,
    SYSTEM,
    TIP,
    VEL,
    WORK,
)

# Columns of Work.frame: position, rotation matrix (body to inertial, by rows),
# velocity, angular velocity, acceleration and angular acceleration at zero z_II'
# (body-resolved, absolute), quaternion.
X, R, V, OMEGA, A, ALPHA, P = 0, 3, 12, 15, 18, 21, 24
N_FRAME = 28

# Columns of Work.point: inertial position, velocity and acceleration (at zero z_II');
# body-resolved position and relative velocity; rotation matrix (marker to inertial, by
# rows), inertial angular velocity and acceleration, and the matrix T that maps rates
# of the rotation vector Psi q to an angular velocity in the body frame.
PX, PV, PA, D, U, PR, PW, PAL, T = 0, 3, 6, 9, 12, 15, 24, 27, 30
N_POINT = 39

# Pool layout of a body: mass, mdCM, J, then arrays over the elastic coordinates:
# vectors (by component, then mode), then square matrices (row k, column l).
P_MASS, P_MD, P_J, P_VECTORS = 0, 1, 4, 10
V_CT, V_CR, V_J1, V_OE0, V_KSIGMA, N_VECTORS = 0, 3, 6, 12, 18, 19
S_KE, S_DE, S_CR1, S_OE1, S_CT1, N_SQUARES = 0, 1, 2, 5, 11, 14

#: Below this rotation the series of the coefficients of T are used.
SMALL_ROTATION = 0.05

#: Entries of Work.modal per elastic coordinate.
N_MODAL = 17

VECTOR = types.UniTuple(float64, 3)


@inner(VECTOR(F1, int64))
def load(a, at):
    return a[at], a[at + 1], a[at + 2]


@inner(types.void(F1, int64, VECTOR))
def store(a, at, x):
    a[at], a[at + 1], a[at + 2] = x[0], x[1], x[2]


@inner(VECTOR(VECTOR, VECTOR))
def cross(a, b):
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@inner(float64(VECTOR, VECTOR))
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner(VECTOR(VECTOR, VECTOR))
def plus(a, b):
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inner(VECTOR(VECTOR, VECTOR))
def minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inner(VECTOR(float64, VECTOR))
def times(s, a):
    return s * a[0], s * a[1], s * a[2]


@inner(VECTOR(F1, int64, VECTOR))
def rotate(m, at, x):
    """The matrix m[at:at+9], by rows, times x."""
    return (
        m[at] * x[0] + m[at + 1] * x[1] + m[at + 2] * x[2],
        m[at + 3] * x[0] + m[at + 4] * x[1] + m[at + 5] * x[2],
        m[at + 6] * x[0] + m[at + 7] * x[1] + m[at + 8] * x[2],
    )


@inner(VECTOR(F1, int64, VECTOR))
def rotate_back(m, at, x):
    """The transpose of the matrix m[at:at+9], by rows, times x."""
    return (
        m[at] * x[0] + m[at + 3] * x[1] + m[at + 6] * x[2],
        m[at + 1] * x[0] + m[at + 4] * x[1] + m[at + 7] * x[2],
        m[at + 2] * x[0] + m[at + 5] * x[1] + m[at + 8] * x[2],
    )


@inner(VECTOR(F1, int64, int64, int64))
def column(a, at, stride, k):
    """Entry k of three consecutive vectors of length `stride`."""
    return a[at + k], a[at + stride + k], a[at + 2 * stride + k]


@inner(types.void(F1, int64, F1, int64))
def rotation_matrix(p, at, out, to):
    """Rotation matrix, by rows, of the quaternion p[at:at+4], of any length."""
    a, b, c, d = p[at], p[at + 1], p[at + 2], p[at + 3]
    n = 2.0 / (a * a + b * b + c * c + d * d)
    out[to] = 1.0 - n * (c * c + d * d)
    out[to + 1] = n * (b * c - a * d)
    out[to + 2] = n * (b * d + a * c)
    out[to + 3] = n * (b * c + a * d)
    out[to + 4] = 1.0 - n * (b * b + d * d)
    out[to + 5] = n * (c * d - a * b)
    out[to + 6] = n * (b * d - a * c)
    out[to + 7] = n * (c * d + a * b)
    out[to + 8] = 1.0 - n * (b * b + c * c)


@inner(types.void(SYSTEM, int64, F1, F1, F1))
def frame_rate(system, b, z, v, out):
    """Rates of position and quaternion of a body frame: r' = R v, p' = p (0, w) / 2."""
    row = system.body[b]
    p, u = row[POS], row[VEL]
    quaternion, at = z, p + 3
    if row[RD] == 3:
        quaternion, at = system.pool, row[FRAME]
    a, b1, c, d = (
        quaternion[at],
        quaternion[at + 1],
        quaternion[at + 2],
        quaternion[at + 3],
    )
    v1, v2, v3 = v[u], v[u + 1], v[u + 2]
    n = 2.0 / (a * a + b1 * b1 + c * c + d * d)
    out[p] = (
        (1.0 - n * (c * c + d * d)) * v1
        + n * (b1 * c - a * d) * v2
        + n * (b1 * d + a * c) * v3
    )
    out[p + 1] = (
        n * (b1 * c + a * d) * v1
        + (1.0 - n * (b1 * b1 + d * d)) * v2
        + n * (c * d - a * b1) * v3
    )
    out[p + 2] = (
        n * (b1 * d - a * c) * v1
        + n * (c * d + a * b1) * v2
        + (1.0 - n * (b1 * b1 + c * c)) * v3
    )
    if row[RD] == 6:
        w1, w2, w3 = 0.5 * v[u + 3], 0.5 * v[u + 4], 0.5 * v[u + 5]
        out[p + 3] = -b1 * w1 - c * w2 - d * w3
        out[p + 4] = a * w1 + c * w3 - d * w2
        out[p + 5] = a * w2 + d * w1 - b1 * w3
        out[p + 6] = a * w3 + b1 * w2 - c * w1


@inner(types.void(F1, int64, float64, float64, float64))
def turn(z, at, t1, t2, t3):
    """Multiplies the quaternion z[at:at+4] by the rotation vector t (body frame)."""
    angle = math.sqrt(t1 * t1 + t2 * t2 + t3 * t3)
    c = math.cos(0.5 * angle)
    s = 0.5 if angle < 1e-12 else math.sin(0.5 * angle) / angle
    t1, t2, t3 = s * t1, s * t2, s * t3
    a, b1, b2, b3 = z[at], z[at + 1], z[at + 2], z[at + 3]
    p0 = c * a - b1 * t1 - b2 * t2 - b3 * t3
    p1 = c * b1 + a * t1 + b2 * t3 - b3 * t2
    p2 = c * b2 + a * t2 + b3 * t1 - b1 * t3
    p3 = c * b3 + a * t3 + b1 * t2 - b2 * t1
    norm = math.sqrt(p0 * p0 + p1 * p1 + p2 * p2 + p3 * p3)
    z[at], z[at + 1], z[at + 2], z[at + 3] = p0 / norm, p1 / norm, p2 / norm, p3 / norm


@inner(types.void(SYSTEM, WORK, int64, F1, F1))
def _free_frame(system, work, b, z, v):
    """Body frame from the coordinates, eq. (1) and (2)."""
    row = system.body[b]
    p, u = row[POS], row[VEL]
    frame = work.frame[b]
    store(frame, X, load(z, p))
    store(frame, V, load(v, u))
    if row[RD] == 6:
        for i in range(4):
            frame[P + i] = z[p + 3 + i]
        store(frame, OMEGA, load(v, u + 3))
    else:
        for i in range(4):
            frame[P + i] = system.pool[row[FRAME] + i]
        store(frame, OMEGA, (0.0, 0.0, 0.0))
    rotation_matrix(frame, P, frame, R)
    store(frame, A, cross(load(frame, OMEGA), load(frame, V)))
    store(frame, ALPHA, (0.0, 0.0, 0.0))


@inner(types.void(F1, int64, VECTOR, float64, F1, int64))
def _turned(matrix, at, axis, angle, out, to):
    """The matrix at `at` times the rotation by `angle` about a unit axis."""
    c, s = math.cos(angle), math.sin(angle)
    for i in range(3):
        r = (matrix[at + 3 * i], matrix[at + 3 * i + 1], matrix[at + 3 * i + 2])
        along = dot(r, axis) * (1.0 - c)
        turned = cross(r, axis)
        store(
            out,
            to + 3 * i,
            (
                c * r[0] + s * turned[0] + along * axis[0],
                c * r[1] + s * turned[1] + along * axis[1],
                c * r[2] + s * turned[2] + along * axis[2],
            ),
        )


@inner(types.void(F1, int64, F1))
def _undo_tip(pool, tip, frame):
    """Frame orientation from that of its tip marker: R <- R AP0^T."""
    for i in range(3):
        r = load(frame, R + 3 * i)
        store(frame, R + 3 * i, rotate(pool, tip + 3, r))


@inner(types.void(SYSTEM, WORK, int64, float64))
def _prescribed_frame(system, work, b, t):
    """Body frame that hangs on a marker of a prescribed body by a driven joint."""
    row = system.body[b]
    frame = work.frame[b]
    pool = system.pool
    if row[MOTION] == GROUND:
        for i in range(N_FRAME):
            frame[i] = 0.0
        frame[R] = frame[R + 4] = frame[R + 8] = frame[P] = 1.0
        return
    base = work.point[row[BASE]]
    tip = system.marker[row[TIP], M_DATA]
    s, sd, sdd = 0.0, 0.0, 0.0
    if row[DRIVE] >= 0:
        s, sd, sdd = drive_value(system, row[DRIVE], work.clock[0], t)
    axis = (0.0, 0.0, 1.0)
    if row[MOTION] != FIXED:
        axis = load(pool, row[FRAME])
    e = rotate(base, PR, axis)
    x, vel, acc = load(base, PX), load(base, PV), load(base, PA)
    w, al = load(base, PW), load(base, PAL)
    angle = s if row[MOTION] == REVOLUTE else 0.0
    _turned(base, PR, axis, angle, frame, R)
    if row[MOTION] == REVOLUTE:
        al = plus(al, plus(times(sdd, e), times(sd, cross(w, e))))
        w = plus(w, times(sd, e))
    elif row[MOTION] == PRISMATIC:
        we = cross(w, e)
        x = plus(x, times(s, e))
        vel = plus(vel, plus(times(sd, e), times(s, we)))
        acc = plus(acc, plus(times(sdd, e), times(2.0 * sd, we)))
        acc = plus(acc, times(s, plus(cross(al, e), cross(w, we))))
    _undo_tip(pool, tip, frame)
    r = rotate(frame, R, load(pool, tip))
    wr = cross(w, r)
    store(frame, X, minus(x, r))
    store(frame, V, rotate_back(frame, R, minus(vel, wr)))
    store(frame, OMEGA, rotate_back(frame, R, w))
    acc = minus(acc, plus(cross(al, r), cross(w, wr)))
    store(frame, A, rotate_back(frame, R, acc))
    store(frame, ALPHA, rotate_back(frame, R, al))


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
    _turned(frame, R, axis, size, point, PR)
    for i in range(3):
        r = load(point, PR + 3 * i)
        store(point, PR + 3 * i, rotate_back(pool, data + 3, r))


@inner(types.void(SYSTEM, WORK, F1, int64, int64, VECTOR, VECTOR))
def segment(system, work, out, offset, m, force, torque):
    """Adds the generalised force of an inertial force and torque at a marker.

    The same row maps velocities to the marker's velocity along the force plus its
    angular velocity along the torque, and variations of position likewise.
    """
    b = system.marker[m, M_BODY]
    row = system.body[b]
    frame, point = work.frame[b], work.point[m]
    rd, nq = row[RD], row[NQ]
    f, t = rotate_back(frame, R, force), rotate_back(frame, R, torque)
    if rd >= 3:
        store(out, offset, plus(load(out, offset), f))
    if rd == 6:
        moment = plus(cross(load(point, D), f), t)
        store(out, offset + 3, plus(load(out, offset + 3), moment))
    if nq == 0:
        return
    phi = system.marker[m, M_PHI]
    psi = phi + 3 * nq
    t = rotate_back(point, T, t)
    for k in range(nq):
        out[offset + rd + k] += dot(column(work.phi, phi, nq, k), f)
        out[offset + rd + k] += dot(column(work.phi, psi, nq, k), t)


@inner(VECTOR(F1, int64, VECTOR))
def inertia_times(six, at, x):
    """The symmetric matrix (xx, yy, zz, xy, xz, yz) at `at` times x."""
    return (
        six[at] * x[0] + six[at + 3] * x[1] + six[at + 4] * x[2],
        six[at + 3] * x[0] + six[at + 1] * x[1] + six[at + 5] * x[2],
        six[at + 4] * x[0] + six[at + 5] * x[1] + six[at + 2] * x[2],
    )


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
            _free_frame(system, work, b, z, v)
        else:
            _prescribed_frame(system, work, b, t)
        while m < markers and system.marker[m, M_BODY] == b:
            _marker(system, work, m, z, v)
            m += 1
        _body(system, work, b, z, v)
