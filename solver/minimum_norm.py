"""Multipliers of redundant constraints: the smallest ones that hold the mechanism.

Where constraints follow from each other, the motion decides only C^T lambda, and what
lies in the null space of C^T (stresses that the joints put on each other) is not known
from rigid joints. Reported are the multipliers without that part. They depend on the
metric in which they are small: here a force counts with the size of the mechanism as
its lever arm, so that sum_i (lambda_i s_i)^2 is least, with s_i as in `row_sizes` and
each term an energy squared. It changes neither with the unit system nor with the axes.
"""

from __future__ import annotations

import numpy as np

from formats.sid import Array

from . import kernel_calls
from .kernels.layout import Work
from .scene import System
from .sizes import coordinate_sizes, row_sizes
from .start import RANK_TOLERANCE, dense_jacobian


def minimum_norm(
    system: System, work: Work, times: Array, z: Array, v: Array, multipliers: Array
) -> Array:
    """Multipliers (nt, rows) of the states z, v at some times, without what lies in the
    null space of C^T."""
    rows, columns = row_sizes(system), coordinate_sizes(system)
    rank = system.n_rows - len(system.redundant)
    result = multipliers.copy()
    for k, (t, clock) in enumerate(zip(times, system.clocks(times), strict=True)):
        work.clock[0] = clock
        kernel_calls.evaluate(system, work, t, z[k], v[k])
        C = dense_jacobian(system, work.C) * columns / rows[:, None]
        left, sizes, _ = np.linalg.svd(C, full_matrices=False)
        known = sizes[:rank] > RANK_TOLERANCE * max(1.0, sizes.max(initial=0.0))
        held = left[:, :rank][:, known]
        result[k] = held @ (held.T @ (multipliers[k] * rows)) / rows
    return result
