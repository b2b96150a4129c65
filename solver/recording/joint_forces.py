"""Which forces and torques outputs tell: of joints, drives and forces."""

from __future__ import annotations

from sidtool.formats.errors import InputError
from sidtool.formats.scene import marker_names, marker_reference
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
    second = next(e.b for e in system.forces if e.acts and e.name == owner)
    joint = getattr(system.scene.forces[owner], "joint", None)
    if joint is not None:
        second = marker_reference(marker_names(system.scene.joints[joint])[1])
    return told.wrench(system.markers[second], f"forces.{owner}")


def friction_column(system: System, samples: Samples, owner: str, what: str) -> Array:
    """Friction along the coordinate of a joint, its load, or 1 while it sticks."""
    j = [rub.joint for rub in system.rubbing].index(owner)
    if what == "sticking":
        return samples.sticking[:, j].astype(float)
    column = RUB_FORCE if what == "friction" else RUB_LOAD
    return samples.friction[:, j, column]
