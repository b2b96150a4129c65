"""What forces between two markers measure: distance, displacement or rotation.

Of each measure g: its value and rate with what a unit force on it does, the derivatives
of the rate by the position of B and by the rotations of A and B, and Rp of a force.
"""

from __future__ import annotations

import math

from ...compiler.compiling import inner
from ...space.algebra import cross, dot, unit, zero
from ...space.spaces import BySpace
from ..constraints.along import fixed_direction
from ..marker_stiffness import (
    bending_stiffness,
    force_stiffness,
    line_stiffness,
    swing_stiffness,
)

#: Below this distance the direction of the line does not turn.
NOTHING = 1e-12


@inner()
def measure_span(system, work, row):
    """SPAN: the distance between the markers; a force along the line between them."""
    A, B = work.point[row.a], work.point[row.b]
    x, v = B.x - A.x, B.v - A.v
    length = math.sqrt(dot(x, x))
    n = (1.0 / max(length, 1e-300)) * x
    return length, dot(n, v), n, zero(A.w), zero(A.w)


@inner()
def span_derivatives(system, work, row, g, rate, n):
    A, B = work.point[row.a], work.point[row.b]
    across = zero(n)
    if g > NOTHING:
        across = (1.0 / g) * (B.v - A.v - rate * n)
    return across, zero(A.w), zero(A.w)


@inner()
def span_stiffness(system, work, row, g, n, force):
    for side in range(2):
        if (row.seg_a if side == 0 else row.seg_b) < 0:
            continue
        m, sign = (row.a, -1.0) if side == 0 else (row.b, 1.0)
        force_stiffness(system, work, m, sign * force * n)
        if g > NOTHING:
            swing_stiffness(system, work, m, n, -force / g)


@inner()
def measure_slide(system, work, row):
    """SLIDE: the displacement of marker B along a direction fixed in marker A."""
    A, B = work.point[row.a], work.point[row.b]
    x = B.x - A.x
    n = fixed_direction(system, work, row.a, row.data)
    arm = cross(n, x)
    return dot(n, x), dot(n, B.v - A.v) + dot(arm, A.w), n, arm, zero(arm)


@inner()
def slide_derivatives(system, work, row, g, rate, n):
    A, B = work.point[row.a], work.point[row.b]
    wn = cross(A.w, n)
    return wn, cross(n, B.v - A.v) + cross(wn, B.x - A.x), zero(A.w)


@inner()
def slide_stiffness(system, work, row, g, n, force):
    x = work.point[row.b].x - work.point[row.a].x
    line_stiffness(system, work, row.a, row.b, n, x, force)


@inner()
def _angle(system, work, row):
    A, B = work.point[row.a], work.point[row.b]
    e, turned = unit(A.w, 0), B.angle - A.angle - system.pool[row.data]
    return turned, dot(e, B.w - A.w), zero(A.x), -e, e


@inner()
def _turned(system, work, row):
    turn = work.turn[row.turn]
    axis = turn.axis
    return turn.value, turn.rate, zero(axis), -axis, axis


#: TWIST, TILT and LEAN: the rotation from A to B, in space from what `turns` keeps.
measure_rotation = BySpace(plane=_angle, space=_turned)


@inner()
def rotation_derivatives(system, work, row, axis):
    turn = cross(work.point[row.b].w, axis)
    return zero(work.point[row.b].x), -turn, turn


@inner()
def rotation_stiffness(system, work, row, axis, force):
    for side in range(2):
        if (row.seg_a if side == 0 else row.seg_b) < 0:
            continue
        m, sign = (row.a, -1.0) if side == 0 else (row.b, 1.0)
        none = zero(work.point[m].x)
        bending_stiffness(system, work, m, none, sign * force * axis)
