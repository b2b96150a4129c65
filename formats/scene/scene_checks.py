"""Checks of a whole scene: existing names, consistent parts.

Checks of joints and drives: existing names, axes, coordinates.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..base.errors import InputError
from ..base.units import parse_unit
from ..toml.expressions import check_names
from .accuracy import check_wanted
from .base import as_3d
from .bodies import RigidBody
from .connections import multipliers, owner_table
from .force_checks import (
    check_force,
    check_function,
    check_input,
    check_reference,
    check_two_bodies,
)
from .forces import PointForce
from .functions import Given, InputFunction
from .joints import (
    MARKER_COORDINATES,
    Coupling,
    Drive,
    Gear,
    Joint,
    JointFriction,
    Screw,
    Universal,
    driven_coordinate,
    marker_names,
)
from .laws import Expression, states_of
from .outputs import (
    FRICTION_QUANTITIES,
    INPUTS,
    JOINT_QUANTITIES,
    MULTIPLIER,
    NAME,
    RESERVED,
    SCENE_QUANTITIES,
    STATE,
    VALUE,
    OutputName,
    coordinate_of,
    is_along_coordinate,
    is_elastic,
    is_joint_output,
    is_quantity,
    is_section_force,
    is_stress,
    parse_output,
)
from .signal_files import check_table
from .tables import SceneTables, check_quantity
from .units import units_of_functions, units_of_takers
from .values import (
    check_initial,
    check_length,
    check_markers,
    check_rigid_body,
    check_time,
    expected_names,
    raise_failure,
)
from .wildcards import has_wildcard, quantities_of


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


def check_scene(scene: SceneTables, fitting: SceneTables | None = None) -> None:
    """Raise the first inconsistency of a scene as `InputError` with its key.

    Parameters
    ----------
    fitting : a scene that was checked, from which this one differs in numbers: bodies,
        joints and forces that are the same objects are not checked again
    """
    if fitting is None or fitting.time is not scene.time:
        _check_names(scene)
        check_time(scene.time)
        fitting = None
    if fitting is None or fitting.tables is not scene.tables:
        for name, table in scene.tables.items():
            check_table(table, f"tables.{name}")
        fitting = None
    check_length(scene.gravity, "gravity", scene.dimension)
    check_markers(scene.ground.markers, "ground.markers", scene.dimension)
    for name, body in _changed_parts("bodies", scene, fitting):
        if isinstance(body, RigidBody):
            check_rigid_body(body, f"bodies.{name}", scene.dimension)
        check_initial(body.initial, f"bodies.{name}.initial", scene.dimension)
    for name, joint in _changed_parts("joints", scene, fitting):
        check_joint(joint, f"joints.{name}", scene)
    acting = ("inputs", "drives", "forces", "outputs", "accuracy", "events", "initial")
    if all(getattr(scene, part) is getattr(fitting, part, None) for part in acting):
        return
    _check_inputs(scene)
    check_drives(scene)
    for name, force in _changed_parts("forces", scene, fitting):
        check_force(force, f"forces.{name}", scene)
    for name, signal in scene.inputs.items():
        _check_input_unit(name, signal.unit, scene)
    _check_units_of_files(scene)
    for index, output in enumerate(scene.outputs.record):
        if has_wildcard(output):
            continue  # what it stands for is known with the SIDs
        _check_output(output, f"outputs.record[{index}]", scene)
    _check_wanted(scene)
    _check_start(scene)
    for name, event in scene.events.items():
        place = f"events.{name}.quantity"
        if not has_wildcard(event.quantity):
            _check_output(event.quantity, place, scene)
        check_quantity(event.quantity, place)


def _check_inputs(scene: SceneTables) -> None:
    for name, signal in scene.inputs.items():
        if name in scene.parameters:
            raise_failure(f"inputs.{name}", "is a parameter as well", "another name")
        try:
            check_names([name], "an input")
        except InputError as error:
            raise_failure(f"inputs.{name}", error.problem, error.expected)
        check_input(signal, f"inputs.{name}", scene.time)


def _check_input_unit(name: str, text: str | None, scene: SceneTables) -> None:
    """Check that what takes an input takes its unit: values are not converted.

    A force at a point takes kN where its components are those of one kN.
    """
    unit = parse_unit(text or "")
    if unit is None:
        return
    for key, taken in units_of_takers(name, scene):
        table, owner = key.split(".")[:2]
        force = scene.forces.get(owner) if table == "forces" else None
        known = parse_unit(taken)
        if isinstance(force, PointForce):
            parts = np.concatenate(
                [np.atleast_1d(force.force or 0.0), np.atleast_1d(force.torque or 0.0)]
            )
            if unit.factor != 1.0 and np.isclose(np.linalg.norm(parts), 1.0):
                raise_failure(
                    f"inputs.{name}.unit",
                    f"{key} takes {text} as if it were an SI unit",
                    f"an SI unit, or components of {unit.factor:g} in the force",
                )
        elif known and unit != known:
            raise_failure(
                f"inputs.{name}.unit",
                f"{key} takes {taken}, not {text}",
                f"{taken}, or a formula that converts the input",
            )


def _check_units_of_files(scene: SceneTables) -> None:
    """Check that files hold what takes their values: metres are no newtons."""
    for key, function, taken in units_of_functions(scene):
        known = parse_unit(taken)
        if isinstance(function, InputFunction):
            key, function = f"inputs.{function.name}", scene.inputs[function.name]
        given = getattr(function, "unit_of_file", "")
        unit = parse_unit(given)
        if unit and known and unit.exponents != known.exponents:
            raise_failure(
                f"{key}.file",
                f"the column of values has the unit {given}",
                f"one such as {taken}, or a scale",
            )


def _changed_parts(
    table: str, scene: SceneTables, fitting: SceneTables | None
) -> Iterator[Any]:
    """Parts of a table by name, but those of a scene that fits."""
    known = getattr(fitting, table, {})
    parts = getattr(scene, table).items()
    return ((name, part) for name, part in parts if part is not known.get(name))


def _check_wanted(scene: SceneTables) -> None:
    requested = scene.accuracy.wanted
    if requested is not None and scene.accuracy.step is not None:
        problem = "is given with accuracy.step, a step without error control"
        raise_failure("accuracy.wanted", problem, "one of the two")
    for name in requested if isinstance(requested, dict) else ():
        if not has_wildcard(name):
            _check_output(name, "accuracy.wanted", scene)
    check_wanted(requested, scene)


def _check_names(scene: SceneTables) -> None:
    for table in ("bodies", "joints", "drives", "forces", "events"):
        for name in getattr(scene, table):
            if not NAME.fullmatch(name) or name in RESERVED:
                raise_failure(
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
            problem = f"is also the name of one of the {others[0]}"
            raise_failure(
                f"{others[1]}.{name}", problem, "different names, for the outputs"
            )
    for name, body in {"ground": scene.ground, **scene.bodies}.items():
        for marker in body.markers:
            table = name if name == "ground" else f"bodies.{name}"
            if not NAME.fullmatch(marker) or is_quantity(marker):
                raise_failure(
                    f"{table}.markers.{marker}",
                    f"{marker!r} cannot be a name of a marker",
                    "letters, digits, _ and -, and not the word of an output quantity",
                )


def _check_output(text: str, place: str, scene: SceneTables) -> None:
    try:
        name = parse_output(text)
    except InputError as error:
        owner, _, quantity = text.partition(".")
        _check_connection(owner, quantity, place, scene)
        raise InputError(error.problem, place=place, expected=error.expected) from None
    if name.owner in SCENE_QUANTITIES:
        return
    if name.owner == INPUTS and not name.marker:
        if name.quantity not in scene.inputs:
            expected = expected_names(name.quantity, scene.inputs, "input")
            raise_failure(place, f"there is no input {name.quantity!r}", expected)
        return
    if name.owner in {**scene.forces, **scene.drives} and name.marker == STATE:
        _check_state(name, place, scene)
        return
    if name.marker == STATE and not is_quantity(name.quantity, of_marker=True):
        raise_failure(
            place, f"found {text!r}", "a state of the law of a force or a drive"
        )
    if name.quantity == VALUE and not name.marker:
        if name.owner not in scene.forces:
            expected = expected_names(name.owner, scene.forces, "force")
            raise_failure(place, f"there is no force {name.owner!r}", expected)
        if not hasattr(scene.forces[name.owner], "function"):
            _check_connection(name.owner, name.quantity, place, scene)
        return
    if not name.marker and is_along_coordinate(name.quantity):
        _check_along_coordinate(name, place, scene)
        return
    coordinate = "" if name.marker else coordinate_of(name.quantity)
    if coordinate and (name.owner in scene.joints or name.quantity != "angle"):
        _check_coordinate(name.owner, coordinate, place, scene)
        return
    if not name.marker and name.quantity in FRICTION_QUANTITIES:
        joint = scene.joints.get(name.owner)
        if joint is None or getattr(joint, "friction", None) is None:
            problem = f"{name.owner} is no joint with friction"
            raise_failure(place, problem, "a joint with [joints.NAME.friction]")
        return
    if not name.marker and MULTIPLIER.fullmatch(name.quantity):
        _check_multiplier(name, place, scene)
    if not name.marker and is_joint_output(name.quantity):
        is_force_quantity = (
            name.quantity in JOINT_QUANTITIES and name.owner in scene.forces
        )
        if name.owner not in [*scene.joints, *scene.drives] and not is_force_quantity:
            _check_connection(name.owner, name.quantity, place, scene)
            known = [*scene.joints, *scene.drives, *scene.forces]
            expected = expected_names(name.owner, known, "joint, drive or force")
            raise_failure(
                place, f"there is no joint, drive or force {name.owner!r}", expected
            )
        return
    if name.owner == "ground" or name.owner not in scene.bodies:
        _check_connection(name.owner, name.quantity, place, scene)
        expected = expected_names(name.owner, scene.bodies, "body")
        raise_failure(place, f"there is no body {name.owner!r}", expected)
    body = scene.bodies[name.owner]
    if is_stress(name.quantity) and isinstance(body, RigidBody):
        raise_failure(place, f"{name.owner} is rigid", "the stress of a SID body")
    if is_section_force(name):
        if isinstance(body, RigidBody):
            raise_failure(place, f"{name.owner} is rigid", "a SID body with sections")
        return
    if name.marker:
        check_reference(f"{name.owner}.{name.marker}", place, scene)
    elif is_elastic(name.quantity) and isinstance(body, RigidBody):
        raise_failure(
            place, f"{name.owner} is rigid", "elastic coordinates of a SID body"
        )


def _check_along_coordinate(name: OutputName, place: str, scene: SceneTables) -> None:
    """Check a quantity of joints, drives and forces along their coordinate."""
    owner, quantity = name.owner, name.quantity
    joint = scene.joints.get(owner)
    is_coordinate = joint is not None and quantity in joint.coordinates
    if is_coordinate or owner_table(owner, quantity, scene):
        return
    _check_connection(owner, quantity, place, scene)
    if owner in scene.bodies:
        problem = f"the body {owner} has no {quantity!r}"
        raise_failure(place, problem, "that of a joint, drive or force")
    known = [*scene.joints, *scene.drives, *scene.forces]
    expected = expected_names(owner, known, "joint, drive or force")
    raise_failure(place, f"there is no joint, drive or force {owner!r}", expected)


def _check_multiplier(name: OutputName, place: str, scene: SceneTables) -> None:
    """A multiplier that the joint or drive has."""
    if name.owner not in [*scene.joints, *scene.drives]:
        return
    count = multipliers(name.owner, scene)
    if int(name.quantity[1:]) > count:
        problem = f"{name.owner} has {count} multipliers"
        raise_failure(place, problem, f"f1 to f{count}" if count else "another joint")


def _check_connection(
    owner: str, quantity: str, place: str, scene: SceneTables
) -> None:
    """Raise what joints, drives and forces do not have, with what they have."""
    tables: dict[str, Mapping[str, object]]
    tables = {"joint": scene.joints, "drive": scene.drives, "force": scene.forces}
    for kind, table in tables.items():
        if owner in table and owner not in scene.bodies:
            problem = f"the {kind} {owner} has no {quantity!r}"
            raise_failure(
                place, problem, "one of " + ", ".join(quantities_of(owner, scene))
            )


def _check_start(scene: SceneTables) -> None:
    """Check what a search for an equilibrium begins with. A result may hold more than
    the scene has.
    """
    if scene.initial.state != "static":
        return
    for key in scene.initial.states or {}:
        place = f"initial.states.{key}"
        if key.split(".")[1:2] != [STATE]:
            raise_failure(place, "is not a state of a law", "FORCE.state.NAME")
        _check_output(key, place, scene)
    for key in scene.initial.rotations or {}:
        place, owner = f"initial.rotations.{key}", key.partition(".")[0]
        known = [*scene.joints, *scene.forces, *scene.drives]
        if owner not in known:
            kinds = "joint, force or drive"
            expected = expected_names(owner, known, kinds)
            raise_failure(place, f"there is no {kinds} {owner!r}", expected)


def _check_state(name: OutputName, place: str, scene: SceneTables) -> None:
    """A state that a law has; those of a law of a program are not known here."""
    owner = scene.drives.get(name.owner) or scene.forces[name.owner]
    function = getattr(owner, "function", None)
    known = owner.states if isinstance(owner, Drive) else states_of(function)
    if name.quantity not in known and not isinstance(function, Given):
        problem = f"the law of {name.owner} has no state {name.quantity!r}"
        raise_failure(place, problem, " or ".join(known) or "a law with states")


def _check_coordinate(
    owner: str, coordinate: str, place: str, scene: SceneTables
) -> None:
    """Coordinates of joints and their rates; bodies have an angle, too."""
    if owner not in scene.joints:
        _check_connection(owner, coordinate, place, scene)
        expected = expected_names(owner, scene.joints, "joint")
        raise_failure(place, f"there is no joint {owner!r}", expected)
    joint = scene.joints[owner]
    if coordinate not in joint.coordinates:
        problem = f"{owner}, of type {joint.type}, has no coordinate {coordinate!r}"
        raise_failure(place, problem, " or ".join(joint.coordinates) or "another joint")
