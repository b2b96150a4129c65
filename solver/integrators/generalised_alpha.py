"""Generalised-alpha on the index-3 equations, fixed or variable step, eq. (21).

A step finds accelerations with M z_II' - C^T lambda = f and c = 0 at its end, where

    z_I   = z_I0 moved with h z_II0 + h^2 ((1/2 - beta) a0 + beta a1) for one unit,
    z_II  = z_II0 + h ((1 - gamma) a0 + gamma a1),
    (1 - alpha_m) a1 + alpha_m a0 = (1 - alpha_f) z_II' + alpha_f z_II0'.

Positions and velocities are projected onto the constraints after every step.

References
----------
J. Chung, G. M. Hulbert: A time integration algorithm for structural dynamics with
improved numerical dissipation: the generalized-alpha method. Journal of Applied
Mechanics 60 (1993), for the coefficients.
M. Arnold, O. Bruels: Convergence of the generalized-alpha scheme for constrained
mechanical systems. Multibody System Dynamics 18 (2007), for constraints.
O. Bruels, A. Cardona, M. Arnold: Lie group generalized-alpha time integration of
constrained flexible multibody systems. Mechanism and Machine Theory 48 (2012), for
frames with body-resolved velocities.
"""

from ..compiler.kernels import inner
from ..compiler.types import float64, int64, void
from ..linear.factor_storage import KERNELS, MEMORY
from ..linear.newton_matrix import index3_factor, index3_residual
from ..linear.saddle_point import REGULARISATION, saddle_solve
from ..spatial.coordinates import chord_of_screw, update_along_chord
from ..spatial.system_arrays import SYSTEM, WORK
from .generalised_alpha_step import (
    ALPHA,
    accumulate_error,
    apply_newton_matrix,
    constrained_part,
    error_tolerances,
    inertia_weight,
    local_error,
)
from .implicit_loop import step_loop
from .loop_state import CONTROL, END_TOLERANCE, copy
from .newton_iteration import check_convergence, decay_contraction_rate, newton_limit
from .output_sampling import advance_state, write_cubic
from .projection import count_rotations, evaluate_accelerations, record_drift
from .singular_configurations import (
    FAR_FROM_SINGULAR,
    SINGULAR,
    SINGULAR_REGULARISATION,
    project_step_end,
)
from .step_limits import check_measure_paths
from .step_size import choose_next_step_in_stages

#: A Jacobian is kept while Newton's iteration contracts the error this much.
JACOBIAN_CONTRACTION = 0.1
#: After a break, part of the step before it.
FIRST_STEP_FACTOR = 0.3
#: The first jerk is a difference over this part of the first step.
JERK_STEP = 0.01
#: What Newton's iteration may leave of the tolerance.
NEWTON_GOAL = 0.03
#: Corrections that no longer shrink are rounding below so many times as much, where
#: constraints are independent.
STAGNATION_FACTOR = 100.0


@inner(void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA))
def _begin_step(kernels, system, work, memory, control, alpha):
    """Slopes at the beginning."""
    old = control.old_step
    kernels.rate(system, control.z, control.v, alpha.rate0)
    if old > 0.0:
        for i in range(len(alpha.acc0)):
            jerk = (memory.acceleration[i] - alpha.acc0[i]) / old
            alpha.snap[i] = (jerk - alpha.jerk[i]) / old
            alpha.jerk[i] = jerk
    copy(memory.acceleration, alpha.acc0)
    if old == 0.0:
        _initial_jerk(kernels, system, work, memory, control, alpha)


@inner(void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA))
def _initial_jerk(kernels, system, work, memory, control, alpha):
    """The slope of the acceleration after a break, and the slope of that."""
    t, jerk_step = control.time, JERK_STEP * control.step
    copy(control.z, alpha.z1)
    copy(control.v, alpha.v1)
    for _ in range(2):
        kernels.rate(system, alpha.z1, alpha.v1, alpha.rz)
        for i in range(len(alpha.v1)):
            stiff = (jerk_step * control.frequency[i]) ** 2
            velocity_change = jerk_step * memory.acceleration[i] / (1.0 + stiff)
            alpha.dx[i] = alpha.v1[i] + 0.5 * velocity_change
            alpha.v1[i] += velocity_change
            alpha.p[i] = memory.acceleration[i]
        kernels.rate(system, alpha.z1, alpha.dx, alpha.rz)
        for i in range(len(alpha.z1)):
            alpha.z1[i] += jerk_step * alpha.rz[i]
        t += jerk_step
        evaluate_accelerations(kernels, system, work, memory, t, alpha.z1, alpha.v1)
        for i in range(len(alpha.acc0)):
            jerk = (memory.acceleration[i] - alpha.p[i]) / jerk_step
            alpha.snap[i] = (jerk - alpha.jerk[i]) / jerk_step
            alpha.jerk[i] = jerk
    for i in range(len(alpha.jerk)):
        alpha.jerk[i] -= 1.5 * jerk_step * alpha.snap[i]
    t = control.time
    evaluate_accelerations(kernels, system, work, memory, t, control.z, control.v)
    copy(memory.multiplier, alpha.lambda_)
    first = len(memory.multiplier)
    for j in range(len(system.friction)):
        alpha.lambda_[first + j] = work.friction_force[j]
    copy(alpha.lambda_, alpha.old_lambda)


@inner(void(KERNELS, SYSTEM, CONTROL, ALPHA, float64))
def _set_end_state(kernels, system, control, alpha, h):
    """z_I, z_II and z_II' at the end of the step from a1.

    Frames follow the screw of dx, the exponential map.
    """
    w = alpha.coefficients
    beta, gamma, am, af = w.beta, w.gamma, w.alpha_m, w.alpha_f
    for i in range(len(alpha.a1)):
        a0, a1, v0 = alpha.a0[i], alpha.a1[i], alpha.v0[i]
        alpha.dx[i] = h * (v0 + h * ((0.5 - beta) * a0 + beta * a1))
        alpha.v1[i] = v0 + h * ((1.0 - gamma) * a0 + gamma * a1)
        change = (1.0 - am) * a1 + am * a0 - af * alpha.acc[i]
        alpha.acc1[i] = change / (1.0 - af)
    chord_of_screw(system, alpha.dx, alpha.p)
    kernels.rate(system, control.z, alpha.p, alpha.rz)
    update_along_chord(system, control.z, alpha.dx, alpha.rz, alpha.z1)


@inner(void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _predict_step(kernels, system, work, memory, control, alpha, h):
    """Set a and v of the algorithm for the next step, and predict a1 and lambda.

    With a constant step, a and v are continued. When the step changes they are
    initialised as in a smooth motion: rounding in a and v would grow with the steps.
    """
    old, w = control.old_step, alpha.coefficients
    ratio = h / old if old > 0.0 else 0.0
    for i in range(len(alpha.lambda_)):
        alpha.lambda1[i] = alpha.lambda_[i] + ratio * (
            alpha.lambda_[i] - alpha.old_lambda[i]
        )
    if abs(ratio - 1.0) <= END_TOLERANCE:
        copy(alpha.last_acceleration, alpha.acc)
        copy(alpha.v, alpha.v0)
        for i in range(len(alpha.a)):
            alpha.a0[i] = alpha.a[i]
            alpha.a1[i] = 2.0 * alpha.a[i] - alpha.old_a[i]
        return
    x, y = alpha.dx, alpha.dv
    for i in range(len(x)):
        x[i] = h * (alpha.jerk[i] + 0.5 * old * alpha.snap[i])
        y[i] = h * h * alpha.snap[i]
    constrained_part(kernels, system, work, memory, alpha, x, y)
    apply_newton_matrix(system, memory, alpha, x)
    for i in range(len(x)):
        x[i] = alpha.p[i] - alpha.constrained_z[i]
    apply_newton_matrix(system, memory, alpha, y)
    for i in range(len(y)):
        y[i] = alpha.p[i] - alpha.constrained_v[i]
    apply_newton_matrix(system, memory, alpha, y)
    alpha_shift = w.alpha_m - w.alpha_f
    for i in range(len(alpha.a)):
        alpha.acc[i] = alpha.acc0[i] - w.force_error * (y[i] - alpha.p[i])
        alpha.a0[i] = (
            alpha.acc[i] + (w.force_error + w.curvature) * y[i] + alpha_shift * x[i]
        )
        alpha.a1[i] = alpha.a0[i] + x[i] + (0.5 + alpha_shift) * y[i]
    copy(control.v, alpha.v0)
    _set_end_state(kernels, system, control, alpha, h)
    kernels.evaluate(system, work, control.time + h, alpha.z1, alpha.v1)
    memory.evaluations += 1
    regularisation = REGULARISATION
    if control.singular_proximity != FAR_FROM_SINGULAR:
        regularisation = SINGULAR_REGULARISATION / control.relative_tolerance
    kernels.project_once(
        system, work, memory, regularisation, alpha.constrained_z, alpha.constrained_v
    )
    for i in range(len(alpha.v0)):
        alpha.v0[i] += alpha.constrained_z[i] / h


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, ALPHA, float64))
def _factor(kernels, system, work, memory, alpha, h):
    damping = h * alpha.coefficients.gamma / alpha.coefficients.beta
    return index3_factor(system, work, memory, inertia_weight(alpha), damping, h * h)


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _newton(kernels, system, work, memory, control, alpha, h):
    """Finds a1 and lambda; iterations used, or 0 without convergence."""
    h2 = h * h
    by_a = 1.0 / (alpha.coefficients.beta * h2)
    tolerance = error_tolerances(system, control, alpha, h)
    _predict_step(kernels, system, work, memory, control, alpha, h)
    decay_contraction_rate(control)
    stagnation_limit = STAGNATION_FACTOR / max(control.independence, SINGULAR)
    old_size = 0.0
    for iteration in range(newton_limit(control)):
        _set_end_state(kernels, system, control, alpha, h)
        kernels.evaluate(system, work, control.time + h, alpha.z1, alpha.v1)
        memory.evaluations += 1
        p, g, lam1 = alpha.p, memory.real.g, alpha.lambda1
        index3_residual(system, work, alpha.newton_rows, alpha.acc1, lam1, h2, p, g)
        saddle_solve(system.newton_subsystem, memory.real, 0, p, g)
        memory.newton_iterations += 1
        norm = size = 0.0
        for i in range(len(p)):
            alpha.a1[i] += by_a * p[i]
            norm = max(norm, abs(p[i]) / alpha.position_rounding[i])
            size = max(size, abs(p[i]) / alpha.rounding_position[i])
        if control.fixed_step == 0:
            size = norm / tolerance
        for i in range(len(alpha.newton_rows)):
            if alpha.newton_rows[i] >= 0:
                lam1[i] += g[alpha.newton_rows[i]] / h2
        convergence = check_convergence(control, NEWTON_GOAL, iteration, size, old_size)
        if (
            convergence == 1
            or norm < 1.0
            or (convergence < 0 and norm < stagnation_limit)
        ):
            _set_end_state(kernels, system, control, alpha, h)
            return iteration + 1
        if convergence < 0:
            return 0
        old_size = size
    return 0


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _accept(kernels, system, work, memory, control, alpha, h):
    """Move the algorithm to the end of the step; 0 on success.

    With error control the end meets the constraints of position and velocity already.
    Fixed steps end as the algorithm does, except at the end of an interval: steps of
    one length need no projection, and recorded states are projected anyway. Every end
    is checked for a solution of friction.
    """
    z1, v1 = alpha.z1, alpha.v1
    if control.fixed_step == 1:
        copy(v1, alpha.v0)
        if control.time + 1.5 * h < control.stop and len(system.friction) == 0:
            status = count_rotations(system, work, control, h, z1)
            if status == 0:
                status = check_measure_paths(work, control, h)
            copy(alpha.acc1, memory.acceleration)
            record_drift(system, work, control)
        else:
            x, y = alpha.dx, alpha.dv
            status = project_step_end(
                kernels, system, work, memory, control, h, z1, v1, x, y
            )
        if status != 0:
            return status
    else:
        accumulate_error(control, alpha)
    first = len(memory.multiplier)
    for i in range(first):
        memory.multiplier[i] = alpha.lambda1[i]
    for j in range(len(system.friction)):
        work.friction_force[j] = alpha.lambda1[first + j]
    write_cubic(
        kernels, system, memory, control, h, z1, v1, alpha.rate0, alpha.acc0, alpha.rz
    )
    advance_state(control, h, z1, v1)
    copy(alpha.v0, alpha.v)
    copy(alpha.a0, alpha.old_a)
    copy(alpha.a1, alpha.a)
    copy(alpha.acc1, alpha.last_acceleration)
    copy(alpha.lambda_, alpha.old_lambda)
    copy(alpha.lambda1, alpha.lambda_)
    return 0


@inner(int64(ALPHA))
def _error_order(alpha):
    """Of the error estimate over the length of the step."""
    return 1


@inner(void(KERNELS, SYSTEM, CONTROL, ALPHA, float64))
def _predict_step_end(kernels, system, control, alpha, h):
    """The end of the step if accelerations stay as they are; `a` may be off."""
    for i in range(len(alpha.v1)):
        alpha.v1[i] = control.v[i] + 0.5 * h * alpha.acc0[i]
    kernels.rate(system, control.z, alpha.v1, alpha.rz)
    for i in range(len(alpha.z1)):
        alpha.z1[i] = control.z[i] + h * alpha.rz[i]
    for i in range(len(alpha.v1)):
        alpha.v1[i] += 0.5 * h * alpha.acc0[i]


advance = step_loop(
    "generalised_alpha",
    ALPHA,
    _begin_step,
    _factor,
    _newton,
    local_error,
    _accept,
    _error_order,
    _predict_step_end,
    JACOBIAN_CONTRACTION,
    FIRST_STEP_FACTOR,
    finish=choose_next_step_in_stages,
)
