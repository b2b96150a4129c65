"""Spatial flexible bodies: kinematics, equations of motion.

Source: the equations of motion of one body in SID quantities (Wallrapp 1994).
Velocities and accelerations of a body frame are resolved in that frame; orientation
is a unit quaternion (scalar first).
"""

from __future__ import annotations

import math

from numba import float64, int64, njit, types

from .layout import F1, FRAME, INNER, POS, RD, SYSTEM, VEL

# Columns of Work.frame: position, rotation matrix (body to inertial, by rows),
# velocity, angular velocity, acceleration and angular acceleration at zero z_II'
# (body-resolved, absolute), quaternion.
X, R, V, OMEGA, A, ALPHA, P = 0, 3, 12, 15, 18, 21, 24
N_FRAME = 28
N_POINT = 48


@njit(types.void(F1, int64, F1, int64), **INNER)
def rotation_matrix(p, at, out, to):
    """Rotation matrix, by rows, of the unit quaternion p[at:at+4]."""
    a, b, c, d = p[at], p[at + 1], p[at + 2], p[at + 3]
    out[to] = 1.0 - 2.0 * (c * c + d * d)
    out[to + 1] = 2.0 * (b * c - a * d)
    out[to + 2] = 2.0 * (b * d + a * c)
    out[to + 3] = 2.0 * (b * c + a * d)
    out[to + 4] = 1.0 - 2.0 * (b * b + d * d)
    out[to + 5] = 2.0 * (c * d - a * b)
    out[to + 6] = 2.0 * (b * d - a * c)
    out[to + 7] = 2.0 * (c * d + a * b)
    out[to + 8] = 1.0 - 2.0 * (b * b + c * c)


@njit(types.void(SYSTEM, int64, F1, F1, F1), **INNER)
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
    out[p] = (
        (1.0 - 2.0 * (c * c + d * d)) * v1
        + 2.0 * (b1 * c - a * d) * v2
        + 2.0 * (b1 * d + a * c) * v3
    )
    out[p + 1] = (
        2.0 * (b1 * c + a * d) * v1
        + (1.0 - 2.0 * (b1 * b1 + d * d)) * v2
        + 2.0 * (c * d - a * b1) * v3
    )
    out[p + 2] = (
        2.0 * (b1 * d - a * c) * v1
        + 2.0 * (c * d + a * b1) * v2
        + (1.0 - 2.0 * (b1 * b1 + c * c)) * v3
    )
    if row[RD] == 6:
        w1, w2, w3 = 0.5 * v[u + 3], 0.5 * v[u + 4], 0.5 * v[u + 5]
        out[p + 3] = -b1 * w1 - c * w2 - d * w3
        out[p + 4] = a * w1 + c * w3 - d * w2
        out[p + 5] = a * w2 + d * w1 - b1 * w3
        out[p + 6] = a * w3 + b1 * w2 - c * w1


@njit(types.void(F1, int64, float64, float64, float64), **INNER)
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
