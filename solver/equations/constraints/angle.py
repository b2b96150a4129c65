"""ANGLE in the plane, and coupled angles: the angle from A to B about an axis n of A.

In space its rate is n . (w_B - w_A) as long as the direction in B that it is measured
to stays at right angles to the axis.
"""

from __future__ import annotations

import math

from ...compiler.compiling import inner
from ...space.algebra import cross, dot, load, rotate, unit, zero
from ...space.spaces import BySpace
from ..marker_rows import marker_acceleration, segment, vary_turning
from ..marker_stiffness import bending_stiffness, torque_stiffness


@inner()
def _turned_in_plane(system, work, con):
    A, B = work.point[con.a], work.point[con.b]
    return unit(A.w, 0), B.angle - A.angle - system.pool[con.data]


@inner()
def _turned_in_space(system, work, con):
    """From the first direction of A to that of B, in (-pi, pi]."""
    A, B, pool = work.point[con.a], work.point[con.b], system.pool
    first = load(A.x, pool, con.data)
    u, w = rotate(A.R, first), rotate(A.R, load(A.x, pool, con.data + 3))
    b = rotate(B.R, first)
    return cross(u, w), math.atan2(dot(w, b), dot(u, b))


_turned = BySpace(plane=_turned_in_plane, space=_turned_in_space)


@inner()
def evaluate(system, work, con, s, sd, sdd):
    A, B = work.point[con.a], work.point[con.b]
    n, angle = _turned(system, work, con)
    rate = dot(n, B.w - A.w) - sd
    gamma = sdd - dot(n, B.al - A.al) - dot(cross(A.w, n), B.w)
    return angle - s, rate, gamma, zero(A.x), -n, n


@inner()
def _nothing(system, work, con, n, weight, acc):
    return zero(n), zero(n)


@inner()
def _vary_axis(system, work, con, n, weight, acc):
    """What the turning of the axis adds; the derivatives by both angular velocities."""
    wb, wn = work.point[con.b].w, cross(work.point[con.a].w, n)
    _, al_b = marker_acceleration(system, work, con.b, acc)
    turn, none = weight * (cross(n, al_b) + cross(wn, wb)), zero(n)
    spin_a, spin_b = weight * cross(n, wb), weight * wn
    if con.seg_a >= 0:
        o = system.segment[con.seg_a].offset
        segment(system, work, work.Gp, o, con.a, none, turn)
        segment(system, work, work.Gv, o, con.a, none, spin_a)
    if con.seg_b >= 0:
        o = system.segment[con.seg_b].offset
        segment(system, work, work.Gp, o, con.b, none, -turn)
        segment(system, work, work.Gv, o, con.b, none, spin_b)
    return spin_a, spin_b


_axis = BySpace(plane=_nothing, space=_vary_axis)


@inner()
def linearise(system, work, con, weight, v, acc, lam):
    n, _ = _turned(system, work, con)
    spin_a, spin_b = _axis(system, work, con, n, weight, acc)
    axis, torque = weight * n, (weight * lam[con.row]) * n
    if con.seg_a >= 0:
        o = system.segment[con.seg_a].offset
        vary_turning(system, work, o, con.a, spin_a, -axis, v, acc)
        bending_stiffness(system, work, con.a, zero(work.point[con.a].x), -torque)
    if con.seg_b >= 0:
        o = system.segment[con.seg_b].offset
        vary_turning(system, work, o, con.b, spin_b, axis, v, acc)
        torque_stiffness(system, work, con.b, torque)
