"""What must hold before a scene is integrated."""

from __future__ import annotations

from formats.errors import InputError
from formats.scene import SCENE_QUANTITIES, parse_output
from formats.sid_mass import IN_PLANE, SPATIAL, free_motion

from .joint_forces import COMPONENTS, second_marker
from .kernels import layout as at
from .outputs import elastic_range, multiplier_rows
from .scene import GROUND_NAME, System


def check_outputs(system: System) -> None:
    """Output names that need the SID or the constraints to be judged.

    Raises
    ------
    InputError : an elastic coordinate or a multiplier that does not exist.
    """
    for text in system.scene.outputs.record:
        name = parse_output(text)
        if name.marker or name.owner in SCENE_QUANTITIES:
            continue
        if name.quantity in COMPONENTS:
            second_marker(system, name.owner)
            continue
        if name.owner not in system.scene.bodies:
            multiplier_rows(system, name.owner, name.quantity)
        elif name.quantity[-1] == "*" or name.quantity[-1].isdigit():
            elastic_range(system, name.owner, name.quantity)


def check_masses(system: System) -> None:
    """Mass matrices of all bodies in the coordinates that the scene uses.

    Raises
    ------
    InputError : one is not positive definite: no such body can exist.
    """
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        if data.name == GROUND_NAME or row[at.RD] < (3 if system.planar else 6):
            continue
        motion = free_motion(data.sid, IN_PLANE[2] if system.planar else SPATIAL)
        if motion.possible:
            continue
        raise InputError(
            f"this body cannot move freely: {motion.reason}",
            place=f"bodies.{data.name}",
            expected="a SID whose coupled mass matrix is positive definite "
            "(`sidtool validate`, I14), a prescribed frame, or --accept-defects",
        )
