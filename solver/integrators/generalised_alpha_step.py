"""Generalised-alpha, eq. (21): coefficients, memory between steps, error estimate."""

import math

import numpy as np

from sidtool.formats.base.sid import Array

from ..compiler.kernels import inner
from ..compiler.tables import Table, TableType
from ..compiler.types import boolean, float64, int64, void
from ..linear.factor_storage import KERNELS, MEMORY
from ..linear.joint_friction import friction_determinant
from ..linear.newton_matrix import add_mass_product
from ..linear.saddle_point import REGULARISATION, saddle_solve
from ..spatial.system_arrays import (
    C_RATE,
    C_VALUE,
    F1,
    R_NEWTON,
    S_OFFSET,
    S_ROW,
    SYSTEM,
    WORK,
    Integers,
    Reals,
    SystemArrays,
)
from .loop_state import CONTROL, copy
from .projection import constraint_velocities
from .singular_configurations import FAR_FROM_SINGULAR, project_step_end
from .step_size import scaled_norm

#: What rounding leaves of positions, relative to their size.
POSITION_ROUNDING = 2e-16

#: Errors are separated from rounding above so many times as much.
ROUNDING_MARGIN = 15.0
#: Steps that determine what of the error estimate is not rounding.
TREND_STEPS = 8.0
#: Determinant of the equations of friction, 1 without it, below which they hardly have
#: a solution.
MIN_FRICTION_DETERMINANT = 0.1
#: Part of the run in which motions may still become much larger.
EARLY_FRACTION = 0.5


class GeneralisedAlphaCoefficients(Table):
    """Of the method, see `coefficients`."""

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    position_error: float
    velocity_error: float
    force_error: float
    curvature: float


#: Its compiled type, which the table of the memory below contains.
COEFFICIENTS = TableType(GeneralisedAlphaCoefficients)


class GeneralisedAlphaMemory(Table):
    """Memory of generalised-alpha: coefficients, state between steps and scratch.

    Attributes
    ----------
    newton_rows
        Row of each constraint in the Newton matrix, -1 for none, followed by those of
        the joints with friction.
    a, v, last_acceleration
        Accelerations, velocities and z_II' of the last step.
    old_a
        Accelerations of the step before.
    a0, v0, acc
        The same at the beginning of this step.
    rate0, acc0
        z_I' and z_II' at the beginning of the step, consistent with the constraints.
    jerk, snap
        First and second slope of `acc0`, from the steps before.
    lambda_, old_lambda
        Multipliers, followed by the friction forces, at the beginning of this step and
        of the step before.
    lambda1
        The same at the end of the step.
    a1, z1, v1
        Values at the end of the step.
    dx
        Motion during the step, in the tangent space.
    rz
        Scratch of the size of z_I.
    constrained_z, constrained_v
        Parts of tangent vectors that the constraints impose.
    p
        Right-hand side and solution of a correction.
    error_tolerance
        Tolerated errors of tangent vectors.
    rounding_position, rounding_velocity
        Smallest errors of both that differ from rounding.
    mean_position_error, mean_velocity_error
        Mean errors of the last steps.
    position_error_sum, velocity_error_sum
        Integrals of the errors over time.
    position_rounding
        Rounding errors of the positions, as a tangent vector.
    """

    newton_rows: Integers
    coefficients: GeneralisedAlphaCoefficients
    a: Reals
    v: Reals
    acc: Reals
    old_a: Reals
    a0: Reals
    v0: Reals
    rate0: Reals
    acc0: Reals
    jerk: Reals
    last_acceleration: Reals
    snap: Reals
    lambda_: Reals
    old_lambda: Reals
    lambda1: Reals
    a1: Reals
    z1: Reals
    v1: Reals
    acc1: Reals
    dx: Reals
    dv: Reals
    rz: Reals
    constrained_z: Reals
    constrained_v: Reals
    p: Reals
    error_tolerance: Reals
    rounding_position: Reals
    rounding_velocity: Reals
    mean_position_error: Reals
    mean_velocity_error: Reals
    position_error_sum: Reals
    velocity_error_sum: Reals
    position_rounding: Reals


ALPHA = TableType(GeneralisedAlphaMemory)


def coefficients(rho: float) -> GeneralisedAlphaCoefficients:
    """Weights for a spectral radius rho at infinite frequency, 0 to 1.

    The errors are those of one step with the exact acceleration z_II' + (alpha_m -
    alpha_f) h z_II'' + ... as a: h^3 z_II'' times `position_error` and h^3 z_II'''
    times `velocity_error`. Where constraints prescribe z_I, z_II' is off by h^2 z_II'''
    times `curvature`.
    """
    alpha_m, alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    shift = alpha_m - alpha_f
    gamma = 0.5 - shift
    beta = 0.25 * (gamma + 0.5) ** 2
    second_order_term = 0.5 * (1.0 - alpha_f) - (1.0 - alpha_m) * (0.5 + shift)
    return GeneralisedAlphaCoefficients(
        alpha_m=alpha_m,
        alpha_f=alpha_f,
        beta=beta,
        gamma=gamma,
        position_error=beta + 0.5 * shift - 1.0 / 6.0,
        velocity_error=second_order_term + gamma * (0.5 + shift) - 1.0 / 6.0,
        force_error=1.0 / 6.0 + 0.5 * shift + 0.25 * shift**2 - (1.0 - alpha_f) * shift,
        curvature=shift**2 + 1.0 / 12.0 - beta - 0.5 * shift,
    )


def new_alpha_memory(
    system: SystemArrays, rho: float, sizes: Array
) -> GeneralisedAlphaMemory:
    """Storage for a run; `sizes` are those of tangent vectors."""
    n, m = system.n_positions, system.n_velocities
    rows = system.n_rows + len(system.friction)
    vectors = dict.fromkeys(GeneralisedAlphaMemory.kind.fields, (m,))
    vectors |= dict.fromkeys(("rate0", "z1", "rz"), (n,))
    vectors |= dict.fromkeys(("lambda_", "old_lambda", "lambda1"), (rows,))
    given = {
        "newton_rows": newton_row_indices(system),
        "coefficients": coefficients(rho),
        "position_rounding": POSITION_ROUNDING * sizes,
    }
    return GeneralisedAlphaMemory.zeros(**(vectors | given))


def newton_row_indices(system: SystemArrays) -> np.ndarray:
    """Row of each constraint in the Newton matrix, -1 for none, followed by those of
    joints with friction.
    """
    newton_rows = np.full(system.n_rows, -1, np.int64)
    newton_row = dict(system.newton_subsystem.segment[:, [S_OFFSET, S_ROW]].tolist())
    for row, offset in system.segment[:, [S_ROW, S_OFFSET]].tolist():
        newton_rows[row] = newton_row[offset]
    return np.append(newton_rows, system.friction[:, R_NEWTON])


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, ALPHA, F1, F1))
def constrained_part(kernels, system, work, memory, alpha, x, y):
    """Move the parts of tangent vectors x and y that constraints impose to
    `constrained_z`, `constrained_v`.

    In the metric of projections: the rigid motion takes them, not the deformation.
    """
    for x_, column in ((x, C_VALUE), (y, C_RATE)):
        constraint_velocities(system, work, x_, column)
        constraint_velocities(
            system.friction_subsystem, work.friction_subsystem, x_, column
        )
    nz, nv = alpha.constrained_z, alpha.constrained_v
    status = kernels.project_once(system, work, memory, REGULARISATION, nz, nv)
    for i in range(len(x)):
        x[i] += nz[i]
        y[i] += nv[i]
    return status


@inner(float64(ALPHA))
def inertia_weight(alpha):
    """h^2 beta'."""
    w = alpha.coefficients
    return (1.0 - w.alpha_m) / (w.beta * (1.0 - w.alpha_f))


@inner(void(SYSTEM, MEMORY, ALPHA, F1))
def apply_newton_matrix(system, memory, alpha, x):
    """Passes a tangent vector through the Newton matrix, into p."""
    for i in range(len(alpha.p)):
        alpha.p[i] = 0.0
    g = memory.real.g
    for i in range(len(g)):
        g[i] = 0.0
    add_mass_product(system, memory.M, x, inertia_weight(alpha), alpha.p)
    saddle_solve(system.newton_subsystem, memory.real, 0, alpha.p, g)


@inner(float64(SYSTEM, CONTROL, ALPHA, float64))
def error_tolerances(system, control, alpha, h):
    """Tolerated errors of tangent vectors, not below rounding; velocities are
    differences of positions.

    Returns the residual that the Newton iteration may leave, in units of rounding:
    constraints turn errors of large motions into errors of small deformations.
    """
    tolerance, rate = math.inf, alpha.coefficients.beta * h / alpha.coefficients.gamma
    for b in range(len(system.body)):
        row = system.body[b]
        rd, nq, u, p = row.rd, row.nq, row.vel, row.pos
        for k in range(rd):
            alpha.error_tolerance[u + k] = control.scale_z[p + k]
        for k in range(nq):
            alpha.error_tolerance[u + rd + k] = control.scale_z[p + row.np - nq + k]
    for i in range(len(alpha.position_rounding)):
        least = ROUNDING_MARGIN * alpha.position_rounding[i]
        alpha.rounding_position[i] = max(alpha.error_tolerance[i], least)
        alpha.rounding_velocity[i] = max(control.scale_v[i], least / h)
        tolerated = min(alpha.rounding_position[i], rate * alpha.rounding_velocity[i])
        tolerance = min(tolerance, tolerated / alpha.position_rounding[i])
    return tolerance


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def local_error(kernels, system, work, memory, control, alpha, h):
    """Norm of the local error, filtered by the Newton matrix for stiff coordinates.

    Position: h^3 z_II'', velocity: h^3 z_II''', from accelerations that are consistent
    with the constraints, as differences of a contain rounding. Parts that the
    constraints impose are not errors of deformations. The step ends on the constraints
    and only has to be accepted.
    """
    singular, independence = control.singular_time, control.independence
    largest_independence, independence_slope, rotation_step_limit = (
        control.largest_independence,
        control.independence_slope,
        control.rotation_step_limit,
    )
    error = math.inf
    copy(alpha.v1, alpha.v0)
    z1, v1, x, y = alpha.z1, alpha.v1, alpha.dx, alpha.dv
    status = project_step_end(kernels, system, work, memory, control, h, z1, v1, x, y)
    if status == 0 and not _lacks_friction_solution(system, memory, control, alpha):
        error = _unconstrained_error(kernels, system, work, memory, control, alpha, h)
    if not error < 1.0:
        control.singular_time, control.independence = singular, independence
        (
            control.largest_independence,
            control.independence_slope,
            control.rotation_step_limit,
        ) = (
            largest_independence,
            independence_slope,
            rotation_step_limit,
        )
    return error


@inner(boolean(SYSTEM, MEMORY, CONTROL, ALPHA))
def _lacks_friction_solution(system, memory, control, alpha):
    """True if friction has hardly a solution, and velocities are rounding already.

    Loads grow without bound there, and steps of rounding would lead past it.
    """
    if len(system.friction) == 0:
        return False
    if (
        friction_determinant(memory.friction_A, memory.friction_pivots)
        > MIN_FRICTION_DETERMINANT
    ):
        return False
    rounded = 0
    for i in range(len(alpha.rounding_velocity)):
        if alpha.rounding_velocity[i] > control.scale_v[i]:
            rounded += 1
    return rounded > 0


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _unconstrained_error(kernels, system, work, memory, control, alpha, h):
    """The estimate, after the end of the step was brought onto the constraints."""
    w, x, y, old = alpha.coefficients, alpha.dx, alpha.dv, control.old_step
    for i in range(len(x)):
        jerk = (memory.acceleration[i] - alpha.acc0[i]) / h
        x[i] = w.position_error * h * h * h * jerk
        y[i] = w.velocity_error * h * h * h * (jerk - alpha.jerk[i]) / (0.5 * (h + old))
    if constrained_part(kernels, system, work, memory, alpha, x, y) != 0:
        return math.inf
    apply_newton_matrix(system, memory, alpha, x)
    copy(alpha.p, x)
    apply_newton_matrix(system, memory, alpha, y)
    if control.singular_proximity == FAR_FROM_SINGULAR:
        for b in range(len(system.body)):
            first = system.body[b].vel
            for i in range(first, first + system.body[b].rd):
                x[i] -= alpha.constrained_z[i]
                alpha.p[i] -= alpha.constrained_v[i]
    error = scaled_norm(x, alpha.p, alpha.rounding_position, alpha.rounding_velocity)
    return max(error, _rotation_interpolation_error(system, control, h))


@inner(void(CONTROL, ALPHA))
def accumulate_error(control, alpha):
    """Accumulate the errors of steps, in units of the tolerated total error.

    The result is larger than one where the error cannot be distinguished from rounding,
    which changes its sign from step to step. Not evaluated before the largest motions
    are known.
    """
    sum_x, sum_v = alpha.position_error_sum, alpha.velocity_error_sum
    for i in range(len(sum_x)):
        alpha.mean_position_error[i] += (
            alpha.dx[i] - alpha.mean_position_error[i]
        ) / TREND_STEPS
        alpha.mean_velocity_error[i] += (
            alpha.p[i] - alpha.mean_velocity_error[i]
        ) / TREND_STEPS
        sum_x[i] += abs(alpha.mean_position_error[i])
        sum_v[i] += abs(alpha.mean_velocity_error[i])
    if control.time - control.start_time > EARLY_FRACTION * control.duration:
        total = scaled_norm(sum_x, sum_v, alpha.error_tolerance, control.scale_v)
        control.accumulated_error = total * control.tolerance_share


@inner(float64(SYSTEM, CONTROL, float64))
def _rotation_interpolation_error(system, control, h):
    """Interpolation error of frames that rotate steadily, for which the steps are
    exact.

    A cubic misses y'''' / 384 in the middle of a step of one: for positions speed times
    (angular velocity)^3, for quaternions (angular velocity / 2)^4. It does not
    accumulate.
    """
    largest, v = 0.0, control.v
    for b in range(len(system.body)):
        row = system.body[b]
        rd, u, p = row.rd, row.vel, row.pos
        if rd == 6:
            path = h * math.sqrt(
                v[u] * v[u] + v[u + 1] * v[u + 1] + v[u + 2] * v[u + 2]
            )
            x, y, z = v[u + 3], v[u + 4], v[u + 5]
            angle = h * math.sqrt(x * x + y * y + z * z)
            largest = max(largest, (0.5 * angle) ** 4 / control.scale_z[p + 3])
        elif rd == 3 and system.planar == 1:
            path = h * math.sqrt(v[u] * v[u] + v[u + 1] * v[u + 1])
            angle = h * abs(v[u + 2])
        else:
            continue
        largest = max(largest, path * angle**3 / control.scale_z[p])
    return largest / 384.0 * control.tolerance_share
