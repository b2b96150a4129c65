"""PERPENDICULAR and ANGLE in space: u . b = 0, with u that turns with A, b fixed in B.

PERPENDICULAR: u is fixed in A. ANGLE: u = cos s second - sin s first, so that u . b is
the sine of the angle beyond s, with b the first direction of B.
"""

from __future__ import annotations

import math

from ...compiler.compiling import inner
from ...space.algebra import (
    add_row,
    add_twice_cross,
    back,
    column,
    cross,
    dot,
    load,
    rotate,
    zero,
)
from ...space.layout import PERPENDICULAR
from ..drives import prescribed
from ..marker_rows import marker_acceleration, vary_rotation
from ..marker_stiffness import bending_stiffness


@inner()
def _directions(system, work, con, s, sd, sdd):
    """u, its rate and acceleration, and b."""
    A, B, pool, data = work.point[con.a], work.point[con.b], system.pool, con.data
    first, second = load(A.x, pool, data), load(A.x, pool, data + 3)
    w, u = A.w, rotate(A.R, first)
    if con.kind == PERPENDICULAR:
        p, b = zero(u), rotate(B.R, second)
    else:
        b, c, sn = rotate(B.R, first), math.cos(s), math.sin(s)
        turned = rotate(A.R, second)
        u, p = c * turned - sn * u, c * u + sn * turned
    wu = cross(w, u)
    acc = cross(A.al, u) + cross(w, wu) - (2.0 * sd) * cross(w, p)
    return u, wu - sd * p, acc - sdd * p - (sd * sd) * u, b


@inner()
def evaluate(system, work, con, s, sd, sdd):
    B = work.point[con.b]
    u, ud, udd, b = _directions(system, work, con, s, sd, sdd)
    bd, axis = cross(B.w, b), cross(u, b)
    bdd = cross(B.al, b) + cross(B.w, bd)
    rate = dot(ud, b) + dot(u, bd)
    gamma = -dot(udd, b) - 2.0 * dot(ud, bd) - dot(u, bdd)
    return dot(u, b), rate, gamma, zero(u), axis, -axis


@inner()
def _torque_stiffness(system, work, m, own, other, torque):
    """Rp of the torque * (own x other), where `own` turns with the marker's body."""
    bending_stiffness(system, work, m, zero(own), torque * cross(own, other))
    marker = system.marker[m]
    row, frame = system.body[marker.body], work.frame[marker.body]
    nv, nq, rd, turn = row.nv, row.nq, row.rd, row.block + 3 * row.nv
    if rd != 6:
        return
    psi = marker.phi + 3 * nq
    p, o = -torque * back(frame.R, own), back(frame.R, other)
    add_twice_cross(work.Rp, turn + 3, nv, p, o, p)
    for k in range(nq):
        arm = cross(cross(column(p, work.phi, psi, nq, k), p), o)
        add_row(work.Rp, row.block + (rd + k) * nv + 3, arm)


@inner()
def linearise(system, work, con, t, v, acc, lam):
    s, sd, sdd = prescribed(system, work, con, t)
    A, B = work.point[con.a], work.point[con.b]
    u, ud, udd, b = _directions(system, work, con, s, sd, sdd)
    _, al_a = marker_acceleration(system, work, con.a, acc)
    _, al_b = marker_acceleration(system, work, con.b, acc)
    udd, bd, wu = udd + cross(al_a - A.al, u), cross(B.w, b), cross(A.w, u)
    bdd = cross(al_b, b) + cross(B.w, bd)
    turn = cross(udd, b) + 2.0 * cross(ud, bd) + cross(u, bdd)
    force, axis = lam[con.row], cross(u, b)
    if con.seg_a >= 0:
        o = system.segment[con.seg_a].offset
        spin = cross(wu, b) + cross(u, cross(b, A.w)) + 2.0 * cross(u, bd)
        spin = spin - 2.0 * cross(wu - ud, b)
        vary_rotation(system, work, o, con.a, turn, spin, axis, v, acc)
        _torque_stiffness(system, work, con.a, u, b, force)
    if con.seg_b >= 0:
        o = system.segment[con.seg_b].offset
        spin = 2.0 * cross(b, ud) + cross(bd, u) + cross(b, cross(u, B.w))
        vary_rotation(system, work, o, con.b, -turn, spin, -axis, v, acc)
        _torque_stiffness(system, work, con.b, b, u, force)
