"""What laws read: outputs of the motion as measures that kernels evaluate.

Each is the measure of an element, or its rate, see `elements.Element`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from sidtool.formats.errors import InputError
from sidtool.formats.scene import (
    FRICTION_QUANTITIES,
    RigidBody,
    SceneFile,
    coordinate_of,
    is_elastic,
    is_of_joint,
    is_rate,
    parse_output,
)
from sidtool.formats.scene.connections import holder
from sidtool.formats.scene.outputs import MEASURES

from ...space import layout as at
from ..bodies.data import BodyData
from .elements import Element, joint_coordinate
from .force_laws import Law
from .rows import force_element

GROUND = ("ground", "")
_ROTATION, _SPEED = ("rotation_x", "rotation_y", "rotation_z"), ("wx", "wy", "wz")
#: How people call what outputs do not have: rates of rates.
_ACCELERATION = re.compile(r"accel|_acc$|_rate_rate$|_ddot$|^(al|alpha)[xyz]?$|^aq\d+$")
_EXPECTED = (
    "an output that is a position or a velocity: JOINT.angle, JOINT.angle_rate and "
    "other coordinates, BODY.MARKER.x, .vx and, of rotation, .angle and .wz (in space "
    ".rotation_x and .wx), the same of a rigid body, "
    "BODY.q1, BODY.vq1, length, deflection and rate of a spring or an actuator, force "
    "and power of those, or a state FORCE.state.NAME"
)


class Reading(NamedTuple):
    """The measure of an element less a constant, or (order 1) its rate."""

    element: Element
    order: int
    constant: float = 0.0


def reading(
    name: str, scene: SceneFile, data: Mapping[str, BodyData], place: str
) -> Reading:
    """What measures an output, for a law.

    Raises
    ------
    InputError : there is no such output, or it depends on accelerations or forces,
        which follow from the forces.
    """
    found_ = _of_force(name, scene)
    if found_ is not None:
        return found_
    _refuse_consequences(name, place)
    try:
        owner, marker, quantity = parse_output(name)
    except InputError:
        raise InputError(
            f"there is nothing to read of the name {name!r}",
            place=place,
            expected=_EXPECTED,
        ) from None
    coordinate = coordinate_of(quantity)
    if owner in scene.joints and not marker and coordinate:
        if coordinate not in scene.joints[owner].coordinates:
            found = f"{owner} has no coordinate {coordinate}"
            listed = " or ".join(scene.joints[owner].coordinates) or "another joint"
            raise InputError(found, place=place, expected=listed)
        element = joint_coordinate(scene, owner, coordinate)
        return Reading(element, int(is_rate(quantity)))
    if owner in scene.bodies and is_elastic(quantity) and not marker:
        return _elastic(name, owner, quantity, data[owner], place)
    if owner in scene.bodies:
        found_ = _of_marker(owner, marker, quantity, scene, data[owner])
        if found_ is not None:
            return found_
    raise InputError(f"a law cannot read {name!r}", place=place, expected=_EXPECTED)


def _of_force(name: str, scene: SceneFile) -> Reading | None:
    """What a force measures along its coordinate; None for other outputs."""
    owner, _, quantity = name.rpartition(".")
    if quantity not in MEASURES or holder(owner, quantity, scene) != "forces":
        return None
    element = force_element(scene, owner)
    constant = element.law.rest if quantity == "deflection" else 0.0
    measure = replace(element, law=Law())
    return Reading(measure, int(quantity == "rate"), constant)


def _refuse_consequences(name: str, place: str) -> None:
    """Raises accelerations and forces, which a law would change by reading them."""
    quantity = name.rpartition(".")[2]
    if is_of_joint(quantity) or quantity in FRICTION_QUANTITIES:
        raise InputError(
            f"a law cannot read {name!r}: it is a force, which follows from all forces "
            "at the same instant, that of the law among them",
            place=place,
            expected=_EXPECTED,
        )
    if quantity in ("ax", "ay", "az") or _ACCELERATION.search(quantity):
        raise InputError(
            f"a law cannot read {name!r}: it is an acceleration, which follows from "
            "the forces at the same instant, that of the law among them",
            place=place,
            expected="a velocity, whose acceleration a state follows with a lag: with "
            'rate = "(elbow.angle_rate - slow)/0.01" of a state slow, that rate is the '
            "acceleration of elbow.angle, 0.01 s late",
        )


def _elastic(
    name: str, owner: str, quantity: str, data: BodyData, place: str
) -> Reading:
    if quantity.endswith("*"):
        raise InputError(
            f"a law cannot read {name!r}, which is all of them",
            place=place,
            expected="one elastic coordinate",
        )
    index = data.numbers.index(data.elastic_number(quantity, place))
    return Reading(coordinate(owner, index), int(quantity[0] == "v"))


def coordinate(body: str, index: int) -> Element:
    """What measures an elastic coordinate, counted from 0."""
    return Element(body, at.COORDINATE, None, (body, ""), (float(index),), Law())


def _of_rotation(end: tuple[str, str], quantity: str, planar: bool) -> Reading | None:
    """Angle or angular velocity of a body or marker, deformation included; in space a
    component of the rotation vector, or of the angular velocity."""
    if planar:
        if quantity not in ("angle", "wz"):
            return None
        element = Element(end[0], at.TWIST, GROUND, end, (0.0,), Law())
        return Reading(element, int(quantity == "wz"))
    if quantity not in (*_ROTATION, *_SPEED):
        return None
    order = int(quantity in _SPEED)
    along = tuple(float(axis == quantity[-1]) for axis in "xyz")
    data = (*along, 0.0, 0.0, 0.0) if order else along
    kind = at.SPIN if order else at.TILT
    return Reading(Element(end[0], kind, GROUND, end, data, Law()), order)


def _of_marker(
    owner: str, marker: str, quantity: str, scene: SceneFile, data: BodyData
) -> Reading | None:
    """Along an inertial axis, of a marker or of a rigid body; None for what is not."""
    planar = scene.dimension == "planar"
    if not marker and not isinstance(scene.bodies[owner], RigidBody):
        return None
    if marker:
        data.node(marker)
    turning = _of_rotation((owner, marker), quantity, planar)
    if turning is not None:
        return turning
    order = len(quantity) - 1
    if quantity[-1] not in ("xy" if planar else "xyz") or order > 1:
        return None
    if order == 1 and quantity[0] != "v":
        return None
    axis = "xyz".index(quantity[-1])
    along: tuple[float, ...] = (0.5 * math.pi * axis,)
    if not planar:
        along = tuple(float(i == axis) for i in range(3))
    element = Element(owner, at.SLIDE, GROUND, (owner, marker), along, Law())
    return Reading(element, order)
