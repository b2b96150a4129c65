"""Checks of joints and drives: existing names, axes, coordinates."""

import numpy as np

from .base import as_3d
from .drives import MARKER_COORDINATES, Drive, driven_coordinate
from .force_checks import check_function, check_reference, check_two_bodies
from .joints import Coupling, Gear, Joint, JointFriction, Screw, Universal, marker_names
from .laws import Expression
from .tables import SceneTables
from .values import check_length, expected_names, raise_failure


def check_joint(joint: Joint, place: str, scene: SceneTables) -> None:
    """Raise what does not fit in a joint as `InputError` with its key."""
    if scene.dimension not in joint.dimensions:
        raise_failure(
            f"{place}.type", f"{joint.type} is not for {scene.dimension} scenes"
        )
    if isinstance(joint, Gear | Coupling):
        _check_coupling(joint, place, scene)
        return
    for index, text in enumerate(marker_names(joint)):
        check_reference(text, f"{place}.markers[{index}]", scene)
    check_two_bodies(joint.markers, f"{place}.markers")
    for key in ("axis", "second_axis"):
        axis = getattr(joint, key, None)
        if axis is not None:
            _check_axis(axis, joint, f"{place}.{key}", scene.dimension)
    friction = getattr(joint, "friction", None)
    if friction is not None:
        _check_friction(friction, joint.type, f"{place}.friction", scene.dimension)
    if isinstance(joint, Screw) and joint.pitch == 0.0:
        raise_failure(f"{place}.pitch", "is zero", "a thread, or a revolute joint")
    if isinstance(joint, Universal):
        first = as_3d(joint.axis or (1.0, 0.0, 0.0))
        second = as_3d(joint.second_axis or (0.0, 1.0, 0.0))
        lengths = np.linalg.norm(first) * np.linalg.norm(second)
        if abs(first @ second) > 1e-9 * lengths:
            expected = f"a direction at right angles to the axis {joint.axis}"
            raise_failure(
                f"{place}.second_axis", f"found {joint.second_axis}", expected
            )


def _check_friction(
    friction: JointFriction, kind: str, place: str, dimension: str
) -> None:
    if (friction.radius is not None) != (kind == "revolute"):
        problem = "is missing" if friction.radius is None else "is for revolute joints"
        expected = "the radius of the pin" if friction.radius is None else "no radius"
        raise_failure(f"{place}.radius", problem, expected)
    if friction.static is not None and friction.static < friction.coefficient:
        problem = f"is {friction.static:g}, below the coefficient of sliding"
        raise_failure(f"{place}.static", problem, f"{friction.coefficient:g} or more")
    if friction.stribeck_velocity is not None and friction.static is None:
        problem = "has no coefficient at rest to begin with"
        raise_failure(f"{place}.stribeck_velocity", problem, "`static` beside it")
    without = ("point_on_line", "revolute")[: 2 if dimension == "planar" else 1]
    if friction.length is not None and kind in without:
        problem = "has no moment to share between two ends"
        raise_failure(f"{place}.length", problem, "no length")


def _check_axis(
    axis: tuple[float, ...], joint: Joint, place: str, dimension: str
) -> None:
    if dimension == "planar" and getattr(joint, "axis_is_normal", False):
        raise_failure(place, "is not for planar scenes", "no axis: it is z")
    check_length(axis, place, dimension)
    if not _squared_length(axis) > 0.0:
        raise_failure(place, "has no direction", "a vector that is not zero")


def _squared_length(vector: tuple[float, ...]) -> float:
    """Zero also where the squares of very small numbers vanish."""
    return sum(x * x for x in vector)


def _check_coupling(joint: Gear | Coupling, place: str, scene: SceneTables) -> None:
    count = len(joint.joints)
    for index, name in enumerate(joint.joints):
        other = scene.joints.get(name)
        location = f"{place}.joints[{index}]"
        if other is None:
            expected = expected_names(name, scene.joints, "joint")
            raise_failure(location, f"there is no joint {name!r}", expected)
        elif not _couplable(other):
            problem = f"{name} is of type {other.type}"
            raise_failure(location, problem, "a joint with an angle or a displacement")
    if len(set(joint.joints)) < count and joint.coordinate is None:
        raise_failure(f"{place}.joints", "names a joint twice", "different joints")
    for key in ("coordinate", "weights"):
        values = getattr(joint, key, None)
        if values is not None and len(values) != count:
            problem = f"has {len(values)} entries for {count} joints"
            raise_failure(f"{place}.{key}", problem, "one for each joint")
    for index, name in enumerate(joint.coordinate or ()):
        known = _couplable(scene.joints[joint.joints[index]])
        if name not in known:
            location = f"{place}.coordinate[{index}]"
            raise_failure(location, f"found {name!r}", " or ".join(known))
    if isinstance(joint, Gear) and joint.ratio == 0.0:
        raise_failure(f"{place}.ratio", "is zero", "a ratio of two speeds")
    if isinstance(joint, Coupling) and not all(joint.weights):
        raise_failure(f"{place}.weights", "has a zero", "weights that are not zero")


def _couplable(joint: Joint) -> tuple[str, ...]:
    return tuple(name for name in joint.coordinates if name != "length")


def check_drives(scene: SceneTables) -> None:
    """Raise what does not fit in the drives of a scene."""
    driven: dict[tuple[str | None, ...], str] = {}
    for name, drive in scene.drives.items():
        place = f"drives.{name}"
        if (drive.joint is None) == (drive.marker is None):
            problem = "neither is given" if drive.joint is None else "both are given"
            raise_failure(place, problem, "one of joint and marker")
        if drive.joint is not None:
            _check_joint_drive(drive, place, scene)
        else:
            _check_marker_drive(drive, place, scene)
        coordinate = driven_coordinate(drive, scene.joints)
        if drive.axis is not None and coordinate != "rotation":
            raise_failure(
                f"{place}.axis", f"is given with {coordinate}", "coordinate: rotation"
            )
        key = (drive.joint, drive.marker, drive.reference, coordinate)
        if key in driven:
            driven_name = drive.joint or drive.marker
            problem = f"{driven_name} is driven by {driven[key]} already"
            expected = "one drive for each coordinate"
            raise_failure(
                f"{place}.{'joint' if drive.joint else 'marker'}", problem, expected
            )
        driven[key] = name
        check_function(drive.function, f"{place}.function", scene)
        _check_law(drive, name, scene)


def _check_law(drive: Drive, name: str, scene: SceneTables) -> None:
    """Check a drive that follows a control law, or a rate or an acceleration."""
    place = f"drives.{name}"
    needs = {"start": drive.integrated, "start_rate": drive.integrated[1:]}
    for key, states in needs.items():
        if getattr(drive, key) != 0.0 and not states:
            problem = f'is given with of = "{drive.of}"'
            raise_failure(
                f"{place}.{key}", problem, "a start that the function itself has"
            )
    if drive.has_law and name in scene.forces:
        expected = "different names, as both may have states"
        raise_failure(place, "is also the name of one of the forces", expected)
    law = drive.function
    if not isinstance(law, Expression):
        return
    for state in drive.integrated:
        kinds = ("state", law.states), ("parameter", law.known), ("term", law.terms)
        for kind, names in kinds:
            if state in names:
                problem = f"{state} is a {kind} and what the {drive.of} adds up to"
                raise_failure(f"{place}.function", problem, "another name")


def _check_joint_drive(drive: Drive, place: str, scene: SceneTables) -> None:
    assert drive.joint is not None
    joint = scene.joints.get(drive.joint)
    if joint is None:
        expected = expected_names(drive.joint, scene.joints, "joint")
        raise_failure(f"{place}.joint", f"there is no joint {drive.joint!r}", expected)
    elif not joint.coordinates:
        problem = f"{drive.joint} is of type {joint.type}"
        expected = "a joint with a coordinate, such as revolute or prismatic"
        raise_failure(f"{place}.joint", problem, expected)
    elif drive.coordinate not in (None, *joint.coordinates):
        expected = " or ".join(joint.coordinates)
        raise_failure(f"{place}.coordinate", f"found {drive.coordinate!r}", expected)
    if drive.reference != "ground":
        raise_failure(
            f"{place}.reference", "is given with joint", "a reference for a marker"
        )


def _check_marker_drive(drive: Drive, place: str, scene: SceneTables) -> None:
    assert drive.marker is not None
    check_reference(drive.marker, f"{place}.marker", scene)
    check_reference(drive.reference, f"{place}.reference", scene)
    check_two_bodies((drive.reference, drive.marker), f"{place}.marker")
    known = MARKER_COORDINATES[scene.dimension]
    if drive.coordinate not in known:
        problem = f"found {drive.coordinate!r}" if drive.coordinate else "is missing"
        raise_failure(f"{place}.coordinate", problem, " or ".join(known))
    if drive.coordinate == "rotation" and not _squared_length(drive.axis or ()):
        problem = "has no direction" if drive.axis else "is missing"
        raise_failure(f"{place}.axis", problem, "the axis of the rotation")
