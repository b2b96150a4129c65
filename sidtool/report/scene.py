"""What a scene file describes, before it is compiled."""

from __future__ import annotations

from typing import Any

from sidtool.formats.scene import (
    Body,
    Drive,
    Event,
    Force,
    Joint,
    OutputTimes,
    Polynomial,
    SceneFile,
    SidBody,
    driven_coordinate,
    marker_names,
)
from sidtool.formats.scene.base import Table

from .tables import Block, named, plural, table

#: Keys of forces that stand in other columns, and functions of many numbers.
_NO_NUMBERS = frozenset(["type", "marker", "markers", "joint", "coordinate"])
_LONG = frozenset(["polynomial", "spline", "table", "sum", "callable"])


def describe_scene(scene: SceneFile) -> str:
    """Lines and tables of bodies, joints and drives."""
    return "\n\n".join(scene_parts(scene))


def _output_times(scene: SceneFile) -> str:
    time = scene.time
    if time.output_step is None and time.output_times is None:
        return "no output times"
    return plural(len(OutputTimes(scene)), "output time")


def scene_parts(scene: SceneFile) -> list[Block]:
    """The same, one by one."""
    accuracy = scene.accuracy
    entries = [
        ("title", scene.title or "(none)"),
        ("dimension", scene.dimension),
        ("gravity", _vector(scene.gravity) + " m/s2" if scene.gravity else "none"),
        (
            "time",
            f"{scene.time.start:g} s to {scene.time.end:g} s, {_output_times(scene)}",
        ),
        (
            "integration",
            f"{accuracy.integrator}, "
            + (
                f"fixed step {accuracy.step:g} s"
                if accuracy.step
                else f"relative tolerance {accuracy.rtol:g}"
            ),
        ),
        ("outputs", ", ".join(scene.outputs.record) or "none"),
    ]
    if scene.parameters:
        known = (f"{name} = {value:g}" for name, value in scene.parameters.items())
        entries.insert(1, ("parameters", ", ".join(known)))
    parts = [named(entries)]
    bodies = [[name, *_body(body)] for name, body in scene.bodies.items()]
    parts.append(table(["body", "kind", "", "markers"], bodies))
    if scene.joints:
        joints = [[name, *_joint(joint)] for name, joint in scene.joints.items()]
        parts.append(table(["joint", "kind", "markers", "axis", "coordinates"], joints))
    if scene.drives:
        drives = [[name, *_drive(drive, scene)] for name, drive in scene.drives.items()]
        parts.append(table(["drive", "of", "coordinate", "function"], drives))
    if scene.forces:
        forces = [[name, *_force(force)] for name, force in scene.forces.items()]
        parts.append(table(["force", "kind", "acts on", "numbers"], forces))
    if scene.events:
        events = [[name, *_event(event)] for name, event in scene.events.items()]
        parts.append(table(["event", "when", "then"], events))
    return parts


def _body(body: Body) -> list[str]:
    markers = ", ".join(body.markers)
    if isinstance(body, SidBody):
        terms = [body.sid or f"made of {body.model}"]
        if body.damping is not None:
            terms.append(f"damping {body.damping.type}")
        if body.frame == "held":
            terms.append("frame held")
        if body.quadratic_inertia:
            terms.append("quadratic inertia")
        if not body.geometric_stiffening:
            terms.append("without geometric stiffening")
        if body.shape_functions is not None:
            numbers = ", ".join(map(str, sorted(body.shape_functions)))
            terms.append(f"shape functions {numbers}")
        kind = "taken as rigid" if body.rigid else "flexible"
        return [kind, ", ".join(terms), markers]
    kind, told = "point mass", f"{body.mass:g} kg"
    if body.inertia is not None:
        kind, told = "rigid", f"{told}, inertia {_amount(body.inertia)} kg m2"
    return [kind, told, markers]


def _joint(joint: Joint) -> list[str]:
    axis = getattr(joint, "axis", None)
    between = " - ".join(marker_names(joint) or getattr(joint, "joints", ()))
    coordinates = ", ".join(joint.coordinates)
    return [joint.type, between, _vector(axis) if axis else "", coordinates]


def _drive(drive: Drive, scene: SceneFile) -> list[str]:
    function = _amount(drive.function)
    if isinstance(drive.function, Polynomial):
        function += f", {plural(len(drive.function.pieces), 'piece')}"
    of = drive.joint or drive.marker or ""
    what = driven_coordinate(drive, scene.joints)
    if drive.of != "value":
        what = f"{drive.of} of {what}"
    return [of, what, function]


def _force(force: Force) -> list[str]:
    pair = getattr(force, "markers", None) or (getattr(force, "marker", None),)
    joint = getattr(force, "joint", None)
    if joint is None:
        return [force.type, " - ".join(map(str, pair)), numbers_of(force)]
    coordinate = getattr(force, "coordinate", None)
    on = f"{joint}, {coordinate}" if coordinate else joint
    return [force.type, on, numbers_of(force)]


def numbers_of(part: Table) -> str:
    """Stiffness, damping, rest, gains and other numbers that are given, as text.

    Functions of time are told by their kind, tables by the number of their points.
    """
    told = []
    for name in type(part).model_fields:
        value = getattr(part, name)
        if name in part.model_fields_set and name not in _NO_NUMBERS:
            told.append(f"{name} {_amount(value)}")
    return ", ".join(told)


def _amount(value: Any) -> str:
    if isinstance(value, Table):
        kind = getattr(value, "type", "")
        inner = "" if kind in _LONG else numbers_of(value)
        points = getattr(value, "deflection", getattr(value, "times", None))
        if points is not None:
            inner = f"{len(points)} points"
        return " ".join(filter(None, [kind, f"({inner})" if inner else ""]))
    if isinstance(value, tuple) and len(value) == 1:
        return _amount(value[0])
    if isinstance(value, tuple):
        return "[" + " ".join(map(_amount, value)) + "]"
    if isinstance(value, dict):
        return ", ".join(f"{name} = {_amount(entry)}" for name, entry in value.items())
    return f"{value:g}" if isinstance(value, float) else str(value)


def _event(event: Event) -> list[str]:
    how = "" if event.direction == "both" else f", {event.direction}"
    count = "" if event.count is None else f", count {event.count}"
    return [f"{event.quantity} = {event.value:g}{how}", event.action + count]


def _vector(vector: tuple[float, ...]) -> str:
    return " ".join(f"{component:g}" for component in vector)
