"""The trapezoidal rule with variable step on the index-1 equations, eq. (20).

Simplified Newton iteration; local error h^3 y''' / 12 from divided differences of the
slopes, filtered so that stiff components do not spoil it. The Jacobian is stored in
saddle-point form, and positions and velocities are projected after every accepted step.
The start, solution and end of a step serve any method of one stage.

References
----------
L. F. Shampine, M. W. Reichelt, J. A. Kierzenka: Solving Index-1 DAEs in MATLAB and
Simulink. SIAM Review 41 (1999).
M. E. Hosea, L. F. Shampine: Analysis and implementation of TR-BDF2. Applied Numerical
Mathematics 20 (1996).
"""

from ..compiler.kernels import inner
from ..compiler.tables import Table, TableType
from ..compiler.types import float64, int64, void
from ..linear.factor_storage import KERNELS, MEMORY
from ..spatial.system_arrays import SYSTEM, WORK, Reals
from .implicit_loop import step_loop
from .loop_state import CONTROL, copy
from .newton_iteration import check_convergence, decay_contraction_rate, newton_limit
from .output_sampling import advance_state, write_cubic
from .projection import evaluate_accelerations
from .singular_configurations import project_step_end, project_velocity_error
from .step_size import scaled_norm

#: A Jacobian is kept while Newton's iteration contracts the error this much.
JACOBIAN_CONTRACTION = 1e-2
#: What Newton's iteration may leave of the tolerance.
NEWTON_GOAL = 0.03
#: Corrections that no longer shrink are rounding; they may be so much of the tolerance.
STAGNATION_LIMIT = 0.3


class TrapezoidalSlopes(Table):
    """Slopes at the beginning of this step and of the last one, and scratch vectors."""

    rate0: Reals
    acc0: Reals
    old_rate: Reals
    old_acc: Reals
    z1: Reals
    v1: Reals
    rz: Reals
    rv: Reals


SLOPES = TableType(TrapezoidalSlopes)


def new_slopes(n_positions: int, n_velocities: int) -> TrapezoidalSlopes:
    """Storage for a run."""
    z = dict.fromkeys(("rate0", "old_rate", "z1", "rz"), (n_positions,))
    v = dict.fromkeys(("acc0", "old_acc", "v1", "rv"), (n_velocities,))
    return TrapezoidalSlopes.zeros(**z, **v)


@inner(void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, SLOPES))
def begin_step(kernels, system, work, memory, control, slopes):
    """Shifts the slopes by one step."""
    copy(slopes.rate0, slopes.old_rate)
    copy(slopes.acc0, slopes.old_acc)
    kernels.rate(system, control.z, control.v, slopes.rate0)
    copy(memory.acceleration, slopes.acc0)


@inner(void(KERNELS, SYSTEM, CONTROL, SLOPES, float64))
def predict(kernels, system, control, slopes, h):
    """Predict the end of the step: slopes continue to change as before."""
    old = control.old_step
    curvature = 0.5 * h * h / old if old > 0.0 else 0.0
    for i in range(len(slopes.z1)):
        change = slopes.rate0[i] - slopes.old_rate[i]
        slopes.z1[i] = control.z[i] + h * slopes.rate0[i] + curvature * change
    for i in range(len(slopes.v1)):
        change = slopes.acc0[i] - slopes.old_acc[i]
        slopes.v1[i] = control.v[i] + h * slopes.acc0[i] + curvature * change


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, SLOPES, float64))
def _newton(kernels, system, work, memory, control, slopes, h):
    """Solves y1 = y0 + h (y0' + y1') / 2; iterations used, or 0 without convergence."""
    mu = 2.0 / h
    predict(kernels, system, control, slopes, h)
    decay_contraction_rate(control)
    stagnation_limit = min(STAGNATION_LIMIT, control.rounding_noise)
    old_norm = 0.0
    for iteration in range(newton_limit(control)):
        z1, v1 = slopes.z1, slopes.v1
        if (
            evaluate_accelerations(
                kernels, system, work, memory, control.time + h, z1, v1
            )
            != 0
        ):
            return 0
        kernels.rate(system, z1, v1, slopes.rz)
        for i in range(len(z1)):
            slopes.rz[i] += slopes.rate0[i] - mu * (z1[i] - control.z[i])
        for i in range(len(v1)):
            slope = memory.acceleration[i] + slopes.acc0[i]
            slopes.rv[i] = slope - mu * (v1[i] - control.v[i])
        rz, rv = slopes.rz, slopes.rv
        kernels.solve_real(system, work, memory, memory.real, 0, mu, rz, rv)
        memory.newton_iterations += 1
        norm = scaled_norm(slopes.rz, slopes.rv, control.scale_z, control.scale_v)
        convergence = check_convergence(control, NEWTON_GOAL, iteration, norm, old_norm)
        if convergence < 0 and not norm < stagnation_limit:
            return 0
        for i in range(len(z1)):
            z1[i] += slopes.rz[i]
        for i in range(len(v1)):
            v1[i] += slopes.rv[i]
        if convergence != 0:
            return iteration + 1
        old_norm = norm
    return 0


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, SLOPES, float64))
def _error(kernels, system, work, memory, control, slopes, h):
    """Norm of the local error h^3 y''' / 12, filtered by (1 - h J / 2)^-1.

    y''' / 2 is the second divided difference of the slopes; the one at the end of the
    step follows from the rule itself. In a first step, where no slope before is known,
    h y''' counts as y''.
    """
    old, mu = control.old_step, 2.0 / h
    weight, before = h / 6.0, 0.0
    if old > 0.0:
        weight, before = h * h / (6.0 * (h + old)), h / old
    for i in range(len(slopes.rz)):
        change = 2.0 * ((slopes.z1[i] - control.z[i]) / h - slopes.rate0[i])
        change -= before * (slopes.rate0[i] - slopes.old_rate[i])
        slopes.rz[i] = mu * weight * change
    for i in range(len(slopes.rv)):
        change = 2.0 * ((slopes.v1[i] - control.v[i]) / h - slopes.acc0[i])
        change -= before * (slopes.acc0[i] - slopes.old_acc[i])
        slopes.rv[i] = mu * weight * change
    z1, v1, rz, rv = slopes.z1, slopes.v1, slopes.rz, slopes.rv
    kernels.solve_real(system, work, memory, memory.real, 0, mu, rz, rv)
    x, p = memory.real.x, memory.real.p
    project_velocity_error(kernels, system, work, memory, control, h, z1, v1, rv, x, p)
    return scaled_norm(slopes.rz, slopes.rv, control.scale_z, control.scale_v)


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, SLOPES, float64))
def accept(kernels, system, work, memory, control, slopes, h):
    """Moves to the end of the step, projected onto the constraints; 0 on success."""
    z1, v1, x, p = slopes.z1, slopes.v1, memory.real.x, memory.real.p
    status = project_step_end(kernels, system, work, memory, control, h, z1, v1, x, p)
    if status != 0:
        return status
    rate0, acc0, rz = slopes.rate0, slopes.acc0, slopes.rz
    write_cubic(kernels, system, memory, control, h, z1, v1, rate0, acc0, rz)
    advance_state(control, h, z1, v1)
    return 0


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, SLOPES, float64))
def _factor(kernels, system, work, memory, slopes, h):
    return kernels.factor_real(system, work, memory, memory.real, 0, 2.0 / h)


@inner(int64(SLOPES))
def _error_order(slopes):
    """Of the error estimate over the length of the step."""
    return 1


advance = step_loop(
    "trapezoidal",
    SLOPES,
    begin_step,
    _factor,
    _newton,
    _error,
    accept,
    _error_order,
    predict,
    JACOBIAN_CONTRACTION,
)
