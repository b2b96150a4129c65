"""Forces and torques of joints and drives, from the multipliers of their constraints.

A constraint c with the multiplier lambda acts on its second marker with lambda dc/dx,
lambda dc/dtheta, and on the first one with the reverse at the same place.
"""

from __future__ import annotations

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.scene import marker_names, marker_reference
from sidtool.formats.sid import Array

from ..integrators.recording import RUB_FORCE, RUB_LOAD
from ..kernels import layout as at
from ..system.scene import System
from .motion import Motion, marker_motion
from .sampling import Samples

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


def wrench(system: System, samples: Samples, owner: str) -> Array:
    """Force and torque on the second marker in inertial axes, (nt, 6)."""
    second = second_marker(system, owner)
    first_rows = {row.first for row in system.rows if row.name == owner}
    total = np.zeros((len(samples.z), 6))
    for con in system.arrays.constraint:
        if con[at.ROW] in first_rows:
            total += _constraint_wrench(system, samples, con, second)
    for j, rub in enumerate(system.rubbing):
        if rub.joint == owner:
            total += _friction_wrench(system, samples, j)
    return total


def friction_column(system: System, samples: Samples, owner: str, what: str) -> Array:
    """Friction along the coordinate of a joint, its load, or 1 while it sticks."""
    j = [rub.joint for rub in system.rubbing].index(owner)
    if what == "sticking":
        return samples.sticking[:, j].astype(float)
    column = RUB_FORCE if what == "friction" else RUB_LOAD
    return samples.friction[:, j, column]


def _friction_wrench(system: System, samples: Samples, j: int) -> Array:
    """Of the friction of a joint, on its second marker."""
    con, rub = system.arrays.sliding.constraint[j], system.rubbing[j]
    A = marker_motion(system, samples, int(con[at.MARKER_A]))
    size = samples.friction[:, j, [RUB_FORCE]]
    data, nothing = rub.primitive.data, np.zeros((len(size), 3))
    turns = con[at.KIND] == at.COUPLED_ANGLE
    if system.planar:
        local = np.array([np.cos(data[0]), np.sin(data[0]), 0.0])
        local = np.array([0.0, 0.0, 1.0]) if turns else local
    else:
        local = np.cross(data[:3], data[3:6]) if turns else np.array(data[:3])
    part = size * (A.R @ local)
    return np.column_stack([nothing, part] if turns else [part, nothing])


def _constraint_wrench(
    system: System, samples: Samples, con: Array, second: int
) -> Array:
    """Of one constraint, on whichever of its markers is the second of the joint."""
    A = marker_motion(system, samples, int(con[at.MARKER_A]))
    B = marker_motion(system, samples, int(con[at.MARKER_B]))
    force, torque = _on_second(system, samples, con, A, B)
    if con[at.MARKER_B] == second:
        return np.column_stack([force, torque])
    return np.column_stack([-force, -torque - np.cross(B.x - A.x, force)])


def _on_second(
    system: System, samples: Samples, con: Array, A: Motion, B: Motion
) -> tuple[Array, Array]:
    """Force and torque at marker B."""
    row, kind = int(con[at.ROW]), con[at.KIND]
    size = samples.multipliers[:, [row]]
    nothing = np.zeros((len(size), 3))
    if kind == at.COINCIDENT:
        axes = 2 if system.planar else 3
        force = nothing.copy()
        force[:, :axes] = samples.multipliers[:, row : row + axes]
        return force, nothing
    if kind == at.DISTANCE:
        line = B.x - A.x
        return size * line / np.linalg.norm(line, axis=1, keepdims=True), nothing
    data = system.arrays.pool[con[at.C_DATA] :]
    if kind == at.ALONG:
        local = data[:3]
        if system.planar:
            local = np.array([np.cos(data[0]), np.sin(data[0]), 0.0])
        return size * (A.R @ local), nothing
    if system.planar:
        return nothing, size * np.array([0.0, 0.0, 1.0])
    return nothing, -size * _turning(kind, data, A, B)


def _turning(kind: int, data: Array, A: Motion, B: Motion) -> Array:
    """u x b of PERPENDICULAR and ANGLE, see `kernels.spatial_constraints`."""
    first, second = A.R @ data[:3], A.R @ data[3:6]
    if kind == at.PERPENDICULAR:
        return np.cross(first, B.R @ data[3:6])
    b = B.R @ data[:3]
    along, across = np.sum(b * first, axis=1), np.sum(b * second, axis=1)
    u = along[:, None] * second - across[:, None] * first
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return np.cross(u, b)
