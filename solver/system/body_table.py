"""Tables of the bodies and of their markers.

Frames without coordinates: fixed and driven joints that prescribe them.

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
from ..spatial.system_arrays import IntTable
from . import sid_packing
from .body_data import BodyData
from .build_inputs import BuildInputs, MarkerKey, PrescribedFrame, driven_coordinates
from .joints import planar_axis, spatial_axis
from .sid_packing import nearest_rotation
from .system import GROUND_NAME

#: Motions of a frame by the joint that carries it.
MOTIONS = {"fixed": at.FIXED, "revolute": at.REVOLUTE, "prismatic": at.PRISMATIC}
#: Point masses may be oriented otherwise than their joint says by as much [rad].
SAME_ORIENTATION = 1e-12
#: Energies that need the forces of all joints and drives.
_NEED_ALL_JOINTS = ("supplied", "balance")

#: Columns that prescribe a frame.
PRESCRIBED_FRAME_COLUMNS = [at.MOTION, at.BASE, at.TIP, at.DRIVE, at.FRAME]


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


def body_table(parts: BuildInputs, markers: dict[MarkerKey, int]) -> IntTable:
    """One row for each body, in the order of `parts`.

    Parameters
    ----------
    markers
        Rows of the marker table.
    """
    table = np.zeros((len(parts.order), at.N_BODY), np.int64)
    position = velocity = block = 0
    for row, name in zip(table, parts.order, strict=True):
        data = parts.data[name]
        nq = data.sid.nq
        rigid, turns = _rigid_coordinates(parts, data)
        row[at.NQ], row[at.RD] = nq, rigid
        row[at.NV], row[at.NP] = rigid + nq, rigid + nq + turns
        row[at.POS], row[at.VEL], row[at.BLOCK] = position, velocity, block
        row[at.FLAGS] = sid_packing.term_flags(data.sid, data.quadratic_inertia)
        if not data.is_scene_body and nq:
            row[at.FLAGS] |= at.LAW_STATE
        row[at.DATA] = parts.real_data.add(sid_packing.pack_sid(data.sid, parts.planar))
        row[at.FRAME], row[at.MOTION] = _frame_data(parts, name)
        row[at.DRIVE] = _frame_drive(parts, name)
        frame = parts.frames.get(name)
        if frame is not None:
            row[at.BASE], row[at.TIP] = markers[frame.base], markers[frame.tip]
        position += row[at.NP]
        velocity += row[at.NV]
        block += row[at.NV] ** 2
    return table


def with_prescribed_frames(full_table: IntTable, reduced_table: IntTable) -> IntTable:
    """The body table with all coordinates, and the prescribed frames of another."""
    table = full_table.copy()
    table[:, PRESCRIBED_FRAME_COLUMNS] = reduced_table[:, PRESCRIBED_FRAME_COLUMNS]
    return table


def _rigid_coordinates(parts: BuildInputs, data: BodyData) -> tuple[int, int]:
    """Rigid velocity coordinates, and how many position coordinates come on top."""
    if not data.is_scene_body or data.name in parts.frames:
        return 0, 0
    if parts.planar:
        return (3, 0) if data.rotates else (2, 0)
    return (6, 1) if data.rotates else (3, 0)


def _frame_data(parts: BuildInputs, name: str) -> tuple[int, int]:
    if not parts.data[name].is_scene_body:
        return 0, at.GROUND
    frame = parts.frames.get(name)
    if frame is None:
        return parts.real_data.add(constant_orientation(parts, name)), at.FREE
    direction = sliding_direction(frame.joint, parts.planar)
    if parts.planar:
        direction = np.append(direction, 0.0)
    return parts.real_data.add(direction), MOTIONS[frame.joint.type]


def constant_orientation(parts: BuildInputs, name: str) -> Array:
    initial = parts.scene.bodies[name].initial
    if parts.planar:
        return np.array([initial.angle or 0.0])
    return sid_packing.quaternion(orientation_matrix(initial))


def _frame_drive(parts: BuildInputs, name: str) -> int:
    frame = parts.frames.get(name)
    if frame is None or frame.drive is None:
        return -1
    return parts.drive_index[frame.drive]


def pack_marker(parts: BuildInputs, reference: MarkerKey) -> Array:
    node = parts.node(reference)
    if not parts.planar:
        return sid_packing.pack_spatial_marker(node)
    return sid_packing.pack_planar_marker(node, parts.marker_angle(reference))


def marker_table(
    parts: BuildInputs, markers: dict[MarkerKey, int]
) -> tuple[IntTable, int]:
    """One row for each marker, and how many numbers their shape functions are."""
    forces, moments = slice(3), slice(3)
    if parts.planar:
        forces, moments = slice(2), slice(2, 3)
    table = np.zeros((len(markers), at.N_MARKER), np.int64)
    phi = 0
    for reference, i in markers.items():
        node = parts.node(reference)
        table[i, at.M_BODY] = parts.order.index(reference[0])
        table[i, at.M_DATA] = parts.real_data.add(pack_marker(parts, reference))
        table[i, at.M_PHI] = phi
        for column, shapes, rows in (
            (at.M_PHI1, node.phi, forces),
            (at.M_PSI1, node.psi, moments),
        ):
            term = sid_packing.pack_stiffening(shapes, rows)
            table[i, column] = parts.real_data.add(term) if len(term) else -1
        phi += sid_packing.shape_functions(node, parts.planar).size
    return table, phi
