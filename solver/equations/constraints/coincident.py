"""COINCIDENT: the positions of two markers agree; a row for each component."""

from __future__ import annotations

from ...compiler.compiling import inner
from ...space.algebra import dot, load, size, unit, zero
from ..marker_rows import marker_acceleration, vary_acceleration
from ..marker_stiffness import force_stiffness
from ..rows import add_jacobian, write_row


@inner()
def evaluate(system, work, con):
    A, B = work.point[con.a], work.point[con.b]
    x, v, a = B.x - A.x, B.v - A.v, B.a - A.a
    for i in range(size(x)):
        e = unit(x, i)
        write_row(work, con.row + i, dot(e, x), dot(e, v), -dot(e, a))
        add_jacobian(system, work, con, i, e, zero(A.w), zero(A.w))


@inner()
def wrench(system, work, con, lam):
    """Force on marker B, whose reverse acts on A, torque on A, and torque on B."""
    none = zero(work.point[con.a].w)
    return load(work.point[con.a].x, lam, con.row), none, none


@inner()
def linearise(system, work, con, v, acc, lam):
    force = load(work.point[con.a].x, lam, con.row)
    for side in range(2):
        first = con.seg_a if side == 0 else con.seg_b
        if first < 0:
            continue
        m, sign = (con.a, -1.0) if side == 0 else (con.b, 1.0)
        a, _ = marker_acceleration(system, work, m, acc)
        for i in range(size(force)):
            o = system.segment[first + i].offset
            e = sign * unit(force, i)
            vary_acceleration(system, work, o, m, e, a, v, acc)
        force_stiffness(system, work, m, sign * force)
