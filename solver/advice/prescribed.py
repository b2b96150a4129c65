"""Bodies whose frames move as drives say, whatever is integrated.

From the ground over fixed, revolute and prismatic joints with drives, with the bodies
as they are undeformed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sidtool.formats.scene import (
    Joint,
    driven_coordinate,
    marker_names,
    marker_reference,
)
from sidtool.formats.sid import Array, Node

from ..space import layout as at
from ..system.bodies.packing import rotation_part
from ..system.joints import planar_axis, spatial_axis
from ..system.scene import GROUND_NAME, System
from .excitation import DriveHistory

_MOVED_BY = {"fixed": "", "revolute": "angle", "prismatic": "displacement"}


@dataclass(frozen=True, eq=False)
class FrameHistory:
    """Motion of a body frame, one row per instant.

    R : (nt, 3, 3) body to inertial axes
    a, w, alpha : (nt, 3) acceleration of the origin, angular velocity and angular
        acceleration, absolute, in body axes
    """

    R: Array
    a: Array
    w: Array
    alpha: Array

    def repeated(self, count: int) -> FrameHistory:
        """The same at `count` instants, for the motion at one."""
        parts = (self.R, self.a, self.w, self.alpha)
        return FrameHistory(*(np.repeat(part, count, axis=0) for part in parts))


def prescribed_frames(system: System, history: DriveHistory) -> dict[str, FrameHistory]:
    """Motion of all bodies whose frame is prescribed, by name, without the ground."""
    zero = np.zeros((len(history.times), 3))
    known = {GROUND_NAME: FrameHistory(zero[:, :, None] + np.eye(3), zero, zero, zero)}
    drives = {
        (drive.joint, driven_coordinate(drive, system.scene.joints)): name
        for name, drive in system.scene.drives.items()
        if drive.joint is not None and name not in system.led
    }
    grown = True
    while grown:
        grown = False
        for name, joint in system.scene.joints.items():
            coordinate = _MOVED_BY.get(joint.type)
            drive = drives.get((name, coordinate or ""))
            if coordinate is None or (coordinate and drive is None):
                continue
            ends = [marker_reference(text) for text in marker_names(joint)]
            if (ends[0][0] in known) == (ends[1][0] in known):
                continue
            back = ends[1][0] in known
            base, tip = ends[::-1] if back else ends
            q = np.zeros((3, len(zero)))
            if drive is not None:
                q = history.values[drive]
            nodes = [system.bodies[system.index(b)].node(m) for b, m in (base, tip)]
            axis = _axis(joint, system.planar)
            turning, sliding = (q, 0.0 * q) if coordinate == "angle" else (0.0 * q, q)
            sign = -1.0 if back else 1.0
            known[tip[0]] = _carried(
                known[base[0]], nodes[0], nodes[1], axis, sign * turning, sign * sliding
            )
            grown = True
    del known[GROUND_NAME]
    return known


def start_frame(system: System, z: Array, v: Array, body: str) -> FrameHistory:
    """Orientation and angular velocity of a frame at one state; no accelerations."""
    from sidtool.formats.scene import Placement, rotation

    row = system.arrays.body[system.index(body)]
    p, u, rigid = int(row[at.POS]), int(row[at.VEL]), int(row[at.RD])
    w, turned = np.zeros(3), Placement()
    if rigid == 3 and system.planar:
        w[2], turned = v[u + 2], Placement(angle=z[p + 2])
    elif rigid == 6:
        w[:], turned = v[u + 3 : u + 6], Placement(quaternion=tuple(z[p + 3 : p + 7]))
    nothing = np.zeros((1, 3))
    return FrameHistory(rotation(turned)[None], nothing, w[None], nothing)


def _axis(joint: Joint, planar: bool) -> Array:
    """Axis of rotation or direction of sliding, in the frames of both markers."""
    if not planar:
        return spatial_axis(joint)
    if joint.type != "prismatic":
        return np.array([0.0, 0.0, 1.0])
    angle = planar_axis(joint)
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def _carried(
    base: FrameHistory, A: Node, B: Node, axis: Array, turn: Array, slide: Array
) -> FrameHistory:
    """The frame that hangs on a joint; turn and slide with two derivatives, (3, nt)."""
    first, second = rotation_part(A.AP.m0), rotation_part(B.AP.m0)
    Q = first @ _about(axis, turn[0]) @ second.T
    n, e = second @ axis, first @ axis
    arm = A.position + np.outer(slide[0], e)
    a = base.a + _swung(base.w, base.alpha, arm) + np.outer(slide[2], e)
    a = a + 2.0 * np.cross(base.w, np.outer(slide[1], e))
    carried = _back(Q, base.w)
    w = carried + np.outer(turn[1], n)
    alpha = _back(Q, base.alpha) + np.outer(turn[2], n)
    alpha = alpha + np.cross(carried, np.outer(turn[1], n))
    a = _back(Q, a) - _swung(w, alpha, np.broadcast_to(B.position, w.shape))
    return FrameHistory(base.R @ Q, a, w, alpha)


def _swung(w: Array, alpha: Array, arm: Array) -> Array:
    """Acceleration of a point at `arm` of a turning frame."""
    return np.cross(alpha, arm) + np.cross(w, np.cross(w, arm))


def _back(Q: Array, vectors: Array) -> Array:
    """Components in the second frame of vectors (nt, 3) in the first."""
    return np.einsum("tba,tb->ta", Q, vectors)


def _about(axis: Array, angle: Array) -> Array:
    """(nt, 3, 3) rotations about a unit axis (Rodrigues)."""
    x, y, z = axis
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * k + (1.0 - c) * (k @ k)
