"""Values of a scene that are hardly intended: angles, sizes, friction, gains.

Springs and dampers with implausible stiffness, and bodies that run away.

Springs are compared with solids of the size of the mechanism, and with what a run can
integrate in a short time.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.plausibility import body_warnings, first_frequency
from sidtool.formats.scene import (
    Actuator,
    Pid,
    PointForce,
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
from sidtool.formats.sid_mass import central_inertia, centre_of_mass

from ..spatial import system_arrays as at
from ..system import work_arrays
from ..system.characteristic_sizes import body_extents
from ..system.force_rows import ForcePolynomials, ForceRow
from ..system.rotated_markers import to_3d, to_rotation_matrices
from ..system.system import System
from ..system.work_arrays import new_work_arrays
from .excitation import ANGLES, drive_history, fastest_rotation
from .light_links import body_extent, is_dense, marker_extent, mechanism_extent

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
#: Of steel [Pa], and faster than sound in any solid [m/s].
_STEEL_MODULUS, _MAX_WAVE_SPEED = 2.1e11, 2e4
#: Dampers stop the whole mechanism so many times faster than sound crosses it.
_MAX_DAMPING_RATE = 10.0
#: Vibrations of a spring that a run follows for minutes, and steps for each of them.
_MAX_PERIODS, _STEPS_PER_PERIOD = 1e5, 10.0
#: Measures that are angles.
ANGULAR_MEASURES = (
    at.ANGLE_MEASURE,
    at.ROTATION_VECTOR_MEASURE,
    at.DIRECTION_COSINE_MEASURE,
)
#: A spring lets go what it lets turn by more than a turn, and would let turn by more
#: than this under a steady load [rad].
_MAX_WINDING = 50.0


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


def stiffness_warnings(system: System) -> Iterator[Diagnostic]:
    """Springs and dampers whose physics shows a slip of units (N210, N211).

    A spring is stiffer than a solid block of steel of the size of the mechanism, and
    would swing the whole mechanism faster than sound crosses it: both.
    """
    size = mechanism_extent(system)
    mass = sum(data.sid.mass for data in system.bodies if data.is_scene_body)
    for element in system.forces:
        if not element.is_force or element.kind == at.COMBINED_MEASURE:
            continue
        is_rotation = element.kind in ANGULAR_MEASURES
        block = _STEEL_MODULUS * (size**3 if is_rotation else size)
        inertia = mass * (size**2 if is_rotation else 1.0)
        fastest = 2.0 * np.pi * _MAX_WAVE_SPEED / size
        spring, damper = (
            linear_coefficient(element.law.stiffness),
            linear_coefficient(element.law.damping),
        )
        unit = " m/rad" if is_rotation else "/m"
        if spring > max(block, inertia * fastest**2) and inertia > 0.0:
            yield diagnose(
                "N210",
                element.name,
                stiffness=spring,
                unit=f"N{unit}",
                ratio=spring / block,
                size=size,
            )
        if damper > _MAX_DAMPING_RATE * inertia * fastest and inertia > 0.0:
            yield diagnose(
                "N211",
                element.name,
                damping=damper,
                unit=_rate_unit(element),
                mass=mass,
                time=inertia / damper,
            )


def frequency_warnings(system: System) -> Iterator[Diagnostic]:
    """Springs whose vibration would make a run long (N212).

    Counted with the mass of all bodies, which is more than the spring moves, and, where
    it is damped, as long as it rings.
    """
    mass = sum(data.sid.mass for data in system.bodies if data.is_scene_body)
    time = system.scene.time
    for element in system.forces:
        spring = linear_coefficient(element.law.stiffness)
        if (
            not element.is_force
            or element.kind in (*ANGULAR_MEASURES, at.COMBINED_MEASURE)
            or min(spring, mass) <= 0.0
        ):
            continue
        omega = np.sqrt(spring / mass)
        periods = omega * (time.end - time.start) / (2.0 * np.pi)
        damping = linear_coefficient(element.law.damping)
        if damping > 0.0:
            periods = min(periods, np.sqrt(spring * mass) / damping)
        if periods > _MAX_PERIODS:
            yield diagnose(
                "N212",
                element.name,
                frequency=omega / (2.0 * np.pi),
                mass=mass,
                periods=periods,
                steps=_STEPS_PER_PERIOD * periods,
            )


def _rate_unit(element: ForceRow) -> str:
    return "N m s/rad" if element.kind in ANGULAR_MEASURES else "N s/m"


def linear_coefficient(curve: ForcePolynomials) -> float:
    """The coefficient of the first power; 0 of tables."""
    is_single_polynomial = len(curve.starts) == 1 and curve.terms.shape[1] > 1
    return float(curve.terms[0, 1]) if is_single_polynomial else 0.0


@dataclass(frozen=True, eq=False)
class _Configuration:
    """Markers and body frames, inertial: (n, 3), R (n, 3, 3)."""

    x: Array
    v: Array
    w: Array
    R: Array
    angle: Array
    frame_v: Array
    frame_w: Array
    frame_x: Array
    frame_R: Array


def runaway_warnings(
    system: System, times: tuple[float, float], z: Array, v: Array
) -> Iterator[Diagnostic]:
    """Springs that held nothing, and the body that became too fast (N217, N218).

    Parameters
    ----------
    times, z, v
        The start and the end of a run.
    """
    span = times[1] - times[0]
    if not span > 0.0 or not np.isfinite([*z[1], *v[1]]).all():
        return
    springs = [
        (k, e)
        for k, e in enumerate(system.forces)
        if e.is_force and linear_coefficient(e.law.stiffness)
    ]
    loads = [
        name
        for name, force in system.scene.forces.items()
        if isinstance(force, PointForce | Actuator)
    ]
    if not springs and not loads:
        return
    first, last = (
        _configuration(system, *now) for now in zip(times, z, v, strict=True)
    )
    for k, element in springs:
        yield from _weak_spring_warnings(system, k, element, first, last, span)
    if loads:
        yield from _excessive_speed_warnings(system, loads, first, last)


def _configuration(system: System, t: float, z: Array, v: Array) -> _Configuration:
    work = new_work_arrays(system)
    work_arrays.evaluate(system, work, t, z, v)
    point, frame = system.points(work.point), system.frames(work.frame)
    if system.planar:
        angle = np.asarray(point["angle"])
        R = to_rotation_matrices(np.column_stack([np.cos(angle), np.sin(angle)]))
    else:
        angle, R = np.zeros(len(point)), to_rotation_matrices(point["R"])
    return _Configuration(
        x=to_3d(point["x"]),
        v=to_3d(point["v"]),
        w=to_3d(point["w"]),
        R=R,
        angle=angle,
        frame_v=to_3d(frame["v"]),
        frame_w=to_3d(frame["w"]),
        frame_x=to_3d(frame["x"]),
        frame_R=to_rotation_matrices(frame["R"]),
    )


def _weak_spring_warnings(
    system: System,
    k: int,
    element: ForceRow,
    first: _Configuration,
    last: _Configuration,
    span: float,
) -> Iterator[Diagnostic]:
    """A spring that was stretched beyond the mechanism and pulled back next to nothing.

    The load that it met follows from the speed that it let the bodies gain, with the
    inertia that these have alone; what joints add to it makes the spring looser still.
    """
    stiffness = linear_coefficient(element.law.stiffness)
    row = system.arrays.force[k]
    a, b = int(row[at.F_A]), int(row[at.F_B])
    is_rotation = element.kind in ANGULAR_MEASURES
    axis, displacement, rate_change = _spring_motion(
        system, element, a, b, first, last, span
    )
    rest = 0.0 if is_rotation else abs(element.law.rest)
    size = mechanism_extent(system)
    limit = (
        _FULL_TURN if is_rotation else max(size, rest, _marker_distance_of(first, a, b))
    )
    inverse = sum(_mobility(system, m, axis, is_rotation, first) for m in (a, b))
    if not (stiffness > 0.0 and inverse > 0.0 and displacement > limit):
        return
    inertia = 1.0 / inverse
    sag = abs(rate_change) / span * inertia / stiffness
    period = _FULL_TURN * np.sqrt(inertia / stiffness)
    if period <= span or sag <= (_MAX_WINDING if is_rotation else limit):
        return
    unit, length_unit = ("N m/rad", "rad") if is_rotation else ("N/m", "m")
    yield diagnose(
        "N217",
        element.name,
        stiffness=stiffness,
        unit=unit,
        displacement=displacement,
        length_unit=length_unit,
        period=period,
        sag=sag,
    )


def _spring_motion(
    system: System,
    element: ForceRow,
    a: int,
    b: int,
    first: _Configuration,
    last: _Configuration,
    span: float,
) -> tuple[Array, float, float]:
    """The direction of a spring, how far it gave way, and the rate that this gained."""
    if element.kind in ANGULAR_MEASURES:
        spins = [now.w[b] - now.w[a] for now in (first, last)]
        rate_change = spins[1] - spins[0]
        size = float(np.linalg.norm(rate_change))
        axis = rate_change / size if size else np.array([0.0, 0.0, 1.0])
        rotation = 0.5 * span * size
        if system.planar:
            angles = [now.angle[b] - now.angle[a] for now in (first, last)]
            rotation = abs(float(angles[1] - angles[0]))
        return axis, rotation, size
    gaps = [now.x[b] - now.x[a] for now in (first, last)]
    rates = [now.v[b] - now.v[a] for now in (first, last)]
    if element.kind == at.DISTANCE_MEASURE:
        lengths = [float(np.linalg.norm(gap)) for gap in gaps]
        directions = [g / n if n else r / max(np.linalg.norm(r), 1e-300)
                for g, n, r in zip(gaps, lengths, rates, strict=True)]  # fmt: skip
    else:
        directions = [_sliding_axis(system, element, a, now) for now in (first, last)]
        lengths = [float(w @ g) for w, g in zip(directions, gaps, strict=True)]
    speeds = [float(w @ r) for w, r in zip(directions, rates, strict=True)]
    return directions[0], abs(lengths[1] - lengths[0]), speeds[1] - speeds[0]


def _sliding_axis(
    system: System, element: ForceRow, a: int, now: _Configuration
) -> Array:
    data = np.array(element.data[:3])
    if system.planar:
        data = np.array([np.cos(data[0]), np.sin(data[0]), 0.0])
    direction: Array = now.R[a] @ data
    return direction


def _marker_distance_of(now: _Configuration, a: int, b: int) -> float:
    return float(np.linalg.norm(now.x[b] - now.x[a]))


def _mobility(
    system: System, marker: int, axis: Array, is_rotation: bool, now: _Configuration
) -> float:
    """Acceleration of a marker under a unit load along or about an axis, of its body
    alone and rigid [1/kg, 1/(kg m2)]."""
    body = next(name for (name, _), m in system.markers.items() if m == marker)
    b = system.index(body)
    sid: SID = system.bodies[b].sid
    if not system.bodies[b].is_scene_body or not sid.mass:
        return 0.0
    R = now.frame_R[b]
    inertia = R @ central_inertia(sid) @ R.T
    if system.planar:
        inertia = np.diag([0.0, 0.0, inertia[2, 2]])
    arm = now.x[marker] - now.frame_x[b] - R @ centre_of_mass(sid)
    lever = axis if is_rotation else np.cross(arm, axis)
    rotational = float(lever @ np.linalg.pinv(inertia) @ lever)
    return rotational if is_rotation else 1.0 / sid.mass + rotational


def _excessive_speed_warnings(
    system: System, loads: list[str], first: _Configuration, last: _Configuration
) -> Iterator[Diagnostic]:
    """The body whose speed grew most, if no mechanism gains as much."""
    translational = np.linalg.norm(last.frame_v - first.frame_v, axis=1)
    rotational = np.linalg.norm(last.frame_w - first.frame_w, axis=1) * body_extents(
        system
    )
    speed_change = np.maximum(translational, rotational)
    b = int(speed_change.argmax())
    if speed_change[b] > _MAX_SPEED:
        name, speed = system.bodies[b].name, float(speed_change[b])
        yield diagnose("N218", name, speed=speed, loads=loads)
