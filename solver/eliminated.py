"""Frames that need no coordinates: fixed and driven joints hang them on the ground.

What is asked of the force of such a joint keeps it among the constraints.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from formats.scene import (
    Joint,
    SceneFile,
    coordinate_of,
    marker_names,
    marker_reference,
    parse_output,
    watched,
)
from formats.sid import Array

from .bodies import BodyData
from .ingredients import Frame, driven_coordinates
from .joints import planar_axis, spatial_axis
from .kernels import layout as at
from .scene import GROUND_NAME

#: Motions of a frame by the joint that carries it.
MOTIONS = {"fixed": at.FIXED, "revolute": at.REVOLUTE, "prismatic": at.PRISMATIC}
#: Energies that need the forces of all joints and drives.
_OF_ALL_JOINTS = ("supplied", "balance")


def eliminated_frames(
    scene: SceneFile, data: Mapping[str, BodyData]
) -> dict[str, Frame]:
    """Bodies whose frame follows from the ground, each after its base."""
    known = {GROUND_NAME}
    frames: dict[str, Frame] = {}
    outputs = [parse_output(text) for text in watched(scene)]
    wanted = {o.owner for o in outputs if not coordinate_of(o.quantity)}
    if any(output.quantity in _OF_ALL_JOINTS for output in outputs):
        return frames
    driven = driven_coordinates(scene)
    grown = True
    while grown:
        grown = False
        for name, joint in scene.joints.items():
            if joint.type not in MOTIONS:
                continue
            a, b = (marker_reference(text) for text in marker_names(joint))
            drive = next(iter(driven[name].values()), None)
            kept = name in wanted or drive in wanted
            if kept or a[0] not in known or b[0] in known:
                continue
            if _carries_frame(joint, data[b[0]], b[1], drive):
                frames[b[0]] = Frame(joint, a, b, drive)
                known.add(b[0])
                grown = True
    return frames


def _carries_frame(joint: Joint, body: BodyData, tip: str, drive: str | None) -> bool:
    """Whether it prescribes all coordinates, at a marker that does not deform."""
    if joint.type != "fixed" and drive is None:
        return False
    node = body.node(tip)
    parts = (node.phi.m0, node.phi.m1, node.psi.m0, node.psi.m1)
    return not any(part is not None and part.any() for part in parts)


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
