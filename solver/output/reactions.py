"""Forces and torques of joints, drives and forces at recorded states.

Bodies whose frames joints prescribe have no constraint rows; their joints are restored
and the reactions follow from the recorded motion.
"""

from dataclasses import replace

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import Distance, SceneFile, marker_names, marker_reference
from sidtool.formats.scene.connections import (
    THREAD_MULTIPLIER,
    actions_on_coordinate,
    joint_coordinate_of,
    owner_table,
)
from sidtool.formats.scene.joints import Screw
from sidtool.formats.scene.outputs import EFFORTS, POWER

from ..dynamics.equations_of_motion import kernel_pointers
from ..initial_state.given_state import set_prescribed_frame
from ..initial_state.overconstraint import ROTATION_CONSTRAINTS, restore_constraints
from ..integrators.output_sampling import OUTPUT_FRICTION, OUTPUT_LOAD
from ..linear import driven_joint_reactions
from ..spatial import system_arrays as at
from ..system.rotated_markers import to_3d
from ..system.system import ConstraintRows, System
from ..system.work_arrays import new_work_arrays, raise_pending
from .samples import EvaluatedForces, Samples

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")


def is_constraint(system: System, owner: str) -> bool:
    """True if a name is that of a joint or a drive."""
    return owner in system.scene.joints or owner in system.scene.drives


def second_marker(system: System, owner: str) -> int:
    """Row of the marker on which the force of a joint or a drive is reported.

    Raises
    ------
    InputError
        A coupling, which has no marker of its own.
    """
    drive = system.scene.drives.get(owner)
    joint = system.scene.joints.get(owner)
    if drive is not None and drive.marker is not None:
        return system.markers[marker_reference(drive.marker)]
    if drive is not None and drive.joint is not None:
        joint = system.scene.joints[drive.joint]
    names = () if joint is None else marker_names(joint)
    if not names:
        raise InputError(
            f"{owner} couples other joints and has no marker",
            place=f"outputs.record, {owner}.fx",
            expected=f"its multiplier, {owner}.f1",
        )
    return system.markers[marker_reference(names[1])]


def output_wrench(evaluated: EvaluatedForces, owner: str) -> Array:
    """Force and torque on the second marker in inertial axes, (nt, 6).

    Of a joint, of a drive, or of a force: of the marker that it acts on or, where it is
    between two, the second one.

    Raises
    ------
    InputError
        A coupling, which has no marker of its own.
    """
    system = evaluated.system
    if is_constraint(system, owner):
        return evaluated.wrench(second_marker(system, owner), owner)
    second = system.forces[force_row(system, owner)].b
    joint = getattr(system.scene.forces[owner], "joint", None)
    if joint is not None:
        second = marker_reference(marker_names(system.scene.joints[joint])[1])
    return evaluated.wrench(system.markers[second], f"forces.{owner}")


def force_row(system: System, force: str) -> int:
    """Row of the first element of a force."""
    return next(
        k for k, e in enumerate(system.forces) if e.is_force and e.name == force
    )


def multiplier_row(system: System, owner: str, quantity: str) -> int:
    """Constraint row of JOINT.fK.

    Raises
    ------
    InputError
        The joint has fewer multipliers.
    """
    rows = _rows_of(system.full_system or system, owner)
    k = int(quantity[1:])
    if k > len(rows):
        raise InputError(
            f"{owner} has {len(rows)} multipliers",
            place=f"outputs.record, {owner}.{quantity}",
            expected=f"f1 to f{len(rows)}" if rows else "another joint",
        )
    return rows[k - 1]


def _rows_of(system: System, owner: str) -> list[int]:
    return [
        i
        for row in system.rows
        if row.name == owner
        for i in range(row.first, row.first + row.count)
    ]


def coordinate_column(evaluated: EvaluatedForces, owner: str, quantity: str) -> Array:
    """One of the quantities of `sidtool.formats.scene.connections`, (nt,)."""
    scene = evaluated.system.scene
    table = owner_table(owner, quantity, scene)
    if quantity == POWER:
        return evaluated.power(_power_sources(owner, table, scene))
    if table == "drives":
        return _drive_effort(evaluated, owner)
    if table == "joints":
        return _joint_effort(evaluated, owner, quantity)
    element = force_row(evaluated.system, owner)
    row = evaluated.forces[:, element]
    if quantity == "deflection":
        return np.asarray(row["measure"] - evaluated.system.forces[element].law.rest)
    names = {"length": "measure", "rate": "rate"} | dict.fromkeys(EFFORTS, "force")
    return np.asarray(row[names[quantity]])


def _power_sources(owner: str, table: str, scene: SceneFile) -> set[str]:
    """What gives the power of a part of the scene, by the names of `System.acting`."""
    if table == "forces":
        return {f"forces.{owner}"}
    if table == "drives":
        return {owner}
    sources = {owner}
    for coordinate in scene.joints[owner].coordinates:
        for kind, name in actions_on_coordinate(owner, coordinate, scene):
            sources.add(name if kind == "drives" else f"forces.{name}")
    return sources


def _drive_effort(evaluated: EvaluatedForces, drive: str) -> Array:
    """The multiplier of the coordinate that a drive prescribes; of a rotation about an
    axis the last one, behind those that hold the axis."""
    row = _rows_of(evaluated.system, drive)[-1]
    return np.asarray(evaluated.samples.multipliers[:, row])


def _joint_effort(evaluated: EvaluatedForces, name: str, quantity: str) -> Array:
    """What acts along a coordinate of a joint, see `connections`."""
    system, samples = evaluated.system, evaluated.samples
    joint = system.scene.joints[name]
    coordinate = joint_coordinate_of(joint, quantity)
    total = np.zeros(len(evaluated.times))
    for table, other in actions_on_coordinate(name, coordinate, system.scene):
        if table == "drives":
            total += _drive_effort(evaluated, other)
        else:
            total += evaluated.forces[:, force_row(system, other)]["force"]
    if any(rub.joint == name for rub in system.friction_joints):
        total += friction_column(system, samples, name, "friction")
    rows = _rows_of(system, name)
    if isinstance(joint, Distance) and rows:
        total += samples.multipliers[:, rows[0]]
    if isinstance(joint, Screw):
        torque_factor = -joint.pitch / (2.0 * np.pi)
        weight = 1.0 if quantity == "force" else torque_factor
        total += weight * samples.multipliers[:, rows[THREAD_MULTIPLIER - 1]]
    return total


def friction_column(
    system: System, samples: Samples, owner: str, quantity: str
) -> Array:
    """Friction along the coordinate of a joint, its load, or 1 while it sticks."""
    j = [rub.joint for rub in system.friction_joints].index(owner)
    if quantity == "sticking":
        return samples.sticking[:, j].astype(float)
    column = OUTPUT_FRICTION if quantity == "friction" else OUTPUT_LOAD
    return samples.friction[:, j, column]


def restore_eliminated_joints(
    system: System, times: Array, samples: Samples
) -> tuple[System, Samples]:
    """The scene with all of its joints, in the motion of the cut one; itself if it is
    not cut, or if no force of a joint is requested.
    """
    full = system.full_system
    if full is None:
        return restore_constraints(system), samples
    z, v, acc = (
        np.zeros((len(times), n))
        for n in (full.n_positions, full.n_velocities, full.n_velocities)
    )
    z[:, full.n_positions - full.n_rotation_counters :] = samples.z[
        :, system.n_positions - system.n_rotation_counters :
    ]
    for b in range(len(system.bodies)):
        _expand_body(system, full, b, samples, (z, v, acc))
    full = restore_constraints(full)
    multipliers = _full_multipliers(system, full, times, samples, (z, v, acc))
    full_samples = replace(
        samples, z=z, v=v, accelerations=acc, multipliers=multipliers
    )
    return full, replace(full_samples, undetermined=())


def _expand_body(
    system: System,
    full: System,
    b: int,
    samples: Samples,
    states: tuple[Array, Array, Array],
) -> None:
    """Coordinates of one body in the whole scene, with two derivatives."""
    z, v, acc = states
    reduced, row = system.arrays.body[b], full.arrays.body[b]
    for target, source, at_, size in (
        (z, samples.z, at.POS, at.NP),
        (v, samples.v, at.VEL, at.NV),
        (acc, samples.accelerations, at.VEL, at.NV),
    ):
        count, end = int(reduced[size]), int(row[at_] + row[size])
        target[:, end - count : end] = source[:, reduced[at_] : reduced[at_] + count]
    if reduced[at.RD] == row[at.RD]:
        return
    u, rigid, frames = int(row[at.VEL]), int(row[at.RD]), samples.frames[:, b]
    set_prescribed_frame(full, b, frames, z, v)
    acc[:, u : u + rigid] = _velocity_rates(full, frames)[:, :rigid]


def _velocity_rates(system: System, frames: Array) -> Array:
    """Derivatives of the body-resolved velocities: a = dv/dt + w x v, (nt, .)."""
    of = system.frames(frames)
    frame_term = np.cross(to_3d(of["w"]), to_3d(of["v"]))
    linear = of["a"] - frame_term[:, : of["a"].shape[1]]
    return np.concatenate([linear, of["al"]], axis=1)


def _full_multipliers(
    system: System,
    full: System,
    times: Array,
    samples: Samples,
    states: tuple[Array, Array, Array],
) -> Array:
    """Those of the cut scene, and what the joints of bodies with prescribed frames
    transmit.
    """
    rows = _matching_rows(system.rows, full.rows)
    known, source = np.array(rows, np.int64).reshape(-1, 2).T
    multipliers = np.zeros((len(times), full.n_rows))
    multipliers[:, known] = samples.multipliers[:, source]
    z, v, acc = states
    driven_joint_reactions.driven_joint_reactions(
        kernel_pointers(full.planar),
        full.arrays,
        new_work_arrays(full),
        _driven_joint_table(system, full, np.setdiff1d(np.arange(full.n_rows), known)),
        np.ascontiguousarray(times),
        system.clocks(times),
        z,
        v,
        acc,
        np.ascontiguousarray(samples.friction[:, :, OUTPUT_FRICTION]),
        multipliers,
        np.zeros(
            (driven_joint_reactions.MAX_ROWS + 1, driven_joint_reactions.MAX_ROWS)
        ),
        np.zeros(driven_joint_reactions.MAX_ROWS, np.int64),
    )
    raise_pending(full)
    return multipliers


def _driven_joint_table(system: System, full: System, missing: Array) -> at.IntTable:
    """Bodies with prescribed frames, each behind its base, with the rows of their
    joints.

    A body that does not turn feels no row of rotations.
    """
    rows = {data.name: list[int]() for data in full.bodies}
    constraints = full.arrays.constraint
    rotation_rows = set(
        constraints[np.isin(constraints[:, at.KIND], ROTATION_CONSTRAINTS), at.ROW]
    )
    for row in full.rows:
        part = set(range(row.first, row.first + row.count)).intersection(missing)
        if part:
            rows[system.eliminated[row.name]] += sorted(part)
    table = []
    bodies = zip(full.bodies, system.arrays.body, full.arrays.body, strict=True)
    for b, (data, reduced, row) in enumerate(bodies):
        if reduced[at.RD] == row[at.RD]:
            continue
        own = rows[data.name]
        if len(own) > row[at.RD]:
            own = [r for r in own if r not in rotation_rows]
        empty = [-1] * (driven_joint_reactions.MAX_ROWS - len(own))
        table.append([b, *own, *empty])
    return np.array(table, np.int64).reshape(-1, driven_joint_reactions.N_DRIVEN_JOINT)


def _matching_rows(
    reduced: tuple[ConstraintRows, ...], full: tuple[ConstraintRows, ...]
) -> list[tuple[int, int]]:
    """Rows of the whole scene with those of the cut one, joint by joint."""
    left: dict[str, list[ConstraintRows]] = {}
    for row in reduced:
        left.setdefault(row.name, []).append(row)
    pairs = []
    for row in full:
        if row.name in left:
            other = left[row.name].pop(0)
            pairs += [(row.first + k, other.first + k) for k in range(row.count)]
    return pairs
