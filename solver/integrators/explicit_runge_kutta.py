"""Explicit Runge-Kutta method of order 8 (DOP853) on the index-1 equations.

For scenes whose fastest vibration is part of the requested motion: nothing is
linearised or iterated. Positions and velocities are projected onto the constraints
after every accepted step.

References
----------
E. Hairer, S. P. Norsett, G. Wanner: Solving Ordinary Differential Equations I, sections
II.5, II.6 and II.10. The test for stiffness: E. Hairer, G. Wanner, part II, section
IV.2.
"""

import math

from ..compiler.kernels import entry, inner
from ..compiler.tables import Table, TableType
from ..compiler.types import boolean, float64, int64, void
from ..linear.factor_storage import KERNELS, MEMORY
from ..spatial.system_arrays import F1, F2, SYSTEM, WORK, Reals, Reals2
from .dop853_tableau import END_STAGE, N_STAGES, TABLEAU
from .loop_state import (
    CONTROL,
    INTERVAL_END,
    NOT_FINITE,
    OFF_CONSTRAINTS,
    OUTPUT_FULL,
    STEPS_DONE,
    STIFF_STEP_FRACTION,
    TOO_SMALL,
    TOO_STIFF,
    copy,
)
from .output_sampling import (
    advance_state,
    exceeds_output_rows,
    next_output_row,
    step_fraction,
)
from .projection import evaluate_accelerations
from .singular_configurations import (
    NEAR_SINGULAR,
    first_step_from_singularity,
    project_step_end,
    project_velocity_error,
    step_avoiding_singularity,
)
from .step_size import (
    all_finite,
    choose_next_step,
    is_below_time_resolution,
    next_step,
    scaled_norm,
    set_error_tolerances,
    step_size_factor,
    update_error_scales,
)

#: The estimated error falls with this power of the step, less one.
ORDER_OF_ERROR = 7
#: For what the estimate overlooks in large steps, and for the dense output inside.
ERROR_SAFETY = 10.0
#: A step loop keeps a Jacobian up to this contraction: there is none.
NO_JACOBIAN = -1.0
#: Steps times the fastest eigenvalue at which stability ends is 6.0 to 6.4.
STABILITY_LIMIT = 4.0
#: A run is given up after so many steps that stability has limited, if at their size
#: it would take so many in all.
MIN_STIFF_STEPS, MAX_STEPS = 200, 200_000


class StageSlopes(Table):
    """StageSlopes of all stages, a stage, the end of the step, and scratch vectors."""

    Kz: Reals2
    Kv: Reals2
    z: Reals
    v: Reals
    z1: Reals
    v1: Reals
    dz: Reals
    dv: Reals
    p: Reals


STAGE_SLOPES = TableType(StageSlopes)


def new_slopes(n_positions: int, n_velocities: int) -> StageSlopes:
    """Storage for a run."""
    n, m = n_positions, n_velocities
    z, v = (
        dict.fromkeys(("z", "z1", "dz"), (n,)),
        dict.fromkeys(("v", "v1", "dv"), (m,)),
    )
    return StageSlopes.zeros(Kz=(N_STAGES, n), Kv=(N_STAGES, m), **z, **v, p=(m,))


@inner(void(F1, float64, F1, F2, int64, F1))
def _add_slopes(y0, h, weights, K, count, y):
    """y = y0 + h (sum of weighted slopes)."""
    copy(y0, y)
    for j in range(count):
        weight = h * weights[j]
        if weight != 0.0:
            for n in range(len(y)):
                y[n] += weight * K[j, n]


@inner(
    int64(KERNELS, SYSTEM, WORK, MEMORY, TABLEAU, CONTROL, STAGE_SLOPES, float64, int64)
)
def _stage(kernels, system, work, memory, tableau, control, slopes, h, i):
    """The slope of stage i; 0 on success."""
    _add_slopes(control.z, h, tableau.A[i], slopes.Kz, i, slopes.z)
    _add_slopes(control.v, h, tableau.A[i], slopes.Kv, i, slopes.v)
    at = control.time + tableau.c[i] * h
    status = evaluate_accelerations(
        kernels, system, work, memory, at, slopes.z, slopes.v
    )
    kernels.rate(system, slopes.z, slopes.v, slopes.Kz[i])
    copy(memory.acceleration, slopes.Kv[i])
    return status


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, TABLEAU, CONTROL, STAGE_SLOPES, float64))
def _error(kernels, system, work, memory, tableau, control, slopes, h):
    """Norm of the error estimate, composed of those of order 5 and 3."""
    third = _estimate(kernels, system, work, memory, tableau.third, control, slopes, h)
    fifth = 0.0
    for k in range(len(tableau.fifth)):
        w = tableau.fifth[k]
        one = _estimate(kernels, system, work, memory, w, control, slopes, h)
        fifth = max(fifth, one)
    if fifth == 0.0:
        return 0.0
    return (
        ERROR_SAFETY * fifth * fifth / math.sqrt(fifth * fifth + 0.01 * third * third)
    )


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, F1, CONTROL, STAGE_SLOPES, float64))
def _estimate(kernels, system, work, memory, weights, control, slopes, h):
    for x, K in ((slopes.dz, slopes.Kz), (slopes.dv, slopes.Kv)):
        for n in range(len(x)):
            x[n] = 0.0
        _add_slopes(x, h, weights, K, END_STAGE, x)
    z1, v1, dv, p = slopes.z1, slopes.v1, slopes.dv, slopes.p
    project_velocity_error(
        kernels, system, work, memory, control, h, z1, v1, dv, memory.dx, p
    )
    return scaled_norm(slopes.dz, slopes.dv, control.scale_z, control.scale_v)


@inner(void(CONTROL, STAGE_SLOPES, float64))
def _count_stiff_steps(control, slopes, h):
    """Count steps at the limit of stability.

    The last stage and the projected end of the step are two states at one time; the
    difference of their slopes estimates the fastest eigenvalue.
    """
    for n in range(len(slopes.dz)):
        slopes.dz[n] = slopes.Kz[END_STAGE, n] - slopes.Kz[END_STAGE - 1, n]
    for n in range(len(slopes.dv)):
        slopes.dv[n] = slopes.Kv[END_STAGE, n] - slopes.Kv[END_STAGE - 1, n]
    slope_difference = scaled_norm(
        slopes.dz, slopes.dv, control.scale_z, control.scale_v
    )
    for n in range(len(slopes.dz)):
        slopes.dz[n] = slopes.z1[n] - slopes.z[n]
    for n in range(len(slopes.dv)):
        slopes.dv[n] = slopes.v1[n] - slopes.v[n]
    state_difference = scaled_norm(
        slopes.dz, slopes.dv, control.scale_z, control.scale_v
    )
    if h * slope_difference > STABILITY_LIMIT * state_difference:
        control.stiff_steps += 1


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, TABLEAU, CONTROL, STAGE_SLOPES, float64))
def _write_outputs(kernels, system, work, memory, tableau, control, slopes, h):
    """Dense output of order 7 at the requested times inside the step; 0 on success.

    Its three additional stages are evaluated only if there are such times.
    """
    output, fraction_index = control.next_output, control.fraction_index
    k = next_output_row(control, h)
    if k < 0:
        return 0
    for i in range(END_STAGE + 1, N_STAGES):
        status = _stage(kernels, system, work, memory, tableau, control, slopes, h, i)
        if status != 0:
            control.next_output, control.fraction_index = output, fraction_index
            return status
    copy(slopes.Kv[END_STAGE], memory.acceleration)
    while k >= 0:
        x = step_fraction(control, k, h)
        _interpolate(
            tableau, control.z, slopes.z1, slopes.Kz, h, x, control.output_z[k]
        )
        _interpolate(
            tableau, control.v, slopes.v1, slopes.Kv, h, x, control.output_v[k]
        )
        k = next_output_row(control, h)
    return 0


@inner(void(TABLEAU, F1, F1, F2, float64, float64, F1))
def _interpolate(tableau, y0, y1, K, h, x, y):
    """The polynomial with the states and slopes at both ends, and four terms more."""
    u = 1.0 - x
    first, last = x * u * u, -x * x * u
    end = x - x * u + 2.0 * x * x * u
    for n in range(len(y)):
        y[n] = y0[n] + end * (y1[n] - y0[n])
        y[n] += h * (first * K[0, n] + last * K[END_STAGE, n])
    term = x * x * u * u
    for j in range(len(tableau.dense)):
        for i in range(N_STAGES):
            weight = h * term * tableau.dense[j, i]
            if weight != 0.0:
                for n in range(len(y)):
                    y[n] += weight * K[i, n]
        term *= x if j % 2 == 0 else u


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, TABLEAU, CONTROL, STAGE_SLOPES, float64))
def _try_step(kernels, system, work, memory, tableau, control, slopes, h):
    """All stages and the end of a step; 0 on success."""
    for i in range(1, END_STAGE):
        status = _stage(kernels, system, work, memory, tableau, control, slopes, h, i)
        if status != 0:
            return status
    _add_slopes(control.z, h, tableau.A[END_STAGE], slopes.Kz, END_STAGE, slopes.z1)
    _add_slopes(control.v, h, tableau.A[END_STAGE], slopes.Kv, END_STAGE, slopes.v1)
    return 0


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, TABLEAU, CONTROL, STAGE_SLOPES, float64))
def _accept(kernels, system, work, memory, tableau, control, slopes, h):
    """Moves to the end of the step, projected onto the constraints; 0 on success."""
    z1, v1, dz, dv = slopes.z1, slopes.v1, slopes.dv, slopes.p
    status = project_step_end(kernels, system, work, memory, control, h, z1, v1, dz, dv)
    if status != 0:
        return status
    kernels.rate(system, slopes.z1, slopes.v1, slopes.Kz[END_STAGE])
    copy(memory.acceleration, slopes.Kv[END_STAGE])
    _count_stiff_steps(control, slopes, h)
    status = _write_outputs(kernels, system, work, memory, tableau, control, slopes, h)
    if status != 0:
        return status
    advance_state(control, h, slopes.z1, slopes.v1)
    return 0


@inner(boolean(MEMORY, CONTROL, float64))
def _is_too_stiff(memory, control, h):
    """True if stability keeps the steps short, and too many of them are to come."""
    stiff = control.stiff_steps
    usual = stiff > MIN_STIFF_STEPS and STIFF_STEP_FRACTION * stiff > memory.steps
    return usual and control.duration > MAX_STEPS * h


@entry(int64(KERNELS, SYSTEM, WORK, MEMORY, TABLEAU, CONTROL, STAGE_SLOPES, int64))
def advance(kernels, system, work, memory, tableau, control, slopes, limit):
    """Steps until the end of the smooth interval or for at most `limit` steps.

    Entered and left with (z, v) on the constraints, accelerations in memory. Returns
    one of the codes of `loop_state`.
    """
    for _ in range(limit):
        h = next_step(control)
        if h == 0.0:
            return INTERVAL_END
        update_error_scales(system, memory, control)
        if control.old_step == 0.0:
            h = first_step_from_singularity(system, memory, control, h)
        if exceeds_output_rows(control, h):
            return OUTPUT_FULL
        kernels.rate(system, control.z, control.v, slopes.Kz[0])
        copy(memory.acceleration, slopes.Kv[0])
        failures = 0
        while True:
            if is_below_time_resolution(control, h):
                return TOO_SMALL
            h = step_avoiding_singularity(control, h, 1.0)
            set_error_tolerances(system, control, h)
            error, factor = 0.0, 0.5
            status = _try_step(
                kernels, system, work, memory, tableau, control, slopes, h
            )
            if status == 0 and control.fixed_step == 0:
                error = _error(
                    kernels, system, work, memory, tableau, control, slopes, h
                )
                factor = step_size_factor(ORDER_OF_ERROR, error, 1)
            if status == 0 and error < 1.0:
                status = _accept(
                    kernels, system, work, memory, tableau, control, slopes, h
                )
                if status == 0:
                    break
                factor = control.retry_fraction
            if control.fixed_step == 1:
                return OFF_CONSTRAINTS
            failures += 1
            memory.rejected += 1
            h *= factor
        choose_next_step(control, ORDER_OF_ERROR, NO_JACOBIAN, h, error, 1, failures)
        memory.steps += 1
        if not all_finite(control.z, control.v):
            return NOT_FINITE
        if control.fixed_step == 0 and _is_too_stiff(memory, control, h):
            return TOO_STIFF
        if control.singular_proximity == NEAR_SINGULAR:
            return STEPS_DONE
    return STEPS_DONE
