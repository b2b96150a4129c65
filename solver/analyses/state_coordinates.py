"""Independent coordinates of a linearised mechanism: their choice, names and units."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import unit_of

from ..output.columns import velocity_names
from ..spatial import system_arrays as at
from ..system.system import System

#: Elastic coordinates are chosen before rotations, and these before displacements,
#: unless the others move so many times as much, in units of equal kinetic energy.
ELASTIC, ROTATION, TRANSLATION = 16.0, 4.0, 1.0
#: Of a displacement along an axis of the body, and about it, by the velocity.
_DISPLACEMENTS = {"v": "", "w": "rotation_"}


@dataclass(frozen=True)
class CoordinateNames:
    """Names and units of the n velocity coordinates and of their displacements."""

    displacements: tuple[str, ...]
    displacement_units: tuple[str, ...]
    velocities: tuple[str, ...]
    velocity_units: tuple[str, ...]


def coordinate_names(system: System) -> CoordinateNames:
    """Return names and units of the coordinates of a linearised mechanism.

    Displacements of frames are those along and about the axes of the body, such as
    `arm.x_body` and `arm.rotation_z_body`.
    """
    velocities = velocity_names(system)
    names, units, velocity_units = [], [], []
    for row, data in zip(system.arrays.body, system.bodies, strict=True):
        first, end = int(row[at.VEL]), int(row[at.VEL] + row[at.NV])
        for k in range(first, end):
            owner, _, quantity = velocities[k].rpartition(".")
            rate = unit_of(velocities[k], system.scene)
            if not data.is_scene_body:
                names.append(f"{velocities[k]} (integral)")
                units.append(f"{rate} s".strip())
            elif k < first + int(row[at.RD]):
                prefix = _DISPLACEMENTS[quantity[0]]
                names.append(f"{owner}.{prefix}{quantity[1:]}")
                units.append("rad" if prefix else "m")
            else:
                names.append(f"{owner}.{quantity[1:]}")
                units.append("")
            velocity_units.append(rate)
    return CoordinateNames(
        tuple(names), tuple(units), tuple(velocities), tuple(velocity_units)
    )


def choose_coordinates(
    system: System, directions: Array, candidates: Array
) -> Sequence[int]:
    """Choose independent coordinates among the rows of a basis of free directions.

    Parameters
    ----------
    directions : (n, d)
        Scaled free directions.
    candidates : (n,)
        True for the rows that can be chosen.

    Returns
    -------
    rows
        d row numbers, growing; the d x d part of the basis in them is well conditioned.
    """
    weights = np.full(len(directions), ELASTIC)
    for row in system.arrays.body:
        u, rd = int(row[at.VEL]), int(row[at.RD])
        translations = min(rd, 2 if system.planar else 3)
        weights[u : u + rd] = ROTATION
        weights[u : u + translations] = TRANSLATION
    weights = np.where(candidates, weights, 0.0)
    count = directions.shape[1]
    if not count:
        return []
    _, _, order = qr((directions * weights[:, None]).T, mode="economic", pivoting=True)
    return sorted(int(k) for k in order[:count])
