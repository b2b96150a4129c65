"""States on the constraints: projection, and turns counted on the way."""

from __future__ import annotations

from numba import float64, int64, types

from ..compiler.compiling import inner
from ..linear.grips import sticks
from ..linear.memory import KERNELS, MEMORY
from ..linear.saddle import REGULARISATION
from ..space.layout import (
    C_RATE,
    C_VALUE,
    F1,
    F2,
    SYSTEM,
    TURN_RATE,
    TURNED,
    WORK,
)
from .stepping import CONTROL

#: Most attempts of a projection.
PROJECTIONS_LIMIT = 6
#: Attempts after which positions that meet the constraints are not moved any more.
SETTLING = 3
#: Attempts after which rates count as zero that are rounding of their terms, and what
#: rounding is, relative to these, where so little is asked for: in long runs.
ROUNDED, RATE_ROUNDING = 2, 1e-15
#: Most that one marker turns against another in a step where turns are counted, of the
#: half turn that two orientations tell [rad].
LARGEST_TURN = 2.5


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, float64, F1, F1))
def accelerate(kernels, system, work, memory, t, z, v):
    """z_II' and lambda of eq. (3) with the constraints differentiated twice (index 1).

    Returns 0, or the code of a singular system.
    """
    kernels.evaluate(system, work, t, z, v)
    memory.evaluations += 1
    return kernels.solve_accelerations(system, work, memory)


@inner(float64(SYSTEM, WORK, F1, int64))
def _rate_rounding(system, work, v, row):
    """What rounding leaves of a constraint's rate: its terms are of the size of C v."""
    total = 0.0
    for k in range(len(system.segment)):
        if system.segment[k].row == row:
            at, b = system.segment[k].offset, system.segment[k].body
            first = system.body[b].vel
            for i in range(system.body[b].nv):
                total += abs(work.C[at + i] * v[first + i])
    return RATE_ROUNDING * total


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, float64, F1, F1, F1, F1, F2))
def project(kernels, system, work, memory, t, z, v, dz, dv, closed):
    """Brings z and v onto the constraints, eq. (18), then solves for accelerations.

    Done when every |c| and |dc/dt| is below those in `closed`, at the last attempt a
    hundred times that. dz and dv are scratch.
    Quaternions get unit length even where no constraint moves their body. Positions
    that meet the constraints stay in the last attempts: near a singular position, to
    move them by rounding spoils velocities.
    Returns 0, or a code when the constraints are singular or cannot be met.
    """
    m = system.n_rows
    if system.planar == 0:
        for i in range(len(dz)):
            dz[i] = 0.0
        kernels.retract(system, work.frame, z, dz)
    for attempt in range(PROJECTIONS_LIMIT):
        kernels.evaluate(system, work, t, z, v)
        memory.evaluations += 1
        loose = 1.0 if attempt + 1 < PROJECTIONS_LIMIT else 100.0
        placed = still = True
        for i in range(m):
            placed = placed and abs(work.row[i, C_VALUE]) <= loose * closed[i, 0]
            rate = abs(work.row[i, C_RATE])
            if rate > loose * closed[i, 1]:
                is_rounding = attempt >= ROUNDED and closed[i, 1] < RATE_ROUNDING
                is_rounding = is_rounding and rate <= _rate_rounding(system, work, v, i)
                still = still and is_rounding
        for j in range(len(system.friction)):
            if sticks(system, j):
                row = work.sliding.row[j]
                placed = placed and abs(row[C_VALUE]) <= loose * closed[m + j, 0]
                still = still and abs(row[C_RATE]) <= loose * closed[m + j, 1]
        if placed and still:
            return kernels.solve_accelerations(system, work, memory)
        memory.projections += 1
        status = kernels.project_once(system, work, memory, REGULARISATION, dz, dv)
        if status != 0:
            return status
        if attempt < SETTLING or not placed:
            kernels.retract(system, work.frame, z, dz)
        for i in range(len(v)):
            v[i] += dv[i]
    return 3


@inner(types.void(SYSTEM, WORK, F1, int64))
def rates_of_rows(system, work, x, column):
    """C x of a tangent vector x, into a column of the rows."""
    for i in range(system.n_rows):
        work.row[i, column] = 0.0
    for k in range(len(system.segment)):
        row, at = system.segment[k].row, system.segment[k].offset
        b = system.segment[k].body
        first = system.body[b].vel
        for i in range(system.body[b].nv):
            work.row[row, column] += work.C[at + i] * x[first + i]


@inner(types.void(SYSTEM, WORK, CONTROL))
def note_drift(system, work, control):
    """Keeps the largest residuals of the constraints, just evaluated."""
    for i in range(system.n_rows):
        control.drift = max(control.drift, abs(work.row[i, C_VALUE]))
        control.drift_rate = max(control.drift_rate, abs(work.row[i, C_RATE]))


@inner(int64(SYSTEM, WORK, CONTROL, float64, F1))
def count_turns(system, work, control, h, z):
    """Lets z, at the end of a step and just evaluated, say how far its markers turned.

    Returns 0, or 4 when they turned too far in the step to be sure.
    """
    count = system.n_turns
    first, fastest = len(z) - count, 0.0
    for i in range(count):
        way = abs(work.turn[i, TURNED] - z[first + i])
        fastest = max(fastest, way / h, abs(work.turn[i, TURN_RATE]))
    if h * fastest > LARGEST_TURN:
        return 4
    control.unturned = 0.8 * LARGEST_TURN / max(fastest, 1e-300)
    for i in range(count):
        z[first + i] = work.turn[i, TURNED]
    return 0
