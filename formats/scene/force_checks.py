"""Checks of forces, functions of time, control laws and marker references."""

from itertools import pairwise

from ..base.errors import InputError
from ..base.numbers import is_label
from ..toml.expressions import check_names, lookups
from .base import Time
from .bodies import SidBody
from .forces import Bushing, Characteristic, Force, Friction, PointForce, SpringDamper
from .functions import (
    Given,
    Harmonic,
    InputFunction,
    Piece,
    Polynomial,
    SineRamp,
    SmoothStep,
    Spline,
    Sum,
)
from .laws import Expression, ForceFunction, Input, Pid
from .outputs import marker_reference
from .tables import SceneTables
from .values import check_length, expected_names, raise_failure


def check_force(force: Force, place: str, scene: SceneTables) -> None:
    """Raise what does not fit in a force as `InputError` with its key."""
    if isinstance(force, PointForce):
        check_reference(force.marker, f"{place}.marker", scene)
        _check_components(force, place, scene)
    elif isinstance(force, Friction):
        _check_joint(force.joint, force.coordinate, place, scene)
    else:
        _check_pair(force, place, scene)
    if isinstance(force, SpringDamper):
        _check_spring(force, place)
    if isinstance(force, Bushing):
        _check_bushing(force, place, scene)
    function = getattr(force, "function", None)
    if function is not None:
        check_function(function, f"{place}.function", scene)


def _check_components(force: PointForce, place: str, scene: SceneTables) -> None:
    if force.force is None and force.torque is None:
        raise_failure(
            place, "has neither force nor torque", "components of one of them"
        )
    check_length(force.force, f"{place}.force", scene.dimension)
    spatial = isinstance(force.torque, tuple)
    if force.torque is not None and spatial != (scene.dimension == "spatial"):
        expected = "three numbers" if scene.dimension == "spatial" else "a number"
        raise_failure(
            f"{place}.torque", f"does not fit a {scene.dimension} scene", expected
        )


def _check_pair(force: Force, place: str, scene: SceneTables) -> None:
    markers, joint = getattr(force, "markers", None), getattr(force, "joint", None)
    if (markers is None) == (joint is None):
        problem = "both are given" if joint is not None else "neither is given"
        raise_failure(place, problem, "one of markers and joint")
    if joint is not None:
        _check_joint(joint, getattr(force, "coordinate", None), place, scene)
        return
    if getattr(force, "coordinate", None) is not None:
        raise_failure(
            f"{place}.coordinate", "is given with markers", "a coordinate of a joint"
        )
    assert markers is not None
    for index, text in enumerate(markers):
        check_reference(text, f"{place}.markers[{index}]", scene)
    if markers[0] == markers[1]:
        raise_failure(f"{place}.markers", "are the same", "two different markers")


def _check_joint(
    name: str, coordinate: str | None, place: str, scene: SceneTables
) -> None:
    joint = scene.joints.get(name)
    if joint is None:
        expected = expected_names(name, scene.joints, "joint")
        raise_failure(f"{place}.joint", f"there is no joint {name!r}", expected)
    if not joint.coordinates:
        problem = f"{name} is of type {joint.type}"
        expected = "a joint with a coordinate, such as revolute or prismatic"
        raise_failure(f"{place}.joint", problem, expected)
    if coordinate is not None and coordinate not in joint.coordinates:
        problem = f"{name} has no coordinate {coordinate!r}"
        raise_failure(f"{place}.coordinate", problem, " or ".join(joint.coordinates))


def _check_spring(force: SpringDamper, place: str) -> None:
    if force.stiffness is not None and force.table is not None:
        raise_failure(f"{place}.table", "is given with stiffness", "one of them")
    if force.table is not None:
        _check_table(force.table, f"{place}.table")
    elif force.stiffness is None and force.damping is None:
        raise_failure(place, "does nothing", "stiffness, table or damping")


def _check_table(table: Characteristic, place: str) -> None:
    if len(table.force) != len(table.deflection):
        problem = f"has {len(table.force)} values for {len(table.deflection)}"
        raise_failure(f"{place}.force", problem, "one value for each deflection")
    for earlier, later in pairwise(table.deflection):
        if not later > earlier:
            problem = f"{later} follows {earlier}"
            raise_failure(f"{place}.deflection", problem, "growing values")


def _check_bushing(force: Bushing, place: str, scene: SceneTables) -> None:
    count = 3 if scene.dimension == "planar" else 6
    if force.shaft and count == 3:
        raise_failure(
            f"{place}.shaft", "found in a planar scene", "a bushing that turns about z"
        )
    for key in ("stiffness", "damping"):
        values = getattr(force, key)
        if values is None:
            continue
        shape_text = f"{count} values or a {count} x {count} matrix"
        expected = f"{shape_text} in a {scene.dimension} scene"
        if len(values) != count:
            raise_failure(f"{place}.{key}", f"found {len(values)} values", expected)
        for row in values:
            if isinstance(row, tuple) and len(row) != count:
                problem = f"found a row of {len(row)} values"
                raise_failure(f"{place}.{key}", problem, expected)


def check_function(function: ForceFunction, place: str, scene: SceneTables) -> None:
    """Raise what does not fit in a function or a law as `InputError` with its key."""
    time = scene.time
    if isinstance(function, Polynomial):
        _check_polynomial(function, place, time)
    elif isinstance(function, Harmonic):
        _check_harmonic(function, place)
    elif isinstance(function, Sum):
        for index, part in enumerate(function.parts):
            check_function(part, f"{place}.parts[{index}]", scene)
    elif isinstance(function, SmoothStep | SineRamp):
        if not function.to > function.from_:
            raise_failure(
                f"{place}.to", f"found {function.to}", f"more than {function.from_}"
            )
        if isinstance(function, SineRamp):
            _check_offset(function, place)
    elif isinstance(function, Spline):
        if not function.times:
            raise_failure(f"{place}.times", "is missing", "times and values, or a file")
        _check_points(function.times, function.values, place)
        curve = "smooth" if place.startswith("drives") else "linear"
        if (function.interpolation or curve) == "smooth":
            _check_span(function.times, place, time)
    elif isinstance(function, Given):
        _check_given(function, place, time)
    elif isinstance(function, InputFunction):
        if function.name not in scene.inputs:
            expected = expected_names(function.name, scene.inputs, "input")
            problem = f"there is no input {function.name!r}"
            raise_failure(f"{place}.name", problem, expected)
    elif isinstance(function, Expression):
        check_expression(function, place, scene)
    elif isinstance(function, Pid):
        check_pid(function, place)
        if not isinstance(function.reference, float | str):
            check_function(function.reference, f"{place}.reference", scene)


def _check_offset(ramp: SineRamp, place: str) -> None:
    if ramp.of == "value" and ramp.offset != 0.0:
        raise_failure(f"{place}.offset", "is given with a ramp of the value", "start")


def _check_harmonic(function: Harmonic, place: str) -> None:
    both = function.frequency is not None and function.angular_frequency is not None
    if both or function.frequency == function.angular_frequency:
        problem = "both are given" if both else "neither is given"
        raise_failure(
            place, problem, "one of frequency [Hz] and angular_frequency [rad/s]"
        )


def check_input(signal: Input, place: str, time: Time) -> None:
    """Raise what does not fit in the table of an input."""
    times, values = signal.times, signal.values
    if (times is None) != (values is None):
        missing = "times" if times is None else "values"
        raise_failure(f"{place}.{missing}", "is missing", "times and values, or none")
    if times is None or values is None:
        return
    _check_points(times, values, place)
    if signal.interpolation != "hold" and len(times) < 2:
        problem = f"has one time, and is {signal.interpolation}"
        raise_failure(f"{place}.times", problem, "two or more")
    if signal.interpolation == "smooth":
        _check_span(times, place, time)


def _check_points(
    times: tuple[float, ...], values: tuple[float, ...], place: str
) -> None:
    """Raise a table whose times do not grow, or that has no value for each of them."""
    if len(times) != len(values):
        problem = f"has {len(values)} values for {len(times)} times"
        raise_failure(f"{place}.values", problem, "one value for each time")
    for earlier, later in pairwise(times):
        if not later > earlier:
            raise_failure(
                f"{place}.times", f"{later} follows {earlier}", "growing times"
            )


def _check_span(times: tuple[float, ...], place: str, time: Time) -> None:
    """Raise a smooth table that does not cover the run: its value is not known there.

    Of others the ends hold.
    """
    if times[0] > time.start or times[-1] < time.end:
        problem = f"goes from {times[0]} to {times[-1]}"
        raise_failure(
            f"{place}.times", problem, f"times from {time.start} to {time.end} at least"
        )


def _check_given(function: Given, place: str, time: Time) -> None:
    """Check the pieces that a result stores, if there are any."""
    edges, terms = function.edges, function.terms
    if len(edges) != len(terms) + bool(terms):
        problem = f"has {len(edges)} edges for {len(terms)} pieces"
        raise_failure(f"{place}.edges", problem, "one more than pieces")
    if len({len(piece) for piece in terms} | {0}) > 2 or () in terms:
        raise_failure(f"{place}.terms", "has pieces of several lengths", "one length")
    for earlier, later in pairwise(edges):
        if not later > earlier:
            raise_failure(
                f"{place}.edges", f"{later} follows {earlier}", "growing times"
            )
    if edges and (edges[0] > time.start or edges[-1] < time.end):
        problem = f"goes from {edges[0]} to {edges[-1]}"
        raise_failure(
            f"{place}.edges", problem, f"times from {time.start} to {time.end} at least"
        )


def _check_polynomial(function: Polynomial, place: str, time: Time) -> None:
    pieces = function.pieces
    for index, piece in enumerate(pieces):
        _check_piece(piece, f"{place}.pieces[{index}]")
    for index, (piece, later) in enumerate(pairwise(pieces)):
        location = f"{place}.pieces[{index + 1}].from"
        if piece.to is None:
            raise_failure(
                f"{place}.pieces[{index}].to", "is missing", "the end of the piece"
            )
        elif abs(later.from_ - piece.to) > 1e-12 * max(1.0, abs(piece.to)):
            raise_failure(
                location, f"found {later.from_}", f"the end before it, {piece.to}"
            )
    if pieces[0].from_ > time.start:
        problem = f"begins at {pieces[0].from_}"
        raise_failure(
            f"{place}.pieces[0].from", problem, f"at most the start, {time.start}"
        )
    last = pieces[-1].to
    if last is not None and last < time.end:
        expected = f"no `to`, or at least the end of the simulation, {time.end}"
        raise_failure(
            f"{place}.pieces[{len(pieces) - 1}].to", f"ends at {last}", expected
        )


def _check_piece(piece: Piece, place: str) -> None:
    hermite = piece.start is not None and piece.end is not None
    partly = piece.start is not None or piece.end is not None
    if hermite == (piece.coefficients is not None) or (partly and not hermite):
        raise_failure(place, "is not one polynomial", "coefficients, or start and end")
    if hermite and piece.to is None:
        raise_failure(f"{place}.to", "is missing", "the end of the piece")
    if piece.to is not None and piece.to <= piece.from_:
        raise_failure(f"{place}.to", f"found {piece.to}", f"a time after {piece.from_}")


def check_reference(text: str, place: str, scene: SceneTables) -> None:
    """Raise a marker that does not exist, or that is no marker's name at all."""
    try:
        name, marker = marker_reference(text)
    except InputError as error:
        raise InputError(error.problem, place=place, expected=error.expected) from None
    body = scene.ground if name == "ground" else scene.bodies.get(name)
    if body is None:
        known = ["ground", *scene.bodies]
        raise_failure(
            place, f"there is no body {name!r}", expected_names(name, known, "body")
        )
    elif isinstance(body, SidBody):
        if not marker:
            raise_failure(
                place, f"{name} is flexible", f"one of its nodes, as {name}.MARKER"
            )
        _check_marker_of_sid(body, marker, name, place)
    elif marker and marker not in body.markers:
        expected = expected_names(marker, body.markers, "marker")
        raise_failure(place, f"{name} has no marker {marker!r}", expected)


def check_two_bodies(texts: tuple[str, str], place: str) -> None:
    """Raise two markers of one body, between which nothing can be prescribed."""
    first, second = (marker_reference(text)[0] for text in texts)
    if first == second:
        raise_failure(place, f"both are on {first}", "markers of two bodies")


def _check_marker_of_sid(body: SidBody, marker: str, name: str, place: str) -> None:
    """A name that is no marker may still be a node; only numbers are let through."""
    if marker not in body.markers and not is_label(marker):
        expected = (
            expected_names(marker, body.markers, "marker") + ", or a node's number"
        )
        raise_failure(place, f"{name} has no marker {marker!r}", expected)


def check_expression(law: Expression, place: str, scene: SceneTables) -> None:
    """Raise what does not fit in a formula and its states, with the key."""
    _check_limits(law.limits, place)
    _check_names_of_law(law, place, scene)
    _check_formula(law.value, law, f"{place}.value")
    for name, term in law.terms.items():
        _check_formula(term, law, f"{place}.terms.{name}")
    for name, state in law.states.items():
        location = f"{place}.states.{name}"
        required = "rate" if law.sample_time is None else "next"
        for key in ("rate", "next"):
            formula = getattr(state, key)
            if (formula is not None) != (key == required):
                problem = f"{key} is {'given' if formula is not None else 'missing'}"
                time = "without" if law.sample_time is None else "with"
                raise_failure(
                    f"{location}.{key}", problem, f"{required} {time} a sample time"
                )
            if formula is not None:
                _check_formula(formula, law, f"{location}.{key}")


def _check_names_of_law(law: Expression, place: str, scene: SceneTables) -> None:
    """A name in formulas means one thing."""
    known: dict[str, str] = dict.fromkeys(scene.inputs, "an input")
    for key, kind, names in (
        ("parameters", "a parameter", law.parameters),
        ("terms", "a term", law.terms),
        ("states", "a state", law.states),
    ):
        for name in names:
            location = f"{place}.{key}.{name}"
            try:
                check_names([name], kind)
            except InputError as error:
                raise_failure(location, error.problem, error.expected)
            if name in known:
                raise_failure(location, f"is {known[name]} as well", "another name")
            known[name] = kind


def check_pid(law: Pid, place: str) -> None:
    """Raise what does not fit in a controller, with the key."""
    _check_limits(law.limits, place)
    if law.p == law.i == law.d == 0.0:
        raise_failure(place, "does nothing", "p, i or d")
    if law.filter is not None and law.d == 0.0:
        raise_failure(f"{place}.filter", "stands without d", "both, or none")
    if law.anti_windup is not None and (law.i == 0.0 or law.limits is None):
        raise_failure(
            f"{place}.anti_windup", "has nothing to do", "i and limits as well"
        )
    integral_only = law.p == law.d == 0.0 and law.limits is not None
    if integral_only and law.anti_windup is None:
        raise_failure(
            f"{place}.anti_windup", "is missing", "a time, as neither p nor d say one"
        )


def _check_limits(limits: tuple[float, float] | None, place: str) -> None:
    if limits is not None and not limits[0] < limits[1]:
        raise_failure(
            f"{place}.limits", f"found {list(limits)}", "a lower and an upper bound"
        )


def _check_formula(text: str, law: Expression, place: str) -> None:
    try:
        postfix = law.parse(text)
    except InputError as error:
        raise_failure(place, error.problem, error.expected)
        return
    for name, count in lookups(postfix):
        table = law.tables.get(name)
        if table is None:
            expected = expected_names(name, law.tables, "table")
            raise_failure(place, f"there is no table {name!r}", expected)
        elif table.variables != count:
            problem = f"lookup({name}, ...) has {count} variables"
            raise_failure(place, problem, f"{table.variables}, as the table has")
