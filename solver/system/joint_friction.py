"""Joints with friction: tables of the kernels and history of stick and slip.

The force F and the moment M of a joint on its second marker load one contact point,
or with ``length`` the two ends of a bearing. The load is a linear combination of the
constraint multipliers of the joint.

Rotations between markers in space, counted over full turns.

Two orientations do not determine full turns. Each rotation that something depends on is
a row of `SystemArrays.rotation_counter`. Where its angle is needed it is counted: the
angle is an entry at the end of z_I and is updated after every step to the nearest one
that the orientations allow.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import Joint, JointFriction, marker_names, marker_reference

from ..functions.function_table import RealData
from ..spatial import system_arrays as at
from ..spatial.system_arrays import IntTable
from .build_inputs import BuildInputs, MarkerKey
from .force_rows import ForceRow
from .joints import Constraint, Primitive, joint_primitives, normals, spatial_axis

Segment = tuple[int, int, int]

#: Joint and coordinate.
Coordinate = tuple[str, str]


@dataclass(frozen=True, eq=False)
class FrictionJoint:
    """A joint with friction.

    Attributes
    ----------
    weights : (contact points, 2, rows)
        How the constraint rows of the joint make the force across its axis at each
        place.
    rows
        Those constraint rows.
    """

    joint: str
    friction: JointFriction
    primitive: Primitive
    a: MarkerKey
    b: MarkerKey
    weights: Array
    rows: tuple[int, ...]
    arm: float
    period: float


def compile_friction_joints(
    parts: BuildInputs, constraints: list[Constraint], table: IntTable
) -> tuple[FrictionJoint, ...]:
    """All joints with friction.

    Parameters
    ----------
    constraints, table
        Those of the scene, in one order.
    """
    joints = []
    for name, joint in parts.scene.joints.items():
        friction = getattr(joint, "friction", None)
        if friction is None:
            continue
        rows: list[int] = []
        for constraint, row in zip(constraints, table, strict=True):
            if constraint.owner == name:
                point = constraint.primitive.kind == at.COINCIDENT
                rows += [int(row[at.ROW]) + k for k in range(2 if point else 1)]
        joints.append(_friction_joint(name, joint, friction, parts.planar, tuple(rows)))
    return tuple(joints)


def _friction_joint(
    name: str,
    joint: Joint,
    friction: JointFriction,
    planar: bool,
    rows: tuple[int, ...],
) -> FrictionJoint:
    a, b = (marker_reference(text) for text in marker_names(joint))
    is_rotation = joint.type == "revolute"
    part = joint_primitives(joint, planar).coordinates[joint.coordinates[0]]
    period = 2.0 * math.pi if is_rotation and not planar else 0.0
    kind = at.COUPLED_ANGLE if is_rotation else at.COUPLED_DISPLACEMENT
    primitive = Primitive(kind, (*part.data, 1.0, 0.0, 0.0, 1.0))
    force, moment = _transverse_weights(joint, planar)
    weights = [force]
    if friction.length is not None:
        ends = moment / friction.length
        weights = [0.5 * force + ends, 0.5 * force - ends]
    used = np.array(weights)
    count = used.shape[2]
    radius = friction.radius or 1.0
    return FrictionJoint(
        name, friction, primitive, a, b, used, rows[:count], radius, period
    )


def _transverse_weights(joint: Joint, planar: bool) -> tuple[Array, Array]:
    """Force F and M x axis across the axis of unit multipliers, (2, rows) each.

    Along two directions across the axis, of which the plane has one.
    """
    if planar and joint.type == "revolute":
        return np.eye(2), np.zeros((2, 2))
    if planar:
        moment = np.zeros((2, 2))
        moment[0, 1] = 1.0
        force = np.array([[1.0, 0.0], [0.0, 0.0]])
        count = 1 if joint.type == "point_on_line" else 2
        return force[:, :count], moment[:, :count]
    force = np.zeros((2, 5))
    force[0, 0] = force[1, 1] = 1.0
    moment = np.zeros((2, 5))
    axis = spatial_axis(joint)
    first, second = normals(axis)
    if joint.type == "point_on_line":
        return force[:, :2], moment[:, :2]
    if joint.type == "revolute":
        torques = {3: second, 4: -first}
    else:
        torques = dict(zip((2, 3, 4), -np.eye(3)[[2, 0, 1]], strict=True))
    for row, torque in torques.items():
        moment[0, row] = torque @ second
        moment[1, row] = -torque @ first
    return force, moment


def friction_tables(
    friction_joints: tuple[FrictionJoint, ...],
    markers: dict[MarkerKey, int],
    body: IntTable,
    marker: IntTable,
    offset: int,
    real_data: RealData,
) -> tuple[IntTable, IntTable, IntTable, int]:
    """Tables of friction, of the coordinates as constraints and of their segments.

    Last the offset behind the entries of the latter, which begin at `offset`.
    """
    friction = np.zeros((len(friction_joints), at.N_FRICTION), np.int64)
    table = np.zeros((len(friction_joints), at.N_CONSTRAINT), np.int64)
    segments: list[Segment] = []
    for j, friction_joint in enumerate(friction_joints):
        row, ends = table[j], (markers[friction_joint.a], markers[friction_joint.b])
        row[at.KIND], row[at.ROW] = friction_joint.primitive.kind, j
        row[[at.MARKER_A, at.MARKER_B]] = ends
        row[at.C_DATA] = real_data.add(friction_joint.primitive.data)
        row[[at.C_DRIVE, at.C_LAW]] = -1
        for column, m in zip((at.SEG_A, at.SEG_B), ends, strict=True):
            b = int(marker[m, at.M_BODY])
            row[column] = -1
            if body[b, at.NV] > 0:
                row[column] = len(segments)
                segments.append((j, b, offset))
                offset += int(body[b, at.NV])
        contacts, _, count = friction_joint.weights.shape
        law = friction_joint.friction
        static_coefficient = law.coefficient if law.static is None else law.static
        width = law.stribeck_velocity or 0.0
        numbers = (
            law.coefficient,
            static_coefficient,
            width,
            law.viscous,
            friction_joint.arm,
            friction_joint.period,
        )
        friction[j, at.R_LAW] = real_data.add(numbers)
        friction[j, at.R_LOAD] = real_data.add(tuple(friction_joint.weights.ravel()))
        friction[j, [at.R_CONTACTS, at.R_COUNT]] = contacts, count
        friction[j, at.R_ROWS : at.R_ROWS + count] = friction_joint.rows
    segment = np.array(segments, np.int64).reshape(-1, at.N_SEGMENT)
    return friction, table, segment, offset


def set_newton_rows(
    friction: IntTable, segment: IntTable, own: IntTable, newton: IntTable
) -> None:
    """Fills in the rows of Newton matrices, known by the entries of segments.

    Parameters
    ----------
    segment, own, newton
        Segments of constraints, of friction, of Newton's rows.
    """
    newton_row_at = dict(newton[:, [at.S_OFFSET, at.S_ROW]].tolist())
    of_row = {int(r): newton_row_at[int(o)] for r, _, o in segment}
    for j, _, offset in own:
        row = friction[j]
        row[at.R_NEWTON] = newton_row_at[int(offset)]
        for r in range(row[at.R_COUNT]):
            row[at.R_NEWTON + 1 + r] = of_row[int(row[at.R_ROWS + r])]


class FrictionStateHistory:
    """The friction states of a run, in sequence.

    What is stored holds no side of a load: a state by itself is as smooth without.

    Attributes
    ----------
    current_states : (frictions, N_FRICTION_STATE)
        `SystemArrays.friction_state`, which kernels read.
    """

    def __init__(self, now: Array) -> None:
        self.current_states = now
        self._times: list[float] = []
        self._kept: list[Array] = []

    def store(self, t: float) -> None:
        """Stores what holds from now on."""
        self._times.append(t)
        stored = self.current_states.copy()
        stored[:, at.CONTACT_SIDE :] = 0.0
        self._kept.append(stored)

    def save(self) -> dict[str, Any]:
        """Return the states until now, without the present one."""
        return {"times": tuple(self._times), "states": tuple(self._kept)}

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Go on from what `save` has returned."""
        self._times, self._kept = list(saved["times"]), list(saved["states"])

    def clear(self) -> None:
        """Nothing is kept any more."""
        self._times.clear()
        self._kept.clear()

    @contextmanager
    def intervals(self, times: Array) -> Iterator[Iterator[slice]]:
        """Runs of times with one friction state, which is put in place for each.

        A time between two friction states belongs to the first one. The present one is
        back at the end.
        """
        present = self.current_states.copy()
        try:
            yield self._parts(times)
        finally:
            self.current_states[:] = present

    def _parts(self, times: Array) -> Iterator[slice]:
        if not self._times:
            yield slice(0, len(times))
            return
        index = np.searchsorted(self._times, times, "left") - 1
        edges = np.flatnonzero(np.diff(index)) + 1
        for first, last in zip([0, *edges], [*edges, len(times)], strict=True):
            if first < last:
                self.current_states[:] = self._kept[max(int(index[first]), 0)]
                yield slice(int(first), int(last))


@dataclass(frozen=True)
class CountedRotation:
    """The rotation from marker a to marker b.

    Attributes
    ----------
    name
        Of its angle, after its joint; after the force that needs it, if it is between
        markers or begins at another angle than the first one.
    kind
        Kind of its measure, see `dynamics.force_measures`.
    data
        Directions; a rotation vector has none.
    entry
        Its first row of `WorkArrays.rotation_counter`.
    is_counted
        Whether its angle is known beyond half a turn.
    rest
        The angle at the start is the one nearest to this [rad].
    drive
        Row of the function that prescribes it and stands for rest, -1 for none.
    """

    name: str
    kind: int
    a: MarkerKey
    b: MarkerKey
    data: tuple[float, ...]
    entry: int
    is_counted: bool
    rest: float = 0.0
    drive: int = -1

    @property
    def angles(self) -> tuple[str, ...]:
        """Names of its entries."""
        if self.kind != at.ROTATION_VECTOR_MEASURE:
            return (self.name,)
        return tuple(f"{self.name}_{axis}" for axis in "xyz")


def assign_rotation_counters(
    forces: Sequence[ForceRow],
    coordinates: Mapping[Coordinate, ForceRow],
    drives: Mapping[Coordinate, int],
) -> tuple[
    tuple[ForceRow, ...], dict[Coordinate, ForceRow], tuple[CountedRotation, ...]
]:
    """Forces and joint coordinates of a spatial scene, with their rows of
    `WorkArrays.rotation_counter`.

    Parameters
    ----------
    coordinates
        What outputs and events look at.
    drives
        Rows of the functions that prescribe coordinates of joints.
    """
    springs = [e for e in forces if _has_spring(e) and e.coordinate]
    table = RotationTable(drives, {e.coordinate: e.law.rest for e in reversed(springs)})
    known = {key: table.with_counter(element) for key, element in coordinates.items()}
    counted = [table.with_counter(e) if _depends_on_angle(e) else e for e in forces]
    return tuple(table.rated(e) for e in counted), known, tuple(table.rotations)


def _depends_on_angle(element: ForceRow) -> bool:
    return (
        element.kind == at.ROTATION_VECTOR_MEASURE
        or _has_spring(element)
        or element.is_measure
    )


def _has_spring(element: ForceRow) -> bool:
    return len(element.law.stiffness.starts) > 0


class RotationTable:
    """Collects rotations; the counted ones have to come first.

    Attributes
    ----------
    rest_angles
        Of the first spring in each coordinate, from which outputs count, too.
    """

    def __init__(
        self,
        drives: Mapping[Coordinate, int],
        rest_angles: Mapping[Coordinate | None, float],
    ) -> None:
        self.drives, self.rest_angles = drives, rest_angles
        self.rotations: list[CountedRotation] = []

    def with_counter(self, element: ForceRow) -> ForceRow:
        """The element with an entry where its angle is counted."""
        if element.kind not in (at.ANGLE_MEASURE, at.ROTATION_VECTOR_MEASURE):
            return element
        drive = self.drives.get(element.coordinate, -1) if element.coordinate else -1
        rest_angle = element.law.rest
        if not _has_spring(element):
            rest_angle = self.rest_angles.get(element.coordinate, rest_angle)
        rest_angle = rest_angle if drive < 0 else 0.0
        same = [
            t for t in self._at(element) if (t.rest, t.drive) == (rest_angle, drive)
        ]
        rotation = same[0] if same else self._add(element, True, rest_angle, drive)
        component = (
            int(np.argmax(element.data))
            if element.kind == at.ROTATION_VECTOR_MEASURE
            else 0
        )
        return replace(element, rotation_entry=rotation.entry + component)

    def rated(self, element: ForceRow) -> ForceRow:
        """The element with an entry for its rate, if it has none and needs one."""
        if (
            element.kind
            not in (
                at.ANGLE_MEASURE,
                at.DIRECTION_COSINE_MEASURE,
                at.ANGULAR_VELOCITY_MEASURE,
            )
            or element.rotation_entry >= 0
        ):
            return element
        known = self._at(element)
        rotation = known[0] if known else self._add(element, False)
        return replace(element, rotation_entry=rotation.entry)

    def _at(self, element: ForceRow) -> list[CountedRotation]:
        """What is known of the rotation of an element."""
        key = _rotation_key(element)
        return [t for t in self.rotations if (t.kind, t.a, t.b, t.data) == key]

    def _add(
        self, element: ForceRow, counted: bool, rest_angle: float = 0.0, drive: int = -1
    ) -> CountedRotation:
        joint, coordinate = element.coordinate or (element.name, "turn")
        entry = sum(len(rotation.angles) for rotation in self.rotations)
        kind, a, b, data = _rotation_key(element)
        # The first one begins at the first spring of its joint, whatever is recorded.
        is_first = not any(t.is_counted for t in self._at(element))
        name = f"{joint if is_first else element.name}.{coordinate}"
        self.rotations.append(
            CountedRotation(name, kind, a, b, data, entry, counted, rest_angle, drive)
        )
        return self.rotations[-1]


def _rotation_key(
    element: ForceRow,
) -> tuple[int, MarkerKey, MarkerKey, tuple[float, ...]]:
    assert element.a is not None
    data = () if element.kind == at.ROTATION_VECTOR_MEASURE else element.data
    return element.kind, element.a, element.b, data


def rotation_table(
    rotations: Sequence[CountedRotation],
    markers: Mapping[MarkerKey, int],
    real_data: RealData,
) -> IntTable:
    """The table of rotations."""
    rows = [
        (t.kind, markers[t.a], markers[t.b], real_data.add(t.data), t.entry)
        for t in rotations
    ]
    return np.array(rows, np.int64).reshape(-1, at.N_ROTATION_COUNTER)
