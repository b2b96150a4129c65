"""DISTANCE: |x_B - x_A| = s(t)."""

from __future__ import annotations

import math

from ...compiler.compiling import inner
from ...space.algebra import dot, zero
from ..marker_rows import marker_acceleration, vary_translation
from ..marker_stiffness import force_stiffness, swing_stiffness


@inner()
def evaluate(system, work, con, s, sd, sdd):
    A, B = work.point[con.a], work.point[con.b]
    x, v, a = B.x - A.x, B.v - A.v, B.a - A.a
    length = math.sqrt(dot(x, x))
    n = (1.0 / length) * x
    along = dot(n, v)
    swing = (dot(v, v) - along * along) / length
    value = length - s - system.pool[con.data]
    return value, along - sd, sdd - dot(n, a) - swing, n, zero(A.w), zero(A.w)


@inner()
def linearise(system, work, con, v, acc, lam):
    A, B = work.point[con.a], work.point[con.b]
    x, vel = B.x - A.x, B.v - A.v
    a_a, _ = marker_acceleration(system, work, con.a, acc)
    a_b, _ = marker_acceleration(system, work, con.b, acc)
    a, length = a_b - a_a, math.sqrt(dot(x, x))
    n = (1.0 / length) * x
    along, force = dot(n, vel), lam[con.row]
    across = vel - along * n
    by_v = (2.0 / length) * across
    swing = dot(n, a) + dot(across, across) / length
    by_x = (1.0 / length) * (a - swing * n - along * by_v)
    for side in range(2):
        first = con.seg_a if side == 0 else con.seg_b
        if first < 0:
            continue
        m, sign, own = (con.a, -1.0, a_a) if side == 0 else (con.b, 1.0, a_b)
        o, e = system.segment[first].offset, sign * n
        vary_translation(system, work, o, m, e, sign * by_v, sign * by_x, own, v, acc)
        force_stiffness(system, work, m, sign * force * n)
        swing_stiffness(system, work, m, n, -force / length)
