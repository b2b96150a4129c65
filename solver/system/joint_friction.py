"""Joints with friction: tables of the kernels and history of stick and slip.

The force F and the moment M of a joint on its second marker load one contact point,
or with ``length`` the two ends of a bearing. The load is a linear combination of the
constraint multipliers of the joint.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import Joint, JointFriction, marker_names, marker_reference

from ..functions.function_table import RealData
from ..spatial import system_arrays as at
from ..spatial.system_arrays import IntTable
from .build_inputs import BuildInputs, MarkerKey
from .constraints import Constraint
from .joints import Primitive, joint_primitives, normals, spatial_axis

Segment = tuple[int, int, int]


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
