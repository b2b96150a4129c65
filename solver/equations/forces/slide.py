"""SLIDE: the displacement of marker B along a direction fixed in marker A."""

from __future__ import annotations

from ...compiler.compiling import inner
from ...space.algebra import cross, dot, zero
from ..constraints.along import fixed_direction
from ..marker_stiffness import line_stiffness


@inner()
def measure(system, work, row):
    A, B = work.point[row.a], work.point[row.b]
    x = B.x - A.x
    n = fixed_direction(system, work, row.a, row.data)
    arm = cross(n, x)
    return dot(n, x), dot(n, B.v - A.v) + dot(arm, A.w), n, arm, zero(arm)


@inner()
def rate_derivatives(system, work, row, g, rate, n):
    """Of the rate: by the position of B, and by the rotations of A and B."""
    A, B = work.point[row.a], work.point[row.b]
    wn = cross(A.w, n)
    return wn, cross(n, B.v - A.v) + cross(wn, B.x - A.x), zero(A.w)


@inner()
def stiffness(system, work, row, g, n, force):
    """Rp of a force on the measure."""
    x = work.point[row.b].x - work.point[row.a].x
    line_stiffness(system, work, row.a, row.b, n, x, force)
