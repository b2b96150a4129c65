"""Body frames in space: free ones with a unit quaternion, and prescribed ones."""

from __future__ import annotations

import math

from numba import float64, int64, types

from .compiling import inner
from .drives import drive_value
from .layout import (
    BASE,
    DRIVE,
    F1,
    FIXED,
    FRAME,
    GROUND,
    M_DATA,
    MOTION,
    POS,
    PRISMATIC,
    RD,
    REVOLUTE,
    SYSTEM,
    TIP,
    VEL,
    WORK,
)
from .spatial_columns import (
    ALPHA,
    N_FRAME,
    OMEGA,
    PA,
    PAL,
    PR,
    PV,
    PW,
    PX,
    A,
    P,
    R,
    V,
    X,
)
from .vectors import (
    cross,
    load,
    minus,
    plus,
    rotate,
    rotate_back,
    rotation_matrix,
    store,
    times,
    turned,
)


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
def free_frame(system, work, b, z, v):
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


@inner(types.void(F1, int64, F1))
def _undo_tip(pool, tip, frame):
    """Frame orientation from that of its tip marker: R <- R AP0^T."""
    for i in range(3):
        r = load(frame, R + 3 * i)
        store(frame, R + 3 * i, rotate(pool, tip + 3, r))


@inner(types.void(SYSTEM, WORK, int64, float64))
def prescribed_frame(system, work, b, t):
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
    turned(base, PR, axis, angle, frame, R)
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
