"""Reactions of joints that prescribe frames, from the equations of their bodies.

A body whose frame a joint with its drive prescribes has as many constraint rows in that
joint as its frame has coordinates. These rows of

    M z_II' = f + C^T lambda, eq. (3),

give their multipliers once those of all other joints of the body are known: from the
last prescribed body to the first.
"""

import math

from ..compiler.kernels import entry, inner
from ..compiler.types import int64, void
from ..spatial.system_arrays import F1, F2, I1, I2, SYSTEM, WORK
from .factor_storage import KERNELS
from .mass_matrix import mass_row_product
from .saddle_point import band_factor, band_solve

# Columns of the table of carried bodies, each behind its base
D_BODY = 0
D_ROWS = 1  # as many constraint rows as the frame has coordinates
MAX_ROWS = 6
N_DRIVEN_JOINT = D_ROWS + MAX_ROWS


@inner(void(SYSTEM, WORK, int64, F1, F1, F1, F1))
def _frame_residual(system, work, b, acceleration, multipliers, friction, residual):
    """M z_II' - f - C^T lambda of the frame of a body, without the unknown
    multipliers.
    """
    first, rigid = system.body[b].vel, system.body[b].rd
    for i in range(rigid):
        residual[i] = mass_row_product(system, work.M, b, i, acceleration)
        residual[i] -= work.f[first + i]
    for s in range(system.body[b].seg0, system.body[b].seg1):
        at, row = system.segment[s].offset, system.segment[s].row
        for i in range(rigid):
            residual[i] -= work.C[at + i] * multipliers[row]
    friction_segments = system.friction_subsystem.segment
    for s in range(len(friction_segments)):
        if friction_segments[s].body == b:
            at = friction_segments[s].offset
            for i in range(rigid):
                residual[i] -= work.C[at + i] * friction[friction_segments[s].row]


@inner(int64(SYSTEM, WORK, I1, F1, F2, F1, I1))
def _solve_joint_multipliers(
    system, work, driven_joints, multipliers, H, residual, pivots
):
    """Multipliers of the joint of one body; 1 if it does not constrain its frame."""
    b = driven_joints[D_BODY]
    n = system.body[b].rd
    for j in range(n):
        for i in range(n):
            H[i, j] = 0.0
        for s in range(system.body[b].seg0, system.body[b].seg1):
            if system.segment[s].row == driven_joints[D_ROWS + j]:
                for i in range(n):
                    H[i, j] += work.C[system.segment[s].offset + i]
    if band_factor(H, n, n, pivots) != 0:
        return 1
    band_solve(H, n, n, pivots, residual)
    for j in range(n):
        multipliers[driven_joints[D_ROWS + j]] = residual[j]
    return 0


@entry(void(KERNELS, SYSTEM, WORK, I2, F1, F1, F2, F2, F2, F2, F2, F2, I1))
def driven_joint_reactions(
    kernels,
    system,
    work,
    driven_joints,
    times,
    interval_times,
    z,
    v,
    accelerations,
    friction,
    multipliers,
    H,
    pivots,
):
    """Multipliers of the joints of prescribed bodies in some states, into
    `multipliers`.

    On input these contain the multipliers of all other rows, and zeros. They are NaN
    where a joint does not constrain its frame. H is scratch of one row more than a
    frame has coordinates.
    """
    residual = H[MAX_ROWS]
    for k in range(len(times)):
        work.interval_time[0] = interval_times[k]
        kernels.evaluate(system, work, times[k], z[k], v[k])
        for c in range(len(driven_joints) - 1, -1, -1):
            b = driven_joints[c, D_BODY]
            _frame_residual(
                system, work, b, accelerations[k], multipliers[k], friction[k], residual
            )
            if (
                _solve_joint_multipliers(
                    system, work, driven_joints[c], multipliers[k], H, residual, pivots
                )
                != 0
            ):
                for j in range(system.body[b].rd):
                    multipliers[k, driven_joints[c, D_ROWS + j]] = math.nan
