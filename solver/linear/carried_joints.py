"""Forces in joints that prescribe frames, from the equations of the bodies they carry.

A body whose frame a joint with its drive prescribes has as many constraint rows in that
joint as its frame has coordinates. The rows of these coordinates in

    M z_II' = f + C^T lambda, eq. (3),

tell their multipliers once those of all other joints of the body are known: from the
last body that is carried to the first.
"""

from __future__ import annotations

import math

from numba import int64, types

from ..compiler.compiling import entry, inner
from ..space.layout import (
    F1,
    F2,
    I1,
    I2,
    SYSTEM,
    WORK,
)
from .mass import mass_row_times
from .memory import KERNELS
from .saddle import band_factor, band_solve

# Columns of the table of carried bodies, each behind its base
H_BODY = 0
H_ROWS = 1  # as many constraint rows as the frame has coordinates
MOST_ROWS = 6
N_HELD = H_ROWS + MOST_ROWS


@inner(types.void(SYSTEM, WORK, int64, F1, F1, F1, F1))
def _unbalanced(system, work, b, acceleration, multipliers, friction, left):
    """M z_II' - f - C^T lambda of the frame of a body, without what is not known."""
    first, rigid = system.body[b].vel, system.body[b].rd
    for i in range(rigid):
        left[i] = mass_row_times(system, work.M, b, i, acceleration)
        left[i] -= work.f[first + i]
    for s in range(system.body[b].seg0, system.body[b].seg1):
        at, row = system.segment[s].offset, system.segment[s].row
        for i in range(rigid):
            left[i] -= work.C[at + i] * multipliers[row]
    rubbing = system.sliding.segment
    for s in range(len(rubbing)):
        if rubbing[s].body == b:
            at = rubbing[s].offset
            for i in range(rigid):
                left[i] -= work.C[at + i] * friction[rubbing[s].row]


@inner(int64(SYSTEM, WORK, I1, F1, F2, F1, I1))
def _solve_joint(system, work, held, multipliers, H, left, pivots):
    """Multipliers of the joint of one body; 1 if it does not hold its frame."""
    b = held[H_BODY]
    n = system.body[b].rd
    for j in range(n):
        for i in range(n):
            H[i, j] = 0.0
        for s in range(system.body[b].seg0, system.body[b].seg1):
            if system.segment[s].row == held[H_ROWS + j]:
                for i in range(n):
                    H[i, j] += work.C[system.segment[s].offset + i]
    if band_factor(H, n, n, pivots) != 0:
        return 1
    band_solve(H, n, n, pivots, left)
    for j in range(n):
        multipliers[held[H_ROWS + j]] = left[j]
    return 0


@entry(types.void(KERNELS, SYSTEM, WORK, I2, F1, F1, F2, F2, F2, F2, F2, F2, I1))
def forces_of_carriers(
    kernels,
    system,
    work,
    held,
    times,
    clocks,
    z,
    v,
    accelerations,
    friction,
    multipliers,
    H,
    pivots,
):
    """Multipliers of the joints of carried bodies in some states, into `multipliers`.

    These hold the multipliers of all other rows, and zero. NaN where a joint does not
    hold its frame. H is scratch of one row more than a frame has coordinates.
    """
    left = H[MOST_ROWS]
    for k in range(len(times)):
        work.clock[0] = clocks[k]
        kernels.evaluate(system, work, times[k], z[k], v[k])
        for c in range(len(held) - 1, -1, -1):
            b = held[c, H_BODY]
            _unbalanced(
                system, work, b, accelerations[k], multipliers[k], friction[k], left
            )
            if (
                _solve_joint(system, work, held[c], multipliers[k], H, left, pivots)
                != 0
            ):
                for j in range(system.body[b].rd):
                    multipliers[k, held[c, H_ROWS + j]] = math.nan
