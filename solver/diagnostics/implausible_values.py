"""Values of a scene that are hardly intended: angles, sizes, friction, gains."""

from collections.abc import Iterator

import numpy as np

from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.plausibility import body_warnings, first_frequency
from sidtool.formats.scene import (
    Actuator,
    Pid,
    Polynomial,
    RigidBody,
    SceneFile,
    SmoothStep,
    SpringDamper,
    driven_coordinate,
    marker_names,
    marker_reference,
    orientation_matrix,
)
from sidtool.formats.sid_mass import central_inertia

from ..system.system import System
from .body_extents import body_extent, is_dense, marker_extent, mechanism_extent
from .excitation import ANGLES, drive_history, fastest_rotation
from .implausible_forces import frequency_warnings, stiffness_warnings

#: What readers of SIDs guessed, and a motion depends on.
_GUESSES_OF_READERS = frozenset({"N841", "N842"})
#: No pair of materials rubs as much.
_MAX_FRICTION = 3.0
#: A pin thicker than this many times the mechanism.
_MAX_PIN_RADIUS = 1.0
#: Outputs that are lengths, and how many times the mechanism they hardly are.
_LENGTH_OUTPUTS, _MAX_LENGTH_RATIO = (
    (".displacement", ".length", ".x", ".y", ".z"),
    50.0,
)


def implausible_friction_warnings(system: System) -> Iterator[Diagnostic]:
    """Friction, gains and lengths (N213, N214, N216)."""
    size = mechanism_extent(system)
    for name, joint in system.scene.joints.items():
        friction = getattr(joint, "friction", None)
        if friction is None:
            continue
        largest = max(friction.coefficient, friction.static or 0.0)
        if largest > _MAX_FRICTION:
            yield diagnose("N213", name, coefficient=largest)
        if (friction.radius or 0.0) > _MAX_PIN_RADIUS * size:
            yield diagnose(
                "N214", name, quantity="pin radius", value=friction.radius, size=size
            )
    yield from _gain_warnings(system.scene)
    yield from _length_warnings(system, size)


def controllers(scene: SceneFile) -> Iterator[tuple[str, Pid]]:
    """Forces and drives that a controller decides, by their names."""
    for name, owner in (*scene.forces.items(), *scene.drives.items()):
        law = getattr(owner, "function", None)
        if isinstance(law, Pid):
            yield name, law


def _length_warnings(system: System, size: float) -> Iterator[Diagnostic]:
    """What is to be reached far beyond the mechanism."""
    lengths = []
    for name, law in controllers(system.scene):
        if law.measured.endswith(_LENGTH_OUTPUTS) and isinstance(law.reference, float):
            lengths.append((name, "reference", law.reference))
    for name, force in system.scene.forces.items():
        if isinstance(force, SpringDamper) and force.markers is not None:
            lengths.append((name, "rest length", force.rest))
    for name, quantity, length in lengths:
        if abs(length) > _MAX_LENGTH_RATIO * size > 0.0:
            yield diagnose("N214", name, quantity=quantity, value=length, size=size)


def _gain_warnings(scene: SceneFile) -> Iterator[Diagnostic]:
    """Controllers that drive their own joint away from what they are to hold."""
    for name, force in scene.forces.items():
        law = getattr(force, "function", None)
        if not isinstance(force, Actuator) or not isinstance(law, Pid):
            continue
        if force.joint is None or law.measured.partition(".")[0] != force.joint:
            continue
        for key in ("p", "d"):
            gain = getattr(law, key)
            if gain < 0.0:
                yield diagnose("N216", name, key=key, gain=gain, output=law.measured)


#: Stronger than gravity on any planet or in a lift [m/s2].
_MAX_GRAVITY = 100.0
#: Whole multiples of these [deg], more than a turn in radians, may be degrees.
_DEGREE_STEPS, _FULL_TURN = (30.0, 45.0), 2.0 * np.pi
#: Bodies that a joint holds together may differ by as much in size.
_SIZE_RATIO = 100.0
#: Radii of gyration larger by as much than the body, and speeds [m/s], are no ordinary
#: ones.
_GYRATION_RATIO, _MAX_SPEED = 30.0, 2000.0
#: What the sum of two moments of inertia may lack by rounding.
_INERTIA_ROUNDING = 1e-6
#: A run of a smaller part of the longest period shows no vibration.
_SHORT_RUN = 0.01


def implausible_value_warnings(system: System) -> Iterator[Diagnostic]:
    """Values of a scene that are hardly intended (N103 to N107, N201 to N216)."""
    scene = system.scene
    gravity = float(np.linalg.norm(scene.gravity or 0.0))
    if gravity > _MAX_GRAVITY:
        yield diagnose("N201", gravity=gravity, ratio=gravity / 9.81)
    for data in system.bodies:
        if data.is_scene_body and data.sid.nq:
            for warning in body_warnings(data.sid, gravity or None):
                yield warning.within(data.name)
            for guess in data.sid.diagnostics:
                if guess.code in _GUESSES_OF_READERS:
                    yield guess.within(data.name)
    yield from _angle_warnings(system)
    yield from _size_warnings(system)
    yield from _inertia_warnings(system)
    yield from _force_warnings(system)
    yield from implausible_friction_warnings(system)
    yield from stiffness_warnings(system)
    yield from frequency_warnings(system)
    yield from _time_span_warnings(system)
    rate, drive = fastest_rotation(system, system.cached(drive_history))
    if rate * system.length > _MAX_SPEED:
        yield diagnose(
            "N209",
            drive,
            rate=rate,
            size=system.length,
            speed=rate * system.length,
            radians=rate * np.pi / 30,
        )
    else:
        yield from _initial_speed_warnings(system)


def _initial_speed_warnings(system: System) -> Iterator[Diagnostic]:
    """Bodies whose nodes start to move faster around them than any part does (N209).

    A SID does not hold the speed of waves, and one without shape functions along the
    body shows no strain from its rotation. Steel of 2000 m/s at the tip is strained by
    7 % at the hub.
    """
    for name in system.scene.bodies:
        initial = system.scene.initial_of(name)
        if initial.angular_velocity is None:
            continue
        rates = np.ravel(initial.angular_velocity)
        rates = rates if len(rates) == 3 else np.array([0.0, 0.0, rates[0]])
        w = orientation_matrix(initial).T @ rates
        nodes = system.bodies[system.index(name)].sid.nodes
        speeds = [float(np.linalg.norm(np.cross(w, n.position))) for n in nodes]
        if max(speeds, default=0.0) > _MAX_SPEED:
            rate, speed = float(np.linalg.norm(w)), max(speeds)
            yield diagnose(
                "N209",
                name,
                rate=rate,
                size=speed / rate,
                speed=speed,
                radians=rate * np.pi / 30,
            )


def _angle_warnings(system: System) -> Iterator[Diagnostic]:
    """Angles in radians that look like degrees."""
    scene = system.scene
    for name, body in scene.bodies.items():
        yield from _angle_warning(f"bodies.{name}.initial.angle", body.initial.angle)
    for name, drive in scene.drives.items():
        function = drive.function
        if not driven_coordinate(drive, scene.joints).startswith(ANGLES):
            continue
        ends: list[float] = []
        if drive.of != "value":
            ends = [drive.start]
        elif isinstance(function, SmoothStep):
            ends = [function.start, function.end]
        elif isinstance(function, Polynomial):
            ends = [piece.end[0] for piece in function.pieces if piece.end]
            ends += [p.coefficients[0] for p in function.pieces if p.coefficients]
        for value in ends:
            yield from _angle_warning(f"drives.{name}", value)
    for name, law in controllers(scene):
        if law.measured.endswith(".angle") and isinstance(law.reference, float):
            yield from _angle_warning(f"reference of {name}", law.reference)


def _angle_warning(what: str, value: float | None) -> Iterator[Diagnostic]:
    if value is None or abs(value) <= _FULL_TURN:
        return
    if any(value % degrees == 0.0 for degrees in _DEGREE_STEPS):
        yield diagnose("N202", what, value=value, radians=float(np.radians(value)))


def _size_warnings(system: System) -> Iterator[Diagnostic]:
    """Bodies that are joined to much smaller ones."""
    sizes = {data.name: body_extent(system, data.name) for data in system.bodies[1:]}
    reported: set[str] = set()
    for name, joint in system.scene.joints.items():
        pair = [marker_reference(text)[0] for text in marker_names(joint)]
        known = sorted((sizes[n], n) for n in pair if sizes.get(n, 0.0) > 0.0)
        if len(known) == 2 and known[1][0] >= _SIZE_RATIO * known[0][0]:
            (small, one), (large, other) = known
            if not reported & {one, other}:
                yield diagnose(
                    "N203", other, size=large, joint=name, other=one, other_size=small
                )
            reported |= {one, other}


def _inertia_warnings(system: System) -> Iterator[Diagnostic]:
    """Rigid bodies whose mass would lie far outside them."""
    for name, body in system.scene.bodies.items():
        if not isinstance(body, RigidBody) or body.inertia is None:
            continue
        sid = system.bodies[system.index(name)].sid
        moments = np.linalg.eigvalsh(central_inertia(sid))
        if (
            not system.planar
            and moments[2] > (1.0 + _INERTIA_ROUNDING) * moments[:2].sum()
        ):
            yield diagnose("N204", name, moments=moments.tolist())
        radius = float(np.sqrt(moments[2] / body.mass))
        extent = marker_extent(sid)
        far = extent > 0.0 and radius > _GYRATION_RATIO * extent
        if far and not is_dense(sid, radius):
            yield diagnose("N205", name, radius=radius, extent=extent)


def _force_warnings(system: System) -> Iterator[Diagnostic]:
    """Springs and dampers that push, and those that can do nothing."""
    for name, force in system.scene.forces.items():
        for key in ("stiffness", "damping"):
            values = np.ravel(getattr(force, key, None) or 0.0)
            if values[0] < 0.0:
                yield diagnose("N206", name, key=key, value=float(values[0]))
        pair = getattr(force, "markers", None)
        ends = {marker_reference(text)[0] for text in pair or ()}
        rigid = [n for n in ends if not system.bodies[system.index(n)].sid.nq]
        if len(ends) == 1 and rigid:
            yield diagnose("N207", name, body=rigid[0])


def _time_span_warnings(system: System) -> Iterator[Diagnostic]:
    """A run that ends before anything can vibrate."""
    time = system.scene.time
    periods = {
        data.name: (time.end - time.start) * first_frequency(data.sid)
        for data in system.bodies
        if data.sid.nq
    }
    if periods and 0.0 < max(periods.values()) < _SHORT_RUN:
        name = max(periods, key=lambda body: periods[body])
        yield diagnose("N208", name, span=time.end - time.start, periods=periods[name])
