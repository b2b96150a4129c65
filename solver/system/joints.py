"""Joints as tables of primitive constraints between two markers.

To add a joint, add an entry to `PLANAR` or `SPATIAL`: its constraints, and for each
coordinate that a drive may prescribe the primitive that does so. Directions are given
in the frame of the first marker.

Primitive constraints of a scene: those of joints, drives and couplings.

A coupling keeps a weighted sum of the coordinates of other joints constant.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import (
    Coupling,
    Drive,
    Gear,
    Joint,
    as_3d,
    coupled_coordinates,
    marker_names,
    marker_reference,
)
from sidtool.formats.sid_mass import cross

from ..spatial.system_arrays import (
    ANGLE,
    COINCIDENT,
    COUPLED_ANGLE,
    COUPLED_DISPLACEMENT,
    DISPLACEMENT,
    DISTANCE,
    PERPENDICULAR,
    W_CONSTANT,
)
from .body_data import BodyData
from .build_inputs import BuildInputs, MarkerKey, driven_coordinates


@dataclass(frozen=True)
class Primitive:
    """A primitive constraint.

    Attributes
    ----------
    kind
        See `spatial.system_arrays`.
    data
        Its numbers.
    swapped
        From the second marker to the first.
    set_at_start
        Entry of `body_data` that the assembled start decides, -1 for none.
    shares_row
        Another term of the row before.
    """

    kind: int
    data: tuple[float, ...] = ()
    swapped: bool = False
    set_at_start: int = -1
    shares_row: bool = False


@dataclass(frozen=True)
class JointPrimitives:
    """Constraints of a joint, and the primitive that measures each coordinate."""

    constraints: list[Primitive]
    coordinates: dict[str, Primitive] = field(default_factory=dict)


def joint_primitives(joint: Joint, planar: bool) -> JointPrimitives:
    """Primitives of a joint; in the plane ALONG holds the angle of its direction."""
    if planar:
        return PLANAR[joint.type](joint, planar_axis(joint))
    return SPATIAL[joint.type](joint, spatial_axis(joint))


def is_point_mass_joint(joint: Joint, data: Mapping[str, BodyData]) -> bool:
    """True if a joint fixes a point mass, which has a place and no orientation."""
    if joint.type != "fixed":
        return False
    for text in marker_names(joint):
        body, marker = marker_reference(text)
        if body in data and not data[body].rotates and body != "ground":
            return not data[body].node(marker).position.any()
    return False


def marker_coordinate(name: str, planar: bool) -> Primitive:
    """The coordinate x, y, z or angle of a marker seen from another one."""
    if name == "angle":
        return Primitive(ANGLE, (0.0, 0.0))
    if planar:
        return _planar_along(0.0 if name == "x" else 0.5 * math.pi)
    return _along(np.eye(3)["xyz".index(name)])


def marker_rotation(axis: tuple[float, ...]) -> tuple[list[Primitive], Primitive]:
    """What keeps the axis of a marker's rotation, and the angle about it."""
    direction = as_3d(axis) / np.linalg.norm(axis)
    return _parallel_axes(direction), _angle(*normals(direction))


def planar_axis(joint: Joint) -> float:
    """Angle of a joint's direction in the first marker's frame, default x."""
    axis = getattr(joint, "axis", None)
    return math.atan2(axis[1], axis[0]) if axis else 0.0


def spatial_axis(joint: Joint) -> Array:
    """Unit direction of a joint, in the first marker's frame."""
    axis = as_3d(getattr(joint, "axis", None) or getattr(joint, "default_axis", (1.0,)))
    return axis / np.linalg.norm(axis)


def normals(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors that complete `axis` to a right-handed frame."""
    helper = np.eye(3)[int(np.argmin(abs(axis)))]
    first = cross(helper, axis)
    first /= np.linalg.norm(first)
    return first, cross(axis, first)


_POINT = Primitive(COINCIDENT)
_PLANAR_ANGLE = Primitive(ANGLE, (0.0, 0.0))


def _distance(joint: Joint, axis: object) -> JointPrimitives:
    """The driven length replaces the constant one."""
    length = joint.length  # type: ignore[union-attr]
    known = Primitive(DISTANCE, (length or 0.0,), set_at_start=-1 if length else 0)
    return JointPrimitives([known], {"length": Primitive(DISTANCE, (0.0,))})


def _planar_along(angle: float) -> Primitive:
    return Primitive(DISPLACEMENT, (angle, 0.0))


def _planar_prismatic(joint: Joint, axis: float) -> JointPrimitives:
    guide = _planar_along(axis + 0.5 * math.pi)
    return JointPrimitives(
        [guide, _PLANAR_ANGLE], {"displacement": _planar_along(axis)}
    )


def _planar_line(joint: Joint, axis: float) -> JointPrimitives:
    guide = _planar_along(axis + 0.5 * math.pi)
    return JointPrimitives([guide], {"displacement": _planar_along(axis)})


PLANAR: dict[str, Callable[[Joint, float], JointPrimitives]] = {
    "fixed": lambda joint, axis: JointPrimitives([_POINT, _PLANAR_ANGLE]),
    "revolute": lambda joint, axis: JointPrimitives([_POINT], {"angle": _PLANAR_ANGLE}),
    "prismatic": _planar_prismatic,
    "point_on_line": _planar_line,
    "coincident": lambda joint, axis: JointPrimitives([_POINT]),
    "distance": _distance,
}


def _along(axis: Array) -> Primitive:
    return Primitive(DISPLACEMENT, (*axis, 0.0, 0.0, 0.0))


def _angle(first: Array, second: Array, swapped: bool = False) -> Primitive:
    """Angle of the first direction of B in the plane of both directions of A."""
    return Primitive(ANGLE, (*first, *second), swapped)


def _perpendicular(pairs: list[tuple[Array, Array]]) -> list[Primitive]:
    return [Primitive(PERPENDICULAR, (*a, *b)) for a, b in pairs]


def _fixed_orientation() -> list[Primitive]:
    x, y, z = np.eye(3)
    return _perpendicular([(x, y), (y, z), (z, x)])


def _parallel_axes(axis: Array) -> list[Primitive]:
    return _perpendicular([(normal, axis) for normal in normals(axis)])


def _on_line(axis: Array) -> list[Primitive]:
    return [_along(normal) for normal in normals(axis)]


def _revolute(joint: Joint, axis: Array) -> JointPrimitives:
    """With friction, its point is held along axes of the first marker, which give the
    load across its own axis."""
    point_constraints = [_POINT]
    if joint.friction is not None:  # type: ignore[union-attr]
        point_constraints = [_along(direction) for direction in (*normals(axis), axis)]
    return JointPrimitives(
        [*point_constraints, *_parallel_axes(axis)], {"angle": _angle(*normals(axis))}
    )


def _prismatic(joint: Joint, axis: Array) -> JointPrimitives:
    return JointPrimitives(
        [*_on_line(axis), *_fixed_orientation()], {"displacement": _along(axis)}
    )


def _cylindrical(joint: Joint, axis: Array) -> JointPrimitives:
    coordinates = {"angle": _angle(*normals(axis)), "displacement": _along(axis)}
    return JointPrimitives([*_on_line(axis), *_parallel_axes(axis)], coordinates)


def coupling_row(
    terms: list[tuple[Primitive, float]], offset: float | None, period: float
) -> list[Primitive]:
    """One row: the sum of coordinates times weights is an offset, None for that of the
    start; it is known up to multiples of a period, 0 for exactly."""
    primitives = []
    for k, (part, weight) in enumerate(terms):
        is_first, set_at_start = float(k == 0), -1
        if k == 0 and offset is None:
            set_at_start = len(part.data) + W_CONSTANT
        constant = (offset or 0.0) * is_first
        data = (*part.data, weight, constant, period, is_first)
        kind = COUPLED_ANGLE if part.kind == ANGLE else COUPLED_DISPLACEMENT
        primitives.append(Primitive(kind, data, part.swapped, set_at_start, k > 0))
    return primitives


def _screw(joint: Joint, axis: Array) -> JointPrimitives:
    """displacement - pitch angle / 2 pi, where the angle is known up to whole turns."""
    pitch, slides = joint.pitch, _cylindrical(joint, axis)  # type: ignore[union-attr]
    angle, along = (slides.coordinates[n] for n in ("angle", "displacement"))
    terms = [(along, 1.0), (angle, -pitch / (2.0 * math.pi))]
    thread = coupling_row(terms, joint.offset, abs(pitch))  # type: ignore[union-attr]
    return JointPrimitives([*slides.constraints, *thread], slides.coordinates)


def _universal(joint: Joint, axis: Array) -> JointPrimitives:
    """The cross turns by angle_1 about `axis`, the second body by angle_2 on it."""
    second = as_3d(joint.second_axis or (0.0, 1.0, 0.0))  # type: ignore[union-attr]
    second = second / np.linalg.norm(second)
    third = cross(axis, second)
    coordinates = {
        "angle_1": _angle(second, third),
        "angle_2": _angle(axis, third, swapped=True),
    }
    return JointPrimitives([_POINT, *_perpendicular([(axis, second)])], coordinates)


def _planar_joint(joint: Joint, axis: Array) -> JointPrimitives:
    constraints = [_along(axis), *_parallel_axes(axis)]
    return JointPrimitives(constraints, {"angle": _angle(*normals(axis))})


def _point_on_line(joint: Joint, axis: Array) -> JointPrimitives:
    return JointPrimitives(_on_line(axis), {"displacement": _along(axis)})


SPATIAL: dict[str, Callable[[Joint, Array], JointPrimitives]] = {
    "fixed": lambda joint, axis: JointPrimitives([_POINT, *_fixed_orientation()]),
    "revolute": _revolute,
    "prismatic": _prismatic,
    "cylindrical": _cylindrical,
    "screw": _screw,
    "spherical": lambda joint, axis: JointPrimitives([_POINT]),
    "universal": _universal,
    "planar": _planar_joint,
    "point_on_line": _point_on_line,
    "point_on_plane": lambda joint, axis: JointPrimitives([_along(axis)]),
    "coincident": lambda joint, axis: JointPrimitives([_POINT]),
    "distance": _distance,
}


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
