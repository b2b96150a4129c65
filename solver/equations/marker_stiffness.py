"""Rp of forces and torques at markers: what they change as their own body moves."""

from __future__ import annotations

import math

from ..compiler.compiling import inner
from ..space.algebra import (
    add_column,
    add_cross,
    add_row,
    add_twice_cross,
    back,
    column,
    cross,
    dot,
    size,
    unit,
    zero,
)
from ..space.spaces import BySpace
from .marker_rows import segment, tilted_back


@inner()
def bending_stiffness(system, work, m, force, torque):
    """Rp from what inertial loads at a marker change as Phi and Psi depend on q."""
    if system.marker[m].phi1 >= 0 or system.marker[m].psi1 >= 0:
        _bend(system, work, m, force, torque)


@inner()
def _bend(system, work, m, force, torque):
    marker = system.marker[m]
    phi1, psi1 = marker.phi1, marker.psi1
    row, frame = system.body[marker.body], work.frame[marker.body]
    nv, nq, rd, block, pool = row.nv, row.nq, row.rd, row.block, system.pool
    f = back(frame.R, force)
    t = tilted_back(work, m, back(frame.R, torque))
    for k in range(nq):
        line = block + (rd + k) * nv + rd
        for i in range(nq):
            if phi1 >= 0:
                bend = column(f, pool, phi1 + k * nq, nq * nq, i)
                work.Rp[line + i] -= dot(bend, f)
            if psi1 >= 0:
                bent = column(t, pool, psi1 + k * nq, nq * nq, i)
                work.Rp[line + i] -= dot(bent, t)


@inner()
def force_stiffness(system, work, m, force):
    """Adds to Rp what an inertial force at a marker changes when its body moves."""
    marker, point = system.marker[m], work.point[m]
    bending_stiffness(system, work, m, force, zero(point.w))
    row, frame = system.body[marker.body], work.frame[marker.body]
    nv, nq, rd, block, n, P = row.nv, row.nq, row.rd, row.block, size(force), work.Rp
    if rd <= n:
        return
    f, turn = back(frame.R, -force), block + n * nv
    add_cross(P, block + n, nv, f, frame.w)
    add_twice_cross(P, turn + n, nv, point.d, f, frame.w)
    for k in range(nq):
        moment = cross(column(f, work.phi, marker.phi, nq, k), f)
        add_column(P, turn + rd + k, nv, moment)
        add_row(P, block + (rd + k) * nv + n, moment)


@inner()
def torque_stiffness(system, work, m, torque):
    """Adds to Rp what an inertial torque at a marker changes when its body moves."""
    marker = system.marker[m]
    row, frame = system.body[marker.body], work.frame[marker.body]
    bending_stiffness(system, work, m, zero(work.point[m].x), torque)
    nv, nq, rd, block, n = row.nv, row.nq, row.rd, row.block, size(frame.x)
    if rd <= n:
        return
    t = back(frame.R, -torque)
    add_cross(work.Rp, block + n * nv + n, nv, t, t)
    psi = marker.phi + n * nq
    for k in range(nq):
        moment = cross(column(t, work.phi, psi, nq, k), t)
        add_row(work.Rp, block + (rd + k) * nv + n, moment)


@inner()
def add_outer(system, work, b, left, right, weight):
    """Rp of a body += weight * scratch[left] scratch[right]^T."""
    nv, block = system.body[b].nv, system.body[b].block
    for i in range(nv):
        for j in range(nv):
            product = work.scratch[left + i] * work.scratch[right + j]
            work.Rp[block + i * nv + j] += weight * product


@inner()
def scratch_row(system, work, at, m, force, torque):
    """The row of a force and a torque at a marker, into scratch[at:]."""
    for i in range(system.body[system.marker[m].body].nv):
        work.scratch[at + i] = 0.0
    segment(system, work, work.scratch, at, m, force, torque)


@inner()
def _across_in_plane(work, n, i):
    return cross(unit(work.point[0].w, 0), n)


@inner()
def _across_in_space(work, n, i):
    first = cross(n, unit(n, 0 if abs(dot(n, unit(n, 0))) < 0.6 else 1))
    first = (1.0 / math.sqrt(dot(first, first))) * first
    return first if i == 0 else cross(n, first)


#: The i-th of the directions across n.
across = BySpace(plane=_across_in_plane, space=_across_in_space)


@inner()
def swing_stiffness(system, work, m, n, weight):
    """Rp += weight * sum of p p^T over the directions across n."""
    b = system.marker[m].body
    for i in range(size(n) - 1):
        e = across(work, n, i)
        scratch_row(system, work, 0, m, e, zero(work.point[m].w))
        add_outer(system, work, b, 0, 0, weight)


@inner()
def _turned_in_plane(system, work, m, n, x, force):
    b, half = system.marker[m].body, len(work.scratch) // 2
    force_stiffness(system, work, m, -force * n)
    spin = unit(work.point[m].w, 0)
    scratch_row(system, work, 0, m, cross(spin, n), zero(spin))
    scratch_row(system, work, half, m, zero(n), spin)
    add_outer(system, work, b, 0, half, force)
    add_outer(system, work, b, half, 0, force)
    add_outer(system, work, b, half, half, force * dot(n, x))


@inner()
def _turned_in_space(system, work, m, n, x, force):
    """That elastic coordinates turn the marker is left out."""
    marker = system.marker[m]
    row, frame = system.body[marker.body], work.frame[marker.body]
    bending_stiffness(system, work, m, -force * n, zero(n))
    if row.rd != 6:
        return
    nv, turn = row.nv, row.block + 3 * row.nv
    h = -force * back(frame.R, n)
    y = back(frame.R, x) + work.point[m].d
    add_twice_cross(work.Rp, turn + 3, nv, h, y, y)
    add_cross(work.Rp, turn, nv, -h, y)


_turned = BySpace(plane=_turned_in_plane, space=_turned_in_space)


@inner()
def line_stiffness(system, work, a, b, n, x, force):
    """Rp of a force along a direction n that turns with marker A, x from A to B."""
    force_stiffness(system, work, b, force * n)
    bending_stiffness(system, work, a, zero(n), force * cross(n, x))
    _turned(system, work, a, n, x, force)
