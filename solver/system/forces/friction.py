"""Joints with friction: rows of their coordinates, and how multipliers load them.

The force F and the moment M of a joint on its second marker load one place of contact,
or with `length` the two ends of a guide or bearing, eq. (33): F/2 +- M x axis / length.
Only what lies across the axis counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sidtool.formats.scene import Joint, JointFriction, marker_names, marker_reference
from sidtool.formats.sid import Array

from ...functions.pool import Pool
from ...space import layout as at
from ...space.layout import IntTable
from ..constraints import Constraint
from ..ingredients import Ingredients, Reference
from ..joints import Primitive, joint_parts, normals, spatial_axis

Segment = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class Rubbing:
    """A joint with friction.

    weights : (places of contact, 2, rows) how the constraint rows of the joint make the
        force across its axis at each place
    rows : those constraint rows
    """

    joint: str
    friction: JointFriction
    primitive: Primitive
    a: Reference
    b: Reference
    weights: Array
    rows: tuple[int, ...]
    arm: float
    period: float


def rubbing_joints(
    parts: Ingredients, constraints: list[Constraint], table: IntTable
) -> tuple[Rubbing, ...]:
    """All joints with friction.

    constraints, table : those of the scene, in one order
    """
    found = []
    for name, joint in parts.scene.joints.items():
        friction = getattr(joint, "friction", None)
        if friction is None:
            continue
        rows: list[int] = []
        for constraint, row in zip(constraints, table, strict=True):
            if constraint.owner == name:
                point = constraint.primitive.kind == at.COINCIDENT
                rows += [int(row[at.ROW]) + k for k in range(2 if point else 1)]
        found.append(_rubbing(name, joint, friction, parts.planar, tuple(rows)))
    return tuple(found)


def _rubbing(
    name: str,
    joint: Joint,
    friction: JointFriction,
    planar: bool,
    rows: tuple[int, ...],
) -> Rubbing:
    a, b = (marker_reference(text) for text in marker_names(joint))
    turns = joint.type == "revolute"
    part = joint_parts(joint, planar).coordinates[joint.coordinates[0]]
    period = 2.0 * math.pi if turns and not planar else 0.0
    kind = at.COUPLED_ANGLE if turns else at.COUPLED_ALONG
    primitive = Primitive(kind, (*part.data, 1.0, 0.0, 0.0, 1.0))
    force, moment = _across(joint, planar)
    weights = [force]
    if friction.length is not None:
        ends = moment / friction.length
        weights = [0.5 * force + ends, 0.5 * force - ends]
    used = np.array(weights)
    count = used.shape[2]
    arm = friction.radius or 1.0
    return Rubbing(name, friction, primitive, a, b, used, rows[:count], arm, period)


def _across(joint: Joint, planar: bool) -> tuple[Array, Array]:
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
    rubbing: tuple[Rubbing, ...],
    markers: dict[Reference, int],
    body: IntTable,
    marker: IntTable,
    offset: int,
    pool: Pool,
) -> tuple[IntTable, IntTable, IntTable, int]:
    """Tables of friction, of the coordinates as constraints and of their segments.

    Last the offset behind the entries of the latter, which begin at `offset`.
    """
    friction = np.zeros((len(rubbing), at.N_FRICTION), np.int64)
    table = np.zeros((len(rubbing), at.N_CONSTRAINT), np.int64)
    pieces: list[Segment] = []
    for j, rub in enumerate(rubbing):
        row, ends = table[j], (markers[rub.a], markers[rub.b])
        row[at.KIND], row[at.ROW] = rub.primitive.kind, j
        row[[at.MARKER_A, at.MARKER_B]] = ends
        row[at.C_DATA] = pool.add(rub.primitive.data)
        row[[at.C_DRIVE, at.C_LAW]] = -1
        for column, m in zip((at.SEG_A, at.SEG_B), ends, strict=True):
            b = int(marker[m, at.M_BODY])
            row[column] = -1
            if body[b, at.NV] > 0:
                row[column] = len(pieces)
                pieces.append((j, b, offset))
                offset += int(body[b, at.NV])
        places, _, count = rub.weights.shape
        law = rub.friction
        rest = law.coefficient if law.static is None else law.static
        width = law.stribeck_velocity or 0.0
        numbers = (law.coefficient, rest, width, law.viscous, rub.arm, rub.period)
        friction[j, at.R_LAW] = pool.add(numbers)
        friction[j, at.R_LOAD] = pool.add(tuple(rub.weights.ravel()))
        friction[j, [at.R_PLACES, at.R_COUNT]] = places, count
        friction[j, at.R_ROWS : at.R_ROWS + count] = rub.rows
    segment = np.array(pieces, np.int64).reshape(-1, at.N_SEGMENT)
    return friction, table, segment, offset


def place_in_newton(
    friction: IntTable, segment: IntTable, own: IntTable, newton: IntTable
) -> None:
    """Fills in the rows of Newton matrices, known by the entries of segments.

    segment, own, newton : segments of constraints, of friction, of Newton's rows
    """
    places = dict(newton[:, [at.S_OFFSET, at.S_ROW]].tolist())
    of_row = {int(r): places[int(o)] for r, _, o in segment}
    for j, _, offset in own:
        row = friction[j]
        row[at.R_NEWTON] = places[int(offset)]
        for r in range(row[at.R_COUNT]):
            row[at.R_NEWTON + 1 + r] = of_row[int(row[at.R_ROWS + r])]
