"""ALONG: n . (x_B - x_A) = s(t), with a direction n fixed in marker A."""

from __future__ import annotations

import math

from ...compiler.compiling import inner
from ...space.algebra import cross, direction, dot, load, rotate, zero
from ...space.spaces import BySpace
from ..marker_rows import marker_acceleration, vary_rotation, vary_translation
from ..marker_stiffness import line_stiffness
from ..rows import offset_at


@inner()
def _fixed_in_plane(system, work, m, data):
    angle = work.point[m].angle + system.pool[data]
    return direction(math.cos(angle), math.sin(angle))


@inner()
def _fixed_in_space(system, work, m, data):
    point = work.point[m]
    return rotate(point.R, load(point.x, system.pool, data))


#: A direction that is fixed in a marker: its angle, or its components, in the pool.
fixed_direction = BySpace(plane=_fixed_in_plane, space=_fixed_in_space)


@inner()
def evaluate(system, work, con, s, sd, sdd):
    A, B = work.point[con.a], work.point[con.b]
    x, v, a, w = B.x - A.x, B.v - A.v, B.a - A.a, A.w
    n = fixed_direction(system, work, con.a, con.data)
    wn, arm = cross(w, n), cross(n, x)
    value = dot(n, x) - s - system.pool[offset_at(n, con.data)]
    rate = dot(n, v) + dot(arm, w) - sd
    turn = cross(A.al, n) + cross(w, wn)
    gamma = sdd - dot(n, a) - 2.0 * dot(wn, v) - dot(turn, x)
    return value, rate, gamma, n, arm, zero(w)


@inner()
def linearise(system, work, con, weight, v, acc, lam):
    A, B = work.point[con.a], work.point[con.b]
    x, vel, w = B.x - A.x, B.v - A.v, A.w
    a_a, al = marker_acceleration(system, work, con.a, acc)
    a_b, _ = marker_acceleration(system, work, con.b, acc)
    n = fixed_direction(system, work, con.a, con.data)
    wn = cross(w, n)
    by_v, by_x = 2.0 * wn, cross(al, n) + cross(w, wn)
    for side in range(2):
        first = con.seg_a if side == 0 else con.seg_b
        if first < 0:
            continue
        m, part, a = (con.a, -weight, a_a) if side == 0 else (con.b, weight, a_b)
        o, e = system.segment[first].offset, part * n
        vary_translation(system, work, o, m, e, part * by_v, part * by_x, a, v, acc)
    if con.seg_a >= 0:
        o = system.segment[con.seg_a].offset
        turn = cross(n, a_b - a_a) + cross(by_v, vel) + cross(by_x, x)
        spin = 2.0 * cross(n, vel) + cross(wn, x) + cross(n, cross(x, w))
        turn, spin, arm = weight * turn, weight * spin, weight * cross(n, x)
        vary_rotation(system, work, o, con.a, turn, spin, arm, v, acc)
    line_stiffness(system, work, con.a, con.b, n, x, weight * lam[con.row])
