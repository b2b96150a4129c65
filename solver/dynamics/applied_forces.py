"""Forces on one marker or one coordinate, eq. (16).

GIVEN and FOLLOWING: a force and a torque on a marker along the inertial axes, or along
the axes of the marker. COORDINATE: a force on one elastic coordinate or law state.
"""

import math

from ..compiler.kernels import inner
from ..spatial.algebra import cross, load, planar_rotation, rotate, size, unit, zero
from ..spatial.dimension import BySpace
from ..spatial.system_arrays import FOLLOWER_LOAD
from .force_law import force_law
from .marker_force_derivatives import (
    add_outer,
    force_stiffness,
    scratch_row,
    shape_function_stiffness,
    torque_stiffness,
)
from .marker_forces import add_generalised_force


@inner()
def _planar_orientation(work, m):
    angle = work.point[m].angle
    return planar_rotation(math.cos(angle), math.sin(angle))


@inner()
def _spatial_orientation(work, m):
    return work.point[m].R


_orientation = BySpace(plane=_planar_orientation, space=_spatial_orientation)


@inner()
def applied_load(system, work, k, scale):
    """Inertial force and torque, multiplied by the scale."""
    row = system.force[k]
    point = work.point[row.b]
    force = scale * load(point.x, system.real_data, row.data)
    torque = scale * load(point.w, system.real_data, row.data + size(point.x))
    if row.kind == FOLLOWER_LOAD:
        R = _orientation(work, row.b)
        return rotate(R, force), rotate(R, torque)
    return force, torque


@inner()
def _planar_follower_stiffness(system, work, m, force, torque):
    b, half = system.marker[m].body, len(work.scratch) // 2
    force_stiffness(system, work, m, force)
    torque_stiffness(system, work, m, torque)
    e_z = unit(torque, 0)
    scratch_row(system, work, 0, m, cross(e_z, force), zero(e_z))
    scratch_row(system, work, half, m, zero(force), e_z)
    add_outer(system, work, b, 0, half, -1.0)


@inner()
def _spatial_follower_stiffness(system, work, m, force, torque):
    """Stiffness of a follower force in space, without rotations by elastic
    coordinates.
    """
    shape_function_stiffness(system, work, m, force, torque)


_follower_stiffness = BySpace(
    plane=_planar_follower_stiffness, space=_spatial_follower_stiffness
)


@inner()
def linearise_applied_load(system, work, k):
    """Rp: the arm of the force moves; a following one turns, another does not.

    With a law, the direction of its row.
    """
    row = system.force[k]
    m = row.b
    if system.body[system.marker[m].body].nv == 0:
        return
    if row.seg_b >= 0:
        force, torque = applied_load(system, work, k, 1.0)
        add_generalised_force(system, work, work.C, row.seg_b, m, force, torque)
    force, torque = applied_load(system, work, k, work.force_scale[k])
    if row.kind == FOLLOWER_LOAD:
        _follower_stiffness(system, work, m, force, torque)
        return
    force_stiffness(system, work, m, force)
    torque_stiffness(system, work, m, torque)


@inner()
def evaluate_coordinate_force(system, work, k, z, v):
    """Store the measure; add the force on it to f."""
    row = system.force[k]
    body = system.body[row.b]
    i = body.vel + body.rd + row.data
    g, rate = z[body.pos + body.np - body.nq + row.data], v[i]
    work.measure[k, 0], work.measure[k, 1] = g, rate
    if row.owner < 0:
        size, _, _ = force_law(system, work, k, g, rate)
        work.f[i] += size


@inner()
def linearise_coordinate_force(system, work, k):
    """The row of the force, or of the measure in that of a law."""
    row = system.force[k]
    if row.seg_b < 0:
        return
    at = row.seg_b + system.body[row.b].rd + row.data
    g, rate = work.measure[k, 0], work.measure[k, 1]
    _, stiffness, damping = force_law(system, work, k, g, rate)
    work.C[at] = 1.0 if row.owner < 0 else 0.0
    work.Gp[at], work.Gv[at] = stiffness, damping
