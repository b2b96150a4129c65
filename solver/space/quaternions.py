"""Quaternions of body frames in space: their rates, and turning them."""

from __future__ import annotations

import math

from numba import float64, int64, types

from ..compiler.compiling import inner
from .layout import F1, FRAME, POS, RD, SYSTEM, VEL


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
