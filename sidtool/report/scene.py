"""What a scene file describes, before it is compiled."""

from __future__ import annotations

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

from .tables import Block, named, plural, table


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
        parts.append(table(["force", "kind", "acts on"], forces))
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
    kind = "rigid" if body.inertia is not None else "point mass"
    return [kind, f"{body.mass:g} kg", markers]


def _joint(joint: Joint) -> list[str]:
    axis = getattr(joint, "axis", None)
    between = " - ".join(marker_names(joint) or getattr(joint, "joints", ()))
    coordinates = ", ".join(joint.coordinates)
    return [joint.type, between, _vector(axis) if axis else "", coordinates]


def _drive(drive: Drive, scene: SceneFile) -> list[str]:
    function: str = drive.function.type
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
        return [force.type, " - ".join(map(str, pair))]
    coordinate = getattr(force, "coordinate", None)
    return [force.type, f"{joint}, {coordinate}" if coordinate else joint]


def _event(event: Event) -> list[str]:
    how = "" if event.direction == "both" else f", {event.direction}"
    count = "" if event.count is None else f", count {event.count}"
    return [f"{event.quantity} = {event.value:g}{how}", event.action + count]


def _vector(vector: tuple[float, ...]) -> str:
    return " ".join(f"{component:g}" for component in vector)
