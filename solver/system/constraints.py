"""Joints, drives and couplings as primitive constraints between two markers."""

from __future__ import annotations

from dataclasses import dataclass

from sidtool.formats.scene import (
    Coupling,
    Drive,
    Gear,
    Joint,
    marker_names,
    marker_reference,
)

from ..space.layout import COINCIDENT
from .couplings import coupling_terms
from .ingredients import Ingredients, Reference, driven_coordinates
from .joints import (
    Parts,
    Primitive,
    is_of_point,
    joint_parts,
    marker_coordinate,
    marker_rotation,
)


@dataclass(frozen=True)
class Constraint:
    """A primitive constraint of a joint or drive.

    drive : row of the function of time that it follows, -1 for none
    law : row of the table of forces whose law it follows instead, -1 for none
    """

    owner: str
    primitive: Primitive
    a: Reference
    b: Reference
    drive: int = -1
    law: int = -1


def constraints_of(parts: Ingredients) -> list[Constraint]:
    """The constraints of a scene; prescribed frames need none.

    Raises
    ------
    InputError : a gear has a ratio that cannot be held.
    """
    scene = parts.scene
    carried = [frame.joint for frame in parts.frames.values()]
    driven = driven_coordinates(scene)
    found: list[Constraint] = []
    for name, joint in scene.joints.items():
        if isinstance(joint, Gear | Coupling):
            found += _coupling(parts, name, joint)
        elif not any(joint is other for other in carried):
            found += _joint(parts, name, joint, driven[name])
    for name, drive in scene.drives.items():
        if drive.marker is not None:
            found += _marker_drive(parts, name, drive)
    return found


def _joint(
    parts: Ingredients, name: str, joint: Joint, drives: dict[str, str]
) -> list[Constraint]:
    """drives : drive of each driven coordinate of the joint"""
    a, b = (marker_reference(text) for text in marker_names(joint))
    primitives = joint_parts(joint, parts.planar)
    if is_of_point(joint, parts.data):
        primitives = Parts([Primitive(COINCIDENT)])
    found = [Constraint(name, part, a, b) for part in primitives.constraints]
    if "length" in drives:
        found = []
    for coordinate, drive in drives.items():
        part = primitives.coordinates[coordinate]
        first, second = (b, a) if part.swapped else (a, b)
        index = parts.drive_index[drive]
        law = parts.led.get(drive, -1)
        found.append(Constraint(drive, part, first, second, index, law))
    return found


def _coupling(
    parts: Ingredients, name: str, joint: Gear | Coupling
) -> list[Constraint]:
    found: list[Constraint] = []
    joints = parts.scene.joints
    for other, part in coupling_terms(name, joint, joints, parts.planar):
        a, b = (marker_reference(text) for text in marker_names(joints[other]))
        first, second = (b, a) if part.swapped else (a, b)
        found.append(Constraint(name, part, first, second))
    return found


def _marker_drive(parts: Ingredients, name: str, drive: Drive) -> list[Constraint]:
    assert drive.marker is not None
    a, b = marker_reference(drive.reference), marker_reference(drive.marker)
    index, law = parts.drive_index[name], parts.led.get(name, -1)
    if drive.axis is None:
        part = marker_coordinate(drive.coordinate or "", parts.planar)
        return [Constraint(name, part, a, b, index, law)]
    fixed, part = marker_rotation(drive.axis)
    held = [Constraint(name, other, a, b) for other in fixed]
    return [*held, Constraint(name, part, a, b, index, law)]
