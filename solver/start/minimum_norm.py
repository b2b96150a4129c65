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

from sidtool.formats.sid import Array

from ..space.layout import Work
from ..system import kernel_calls
from ..system.scene import System
from ..system.sizes import coordinate_sizes, row_sizes
from .consistent import RANK_TOLERANCE, dense_jacobian
from .large_scenes import MANY, IndependentRows, scaled_jacobian
from .overconstraint import complete

#: Square of the part of a multiplier in the null space of C^T that is no rounding.
UNDETERMINED = 1e-10


def minimum_norm(
    system: System, work: Work, times: Array, z: Array, v: Array, multipliers: Array
) -> tuple[Array, tuple[int, ...]]:
    """Multipliers (nt, rows) of the states z, v at some times, without what lies in the
    null space of C^T; and the rows that have a part in it, which the motion does not
    determine."""
    rows, columns = row_sizes(system), coordinate_sizes(system)
    rank, whole = system.n_rows - len(system.redundant), complete(system)
    result, known_part = multipliers.copy(), np.ones(system.n_rows)
    for k, (t, clock) in enumerate(zip(times, system.clocks(times), strict=True)):
        work.clock[0] = clock
        kernel_calls.evaluate(system, work, t, z[k], v[k])
        undetermined = _of_many(system, work, rows) if whole is system else None
        if undetermined is not None:
            scaled = multipliers[k] * rows
            result[k] = (scaled - undetermined @ (undetermined.T @ scaled)) / rows
            known_part = np.minimum(known_part, 1.0 - np.sum(undetermined**2, axis=1))
            continue
        force = dense_jacobian(system, work.C).T @ multipliers[k]
        kernel_calls.evaluate(whole, work, t, z[k], v[k])
        C = dense_jacobian(system, work.C) * columns / rows[:, None]
        left, sizes, right = np.linalg.svd(C, full_matrices=False)
        known = sizes[:rank] > RANK_TOLERANCE * max(1.0, sizes.max(initial=0.0))
        held = left[:, :rank][:, known]
        if whole is system:
            part = held.T @ (multipliers[k] * rows)
        else:
            part = right[:rank][known] @ (columns * force) / sizes[:rank][known]
        result[k] = held @ part / rows
        known_part = np.minimum(known_part, np.sum(held**2, axis=1))
    return result, tuple(map(int, np.flatnonzero(1.0 - known_part > UNDETERMINED)))


def _of_many(system: System, work: Work, sizes: Array) -> Array | None:
    """An orthonormal basis of the null space (rows, n) in a large scene; None where it
    is not clear.

    sizes : (rows,) of the constraints
    """
    if system.n_rows < MANY:
        return None
    rows = IndependentRows(scaled_jacobian(system, work.C))
    if rows.dependent.sum() != len(system.redundant):
        return None
    if not rows.are_clear(RANK_TOLERANCE):
        return None
    scale = sizes / rows.lengths
    return np.asarray(np.linalg.qr(scale[:, None] * rows.dependencies())[0])
