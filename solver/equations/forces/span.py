"""SPAN: the distance between two markers; a force along the line between them."""

from __future__ import annotations

import math

from ...compiler.compiling import inner
from ...space.algebra import dot, zero
from ..marker_stiffness import force_stiffness, swing_stiffness

#: Below this distance the direction of the line does not turn.
NOTHING = 1e-12


@inner()
def measure(system, work, row):
    A, B = work.point[row.a], work.point[row.b]
    x, v = B.x - A.x, B.v - A.v
    length = math.sqrt(dot(x, x))
    n = (1.0 / max(length, 1e-300)) * x
    return length, dot(n, v), n, zero(A.w), zero(A.w)


@inner()
def rate_derivatives(system, work, row, g, rate, n):
    """Of the rate: by the position of B, and by the rotations of A and B."""
    A, B = work.point[row.a], work.point[row.b]
    across = zero(n)
    if g > NOTHING:
        across = (1.0 / g) * (B.v - A.v - rate * n)
    return across, zero(A.w), zero(A.w)


@inner()
def stiffness(system, work, row, g, n, force):
    """Rp of a force on the measure."""
    for side in range(2):
        if (row.seg_a if side == 0 else row.seg_b) < 0:
            continue
        m, sign = (row.a, -1.0) if side == 0 else (row.b, 1.0)
        force_stiffness(system, work, m, sign * force * n)
        if g > NOTHING:
            swing_stiffness(system, work, m, n, -force / g)
