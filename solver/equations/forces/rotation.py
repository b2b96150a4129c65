"""TWIST, TILT and LEAN: what a rotation from marker A to marker B measures."""

from __future__ import annotations

from ...compiler.compiling import inner
from ...space.algebra import cross, dot, unit, zero
from ...space.spaces import BySpace
from ..marker_stiffness import bending_stiffness


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


#: In space from what `turns` keeps.
measure = BySpace(plane=_angle, space=_turned)


@inner()
def rate_derivatives(system, work, row, axis):
    """Of the rate: by the position of B, and by the rotations of A and B."""
    turn = cross(work.point[row.b].w, axis)
    return zero(work.point[row.b].x), -turn, turn


@inner()
def stiffness(system, work, row, axis, force):
    """Rp of a force on the measure."""
    for side in range(2):
        if (row.seg_a if side == 0 else row.seg_b) < 0:
            continue
        m, sign = (row.a, -1.0) if side == 0 else (row.b, 1.0)
        none = zero(work.point[m].x)
        bending_stiffness(system, work, m, none, sign * force * axis)
