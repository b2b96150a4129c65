"""Body frames: those with coordinates of their own, and those that a joint prescribes.

A frame has position x, orientation R, body-resolved velocity v and angular velocity w,
eq. (2); a prescribed frame follows from its base and the drive of its joint.
"""

import math

from ..compiler.kernels import inner
from ..spatial.algebra import (
    cross,
    direction,
    load,
    planar_rotation,
    rotate,
    rotate_about_axis,
    rotate_inverse,
    rotation_from_quaternion,
    rotation_product_transposed,
    size,
    unit,
    zero,
)
from ..spatial.dimension import BySpace
from ..spatial.system_arrays import FIXED, GROUND, PRISMATIC, REVOLUTE
from .drives import function_value


@inner()
def _set_angle(work, frame, angle):
    frame.angle, frame.R = angle, planar_rotation(math.cos(angle), math.sin(angle))


@inner()
def _orient_planar_frame(system, work, row, frame, z):
    angle = z[row.pos + 2] if row.rd == 3 else system.real_data[row.frame]
    _set_angle(work, frame, angle)


@inner()
def _orient_spatial_frame(system, work, row, frame, z):
    if row.rd == 6:
        frame.p = load(frame.p, z, row.pos + 3)
    else:
        frame.p = load(frame.p, system.real_data, row.frame)
    frame.R = rotation_from_quaternion(frame.p)


_orient_free_frame = BySpace(plane=_orient_planar_frame, space=_orient_spatial_frame)


@inner()
def free_frame(system, work, b, z, v):
    """Body frame from the coordinates, eq. (1) and (2)."""
    row, frame, u = system.body[b], work.frame[b], system.body[b].vel
    frame.x, frame.v, n = load(frame.x, z, row.pos), load(frame.v, v, u), size(frame.x)
    frame.w, frame.al = zero(frame.w), zero(frame.al)
    if row.rd > n:
        frame.w = load(frame.w, v, u + n)
    _orient_free_frame(system, work, row, frame, z)
    frame.a = cross(frame.w, frame.v)


@inner()
def _planar_identity(work, frame):
    frame.angle, frame.R = 0.0, planar_rotation(1.0, 0.0)


@inner()
def _spatial_identity(work, frame):
    frame.p = unit(frame.p, 0)
    frame.R = rotation_from_quaternion(frame.p)


_set_identity = BySpace(plane=_planar_identity, space=_spatial_identity)


@inner()
def _planar_joint_axis(system, work, row, base):
    return unit(base.w, 0)


@inner()
def _planar_sliding_direction(system, work, row, base):
    angle = base.angle + system.real_data[row.frame]
    return direction(math.cos(angle), math.sin(angle))


@inner()
def _spatial_joint_axis(system, work, row, base):
    return rotate(base.R, load(base.w, system.real_data, row.frame))


#: Axis of rotation and direction of displacement of a driven joint.
_joint_axis = BySpace(plane=_planar_joint_axis, space=_spatial_joint_axis)
_sliding_direction = BySpace(plane=_planar_sliding_direction, space=_spatial_joint_axis)


@inner()
def _orient_planar_child(system, work, row, base, frame, tip, angle):
    offset = system.real_data[row.frame + 1] - system.real_data[tip + 2]
    _set_angle(work, frame, base.angle + angle + offset)


@inner()
def _orient_spatial_child(system, work, row, base, frame, tip, angle):
    axis = unit(base.w, 2)
    if row.motion != FIXED:
        axis = load(axis, system.real_data, row.frame)
    R = rotate_about_axis(base.R, axis, math.cos(angle), math.sin(angle))
    frame.R = rotation_product_transposed(R, load(R, system.real_data, tip + 3))


#: Orientation of a frame whose tip marker is that of the base, turned by an angle.
_orient_child = BySpace(plane=_orient_planar_child, space=_orient_spatial_child)


@inner()
def prescribed_frame(system, work, b, t):
    """Body frame that hangs on a marker of a prescribed body by a driven joint."""
    row, frame = system.body[b], work.frame[b]
    if row.motion == GROUND:
        frame.x, frame.v, frame.a = zero(frame.x), zero(frame.x), zero(frame.x)
        frame.w, frame.al = zero(frame.w), zero(frame.w)
        _set_identity(work, frame)
        return
    base, tip = work.point[row.base], system.marker[row.tip].data
    s, sd, sdd, angle = 0.0, 0.0, 0.0, 0.0
    if row.drive >= 0:
        s, sd, sdd = function_value(system, row.drive, work.interval_time[0], t)
    x, v, a, omega, alpha = base.x, base.v, base.a, base.w, base.al
    if row.motion == REVOLUTE:
        angle, axis = s, _joint_axis(system, work, row, base)
        alpha = alpha + sdd * axis + sd * cross(omega, axis)
        omega = omega + sd * axis
    elif row.motion == PRISMATIC:
        e = _sliding_direction(system, work, row, base)
        we = cross(omega, e)
        x, v = x + s * e, v + sd * e + s * we
        a = a + sdd * e + (2.0 * sd) * we + s * (cross(alpha, e) + cross(omega, we))
    _orient_child(system, work, row, base, frame, tip, angle)
    R = frame.R
    r = rotate(R, load(x, system.real_data, tip))
    wr = cross(omega, r)
    frame.x, frame.v = x - r, rotate_inverse(R, v - wr)
    frame.a = rotate_inverse(R, a - cross(alpha, r) - cross(omega, wr))
    frame.w, frame.al = rotate_inverse(R, omega), rotate_inverse(R, alpha)
