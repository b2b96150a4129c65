"""Position coordinates z_I: their rates, their tangent space, and steps in it.

Variations of z_I are resolved in the tangent space, with as many entries as z_II: a
translation and a small rotation in the body frame, and the elastic coordinates. There
z_I' = Z z_II varies as

    dx' = dv + dtheta x v,    dtheta' = domega - omega x dtheta / 2 + omega dr,
    dr' = -omega . dtheta / 4,    dq' = dq',

in short dz_I' = E dz_I + dz_II, where dr is the change of length of a quaternion
p = p0 (1 + dr, dtheta / 2), whose components are integrated freely (in the plane an
angle replaces it). Only the tangent part is stored; dr follows from it. The frames
are columns of `WorkArrays.frame`.
"""

import math

from ..compiler.inner_kernels import quotient
from ..compiler.kernels import entry, inner
from ..compiler.types import complex128, float64, int64, void
from .dimension import FRAMES, PLANE, SPACE
from .system_arrays import C1, F1, F2, SYSTEM


@inner(void(SYSTEM, int64, F1, F1, F1))
def frame_rate(system, b, z, v, out):
    """Rates of position and quaternion of a body frame: r' = R v, p' = p (0, w) / 2."""
    row = system.body[b]
    p, u = row.pos, row.vel
    quaternion, at = z, p + 3
    if row.rd == 3:
        quaternion, at = system.real_data, row.frame
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
    if row.rd == 6:
        w1, w2, w3 = 0.5 * v[u + 3], 0.5 * v[u + 4], 0.5 * v[u + 5]
        out[p + 3] = -b1 * w1 - c * w2 - d * w3
        out[p + 4] = a * w1 + c * w3 - d * w2
        out[p + 5] = a * w2 + d * w1 - b1 * w3
        out[p + 6] = a * w3 + b1 * w2 - c * w1


@inner(void(F1, int64, float64, float64, float64))
def rotate_quaternion(z, at, t1, t2, t3):
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


# Columns of frames in the plane, and in space.
_PLANE, _SPACE = (FRAMES[space].record.places for space in (PLANE, SPACE))
COS, SIN = _PLANE["R"], _PLANE["R"] + 1
VX, VY = _PLANE["v"], _PLANE["v"] + 1
R, V, OMEGA, P = (_SPACE[field] for field in ("R", "v", "w", "p"))


RATE = void(SYSTEM, F1, F1, F1)
RETRACT = void(SYSTEM, F2, F1, F1)


@entry(RATE)
def rate(system, z, v, out):
    """z_I' = Z(z_I) z_II, eq. (3)."""
    for b in range(len(system.body)):
        row = system.body[b]
        p, u, rd, nq = row.pos, row.vel, row.rd, row.nq
        if rd > 0 and system.planar == 1:
            angle = z[p + 2] if rd == 3 else system.real_data[row.frame]
            c, s = math.cos(angle), math.sin(angle)
            out[p] = c * v[u] - s * v[u + 1]
            out[p + 1] = s * v[u] + c * v[u + 1]
            if rd == 3:
                out[p + 2] = v[u + 2]
        elif rd > 0:
            frame_rate(system, b, z, v, out)
        for k in range(nq):
            out[p + row.np - nq + k] = v[u + rd + k]


@inner(*[void(SYSTEM, F2, X, A, A) for X, A in ((float64, F1), (complex128, C1))])
def rhs_to_tangent(system, frame, mu, z, x):
    """A right-hand side z of (mu - E) dz_I, from coordinates to the tangent space."""
    for b in range(len(system.body)):
        row = system.body[b]
        p, u, rd, nq = row.pos, row.vel, row.rd, row.nq
        g = frame[b]
        if rd > 0 and system.planar == 1:
            x[u] = g[COS] * z[p] + g[SIN] * z[p + 1]
            x[u + 1] = -g[SIN] * z[p] + g[COS] * z[p + 1]
            if rd == 3:
                x[u + 2] = z[p + 2]
        elif rd > 0:
            for i in range(3):
                x[u + i] = (
                    g[R + i] * z[p] + g[R + 3 + i] * z[p + 1] + g[R + 6 + i] * z[p + 2]
                )
            if rd == 6:
                a, b1, b2, b3 = g[P], g[P + 1], g[P + 2], g[P + 3]
                r, r1, r2, r3 = z[p + 3], z[p + 4], z[p + 5], z[p + 6]
                length_change = quotient(a * r + b1 * r1 + b2 * r2 + b3 * r3, mu)
                x[u + 3] = 2.0 * (a * r1 - b1 * r + b3 * r2 - b2 * r3)
                x[u + 4] = 2.0 * (a * r2 - b2 * r + b1 * r3 - b3 * r1)
                x[u + 5] = 2.0 * (a * r3 - b3 * r + b2 * r1 - b1 * r2)
                for i in range(3):
                    x[u + 3 + i] += length_change * g[OMEGA + i]
        for k in range(nq):
            x[u + rd + k] = z[p + row.np - nq + k]


@inner(*[void(SYSTEM, F2, float64, F1), void(SYSTEM, F2, complex128, C1)])
def apply_shifted_inverse(system, frame, mu, x):
    """Replaces a tangent vector x by (mu - E)^-1 x."""
    inverse = quotient(1.0, mu)
    for b in range(len(system.body)):
        row = system.body[b]
        u, rd = row.vel, row.rd
        g = frame[b]
        for k in range(u + rd, u + row.nv):
            x[k] *= inverse
        if rd == 3 and system.planar == 1:
            x[u + 2] *= inverse
            x[u] -= g[VY] * x[u + 2]
            x[u + 1] += g[VX] * x[u + 2]
        elif rd == 6:
            w1, w2, w3 = 0.5 * g[OMEGA], 0.5 * g[OMEGA + 1], 0.5 * g[OMEGA + 2]
            v1, v2, v3 = g[V], g[V + 1], g[V + 2]
            t1, t2, t3 = x[u + 3], x[u + 4], x[u + 5]
            scale = quotient(1.0, mu * mu + w1 * w1 + w2 * w2 + w3 * w3)
            a1 = (mu * t1 - w2 * t3 + w3 * t2) * scale
            a2 = (mu * t2 - w3 * t1 + w1 * t3) * scale
            a3 = (mu * t3 - w1 * t2 + w2 * t1) * scale
            x[u + 3], x[u + 4], x[u + 5] = a1, a2, a3
            x[u] += a2 * v3 - a3 * v2
            x[u + 1] += a3 * v1 - a1 * v3
            x[u + 2] += a1 * v2 - a2 * v1
        translations = 2 if system.planar == 1 else 3
        for k in range(u, u + min(rd, translations)):
            x[k] *= inverse


@inner(
    *[
        void(SYSTEM, F2, int64, float64, F1, int64, F1, int64),
        void(SYSTEM, F2, int64, complex128, F1, int64, C1, int64),
    ]
)
def add_row_shifted_inverse(system, frame, b, mu, source, at, out, to):
    """Adds the row source (mu - E)^-1 of one body to a row of `out`."""
    row = system.body[b]
    nv, rd = row.nv, row.rd
    g = frame[b]
    inverse = quotient(1.0, mu)
    for k in range(nv):
        if rd != 6 or k < 3 or k > 5:
            out[to + k] += source[at + k] * inverse
    if rd == 3 and system.planar == 1:
        rotation_entry = source[at + 1] * g[VX] - source[at] * g[VY]
        out[to + 2] += rotation_entry * inverse * inverse
    elif rd == 6:
        w1, w2, w3 = 0.5 * g[OMEGA], 0.5 * g[OMEGA + 1], 0.5 * g[OMEGA + 2]
        v1, v2, v3 = g[V], g[V + 1], g[V + 2]
        s1, s2, s3 = source[at], source[at + 1], source[at + 2]
        t1 = source[at + 3] + (v2 * s3 - v3 * s2) * inverse
        t2 = source[at + 4] + (v3 * s1 - v1 * s3) * inverse
        t3 = source[at + 5] + (v1 * s2 - v2 * s1) * inverse
        scale = quotient(1.0, mu * mu + w1 * w1 + w2 * w2 + w3 * w3)
        out[to + 3] += (mu * t1 + w2 * t3 - w3 * t2) * scale
        out[to + 4] += (mu * t2 + w3 * t1 - w1 * t3) * scale
        out[to + 5] += (mu * t3 + w1 * t2 - w2 * t1) * scale


@inner(
    *[
        void(SYSTEM, F2, float64, F1, F1, F1),
        void(SYSTEM, F2, complex128, C1, C1, C1),
    ]
)
def tangent_to_coordinates(system, frame, mu, x, r, out):
    """Map a tangent vector x of z_I to coordinates.

    The length of quaternions changes, too, by its part of the right-hand side r.
    """
    for b in range(len(system.body)):
        row = system.body[b]
        p, u, rd, nq = row.pos, row.vel, row.rd, row.nq
        g = frame[b]
        if rd > 0 and system.planar == 1:
            out[p] = g[COS] * x[u] - g[SIN] * x[u + 1]
            out[p + 1] = g[SIN] * x[u] + g[COS] * x[u + 1]
            if rd == 3:
                out[p + 2] = x[u + 2]
        elif rd > 0:
            for i in range(3):
                o = R + 3 * i
                out[p + i] = g[o] * x[u] + g[o + 1] * x[u + 1] + g[o + 2] * x[u + 2]
            if rd == 6:
                a, b1, b2, b3 = g[P], g[P + 1], g[P + 2], g[P + 3]
                t1, t2, t3 = 0.5 * x[u + 3], 0.5 * x[u + 4], 0.5 * x[u + 5]
                length_change = (
                    a * r[p + 3] + b1 * r[p + 4] + b2 * r[p + 5] + b3 * r[p + 6]
                )
                omega_theta = g[OMEGA] * t1 + g[OMEGA + 1] * t2 + g[OMEGA + 2] * t3
                length_change = quotient(length_change - 0.5 * omega_theta, mu)
                out[p + 3] = length_change * a - b1 * t1 - b2 * t2 - b3 * t3
                out[p + 4] = length_change * b1 + a * t1 + b2 * t3 - b3 * t2
                out[p + 5] = length_change * b2 + a * t2 + b3 * t1 - b1 * t3
                out[p + 6] = length_change * b3 + a * t3 + b1 * t2 - b2 * t1
        for k in range(nq):
            out[p + row.np - nq + k] = x[u + rd + k]


@entry(RETRACT)
def retract(system, frame, z, x):
    """Moves z_I by a small tangent vector x, keeping quaternions of unit length."""
    for b in range(len(system.body)):
        row = system.body[b]
        p, u, rd, nq = row.pos, row.vel, row.rd, row.nq
        g = frame[b]
        if rd > 0 and system.planar == 1:
            z[p] += g[COS] * x[u] - g[SIN] * x[u + 1]
            z[p + 1] += g[SIN] * x[u] + g[COS] * x[u + 1]
            if rd == 3:
                z[p + 2] += x[u + 2]
        elif rd > 0:
            for i in range(3):
                o = R + 3 * i
                z[p + i] += g[o] * x[u] + g[o + 1] * x[u + 1] + g[o + 2] * x[u + 2]
            if rd == 6:
                rotate_quaternion(z, p + 3, x[u + 3], x[u + 4], x[u + 5])
        for k in range(nq):
            z[p + row.np - nq + k] += x[u + rd + k]


@inner(void(SYSTEM, F1, F1))
def chord_of_screw(system, x, y):
    """Tangent vectors y with straight translations for those of x along screws.

    A frame that translates by u and rotates by theta, both resolved in it and at
    constant rates, gets to u + (1 - cos n) / n^2 theta x u + (n - sin n) / n^3 theta x
    (theta x u) with n = |theta|.
    """
    for i in range(len(x)):
        y[i] = x[i]
    for b in range(len(system.body)):
        u, rd = system.body[b].vel, system.body[b].rd
        if rd == 3 and system.planar == 1:
            t1, t2, t3, u3 = 0.0, 0.0, x[u + 2], 0.0
        elif rd == 6:
            t1, t2, t3, u3 = x[u + 3], x[u + 4], x[u + 5], x[u + 2]
        else:
            continue
        n2 = t1 * t1 + t2 * t2 + t3 * t3
        if n2 < 1e-4:
            c, k = 0.5 - n2 / 24.0, 1.0 / 6.0 - n2 / 120.0
        else:
            n = math.sqrt(n2)
            c, k = (1.0 - math.cos(n)) / n2, (n - math.sin(n)) / (n2 * n)
        u1, u2 = x[u], x[u + 1]
        a1, a2, a3 = t2 * u3 - t3 * u2, t3 * u1 - t1 * u3, t1 * u2 - t2 * u1
        y[u] += c * a1 + k * (t2 * a3 - t3 * a2)
        y[u + 1] += c * a2 + k * (t3 * a1 - t1 * a3)
        if rd == 6:
            y[u + 2] += c * a3 + k * (t1 * a2 - t2 * a1)


@inner(void(SYSTEM, F1, F1, F1, F1))
def update_along_chord(system, z0, x, dz, z1):
    """z1 = z0 + dz, but quaternions rotate by the vectors in x, of which dz is half."""
    for i in range(len(z0)):
        z1[i] = z0[i] + dz[i]
    for b in range(len(system.body)):
        if system.body[b].rd == 6:
            p, u = system.body[b].pos + 3, system.body[b].vel + 3
            n = math.sqrt(x[u] * x[u] + x[u + 1] * x[u + 1] + x[u + 2] * x[u + 2])
            c, s = math.cos(0.5 * n), 2.0 * math.sin(0.5 * n) / max(n, 1e-300)
            for i in range(p, p + 4):
                z1[i] = c * z0[i] + (s if n > 1e-12 else 1.0) * dz[i]
