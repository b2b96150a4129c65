"""The tables of bodies and of their markers."""

from __future__ import annotations

import numpy as np

from sidtool.formats.scene import rotation
from sidtool.formats.sid import Array

from ...space import layout as at
from ...space.layout import IntTable
from ..ingredients import Ingredients, Reference
from . import packing
from .data import BodyData
from .eliminated import MOTIONS, slide

#: Columns that prescribe a frame.
PRESCRIBING = [at.MOTION, at.BASE, at.TIP, at.DRIVE, at.FRAME]


def body_table(parts: Ingredients, markers: dict[Reference, int]) -> IntTable:
    """One row for each body, in the order of `parts`.

    markers : rows of the marker table
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
        row[at.FLAGS] = packing.flags(data.sid, data.quadratic_inertia)
        if not data.of_scene and nq:
            row[at.FLAGS] |= at.STATE
        row[at.DATA] = parts.pool.add(packing.pack(data.sid, parts.planar))
        row[at.FRAME], row[at.MOTION] = _frame_data(parts, name)
        row[at.DRIVE] = _frame_drive(parts, name)
        frame = parts.frames.get(name)
        if frame is not None:
            row[at.BASE], row[at.TIP] = markers[frame.base], markers[frame.tip]
        position += row[at.NP]
        velocity += row[at.NV]
        block += row[at.NV] ** 2
    return table


def with_prescribed_frames(whole: IntTable, cut: IntTable) -> IntTable:
    """The body table with all coordinates, and the prescribed frames of another."""
    table = whole.copy()
    table[:, PRESCRIBING] = cut[:, PRESCRIBING]
    return table


def _rigid_coordinates(parts: Ingredients, data: BodyData) -> tuple[int, int]:
    """Rigid velocity coordinates, and how many position coordinates come on top."""
    if not data.of_scene or data.name in parts.frames:
        return 0, 0
    if parts.planar:
        return (3, 0) if data.rotates else (2, 0)
    return (6, 1) if data.rotates else (3, 0)


def _frame_data(parts: Ingredients, name: str) -> tuple[int, int]:
    if not parts.data[name].of_scene:
        return 0, at.GROUND
    frame = parts.frames.get(name)
    if frame is None:
        return parts.pool.add(free_orientation(parts, name)), at.FREE
    direction = slide(frame.joint, parts.planar)
    if parts.planar:
        direction = np.append(direction, 0.0)
    return parts.pool.add(direction), MOTIONS[frame.joint.type]


def free_orientation(parts: Ingredients, name: str) -> Array:
    initial = parts.scene.bodies[name].initial
    if parts.planar:
        return np.array([initial.angle or 0.0])
    return packing.quaternion(rotation(initial))


def _frame_drive(parts: Ingredients, name: str) -> int:
    frame = parts.frames.get(name)
    if frame is None or frame.drive is None:
        return -1
    return parts.drive_index[frame.drive]


def packed_marker(parts: Ingredients, reference: Reference) -> Array:
    node = parts.node(reference)
    if not parts.planar:
        return packing.pack_spatial_marker(node)
    return packing.pack_planar_marker(node, parts.marker_angle(reference))


def marker_table(
    parts: Ingredients, markers: dict[Reference, int]
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
        table[i, at.M_DATA] = parts.pool.add(packed_marker(parts, reference))
        table[i, at.M_PHI] = phi
        for column, shapes, rows in (
            (at.M_PHI1, node.phi, forces),
            (at.M_PSI1, node.psi, moments),
        ):
            term = packing.pack_stiffening(shapes, rows)
            table[i, column] = parts.pool.add(term) if len(term) else -1
        phi += packing.shape_functions(node, parts.planar).size
    return table, phi
