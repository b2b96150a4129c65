"""What the types of a scene cannot say: names that exist, parts that fit together."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..errors import InputError
from .bodies import RigidBody, SidBody
from .failures import fail, known_names
from .force_checks import check_force
from .function_checks import check_function
from .joints import Joint
from .outputs import (
    ELASTIC,
    NAME,
    RESERVED,
    SCENE_QUANTITIES,
    is_of_joint,
    is_quantity,
    marker_reference,
    parse_output,
)
from .values import (
    check_initial,
    check_length,
    check_markers,
    check_rigid_body,
    check_time,
)

if TYPE_CHECKING:
    from .file import SceneFile


def check(scene: SceneFile) -> None:
    """Raise the first inconsistency of a scene as `InputError` with its key."""
    _check_names(scene)
    check_time(scene.time)
    check_length(scene.gravity, "gravity", scene.dimension)
    check_markers(scene.ground.markers, "ground.markers", scene.dimension)
    for name, body in scene.bodies.items():
        if isinstance(body, RigidBody):
            check_rigid_body(body, f"bodies.{name}", scene.dimension)
        check_initial(body.initial, f"bodies.{name}.initial", scene.dimension)
    for name, joint in scene.joints.items():
        _check_joint(joint, f"joints.{name}", scene)
    _check_drives(scene)
    for name, force in scene.forces.items():
        check_force(force, f"forces.{name}", scene, _check_reference)
    for index, output in enumerate(scene.outputs.record):
        _check_output(output, f"outputs.record[{index}]", scene)


def _check_names(scene: SceneFile) -> None:
    for table in ("bodies", "joints", "drives", "forces"):
        for name in getattr(scene, table):
            if not NAME.fullmatch(name) or name in RESERVED:
                fail(
                    f"{table}.{name}",
                    f"{name!r} cannot be a name",
                    "letters, digits, _ and -, beginning with a letter, none of "
                    f"{', '.join(sorted(RESERVED))}",
                )
    for name in [*scene.joints, *scene.drives]:
        others = [
            t for t in ("bodies", "joints", "drives") if name in getattr(scene, t)
        ]
        if len(others) > 1:
            found = f"is also the name of one of the {others[0]}"
            fail(f"{others[1]}.{name}", found, "different names, for the outputs")
    for name, body in {"ground": scene.ground, **scene.bodies}.items():
        for marker in body.markers:
            table = name if name == "ground" else f"bodies.{name}"
            if not NAME.fullmatch(marker) or is_quantity(marker):
                fail(
                    f"{table}.markers.{marker}",
                    f"{marker!r} cannot be a name of a marker",
                    "letters, digits, _ and -, and not the word of an output quantity",
                )


def _check_joint(joint: Joint, place: str, scene: SceneFile) -> None:
    if scene.dimension not in joint.dimensions:
        fail(f"{place}.type", f"{joint.type} is not for {scene.dimension} scenes")
    for index, text in enumerate(joint.markers):
        _check_reference(text, f"{place}.markers[{index}]", scene)
    first, second = (marker_reference(text)[0] for text in joint.markers)
    if first == second:
        fail(f"{place}.markers", f"both are on {first}", "markers of two bodies")
    axis = getattr(joint, "axis", None)
    if axis is None:
        return
    if scene.dimension == "planar" and joint.type == "revolute":
        fail(f"{place}.axis", "is not for planar scenes", "no axis: it is z")
    check_length(axis, f"{place}.axis", scene.dimension)
    if not any(axis):
        fail(f"{place}.axis", "has no direction", "a vector that is not zero")


def _check_reference(text: str, place: str, scene: SceneFile) -> None:
    try:
        name, marker = marker_reference(text)
    except InputError as error:
        raise InputError(error.problem, place=place, expected=error.expected) from None
    body = scene.ground if name == "ground" else scene.bodies.get(name)
    if body is None:
        known = ["ground", *scene.bodies]
        fail(place, f"there is no body {name!r}", known_names(name, known, "body"))
    elif isinstance(body, SidBody):
        if not marker:
            fail(place, f"{name} is flexible", f"one of its nodes, as {name}.MARKER")
        _check_marker_of_sid(body, marker, name, place)
    elif marker and marker not in body.markers:
        expected = known_names(marker, body.markers, "marker")
        fail(place, f"{name} has no marker {marker!r}", expected)


def _check_marker_of_sid(body: SidBody, marker: str, name: str, place: str) -> None:
    """A name that is no marker may still be a node; only numbers are let through."""
    if marker not in body.markers and not marker.isdigit():
        expected = known_names(marker, body.markers, "marker") + ", or a node's number"
        fail(place, f"{name} has no marker {marker!r}", expected)


def _check_drives(scene: SceneFile) -> None:
    driven: dict[str, str] = {}
    for name, drive in scene.drives.items():
        place = f"drives.{name}"
        joint = scene.joints.get(drive.joint)
        if joint is None:
            expected = known_names(drive.joint, scene.joints, "joint")
            fail(f"{place}.joint", f"there is no joint {drive.joint!r}", expected)
        elif joint.coordinate is None:
            found = f"{drive.joint} is of type {joint.type}"
            fail(f"{place}.joint", found, "a revolute or prismatic joint")
        if drive.joint in driven:
            found = f"{drive.joint} is driven by {driven[drive.joint]} already"
            fail(f"{place}.joint", found, "one drive per joint")
        driven[drive.joint] = name
        check_function(drive.function, f"{place}.function", scene.time)


def _check_output(text: str, place: str, scene: SceneFile) -> None:
    try:
        name = parse_output(text)
    except InputError as error:
        raise InputError(error.problem, place=place, expected=error.expected) from None
    if name.owner in SCENE_QUANTITIES:
        return
    if not name.marker and is_of_joint(name.quantity):
        if name.owner not in scene.joints and name.owner not in scene.drives:
            expected = known_names(name.owner, scene.joints, "joint")
            fail(place, f"there is no joint {name.owner!r}", expected)
        return
    if name.owner == "ground" or name.owner not in scene.bodies:
        expected = known_names(name.owner, scene.bodies, "body")
        fail(place, f"there is no body {name.owner!r}", expected)
    body = scene.bodies[name.owner]
    if name.marker:
        _check_reference(f"{name.owner}.{name.marker}", place, scene)
    elif ELASTIC.fullmatch(name.quantity) and isinstance(body, RigidBody):
        fail(place, f"{name.owner} is rigid", "elastic coordinates of a SID body")
