"""Forces, torques and powers along the coordinates of joints, drives and forces."""

from collections.abc import Iterator

from .bodies import RigidBody
from .forces import Force
from .joints import Drive, Joint, driven_coordinate, marker_names
from .outputs import POWER, marker_reference
from .tables import SceneTables

#: Of the multipliers of a joint those that are forces, in the plane and in space: they
#: come first, and the others are torques.
FORCES = {
    "fixed": (2, 3),
    "revolute": (2, 3),
    "prismatic": (1, 2),
    "cylindrical": (0, 2),
    "screw": (0, 2),
    "spherical": (0, 3),
    "universal": (0, 3),
    "planar": (0, 1),
    "point_on_line": (1, 2),
    "point_on_plane": (0, 1),
    "coincident": (2, 3),
    "distance": (1, 1),
}
#: Torques among the multipliers, likewise.
_TORQUES = {
    "fixed": (1, 3),
    "revolute": (0, 2),
    "prismatic": (1, 3),
    "cylindrical": (0, 2),
    "screw": (0, 2),
    "universal": (0, 1),
    "planar": (0, 2),
}
#: Of a screw the last multiplier, which holds its thread, is a force.
THREAD_MULTIPLIER = 5


def multipliers(name: str, scene: SceneTables) -> int:
    """How many Lagrange multipliers, f1, f2, ..., a joint or drive has."""
    drive, is_spatial = scene.drives.get(name), scene.dimension == "spatial"
    if drive is not None:
        return 1 if drive.axis is None else 3
    joint = scene.joints[name]
    if not marker_names(joint):
        return 1
    if joint.type == "fixed" and _holds_point(joint, scene):
        return FORCES["fixed"][is_spatial]
    if joint.type == "distance" and any(d.joint == name for d in scene.drives.values()):
        return 0
    torques = _TORQUES.get(joint.type, (0, 0))
    thread = int(joint.type == "screw")
    return FORCES[joint.type][is_spatial] + torques[is_spatial] + thread


def _holds_point(joint: Joint, scene: SceneTables) -> bool:
    """Whether a joint fixes a point mass, which has no orientation."""
    for text in marker_names(joint):
        name, marker = marker_reference(text)
        body = scene.bodies.get(name)
        if not isinstance(body, RigidBody) or body.inertia is not None:
            continue
        if not any(body.centre_of_mass or ()):
            return not (marker and any(body.markers[marker].position or ()))
    return False


def is_turned(coordinate: str) -> bool:
    """Whether a coordinate is an angle, on which a torque acts."""
    return coordinate.startswith("angle") or coordinate == "rotation"


def effort_name(coordinate: str) -> str:
    """The name of what acts on a coordinate: force or torque."""
    return "torque" if is_turned(coordinate) else "force"


def force_coordinate(force: Force, scene: SceneTables) -> str:
    """The coordinate that a force acts on; empty for one in several directions."""
    if not hasattr(force, "coordinate"):
        return ""
    joint, coordinate = getattr(force, "joint", None), force.coordinate
    if joint is None:
        return "length"
    return coordinate or scene.joints[joint].coordinates[0]


def joint_coordinate_of(joint: Joint, quantity: str) -> str:
    """The coordinate of a joint on which its force or torque acts; empty for none."""
    on = [c for c in joint.coordinates if effort_name(c) == quantity]
    return on[0] if len(on) == 1 else ""


def actions_on_coordinate(
    joint: str, coordinate: str, scene: SceneTables
) -> Iterator[tuple[str, str]]:
    """Table and name of the drives and forces that act on a coordinate of a joint."""
    for other, drive in scene.drives.items():
        if drive.joint == joint and _is_driving(drive, coordinate, scene):
            yield "drives", other
    for other, force in scene.forces.items():
        in_joint = getattr(force, "joint", None) == joint
        if in_joint and force_coordinate(force, scene) == coordinate:
            yield "forces", other


def _is_driving(drive: Drive, coordinate: str, scene: SceneTables) -> bool:
    return driven_coordinate(drive, scene.joints) == coordinate


def quantities_of_joint(joint: Joint) -> tuple[str, ...]:
    """Return the quantities of this module that a joint has."""
    efforts = tuple(q for q in ("force", "torque") if joint_coordinate_of(joint, q))
    return (*efforts, POWER) if efforts else ()


def quantities_of_drive(drive: Drive, scene: SceneTables) -> tuple[str, ...]:
    """Return the quantities of this module that a drive has."""
    return effort_name(driven_coordinate(drive, scene.joints)), POWER


def quantities_of_force(force: Force, scene: SceneTables) -> tuple[str, ...]:
    """Return the quantities of this module that a force has."""
    coordinate = force_coordinate(force, scene)
    if not coordinate:
        return (POWER,)
    length = ("length",) if coordinate == "length" else ()
    deflection = ("deflection",) if hasattr(force, "rest") else ()
    return (*length, *deflection, "rate", effort_name(coordinate), POWER)


def owner_table(owner: str, quantity: str, scene: SceneTables) -> str:
    """The table of the scene whose part `owner` has a quantity of this module; joints
    first, as forces may have their names. Empty if none has it."""
    joint, drive = scene.joints.get(owner), scene.drives.get(owner)
    force = scene.forces.get(owner)
    if joint is not None and quantity in quantities_of_joint(joint):
        return "joints"
    if drive is not None and quantity in quantities_of_drive(drive, scene):
        return "drives"
    if force is not None and quantity in quantities_of_force(force, scene):
        return "forces"
    return ""
