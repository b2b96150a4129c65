"""Frames without coordinates: fixed and driven joints that prescribe them.

Recorded forces of such joints follow from the motion, see `output.reactions`.
"""

from collections.abc import Container, Mapping

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import (
    Initial,
    Joint,
    SceneFile,
    coordinate_of,
    is_section_force,
    marker_names,
    marker_reference,
    observed_outputs,
    orientation_matrix,
    parse_output,
)

from ..spatial import system_arrays as at
from .body_data import BodyData
from .build_inputs import MarkerKey, PrescribedFrame, driven_coordinates
from .joints import planar_axis, spatial_axis
from .sid_packing import nearest_rotation
from .system import GROUND_NAME

#: Motions of a frame by the joint that carries it.
MOTIONS = {"fixed": at.FIXED, "revolute": at.REVOLUTE, "prismatic": at.PRISMATIC}
#: Point masses may be oriented otherwise than their joint says by as much [rad].
SAME_ORIENTATION = 1e-12
#: Energies that need the forces of all joints and drives.
_NEED_ALL_JOINTS = ("supplied", "balance")


def eliminated_frames(
    scene: SceneFile, data: Mapping[str, BodyData], law_drives: Container[str]
) -> dict[str, PrescribedFrame]:
    """Bodies whose frame follows from the ground, each after its base.

    Parameters
    ----------
    law_drives
        Drives with laws, whose motion is not known before.
    """
    known: dict[str, Array | None] = {GROUND_NAME: np.eye(3)}
    frames: dict[str, PrescribedFrame] = {}
    driven = driven_coordinates(scene)
    changed = True
    while changed:
        changed = False
        for name, joint in scene.joints.items():
            if joint.type not in MOTIONS:
                continue
            a, b = (marker_reference(text) for text in marker_names(joint))
            drive = next(iter(driven[name].values()), None)
            if a[0] not in known or b[0] in known:
                continue
            if drive in law_drives or not _prescribes_frame(joint, drive):
                continue
            if not _is_rigid(data, a, b):
                continue
            R = _constant_orientation(joint, known[a[0]], data, a, b)
            if data[b[0]].rotates or _is_close(R, scene.bodies[b[0]].initial):
                frames[b[0]] = PrescribedFrame(joint, a, b, drive)
                known[b[0]] = R
                changed = True
    return frames


def _prescribes_frame(joint: Joint, drive: str | None) -> bool:
    """True if a joint leaves no coordinate to its second body.

    The force of a joint that rubs is needed for its friction.
    """
    has_friction = getattr(joint, "friction", None) is not None
    return joint.type == "fixed" or (drive is not None and not has_friction)


def _is_rigid(data: Mapping[str, BodyData], *markers: MarkerKey) -> bool:
    """True if elastic coordinates neither move markers nor feel a force on them.

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
    a: MarkerKey,
    b: MarkerKey,
) -> Array | None:
    """Orientation of the body that a joint carries; None if it may turn."""
    if base is None or joint.type == "revolute":
        return None
    A, B = (nearest_rotation(data[body].node(name).AP.m0) for body, name in (a, b))
    return np.asarray(base @ A @ B.T)


def _is_close(R: Array | None, initial: Initial) -> bool:
    """True if a point mass, which never turns, has the orientation R."""
    return R is not None and bool(
        np.abs(R - orientation_matrix(initial)).max() < SAME_ORIENTATION
    )


def needs_reactions(scene: SceneFile, names: Mapping[str, str]) -> bool:
    """True if an output or event needs forces of some joints and drives."""
    outputs = [parse_output(text) for text in observed_outputs(scene)]
    forces = [o.owner for o in outputs if not coordinate_of(o.quantity)]
    every = any(
        output.quantity in _NEED_ALL_JOINTS or is_section_force(output)
        for output in outputs
    )
    return bool(names) and (every or any(owner in names for owner in forces))


def eliminated_joints(
    scene: SceneFile, frames: Mapping[str, PrescribedFrame]
) -> dict[str, str]:
    """Body of each joint and drive that became a prescribed frame."""
    eliminated = {}
    for name, joint in scene.joints.items():
        for body, frame in frames.items():
            if frame.joint is joint:
                eliminated[name] = body
                if frame.drive is not None:
                    eliminated[frame.drive] = body
    return eliminated


def sliding_direction(joint: Joint, planar: bool) -> Array:
    """Direction of a prescribed joint in its base marker."""
    return np.array([planar_axis(joint)]) if planar else spatial_axis(joint)
