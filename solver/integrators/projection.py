"""Projection onto the constraints, eq. (18), and update of the rotation counters."""

from ..compiler.kernels import inner
from ..compiler.types import float64, int64, void
from ..linear.factor_storage import KERNELS, MEMORY
from ..linear.saddle_point import REGULARISATION
from ..spatial.system_arrays import (
    C_RATE,
    C_VALUE,
    F1,
    F2,
    ROTATION_RATE,
    ROTATION_VALUE,
    SYSTEM,
    WORK,
    is_sticking,
)
from .loop_state import CONTROL

#: Most attempts of a projection.
PROJECTIONS_LIMIT = 6
#: Attempts after which positions that meet the constraints are not moved any more.
MAX_POSITION_MOVES = 3
#: Attempts after which rates count as zero that are rounding of their terms, and what
#: rounding is, relative to these, where so little is requested: in long runs.
ROUNDING_ATTEMPTS, RATE_ROUNDING = 2, 1e-15
#: Most that one marker turns against another in a step where turns are counted, of the
#: half turn that two orientations determine [rad].
MAX_ROTATION_PER_STEP = 2.5


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, float64, F1, F1))
def evaluate_accelerations(kernels, system, work, memory, t, z, v):
    """z_II' and lambda of eq. (3) with the constraints differentiated twice (index 1).

    Returns 0, or the code of a singular system.
    """
    kernels.evaluate(system, work, t, z, v)
    memory.evaluations += 1
    return kernels.solve_accelerations(system, work, memory)


@inner(float64(SYSTEM, WORK, F1, int64))
def _rate_rounding(system, work, v, row):
    """Rounding error of the rate of a constraint, whose terms have the size of C v."""
    total = 0.0
    for k in range(len(system.segment)):
        if system.segment[k].row == row:
            at, b = system.segment[k].offset, system.segment[k].body
            first = system.body[b].vel
            for i in range(system.body[b].nv):
                total += abs(work.C[at + i] * v[first + i])
    return RATE_ROUNDING * total


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, float64, F1, F1, F1, F1, F2))
def project_state(kernels, system, work, memory, t, z, v, dz, dv, constraint_tolerance):
    """Brings z and v onto the constraints, eq. (18), then solves for accelerations.

    Done when every |c| and |dc/dt| is below those in `constraint_tolerance`, at the
    last attempt a hundred times that. dz and dv are scratch. Quaternions get unit
    length even where no constraint moves their body. Positions that meet the
    constraints stay in the last attempts: near a singular configuration, to move them
    by rounding spoils velocities. Returns 0, or a code when the constraints are
    singular or cannot be met.
    """
    m = system.n_rows
    if system.planar == 0:
        for i in range(len(dz)):
            dz[i] = 0.0
        kernels.retract(system, work.frame, z, dz)
    for attempt in range(PROJECTIONS_LIMIT):
        kernels.evaluate(system, work, t, z, v)
        memory.evaluations += 1
        factor = 1.0 if attempt + 1 < PROJECTIONS_LIMIT else 100.0
        positions_met = velocities_met = True
        for i in range(m):
            positions_met = (
                positions_met
                and abs(work.row[i, C_VALUE]) <= factor * constraint_tolerance[i, 0]
            )
            rate = abs(work.row[i, C_RATE])
            if rate > factor * constraint_tolerance[i, 1]:
                is_rounding = (
                    attempt >= ROUNDING_ATTEMPTS
                    and constraint_tolerance[i, 1] < RATE_ROUNDING
                )
                is_rounding = is_rounding and rate <= _rate_rounding(system, work, v, i)
                velocities_met = velocities_met and is_rounding
        for j in range(len(system.friction)):
            if is_sticking(system, j):
                row = work.friction_subsystem.row[j]
                positions_met = (
                    positions_met
                    and abs(row[C_VALUE]) <= factor * constraint_tolerance[m + j, 0]
                )
                velocities_met = (
                    velocities_met
                    and abs(row[C_RATE]) <= factor * constraint_tolerance[m + j, 1]
                )
        if positions_met and velocities_met:
            return kernels.solve_accelerations(system, work, memory)
        memory.projections += 1
        status = kernels.project_once(system, work, memory, REGULARISATION, dz, dv)
        if status != 0:
            return status
        if attempt < MAX_POSITION_MOVES or not positions_met:
            kernels.retract(system, work.frame, z, dz)
        for i in range(len(v)):
            v[i] += dv[i]
    return 3


@inner(void(SYSTEM, WORK, F1, int64))
def constraint_velocities(system, work, x, column):
    """C x of a tangent vector x, into a column of the rows."""
    for i in range(system.n_rows):
        work.row[i, column] = 0.0
    for k in range(len(system.segment)):
        row, at = system.segment[k].row, system.segment[k].offset
        b = system.segment[k].body
        first = system.body[b].vel
        for i in range(system.body[b].nv):
            work.row[row, column] += work.C[at + i] * x[first + i]


@inner(void(SYSTEM, WORK, CONTROL))
def record_drift(system, work, control):
    """Update the largest residuals of the constraints that were just evaluated."""
    for i in range(system.n_rows):
        control.position_drift = max(control.position_drift, abs(work.row[i, C_VALUE]))
        control.velocity_drift = max(control.velocity_drift, abs(work.row[i, C_RATE]))


@inner(int64(SYSTEM, WORK, CONTROL, float64, F1))
def count_rotations(system, work, control, h, z):
    """Update the rotation counters in z at the end of a step that was just evaluated.

    Returns 0, or 4 if the rotation in the step was too large to be certain.
    """
    count = system.n_rotation_counters
    first, fastest = len(z) - count, 0.0
    for i in range(count):
        rotation = abs(work.rotation_counter[i, ROTATION_VALUE] - z[first + i])
        fastest = max(
            fastest, rotation / h, abs(work.rotation_counter[i, ROTATION_RATE])
        )
    if h * fastest > MAX_ROTATION_PER_STEP:
        return 4
    control.rotation_step_limit = 0.8 * MAX_ROTATION_PER_STEP / max(fastest, 1e-300)
    for i in range(count):
        z[first + i] = work.rotation_counter[i, ROTATION_VALUE]
    return 0
