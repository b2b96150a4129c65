"""Which forces and torques outputs tell: of joints, drives and forces."""

from __future__ import annotations

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.scene import (
    Distance,
    SceneFile,
    marker_names,
    marker_reference,
)
from sidtool.formats.scene.connections import (
    THREAD,
    acting_in,
    holder,
    joint_coordinate_of,
)
from sidtool.formats.scene.joints import Screw
from sidtool.formats.scene.outputs import EFFORTS, POWER
from sidtool.formats.sid import Array

from ..integrators.recording import RUB_FORCE, RUB_LOAD
from ..system.scene import System
from .sampling import Samples
from .told import Told

COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")


def is_constraint(system: System, owner: str) -> bool:
    """Whether a name is that of a joint or a drive."""
    return owner in system.scene.joints or owner in system.scene.drives


def second_marker(system: System, owner: str) -> int:
    """Row of the marker on which the force of a joint or a drive is told.

    Raises
    ------
    InputError : a coupling, which has no marker of its own.
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


def wrench(told: Told, owner: str) -> Array:
    """Force and torque on the second marker in inertial axes, (nt, 6).

    Of a joint, of a drive, or of a force: of the marker that it acts on or, where it is
    between two, the second one.

    Raises
    ------
    InputError : a coupling, which has no marker of its own.
    """
    system = told.system
    if is_constraint(system, owner):
        return told.wrench(second_marker(system, owner), owner)
    second = system.forces[acting_row(system, owner)].b
    joint = getattr(system.scene.forces[owner], "joint", None)
    if joint is not None:
        second = marker_reference(marker_names(system.scene.joints[joint])[1])
    return told.wrench(system.markers[second], f"forces.{owner}")


def acting_row(system: System, force: str) -> int:
    """Row of the first element of a force."""
    return next(k for k, e in enumerate(system.forces) if e.acts and e.name == force)


def multiplier_row(system: System, owner: str, quantity: str) -> int:
    """Constraint row of JOINT.fK.

    Raises
    ------
    InputError : the joint has fewer multipliers.
    """
    rows = _rows_of(system.whole or system, owner)
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


def along_column(told: Told, owner: str, quantity: str) -> Array:
    """One of the quantities of `sidtool.formats.scene.connections`, (nt,)."""
    scene = told.system.scene
    table = holder(owner, quantity, scene)
    if quantity == POWER:
        return told.power(_acting_names(owner, table, scene))
    if table == "drives":
        return _drive_effort(told, owner)
    if table == "joints":
        return _joint_effort(told, owner, quantity)
    element = acting_row(told.system, owner)
    row = told.forces[:, element]
    if quantity == "deflection":
        return np.asarray(row["measure"] - told.system.forces[element].law.rest)
    names = {"length": "measure", "rate": "rate"} | dict.fromkeys(EFFORTS, "size")
    return np.asarray(row[names[quantity]])


def _acting_names(owner: str, table: str, scene: SceneFile) -> set[str]:
    """What gives the power of a part of the scene, by the names of `System.acting`."""
    if table == "forces":
        return {f"forces.{owner}"}
    if table == "drives":
        return {owner}
    found = {owner}
    for coordinate in scene.joints[owner].coordinates:
        for kind, name in acting_in(owner, coordinate, scene):
            found.add(name if kind == "drives" else f"forces.{name}")
    return found


def _drive_effort(told: Told, drive: str) -> Array:
    """The multiplier of the coordinate that a drive prescribes; of a rotation about an
    axis the last one, behind those that hold the axis."""
    row = _rows_of(told.system, drive)[-1]
    return np.asarray(told.samples.multipliers[:, row])


def _joint_effort(told: Told, name: str, quantity: str) -> Array:
    """What acts along a coordinate of a joint, see `connections`."""
    system, samples = told.system, told.samples
    joint = system.scene.joints[name]
    coordinate = joint_coordinate_of(joint, quantity)
    total = np.zeros(len(told.times))
    for table, other in acting_in(name, coordinate, system.scene):
        if table == "drives":
            total += _drive_effort(told, other)
        else:
            total += told.forces[:, acting_row(system, other)]["size"]
    if any(rub.joint == name for rub in system.rubbing):
        total += friction_column(system, samples, name, "friction")
    rows = _rows_of(system, name)
    if isinstance(joint, Distance) and rows:
        total += samples.multipliers[:, rows[0]]
    if isinstance(joint, Screw):
        turned = -joint.pitch / (2.0 * np.pi)
        weight = 1.0 if quantity == "force" else turned
        total += weight * samples.multipliers[:, rows[THREAD - 1]]
    return total


def friction_column(system: System, samples: Samples, owner: str, what: str) -> Array:
    """Friction along the coordinate of a joint, its load, or 1 while it sticks."""
    j = [rub.joint for rub in system.rubbing].index(owner)
    if what == "sticking":
        return samples.sticking[:, j].astype(float)
    column = RUB_FORCE if what == "friction" else RUB_LOAD
    return samples.friction[:, j, column]
