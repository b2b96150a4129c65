"""Primitive constraints of a scene: those of joints, drives and couplings.

A coupling keeps a weighted sum of the coordinates of other joints constant.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from sidtool.formats.base.errors import InputError
from sidtool.formats.scene import (
    Coupling,
    Drive,
    Gear,
    Joint,
    coupled_coordinates,
    marker_names,
    marker_reference,
)

from ..spatial.system_arrays import ANGLE, COINCIDENT
from .build_inputs import BuildInputs, MarkerKey, driven_coordinates
from .joints import (
    JointPrimitives,
    Primitive,
    coupling_row,
    is_point_mass_joint,
    joint_primitives,
    marker_coordinate,
    marker_rotation,
)

#: Largest whole numbers of a ratio of angles in spatial scenes.
MAX_RATIO_NUMBER = 10_000
RATIO_TOLERANCE = 1e-12


def coupling_terms(
    name: str, joint: Gear | Coupling, joints: Mapping[str, Joint], planar: bool
) -> list[tuple[str, Primitive]]:
    """(joint, primitive) of each term of the sum, the first with its constant.

    An angle in space is known from the orientations of two markers, up to whole turns.
    When the weights of all angles are in ratios of whole numbers, the sum is known up
    to a period, and the constraint holds exactly and without memory for any number of
    turns.

    Raises
    ------
    InputError
        Weights of angles in space are not in ratios of whole numbers.
    """
    coupled = []
    for other, coordinate, weight in coupled_coordinates(joint, dict(joints)):
        parts = joint_primitives(joints[other], planar)
        coupled.append((other, parts.coordinates[coordinate], weight))
    weights = [weight for _, part, weight in coupled if part.kind == ANGLE]
    period = 0.0 if planar else 2.0 * math.pi * _common_unit(weights, name)
    terms = coupling_row([term[1:] for term in coupled], joint.offset, period)
    return list(zip((name for name, _, _ in coupled), terms, strict=True))


def _common_unit(weights: list[float], name: str) -> float:
    """The largest number of which all weights are whole multiples; 0 for no weights."""
    if not weights:
        return 0.0
    base = abs(weights[0])
    ratios = []
    for weight in weights:
        exact = weight / base
        ratio = Fraction(exact).limit_denominator(MAX_RATIO_NUMBER)
        if abs(ratio.numerator) > MAX_RATIO_NUMBER or abs(
            ratio - exact
        ) > RATIO_TOLERANCE * abs(exact):
            raise InputError(
                f"couples angles in the ratio {exact:.12g}",
                place=f"joints.{name}",
                expected="a ratio of whole numbers (of teeth) in a spatial scene, "
                f"none above {MAX_RATIO_NUMBER}",
            )
        ratios.append(ratio)
    denominator = math.lcm(*(ratio.denominator for ratio in ratios))
    common = math.gcd(*(int(ratio * denominator) for ratio in ratios))
    return base * common / denominator


@dataclass(frozen=True)
class Constraint:
    """A primitive constraint of a joint or drive.

    Attributes
    ----------
    drive
        Row of the function of time that it follows, -1 for none.
    law
        Row of the table of forces whose law it follows instead, -1 for none.
    """

    owner: str
    primitive: Primitive
    a: MarkerKey
    b: MarkerKey
    drive: int = -1
    law: int = -1


def constraints_of(parts: BuildInputs) -> list[Constraint]:
    """The constraints of a scene; prescribed frames need none.

    Raises
    ------
    InputError
        A gear has a ratio that cannot be held.
    """
    scene = parts.scene
    prescribing_joints = [frame.joint for frame in parts.frames.values()]
    driven = driven_coordinates(scene)
    constraints: list[Constraint] = []
    for name, joint in scene.joints.items():
        if isinstance(joint, Gear | Coupling):
            constraints += _coupling_constraints(parts, name, joint)
        elif not any(joint is other for other in prescribing_joints):
            constraints += _joint_constraints(parts, name, joint, driven[name])
    for name, drive in scene.drives.items():
        if drive.marker is not None:
            constraints += _marker_drive_constraints(parts, name, drive)
    return constraints


def _joint_constraints(
    parts: BuildInputs, name: str, joint: Joint, drives: dict[str, str]
) -> list[Constraint]:
    """Parameters
    ----------
    drives
        Drive of each driven coordinate of the joint.
    """
    a, b = (marker_reference(text) for text in marker_names(joint))
    primitives = joint_primitives(joint, parts.planar)
    if is_point_mass_joint(joint, parts.data):
        primitives = JointPrimitives([Primitive(COINCIDENT)])
    constraints = [Constraint(name, part, a, b) for part in primitives.constraints]
    if "length" in drives:
        constraints = []
    for coordinate, drive in drives.items():
        part = primitives.coordinates[coordinate]
        first, second = (b, a) if part.swapped else (a, b)
        index = parts.drive_index[drive]
        law = parts.drive_law_rows.get(drive, -1)
        constraints.append(Constraint(drive, part, first, second, index, law))
    return constraints


def _coupling_constraints(
    parts: BuildInputs, name: str, joint: Gear | Coupling
) -> list[Constraint]:
    constraints: list[Constraint] = []
    joints = parts.scene.joints
    for other, part in coupling_terms(name, joint, joints, parts.planar):
        a, b = (marker_reference(text) for text in marker_names(joints[other]))
        first, second = (b, a) if part.swapped else (a, b)
        constraints.append(Constraint(name, part, first, second))
    return constraints


def _marker_drive_constraints(
    parts: BuildInputs, name: str, drive: Drive
) -> list[Constraint]:
    assert drive.marker is not None
    a, b = marker_reference(drive.reference), marker_reference(drive.marker)
    index, law = parts.drive_index[name], parts.drive_law_rows.get(name, -1)
    if drive.axis is None:
        part = marker_coordinate(drive.coordinate or "", parts.planar)
        return [Constraint(name, part, a, b, index, law)]
    fixed, part = marker_rotation(drive.axis)
    axis_constraints = [Constraint(name, other, a, b) for other in fixed]
    return [*axis_constraints, Constraint(name, part, a, b, index, law)]
