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

from ..equations.pointers import kernels
from ..integrators import recording
from ..space.layout import Work
from ..system.kernel_calls import go_on
from ..system.scene import System
from ..system.sizes import coordinate_sizes, row_sizes
from .consistent import RANK_TOLERANCE, dense_jacobians
from .large_scenes import CLEAR, MANY, scaled_jacobian
from .orthogonal import Reached
from .overconstraint import complete

#: Square of the part of a multiplier in the null space of C^T that is no rounding.
UNDETERMINED = 1e-10
#: Entries of dense Jacobians of states that are looked at together.
NUMBERS = 1_000_000


def minimum_norm(
    system: System, work: Work, times: Array, z: Array, v: Array, multipliers: Array
) -> tuple[Array, tuple[int, ...]]:
    """Multipliers (nt, rows) of the states z, v at some times, without what lies in the
    null space of C^T; and the rows that have a part in it, which the motion does not
    determine."""
    result, known_part = multipliers.copy(), np.ones(system.n_rows)
    whole, is_large = complete(system), system.n_rows >= MANY
    numbers = max(1, system.n_rows * system.n_velocities)
    block = 1 if is_large else max(1, NUMBERS // numbers)
    for first in range(0, len(times), block):
        part = slice(first, first + block)
        states = times[part], z[part], v[part]
        C, found = _jacobians(system, work, *states), None
        strict = C if whole is system else _jacobians(whole, work, *states)
        if is_large and strict is C:
            found = _least_of_many(system, C[0], multipliers[part])
        if found is None:
            found = _least(system, C, strict, multipliers[part])
        result[part], held = found
        known_part = np.minimum(known_part, held)
    return result, tuple(map(int, np.flatnonzero(1.0 - known_part > UNDETERMINED)))


def _jacobians(system: System, work: Work, times: Array, z: Array, v: Array) -> Array:
    """`Work.C` of some states, (nt, .)."""
    found = np.zeros((len(times), len(work.C)))
    clocks = system.clocks(times)
    recording.jacobians(
        kernels(system.planar), system.arrays, work, times, clocks, z, v, found
    )
    go_on(system)
    return found


def _least(
    system: System, C: Array, strict: Array, multipliers: Array
) -> tuple[Array, Array]:
    """The smallest multipliers of some states (nt, rows), and of each row the least
    part (rows,) that the motion determines.

    strict : C where no constraint is left out
    """
    rows, columns = row_sizes(system), coordinate_sizes(system)
    rank = system.n_rows - len(system.redundant)
    scaled = dense_jacobians(system, strict) * columns / rows[:, None]
    left, sizes, right = np.linalg.svd(scaled, full_matrices=False)
    largest = np.maximum(1.0, sizes.max(axis=1, initial=0.0))
    sizes = sizes[:, :rank]
    known = sizes > RANK_TOLERANCE * largest[:, None]
    held = left[:, :, :rank] * known[:, None, :]
    if strict is C:
        part = np.einsum("krn,kr->kn", held, multipliers * rows)
    else:
        force = np.einsum("kru,kr->ku", dense_jacobians(system, C), multipliers)
        part = np.einsum("knu,ku->kn", right[:, :rank], columns * force)
        part /= np.where(known, sizes, np.inf)
    least = np.einsum("krn,kn->kr", held, part) / rows
    return least, np.sum(held**2, axis=2).min(axis=0, initial=1.0)


def _least_of_many(
    system: System, C: Array, multipliers: Array
) -> tuple[Array, Array] | None:
    """The same for one state of a large scene; None where its rows are not clear."""
    sizes = row_sizes(system)
    B = scaled_jacobian(system, C).multiply(1.0 / sizes[:, None]).tocsr()
    reached = Reached(B, CLEAR)
    if not reached.clear or reached.rank != system.n_rows - len(system.redundant):
        return None
    least = reached.part(multipliers[0] * sizes) / sizes
    return least[None], 1.0 - reached.shares(system.n_rows) ** 2
