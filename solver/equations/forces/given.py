"""GIVEN and FOLLOWING: force and torque on a marker along inertial axes, or its own."""

from __future__ import annotations

import math

from ...compiler.compiling import inner
from ...space.algebra import cross, load, plane_turn, rotate, size, unit, zero
from ...space.layout import FOLLOWING
from ...space.spaces import BySpace
from ..marker_rows import segment
from ..marker_stiffness import (
    add_outer,
    bending_stiffness,
    force_stiffness,
    scratch_row,
    torque_stiffness,
)


@inner()
def _in_plane(work, m):
    angle = work.point[m].angle
    return plane_turn(math.cos(angle), math.sin(angle))


@inner()
def _in_space(work, m):
    return work.point[m].R


_orientation = BySpace(plane=_in_plane, space=_in_space)


@inner()
def evaluate(system, work, k, scale):
    """Inertial force and torque, for what scales them."""
    row = system.force[k]
    point = work.point[row.b]
    force = scale * load(point.x, system.pool, row.data)
    torque = scale * load(point.w, system.pool, row.data + size(point.x))
    if row.kind == FOLLOWING:
        R = _orientation(work, row.b)
        return rotate(R, force), rotate(R, torque)
    return force, torque


@inner()
def _follow_in_plane(system, work, m, force, torque):
    b, half = system.marker[m].body, len(work.scratch) // 2
    force_stiffness(system, work, m, force)
    torque_stiffness(system, work, m, torque)
    spin = unit(torque, 0)
    scratch_row(system, work, 0, m, cross(spin, force), zero(spin))
    scratch_row(system, work, half, m, zero(force), spin)
    add_outer(system, work, b, 0, half, -1.0)


@inner()
def _follow_in_space(system, work, m, force, torque):
    """That elastic coordinates turn the marker is left out."""
    bending_stiffness(system, work, m, force, torque)


_follow = BySpace(plane=_follow_in_plane, space=_follow_in_space)


@inner()
def linearise(system, work, k):
    """Rp: the arm of the force moves; a following one turns, another does not. With a
    law, the direction of its row."""
    row = system.force[k]
    m = row.b
    if system.body[system.marker[m].body].nv == 0:
        return
    if row.seg_b >= 0:
        force, torque = evaluate(system, work, k, 1.0)
        segment(system, work, work.C, row.seg_b, m, force, torque)
    force, torque = evaluate(system, work, k, work.factor[k])
    if row.kind == FOLLOWING:
        _follow(system, work, m, force, torque)
        return
    force_stiffness(system, work, m, force)
    torque_stiffness(system, work, m, torque)
