"""What must hold before a scene is integrated."""

from __future__ import annotations

import numpy as np

from formats.errors import InputError
from formats.scene import parse_output
from formats.sid_mass import coupled_mass_matrix

from .kernels import layout as at
from .outputs import elastic_range, multiplier_rows
from .scene import GROUND_NAME, System

#: A mass matrix counts as positive down to this part of its largest eigenvalue.
DEFINITE = 1e-12


def check_outputs(system: System) -> None:
    """Output names that need the SID or the constraints to be judged.

    Raises
    ------
    InputError : an elastic coordinate or a multiplier that does not exist.
    """
    for text in system.scene.outputs.record:
        name = parse_output(text)
        if name.marker:
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
        if data.name == GROUND_NAME or row[at.NV] == 0:
            continue
        matrix = coupled_mass_matrix(data.sid)
        used = _used_coordinates(system, int(row[at.RD]), data.sid.nq)
        values = np.linalg.eigvalsh(_balanced(matrix[np.ix_(used, used)]))
        if values[0] > DEFINITE:
            continue
        raise InputError(
            f"the mass matrix is not positive definite (smallest eigenvalue "
            f"{values[0]:.3g} of the balanced matrix): no such body can exist",
            place=f"bodies.{data.name}",
            expected="inertia for every motion that the scene leaves free, or a SID "
            "that passes identity I14, or --accept-defects",
        )


def _used_coordinates(system: System, rigid: int, nq: int) -> list[int]:
    spatial = {0: [], 3: [0, 1, 2], 6: [0, 1, 2, 3, 4, 5]}
    planar = {0: [], 2: [0, 1], 3: [0, 1, 5]}
    frame = (planar if system.planar else spatial)[rigid]
    return [*frame, *range(6, 6 + nq)]


def _balanced(matrix: np.ndarray) -> np.ndarray:
    """The matrix with a unit diagonal where that is positive."""
    diagonal = np.diag(matrix)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    return matrix * np.outer(scale, scale)
