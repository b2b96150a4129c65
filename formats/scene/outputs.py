"""The grammar of output names.

BODY.QUANTITY, BODY.MARKER.QUANTITY or JOINT.QUANTITY, where BODY may be followed by a
marker name or, for a SID, a node id. Quantities of a body: x y z, angle, vx vy vz,
wx wy wz, ax ay az, qN, vqN, and q*, vq* for all of them. An elastic coordinate may be
named by its kind, which stays when a SID is replaced by another: bending_y1, the first
that bends along y, bending_z2, axial_x1, torsion_x1, mainly_x1, mixed_xy1, and with a v
before it for its velocity. Motion is in inertial axes; vx_body vy_body vz_body and
wx_body wy_body wz_body are velocities in the axes of the body, which are the states of
a result. Quantities of a marker: x y z, vx vy vz, ax ay az, angle, wx wy wz, ux uy uz
for its elastic displacement in the body frame,
and, of a SID with stress rows, sigma_xx sigma_yy sigma_zz sigma_xy sigma_yz sigma_xz
and von_mises [Pa]. Of a body, over all nodes with stress: peak_von_mises, the largest
von_mises, and norm_von_mises, its 8-norm, which is smooth where it is not zero.

A body whose SID has sections has the section forces N Vy Vz [N], T My Mz [N m] at
BODY.SECTION, in the axes of the deformed section, on the part before it: a positive N
pulls.

Orientations of bodies and of markers: quaternion_0 (scalar, not negative) to
quaternion_3, and rotation_x rotation_y rotation_z, the rotation vector of at most half
a turn [rad]. Momenta of bodies: momentum_x to _z [kg m/s] and, about the inertial
origin, angular_momentum_x to _z [kg m2/s], in inertial axes; all bodies together have
momentum.x to .z and angular_momentum.x to .z.

Coordinates of a joint are angle, displacement, length, angle_1 and angle_2, as far as
it has them, and their rates angle_rate, ...; angles go on over many turns. Quantities
of a joint or a drive: fx fy fz and mx my mz, the force and torque on its
second marker in inertial axes; fK is its K-th Lagrange multiplier, the force on the
second marker along the direction of a constraint, see "Names of outputs" in
docs/howto/scenes.md. `force` or `torque` and `power` of joints, drives and forces, and
`length`, `deflection` and `rate` of springs, dampers and actuators are described in
`connections`. fx to mz
of a force are what it puts on its marker, or on the second one; its `value` is what
scales it, a function of time or a law, whose states are FORCE.state.NAME. A joint with
friction has friction, the force or torque along its coordinate, normal_force, the load
that makes it, and sticking, 1 or 0; fx to mz are with friction. Of the whole scene:
energy.kinetic, .elastic (of bodies), .potential (of gravity and of springs),
.dissipated, .supplied and .balance (the first four less the fifth), and
constraint.position and .velocity, the largest residual of the constraints. An input
of the scene is inputs.NAME.
"""

import re
from functools import lru_cache
from typing import NamedTuple

from ..base.errors import InputError
from ..base.stress import COMPONENTS as STRESS_COMPONENTS
from .joints import COORDINATES

POINT_QUANTITIES = frozenset(["x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az"])
#: Stresses at a marker of a flexible body; the largest one and the 8-norm of the body.
STRESSES = (*(f"sigma_{pair}" for pair in STRESS_COMPONENTS), "von_mises")
BODY_STRESSES = PEAK_STRESS, STRESS_NORM = "peak_von_mises", "norm_von_mises"
#: At a section of a body.
SECTION_FORCES = ("N", "Vy", "Vz", "T", "My", "Mz")
#: Of bodies and markers.
ORIENTATIONS = (
    *(f"quaternion_{k}" for k in range(4)),
    *(f"rotation_{axis}" for axis in "xyz"),
)
#: Of a body.
MOMENTA = (
    *(f"momentum_{axis}" for axis in "xyz"),
    *(f"angular_momentum_{axis}" for axis in "xyz"),
)
TURNING = ("angle", "wx", "wy", "wz")
#: Elastic displacements of a marker, in body axes.
DISPLACEMENTS = ("ux", "uy", "uz")
MARKER_QUANTITIES = POINT_QUANTITIES | frozenset(
    [*DISPLACEMENTS, *STRESSES, *TURNING, *ORIENTATIONS]
)
#: Velocities of a body frame in its own axes end in this.
IN_BODY = "_body"
VELOCITIES = ("vx", "vy", "vz", "wx", "wy", "wz")
BODY_QUANTITIES = (
    POINT_QUANTITIES
    | frozenset(["angle", *BODY_STRESSES, *VELOCITIES, *ORIENTATIONS, *MOMENTA])
    | frozenset(name + IN_BODY for name in VELOCITIES)
)
JOINT_QUANTITIES = frozenset(["fx", "fy", "fz", "mx", "my", "mz"])
#: What a joint with friction has: friction along its coordinate, the load that makes
#: it, and 1 while it sticks.
FRICTION_QUANTITIES = frozenset(["friction", "normal_force", "sticking"])
#: What acts along the coordinate of a joint, drive or force, and how that moves; see
#: `connections`. A `length` is also a coordinate of joints.
EFFORTS = ("force", "torque")
POWER = "power"
MEASURES = ("length", "deflection", "rate")
#: Quantities of the whole scene, by the name in place of a body.
SCENE_QUANTITIES = {
    "energy": ("kinetic", "elastic", "potential", "dissipated", "supplied", "balance"),
    "constraint": ("position", "velocity"),
    "momentum": ("x", "y", "z"),
    "angular_momentum": ("x", "y", "z"),
}
#: Those that the state at one time decides and that can take any value.
INSTANTANEOUS = ("kinetic", "elastic", "potential", "x", "y", "z")
#: What stands before the name of an input.
INPUTS = "inputs"
#: Names that no part of a scene may have.
RESERVED = frozenset(["ground", INPUTS, *SCENE_QUANTITIES])
ELASTIC = re.compile(r"(q|vq)([1-9][0-9]*|\*)")
#: An elastic coordinate or its velocity by its kind, see `motion_kinds`.
KIND = re.compile(
    r"(v?)((?:bending|axial|torsion|mainly)_[xyz][1-9][0-9]*"
    r"|mixed_x?y?z?[1-9][0-9]*|torsion[1-9][0-9]*)"
)
MULTIPLIER = re.compile(r"f[1-9][0-9]*")
RATE = "_rate"
#: Of a force: what scales it; and what stands before the name of a state of its law.
VALUE, STATE = "value", "state"
NAME = re.compile(r"[^\W\d][\w-]*")

_EXPECTED = "BODY.QUANTITY, BODY.MARKER.QUANTITY or JOINT.fx, such as piston.x"


class OutputName(NamedTuple):
    """The parts of an output name; `marker` is empty for a body or a joint.

    Of a section of a member of a frame it is MEMBER.SECTION.
    """

    owner: str
    marker: str
    quantity: str


@lru_cache(maxsize=4096)
def parse_output(name: str) -> OutputName:
    """Split an output name.

    Raises
    ------
    InputError : it has another form, or a quantity that does not exist.
    """
    parts = name.split(".")
    of_member = len(parts) == 4 and parts[-1] in SECTION_FORCES
    if not (of_member or len(parts) in (2, 3)) or not all(parts):
        raise InputError(f"found {name!r}", expected=_EXPECTED)
    owner, quantity = parts[0], parts[-1]
    marker = ".".join(parts[1:-1])
    if owner == INPUTS and not marker:
        return OutputName(owner, marker, quantity)
    if owner in SCENE_QUANTITIES:
        if marker or quantity not in SCENE_QUANTITIES[owner]:
            listed = ", ".join(SCENE_QUANTITIES[owner])
            raise InputError(f"found {name!r}", expected=f"{owner}. and {listed}")
        return OutputName(owner, marker, quantity)
    is_law = marker == STATE or (not marker and quantity == VALUE)
    is_along = not marker and (coordinate_of(quantity) or is_along_coordinate(quantity))
    if not is_law and not is_along:
        _check_word(name, quantity, marker)
    return OutputName(owner, marker, quantity)


def _check_word(name: str, quantity: str, marker: str) -> None:
    if not is_quantity(quantity, of_marker=bool(marker)):
        known = sorted(MARKER_QUANTITIES if marker else BODY_QUANTITIES)
        more = (
            ", or N, Vy, Vz, T, My, Mz of a section"
            if marker
            else ", qN, vqN, q*, vq*, bending_y1 or another kind, or fN, fx to mz,"
            " force, torque, power, angle, displacement"
            " or another coordinate and its rate, such as angle_rate, of a joint,"
            " or length, deflection, rate, value and state.NAME of a force"
        )
        raise InputError(
            f"found {name!r}", expected=f"a quantity out of {', '.join(known)}{more}"
        )


def coordinate_of(quantity: str) -> str:
    """The joint coordinate that a quantity is, or is the rate of; empty if none."""
    coordinate = quantity.removesuffix(RATE)
    return coordinate if coordinate in COORDINATES else ""


def is_rate(quantity: str) -> bool:
    """True for the rate of a joint coordinate."""
    return quantity.endswith(RATE)


def is_quantity(text: str, *, of_marker: bool = False) -> bool:
    """True for the word of a quantity, which no marker may have as its name."""
    if of_marker:
        return text in MARKER_QUANTITIES or text in SECTION_FORCES
    pattern = is_elastic(text) or MULTIPLIER.fullmatch(text)
    quantities = BODY_QUANTITIES | JOINT_QUANTITIES | FRICTION_QUANTITIES
    return text in quantities or bool(pattern)


def is_joint_output(quantity: str) -> bool:
    """True for what follows from the constraints of joints and drives: multipliers,
    force, torque and power; all but the first forces have as well."""
    known = quantity in JOINT_QUANTITIES or quantity in (*EFFORTS, POWER)
    return known or MULTIPLIER.fullmatch(quantity) is not None


def is_along_coordinate(quantity: str) -> bool:
    """True for force, torque and power along a coordinate and what that measures."""
    return quantity in (*EFFORTS, POWER, *MEASURES)


def is_elastic(quantity: str) -> bool:
    """True for an elastic coordinate, its velocity, or all of them."""
    return bool(ELASTIC.fullmatch(quantity) or KIND.fullmatch(quantity))


def is_section_force(name: OutputName) -> bool:
    """True for a force or moment at a section of a body."""
    return name.marker not in ("", STATE) and name.quantity in SECTION_FORCES


def is_stress(quantity: str) -> bool:
    """True for what only a flexible body with stress rows has."""
    return quantity in (*STRESSES, *BODY_STRESSES)


def marker_reference(text: str) -> tuple[str, str]:
    """Split ``crank.pin`` to ("crank", "pin"); the marker is empty for an origin alone.

    Raises
    ------
    InputError : more than one dot, or an empty part.
    """
    body, dot, marker = text.partition(".")
    if not body or "." in marker or (dot and not marker):
        raise InputError(f"found {text!r}", expected="BODY.MARKER or ground")
    return body, marker
