"""Checks of a whole scene: existing names, consistent parts."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..base.errors import InputError
from ..base.units import parse_unit
from ..toml.expressions import check_names
from .accuracy import check_wanted
from .bodies import RigidBody
from .connections import multipliers, owner_table
from .drives import Drive
from .events import check_quantity
from .force_checks import check_force, check_input, check_reference
from .forces import PointForce
from .functions import Given, InputFunction
from .joint_checks import check_drives, check_joint
from .laws import states_of
from .lookup import check_table
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
from .tables import SceneTables
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
