"""The state that a scene states, and rotations over full turns at the start.

Bodies whose frames joints or drives prescribe get the coordinates that these give.

Initial orientations: the intended one of the positions in which axes are aligned.

Orientation constraints require axes to be perpendicular, which also holds when a body
is turned upside down. Before the assembly, bodies far from the orientation that a joint
requires are rotated to it; after it the result is checked.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.scene import (
    Initial,
    SceneFile,
    as_3d,
    driven_coordinate,
    marker_names,
    marker_reference,
    orientation_matrix,
    rotation_matrix,
)

from ..dynamics.drives import function_value
from ..integrators import loop_state, projection
from ..spatial import system_arrays as at
from ..spatial.system_arrays import IntTable, WorkArrays
from ..system import work_arrays
from ..system.body_data import BodyData
from ..system.force_rows import ForceRow
from ..system.joints import is_point_mass_joint, joint_primitives
from ..system.rotated_markers import (
    rotation_vector,
    shortest_rotation,
    to_rotation_matrices,
)
from ..system.sid_packing import nearest_rotation, quaternion
from ..system.system import System
from ..system.work_arrays import new_work_arrays

#: Rotations that differ by less from the expected ones are those nearest to them [rad].
_MOST_OF_HALF_A_TURN = 3.0

FULL_TURN = 2.0 * np.pi
#: Whole turns from marker to marker, rows of the marker table [rad].
Pairs = dict[tuple[int, int], float]
#: Bodies are turned beforehand when they are off by more than this angle [rad].
LARGE_MISALIGNMENT = 1.0


def place_prescribed_bodies(system: System, z: Array, v: Array) -> None:
    """Gives bodies with prescribed frames the coordinates that their joints prescribe
    at the start.

    The assembly then leaves them alone, and a scene with all of its joints starts where
    the one without them does.
    """
    if system.prescribed_body_table is None:
        return
    work = new_work_arrays(system)
    work.interval_time[0] = 0.5 * (system.scene.time.start + system.breaks[0])
    work_arrays.evaluate(
        prescribing_system(system), work, system.scene.time.start, z, v
    )
    for b in prescribed_rows(system.prescribed_body_table):
        set_prescribed_frame(system, b, work.frame[b], z, v)


def prescribing_system(system: System) -> System:
    """The system in which frames that joints prescribe have no coordinates."""
    if system.prescribed_body_table is None:
        return system
    return replace(
        system, arrays=system.arrays.replaced(body=system.prescribed_body_table)
    )


def prescribed_rows(body: IntTable) -> list[int]:
    """Rows of the bodies whose frames a body table prescribes."""
    motion = body[:, at.MOTION]
    return [int(b) for b in np.flatnonzero((motion != at.FREE) & (motion != at.GROUND))]


def set_prescribed_frame(
    system: System, b: int, frame: Array, z: Array, v: Array
) -> None:
    """Writes a frame (.) into the coordinates of its body, or frames (nt, .)."""
    row = system.arrays.body[b]
    p, u, rigid = row[at.POS], row[at.VEL], row[at.RD]
    of = system.frames(frame)
    if system.planar:
        orientation = np.asarray(of["angle"])[..., None]
    else:
        orientation = quaternion(to_rotation_matrices(of["R"]))
    position = np.concatenate([of["x"], orientation], axis=-1)
    velocity = np.concatenate([of["v"], of["w"]], axis=-1)
    count = row[at.NP] - row[at.NQ]
    z[..., p : p + count] = position[..., :count]
    v[..., u : u + rigid] = velocity[..., :rigid]


def initial_rotations(system: System) -> Array:
    """What counted rotations are nearest to at the start, (n_turns,) [rad]."""
    t, angles = system.scene.time.start, []
    clock = 0.5 * (t + system.breaks[0])
    for counted_rotation in system.rotations:
        rest_angle = counted_rotation.rest
        if counted_rotation.drive >= 0:
            rest_angle = function_value.py_func(
                system.arrays, counted_rotation.drive, clock, t
            )[0]
        counted = system.scene.initial.rotations or {}
        angles += [counted.get(name, rest_angle) for name in counted_rotation.angles]
    return np.array(angles[: system.n_rotation_counters])


def whole_turns(system: System, z: Array) -> dict[str, float]:
    """Counted rotations at some positions that the start would take for others, by
    name [rad]: those more than half a turn from what they are nearest to."""
    expected, found = initial_rotations(system), dict[str, float]()
    known = z[len(z) - system.n_rotation_counters :]
    for rotation in system.rotations:
        if not rotation.is_counted:
            continue
        part = slice(rotation.entry, rotation.entry + len(rotation.angles))
        if np.linalg.norm(known[part] - expected[part]) > _MOST_OF_HALF_A_TURN:
            found |= zip(rotation.angles, map(float, known[part]), strict=True)
    return found


def store_rotations(system: System, work: WorkArrays, z: Array) -> None:
    """Stores in z how far its markers turned, as evaluated last."""
    z[len(z) - system.n_rotation_counters :] = work.rotation_counter[
        : system.n_rotation_counters, at.ROTATION_VALUE
    ]


def lost_rotation(
    system: System, work: WorkArrays, control: loop_state.StepLoopState
) -> Diagnostic | None:
    """Why rotations of the last step could not be counted (N315, N318), if so."""
    fixed = control.fixed_step == 1
    n, h = system.n_rotation_counters, control.step if fixed else 0.0
    known, evaluated = control.z[len(control.z) - n :], work.rotation_counter[:n]
    change = abs(evaluated[:, at.ROTATION_VALUE] - known)
    change = np.maximum(change, h * abs(evaluated[:, at.ROTATION_RATE]))
    for counted_rotation in system.rotations:
        part = slice(
            counted_rotation.entry,
            counted_rotation.entry + len(counted_rotation.angles),
        )
        if (
            not counted_rotation.is_counted
            or not change[part].max() > projection.MAX_ROTATION_PER_STEP
        ):
            continue
        name = counted_rotation.name.split(".")[0]
        if (
            np.linalg.norm(known[part]) > np.pi
            and counted_rotation.kind == at.ROTATION_VECTOR_MEASURE
        ):
            return diagnose("N315", name, t=control.time)
        limit = projection.MAX_ROTATION_PER_STEP
        return diagnose("N318", name, t=control.time, limit=limit)
    return None


@dataclass(frozen=True, eq=False)
class StateVectors:
    """A consistent state: z_I and z_II."""

    z: Array
    v: Array


def initial_estimate(system: System) -> StateVectors:
    """The state that the scene file states.

    Raises
    ------
    InputError
        Wrong number of elastic coordinates.
    """
    z, v = np.zeros(system.n_positions), np.zeros(system.n_velocities)
    for row, data in zip(system.arrays.body.tolist(), system.bodies, strict=True):
        if not data.is_scene_body:
            v[row[at.VEL] : row[at.VEL] + row[at.NV]] = data.initial_state
            continue
        initial = system.scene.initial_of(data.name)
        rigid = row[at.NP] - row[at.NQ]
        p, u = row[at.POS], row[at.VEL]
        if row[at.RD] > 0:
            axes = 2 if system.planar else 3
            z[p : p + axes] = initial.position or 0.0
            v[u : u + axes] = _in_frame(initial, initial.velocity)[:axes]
            if system.planar and rigid == 3:
                z[p + 2] = initial.angle or 0.0
                v[u + 2] = float(np.ravel(initial.angular_velocity or 0.0)[-1])
            elif rigid == 7:
                z[p + 3 : p + 7] = _quaternion(system, data.name)
                v[u + 3 : u + 6] = _in_frame(initial, initial.angular_velocity)
        z[p + rigid : p + row[at.NP]] = _elastic_values(initial, "elastic", data)
        v[u + row[at.RD] : u + row[at.NV]] = _elastic_values(
            initial, "elastic_velocity", data
        )
    place_prescribed_bodies(system, z, v)
    z[len(z) - system.n_rotation_counters :] = initial_rotations(system)
    return StateVectors(z, v)


def is_velocity_specified(system: System) -> Array:
    """True for the velocity coordinates that the scene file states, (n,).

    A body of which it states any has elastic velocities of zero unless it says others.
    """
    is_specified = np.zeros(system.n_velocities, bool)
    for row, data in zip(system.arrays.body.tolist(), system.bodies, strict=True):
        if not data.is_scene_body:
            continue
        initial = system.scene.initial_of(data.name)
        u, axes = row[at.VEL], 2 if system.planar else 3
        rotation_end, elastic = u + min(axes, row[at.RD]), u + row[at.RD]
        is_specified[u:rotation_end] = initial.velocity is not None
        is_specified[rotation_end:elastic] = initial.angular_velocity is not None
        given = getattr(initial, "elastic_velocity", None)
        has_velocity = is_specified[u:elastic].any() or given is not None
        is_specified[elastic : u + row[at.NV]] = has_velocity
    return is_specified


def _quaternion(system: System, body: str) -> Array:
    """The orientation of a body; of a result with its sign, which
    `direction_constraints` counts.
    """
    initial = system.scene.initial_of(body)
    if initial is system.scene.bodies[body].initial or initial.quaternion is None:
        return quaternion(orientation_matrix(initial))
    given = np.array(initial.quaternion)
    return given / np.linalg.norm(given)


def _in_frame(initial: Initial, value: Any) -> Array:
    """Inertial components, as files hold them, in the body frame, (3,)."""
    return (
        np.zeros(3) if value is None else orientation_matrix(initial).T @ as_3d(value)
    )


def _elastic_values(initial: Initial, key: str, data: BodyData) -> Array | float:
    values = getattr(initial, key, None)
    if values is None:
        return 0.0
    if len(values) != data.sid.nq:
        raise InputError(
            f"has {len(values)} values",
            place=f"bodies.{data.name}.initial.{key}",
            expected=f"{data.sid.nq}, one for each elastic coordinate of the SID",
        )
    return np.array(values)


def with_full_turns(system: System, work: WorkArrays) -> System:
    """A planar system whose joints and drives start in the turns of the scene.

    Parameters
    ----------
    work
        Of the system, to evaluate it.
    """
    if not system.planar:
        return system
    work.interval_time[0] = 0.5 * (system.scene.time.start + system.breaks[0])
    system, pairs = _frame_turns(system, work)
    system, more = _constraint_turns(system, work)
    pairs |= more
    entries = {}
    for con in system.arrays.constraint:
        if con[at.KIND] == at.COUPLED_ANGLE:
            ends = int(con[at.MARKER_A]), int(con[at.MARKER_B])
            entries[int(con[at.C_DATA])] = _turns_between(pairs, *ends)
    twists = [*system.forces, *system.coordinates.values()]
    if all(element.kind != at.ANGLE_MEASURE for element in twists):
        return _with_real_data(system, entries)
    known = {
        key: _with_counted_turns(system, pairs, element)
        for key, element in system.coordinates.items()
    }
    forces = tuple(
        _with_counted_turns(system, pairs, element) for element in system.forces
    )
    rows = np.concatenate([system.arrays.force, system.measures])
    for row, element in zip(rows, [*forces, *known.values()], strict=True):
        if element.kind == at.ANGLE_MEASURE:
            entries[int(row[at.F_DATA])] = element.data[0]
    system = _with_real_data(system, entries)
    return replace(system, forces=forces, coordinates=known)


def _with_real_data(system: System, numbers: Mapping[int, float]) -> System:
    """The system with other numbers at some places of its real data, itself where they
    are there already.
    """
    real_data = system.arrays.real_data
    if all(real_data[place] == number for place, number in numbers.items()):
        return system
    real_data = real_data.copy()
    real_data[list(numbers)] = list(numbers.values())
    return replace(system, arrays=system.arrays.replaced(real_data=real_data))


def _frame_turns(system: System, work: WorkArrays) -> tuple[System, Pairs]:
    """Keeps bodies with prescribed frames in their turns, each after its base."""
    prescribing, pairs = prescribing_system(system), Pairs()
    start, z = system.scene.time.start, np.zeros(system.n_positions)
    body = prescribing.arrays.body
    for b in prescribed_rows(body):
        work_arrays.evaluate(prescribing, work, start, z, np.zeros(system.n_velocities))
        specified = system.scene.initial_of(system.bodies[b].name).angle or 0.0
        entry = int(body[b, at.FRAME]) + 1
        angle = float(system.frames(work.frame[b])["angle"])
        turns = float(system.arrays.real_data[entry]) + _full_turns(specified - angle)
        system = _with_real_data(system, {entry: turns})
        prescribing = prescribing_system(system)
        pairs[int(body[b, at.BASE]), int(body[b, at.TIP])] = turns
    return system, pairs


def _constraint_turns(system: System, work: WorkArrays) -> tuple[System, Pairs]:
    """Lets angles that are held or driven count from the turns of the start."""
    angle_constraints = [
        con for con in system.arrays.constraint if con[at.KIND] == at.ANGLE
    ]
    if not angle_constraints:
        return system, {}
    start, numbers, pairs = initial_estimate(system), {}, Pairs()
    work_arrays.evaluate(system, work, system.scene.time.start, start.z, start.v)
    for con in angle_constraints:
        place, value = int(con[at.C_DATA]), work.row[con[at.ROW], at.C_VALUE]
        numbers[place] = float(system.arrays.real_data[place]) + _full_turns(value)
        ends = int(con[at.MARKER_A]), int(con[at.MARKER_B])
        pairs[ends] = numbers[place]
    return _with_real_data(system, numbers), pairs


def _full_turns(angle: float) -> float:
    return FULL_TURN * float(np.round(angle / FULL_TURN))


def _with_counted_turns(system: System, pairs: Pairs, element: ForceRow) -> ForceRow:
    """The element with the turns from which its angle counts."""
    if element.kind != at.ANGLE_MEASURE:
        return element
    assert element.a is not None
    ends = system.markers[element.a], system.markers[element.b]
    return replace(element, data=(_turns_between(pairs, *ends), *element.data[1:]))


def _turns_between(pairs: Pairs, a: int, b: int) -> float:
    return pairs[a, b] if (a, b) in pairs else -pairs.get((b, a), 0.0)


@dataclass(frozen=True)
class _OrientationGoal:
    """What a joint wants of the orientation Q of its second marker in the first.

    Attributes
    ----------
    orientation
        Q itself, or None when it is wanted only that.
    source, target
        Q takes one direction to the other.
    angle
        Wanted rotation about them, if it is driven and they are the same.
    """

    name: str
    a: tuple[str, str]
    b: tuple[str, str]
    orientation: Array | None = None
    source: Array = field(default_factory=lambda: np.zeros(3))
    target: Array = field(default_factory=lambda: np.zeros(3))
    angle: float | None = None

    def correction(self, Q: Array) -> Array:
        """The rotation C, in the frame of the first marker, for which C Q is right."""
        if self.orientation is not None:
            return self.orientation @ Q.T
        rotation = shortest_rotation(Q @ self.source, self.target)
        if self.angle is None:
            return rotation
        now = rotation_vector(rotation @ Q) @ self.target
        remaining = (self.angle - now + np.pi) % (2.0 * np.pi) - np.pi
        return rotation_matrix(remaining * self.target) @ rotation


def align_bodies(system: System, work: WorkArrays, z: Array) -> None:
    """Turns bodies of a spatial guess to their joints, where they are far away.

    `work` holds the frames of that guess. Each body is turned once, after those that
    lie between it and the ground.
    """
    if system.planar:
        return
    frames = {
        body.name: to_rotation_matrices(system.frames(work.frame[b])["R"])
        for b, body in enumerate(system.bodies)
    }
    known = {
        system.bodies[0].name,
        *system.eliminated.values(),
        *_fixed_bodies(system.scene),
    }
    goals = list(_orientation_goals(system))
    while goals:
        ready = [w for w in goals if w.a[0] in known or w.b[0] in known]
        goal = ready[0] if ready else goals[0]
        if not ready:
            known.add(goal.a[0])
        rotated = goal.b[0] if goal.b[0] not in known else goal.a[0]
        if rotated not in known:
            _rotate_body(system, z, frames, goal, rotated)
        known |= {goal.a[0], goal.b[0]}
        goals.remove(goal)


def check_alignment(system: System, work: WorkArrays) -> None:
    """Raises joints that were assembled the wrong way round.

    Raises
    ------
    InputError
        Names the joint and the angle by which it is off.
    """
    if system.planar:
        return
    for goal in _orientation_goals(system):
        if goal.a not in system.markers or goal.b not in system.markers:
            continue
        A, B = (
            to_rotation_matrices(system.points(work.point[system.markers[m]])["R"])
            for m in (goal.a, goal.b)
        )
        off = float(np.linalg.norm(rotation_vector(goal.correction(A.T @ B))))
        if off > LARGE_MISALIGNMENT:
            raise InputError(
                f"the start is assembled with {goal.name} turned by {off:.3g} rad",
                place="bodies.*.initial",
                expected="initial orientations nearer to what the joints want",
            )


def _orientation_goals(system: System) -> Iterator[_OrientationGoal]:
    """Joints that want an orientation, and are not carried by a prescribed frame; and
    driven rotations."""
    scene = system.scene
    for name, drive in scene.drives.items():
        if drive.axis is not None and drive.marker is not None:
            a, b = marker_reference(drive.reference), marker_reference(drive.marker)
            axis = np.array(drive.axis) / np.linalg.norm(drive.axis)
            angle = _driven_value(system, name)
            yield _OrientationGoal(name, a, b, source=axis, target=axis, angle=angle)
    for name, joint in scene.joints.items():
        texts = marker_names(joint)
        if not texts or name in system.eliminated:
            continue
        if is_point_mass_joint(joint, {data.name: data for data in system.bodies}):
            continue
        constraints = joint_primitives(joint, system.planar).constraints
        perpendicular = [p for p in constraints if p.kind == at.PERPENDICULAR]
        a, b = (marker_reference(text) for text in texts)
        driven = _driven_angles(system, name)
        if len(perpendicular) == 3:
            yield _OrientationGoal(name, a, b, orientation=np.eye(3))
        elif len(perpendicular) == 2:
            axis = np.array(perpendicular[0].data[3:])
            yield _OrientationGoal(
                name, a, b, source=axis, target=axis, angle=driven.get("angle")
            )
        elif perpendicular and driven:
            first, second = np.reshape(perpendicular[0].data, (2, 3))
            yield _OrientationGoal(
                name, a, b, **_universal_joint_goal(first, second, driven)
            )


def _universal_joint_goal(
    first: Array, second: Array, angles: dict[str, float]
) -> dict[str, Any]:
    """What a universal joint wants with one or both of its angles driven."""
    inner = rotation_matrix(angles.get("angle_1", 0.0) * first)
    outer = rotation_matrix(angles.get("angle_2", 0.0) * second)
    if len(angles) == 2:
        return {"orientation": inner @ outer}
    if "angle_1" in angles:
        return {"source": second, "target": inner @ second}
    return {"source": outer.T @ first, "target": first}


def _driven_angles(system: System, joint: str) -> dict[str, float]:
    """Driven angles of a joint at the start."""
    scene, angles = system.scene, {}
    for name, drive in scene.drives.items():
        if drive.joint != joint:
            continue
        coordinate = driven_coordinate(drive, scene.joints)
        if coordinate.startswith("angle"):
            angles[coordinate] = _driven_value(system, name)
    return angles


def _driven_value(system: System, drive: str) -> float:
    """The function of a drive at the start."""
    row, start = list(system.scene.drives).index(drive), system.scene.time.start
    clock = 0.5 * (start + system.breaks[0])
    return float(function_value.py_func(system.arrays, row, clock, start)[0])


def _fixed_bodies(scene: SceneFile) -> set[str]:
    return {name for name, body in scene.bodies.items() if body.initial.fixed}


def _rotate_body(
    system: System,
    z: Array,
    frames: dict[str, Array],
    goal: _OrientationGoal,
    body: str,
) -> None:
    """Turns one of the two bodies if it is far from what the joint wants."""
    first, second = (
        nearest_rotation(system.bodies[system.index(name)].node(marker).AP.m0)
        for name, marker in (goal.a, goal.b)
    )
    A, B = frames[goal.a[0]] @ first, frames[goal.b[0]] @ second
    correction = goal.correction(A.T @ B)
    row = system.arrays.body[system.index(body)]
    if (
        np.linalg.norm(rotation_vector(correction)) < LARGE_MISALIGNMENT
        or row[at.RD] != 6
    ):
        return
    Q = correction @ A.T @ B
    rotated = A @ Q @ second.T if body == goal.b[0] else B @ Q.T @ first.T
    frames[body] = rotated
    p = row[at.POS] + 3
    z[p : p + 4] = quaternion(rotated)
