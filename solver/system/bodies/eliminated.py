"""Frames that need no coordinates: fixed and driven joints hang them on the ground.

What is recorded has no say in it: forces of such joints follow from the motion, see
`carried`.
"""

from __future__ import annotations

from collections.abc import Container, Mapping

import numpy as np

from sidtool.formats.scene import (
    Initial,
    Joint,
    SceneFile,
    coordinate_of,
    marker_names,
    marker_reference,
    parse_output,
    rotation,
    watched,
)
from sidtool.formats.sid import Array

from ...space import layout as at
from ..ingredients import Frame, Reference, driven_coordinates
from ..joints import planar_axis, spatial_axis
from ..scene import GROUND_NAME
from .data import BodyData
from .packing import rotation_part

#: Motions of a frame by the joint that carries it.
MOTIONS = {"fixed": at.FIXED, "revolute": at.REVOLUTE, "prismatic": at.PRISMATIC}
#: Point masses may be oriented otherwise than their joint says by as much [rad].
SAME = 1e-12
#: Energies that need the forces of all joints and drives.
_OF_ALL_JOINTS = ("supplied", "balance")


def eliminated_frames(
    scene: SceneFile, data: Mapping[str, BodyData], led: Container[str]
) -> dict[str, Frame]:
    """Bodies whose frame follows from the ground, each after its base.

    led : drives with laws, whose motion is not known before
    """
    known: dict[str, Array | None] = {GROUND_NAME: np.eye(3)}
    frames: dict[str, Frame] = {}
    driven = driven_coordinates(scene)
    grown = True
    while grown:
        grown = False
        for name, joint in scene.joints.items():
            if joint.type not in MOTIONS:
                continue
            a, b = (marker_reference(text) for text in marker_names(joint))
            drive = next(iter(driven[name].values()), None)
            if a[0] not in known or b[0] in known:
                continue
            if drive in led or not _prescribes(joint, drive):
                continue
            if not _is_rigid(data, a, b):
                continue
            R = _constant_orientation(joint, known[a[0]], data, a, b)
            if data[b[0]].rotates or _is_close(R, scene.bodies[b[0]].initial):
                frames[b[0]] = Frame(joint, a, b, drive)
                known[b[0]] = R
                grown = True
    return frames


def _prescribes(joint: Joint, drive: str | None) -> bool:
    """Whether a joint leaves no coordinate to its second body.

    The force of a joint that rubs is needed for its friction.
    """
    rubs = getattr(joint, "friction", None) is not None
    return joint.type == "fixed" or (drive is not None and not rubs)


def _is_rigid(data: Mapping[str, BodyData], *markers: Reference) -> bool:
    """Whether elastic coordinates neither move markers nor feel a force on them.

    Both markers of a joint have to be so: a base that bends carries the mass of what
    hangs on it, and a tip that bends moves its body.
    """
    nodes = [data[body].node(marker) for body, marker in markers]
    parts = [t for n in nodes for t in (n.phi.m0, n.phi.m1, n.psi.m0, n.psi.m1)]
    return not any(part is not None and part.any() for part in parts)


def _constant_orientation(
    joint: Joint,
    base: Array | None,
    data: Mapping[str, BodyData],
    a: Reference,
    b: Reference,
) -> Array | None:
    """Orientation of the body that a joint carries; None if it may turn."""
    if base is None or joint.type == "revolute":
        return None
    A, B = (rotation_part(data[body].node(name).AP.m0) for body, name in (a, b))
    return np.asarray(base @ A @ B.T)


def _is_close(R: Array | None, initial: Initial) -> bool:
    """Whether a point mass, which never turns, has the orientation R."""
    return R is not None and bool(np.abs(R - rotation(initial)).max() < SAME)


def asks_for_joints(scene: SceneFile, names: Mapping[str, str]) -> bool:
    """Whether an output or event needs forces of some joints and drives."""
    outputs = [parse_output(text) for text in watched(scene)]
    forces = [o.owner for o in outputs if not coordinate_of(o.quantity)]
    every = any(output.quantity in _OF_ALL_JOINTS for output in outputs)
    return bool(names) and (every or any(owner in names for owner in forces))


def eliminated_joints(scene: SceneFile, frames: Mapping[str, Frame]) -> dict[str, str]:
    """Body of each joint and drive that became a prescribed frame."""
    gone = {}
    for name, joint in scene.joints.items():
        for body, frame in frames.items():
            if frame.joint is joint:
                gone[name] = body
                if frame.drive is not None:
                    gone[frame.drive] = body
    return gone


def slide(joint: Joint, planar: bool) -> Array:
    """Direction of a prescribed joint in its base marker."""
    return np.array([planar_axis(joint)]) if planar else spatial_axis(joint)
