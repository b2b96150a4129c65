"""Body frames: free ones, and those that hang on a driven joint."""

from __future__ import annotations

import math

from ..compiler.compiling import inner
from ..space.algebra import (
    after_back,
    back,
    cross,
    direction,
    load,
    plane_turn,
    quaternion_turn,
    rotate,
    size,
    turned,
    unit,
    zero,
)
from ..space.layout import FIXED, GROUND, PRISMATIC, REVOLUTE
from ..space.spaces import BySpace
from .drives import drive_value


@inner()
def _set_angle(work, frame, angle):
    frame.angle, frame.R = angle, plane_turn(math.cos(angle), math.sin(angle))


@inner()
def _orient_in_plane(system, work, row, frame, z):
    angle = z[row.pos + 2] if row.rd == 3 else system.pool[row.frame]
    _set_angle(work, frame, angle)


@inner()
def _orient_in_space(system, work, row, frame, z):
    if row.rd == 6:
        frame.p = load(frame.p, z, row.pos + 3)
    else:
        frame.p = load(frame.p, system.pool, row.frame)
    frame.R = quaternion_turn(frame.p)


_orient = BySpace(plane=_orient_in_plane, space=_orient_in_space)


@inner()
def free_frame(system, work, b, z, v):
    """Body frame from the coordinates, eq. (1) and (2)."""
    row, frame, u = system.body[b], work.frame[b], system.body[b].vel
    frame.x, frame.v, n = load(frame.x, z, row.pos), load(frame.v, v, u), size(frame.x)
    frame.w, frame.al = zero(frame.w), zero(frame.al)
    if row.rd > n:
        frame.w = load(frame.w, v, u + n)
    _orient(system, work, row, frame, z)
    frame.a = cross(frame.w, frame.v)


@inner()
def _stand_in_plane(work, frame):
    frame.angle, frame.R = 0.0, plane_turn(1.0, 0.0)


@inner()
def _stand_in_space(work, frame):
    frame.p = unit(frame.p, 0)
    frame.R = quaternion_turn(frame.p)


_stand = BySpace(plane=_stand_in_plane, space=_stand_in_space)


@inner()
def _axis_in_plane(system, work, row, base):
    return unit(base.w, 0)


@inner()
def _slide_in_plane(system, work, row, base):
    angle = base.angle + system.pool[row.frame]
    return direction(math.cos(angle), math.sin(angle))


@inner()
def _axis_in_space(system, work, row, base):
    return rotate(base.R, load(base.w, system.pool, row.frame))


#: Axis of rotation and direction of displacement of a driven joint.
_axis = BySpace(plane=_axis_in_plane, space=_axis_in_space)
_slide = BySpace(plane=_slide_in_plane, space=_axis_in_space)


@inner()
def _hang_in_plane(system, work, row, base, frame, tip, angle):
    offset = system.pool[row.frame + 1] - system.pool[tip + 2]
    _set_angle(work, frame, base.angle + angle + offset)


@inner()
def _hang_in_space(system, work, row, base, frame, tip, angle):
    axis = unit(base.w, 2)
    if row.motion != FIXED:
        axis = load(axis, system.pool, row.frame)
    R = turned(base.R, axis, math.cos(angle), math.sin(angle))
    frame.R = after_back(R, load(R, system.pool, tip + 3))


#: Orientation of a frame whose tip marker is that of the base, turned by an angle.
_hang = BySpace(plane=_hang_in_plane, space=_hang_in_space)


@inner()
def prescribed_frame(system, work, b, t):
    """Body frame that hangs on a marker of a prescribed body by a driven joint."""
    row, frame = system.body[b], work.frame[b]
    if row.motion == GROUND:
        frame.x, frame.v, frame.a = zero(frame.x), zero(frame.x), zero(frame.x)
        frame.w, frame.al = zero(frame.w), zero(frame.w)
        _stand(work, frame)
        return
    base, tip = work.point[row.base], system.marker[row.tip].data
    s, sd, sdd, angle = 0.0, 0.0, 0.0, 0.0
    if row.drive >= 0:
        s, sd, sdd = drive_value(system, row.drive, work.clock[0], t)
    x, v, a, w, al = base.x, base.v, base.a, base.w, base.al
    if row.motion == REVOLUTE:
        angle, axis = s, _axis(system, work, row, base)
        al = al + sdd * axis + sd * cross(w, axis)
        w = w + sd * axis
    elif row.motion == PRISMATIC:
        e = _slide(system, work, row, base)
        we = cross(w, e)
        x, v = x + s * e, v + sd * e + s * we
        a = a + sdd * e + (2.0 * sd) * we + s * (cross(al, e) + cross(w, we))
    _hang(system, work, row, base, frame, tip, angle)
    R = frame.R
    r = rotate(R, load(x, system.pool, tip))
    wr = cross(w, r)
    frame.x, frame.v = x - r, back(R, v - wr)
    frame.a = back(R, a - cross(al, r) - cross(w, wr))
    frame.w, frame.al = back(R, w), back(R, al)
