"""Rotations between markers in space, counted beyond what orientations tell."""

from __future__ import annotations

import math

from ...compiler.compiling import inner
from ...compiler.values import Vector, formula
from ...space.algebra import back, cross, dot, load, rotate, unit
from ...space.layout import LEAN, SPIN, TILT

#: Below this rotation the series of the coefficient of the inverse of T is used.
SMALL_ROTATION = 0.05
#: Largest rotation vector that is known [rad]; torques on its components grow without
#: bound towards a full turn.
FULL_TURN = 6.0


@formula
def _skew_part(x, y, z):
    """Axis times sine of the rotation matrix with these columns."""
    return Vector(0.5 * (y[2] - z[1]), 0.5 * (z[0] - x[2]), 0.5 * (x[1] - y[0]))


@formula
def _trace(x, y, z):
    return x[0] + y[1] + z[2]


@formula
def _row_sums(x, y, z, e):
    """R e + R^T e."""
    columns = e[0] * x + e[1] * y + e[2] * z
    return columns + Vector(dot(x, e), dot(y, e), dot(z, e))


@inner()
def relative_rotation(A, B):
    """Rotation vector from marker A to marker B, in the axes of A; at most pi.

    Near half a turn its direction is a column of R + R^T - 2 cos, else that of the
    skew part of R.
    """
    e0, e1, e2 = unit(A.x, 0), unit(A.x, 1), unit(A.x, 2)
    x = back(A.R, rotate(B.R, e0))
    y = back(A.R, rotate(B.R, e1))
    z = back(A.R, rotate(B.R, e2))
    axis = _skew_part(x, y, z)
    sine, cosine = math.sqrt(dot(axis, axis)), 0.5 * (_trace(x, y, z) - 1.0)
    angle = math.atan2(sine, cosine)
    if cosine > -0.9:
        return axis if sine < 1e-8 else (angle / sine) * axis
    xx, yy, zz = dot(x, e0), dot(y, e1), dot(z, e2)
    e = e0 if xx >= yy and xx >= zz else (e1 if yy >= zz else e2)
    n = _row_sums(x, y, z, e) - (2.0 * cosine) * e
    return (math.copysign(angle, dot(n, axis)) / math.sqrt(dot(n, n))) * n


@inner()
def _continued(theta, known):
    """The rotation vector of the same rotation that is nearest to a known one."""
    n = math.sqrt(dot(theta, theta))
    if n < 1e-8:
        return theta
    turn = 2.0 * math.pi
    whole = n + turn * math.floor(0.5 + (dot(theta, known) / n - n) / turn)
    return (whole / n) * theta if abs(whole) < FULL_TURN else theta


@inner()
def tilt_direction(theta, e):
    """T^-T e: the torque that works on the component of the rotation vector along e."""
    n2 = dot(theta, theta)
    if n2 < SMALL_ROTATION * SMALL_ROTATION:
        c = 1.0 / 12.0 + n2 / 720.0 + n2 * n2 / 30240.0
    else:
        n = math.sqrt(n2)
        c = 1.0 / n2 - 0.5 / (n * math.tan(0.5 * n))
    turned = cross(theta, e)
    return e + 0.5 * turned + c * cross(theta, turned)


@inner()
def _angle(system, work, row, known):
    """Value of TWIST, the nearest to a known one, or of LEAN; and the torque that works
    on it, in the axes of A. Of TWIST that is the axis, but for what B is tilted; of
    SPIN, which has a rate only, it is the axis itself."""
    A, B, pool = work.point[row.a], work.point[row.b], system.pool
    first, second = load(A.x, pool, row.data), load(A.x, pool, row.data + 3)
    if row.kind == SPIN:
        return 0.0, first
    if row.kind == LEAN:
        b = back(A.R, rotate(B.R, second))
        return dot(first, b), cross(b, first)
    b = back(A.R, rotate(B.R, first))
    axis, turn = cross(first, second), 2.0 * math.pi
    angle = math.atan2(dot(second, b), dot(first, b))
    off = dot(axis, b)
    flat = b - off * axis
    tilt = (off / max(dot(flat, flat), 1e-300)) * flat
    return angle - turn * math.floor(0.5 + (angle - known) / turn), axis - tilt


@inner()
def _keep_turn(work, to, a, value, axis, w):
    """An entry of Work.turn; its axis is given in the axes of marker a."""
    turn = work.turn[to]
    turn.axis = rotate(work.point[a].R, axis)
    turn.value, turn.rate = value, dot(turn.axis, w)


@inner()
def keep_turns(system, work, z):
    """Rotations between markers, those that are counted near their values in z."""
    counted = system.n_turns
    for k in range(len(system.turn)):
        row = system.turn[k]
        A, B, to = work.point[row.a], work.point[row.b], row.entry
        known, w = len(z) - counted + to, B.w - A.w
        if row.kind != TILT:
            near = z[known] if to < counted else 0.0
            value, axis = _angle(system, work, row, near)
            _keep_turn(work, to, row.a, value, axis, w)
            continue
        theta = _continued(relative_rotation(A, B), load(w, z, known))
        for i in range(3):
            e = unit(w, i)
            axis = tilt_direction(theta, e)
            _keep_turn(work, to + i, row.a, dot(e, theta), axis, w)
