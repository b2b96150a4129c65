"""Tables of the bodies and of their markers."""

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import orientation_matrix

from ..spatial import system_arrays as at
from ..spatial.system_arrays import IntTable
from . import sid_packing
from .body_data import BodyData
from .body_frames import MOTIONS, sliding_direction
from .build_inputs import BuildInputs, MarkerKey

#: Columns that prescribe a frame.
PRESCRIBED_FRAME_COLUMNS = [at.MOTION, at.BASE, at.TIP, at.DRIVE, at.FRAME]


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
