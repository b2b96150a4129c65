"""A mechanism whose drives and forces hold their values at the start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..kernels import layout as at
from ..kernels.drives import drive_value
from ..system.scene import System


def held(system: System) -> System:
    """The system with all functions of time constant, at their values at the start.

    Nothing that follows from their rates is left: velocities, accelerations, inertia.
    """
    arrays, t = system.arrays, system.scene.time.start
    clock = 0.5 * (t + system.breaks[0])
    values = [
        drive_value.py_func(arrays, row, clock, t)[0]
        for row in range(len(arrays.drive))
    ]
    first = len(arrays.pool)
    table = arrays.drive.copy()
    for row in range(len(table)):
        table[row, [at.D_PIECES, at.D_TERMS]] = 1, 1
        table[row, [at.D_DATA, at.D_KIND]] = first + 2 * row, at.POLYNOMIAL
    constants = np.column_stack([np.zeros(len(values)), values]).ravel()
    pool = np.concatenate([arrays.pool, constants])
    return replace(system, arrays=arrays.replaced(drive=table, pool=pool))
