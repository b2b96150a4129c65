"""Explicit Runge-Kutta of order 8 (DOP853) with variable step, on index-1 equations.

For scenes whose fastest vibration is part of the motion that is asked for: nothing is
linearised or iterated. Source: E. Hairer, S. P. Norsett, G. Wanner, "Solving Ordinary
Differential Equations I", sections II.5, II.6 and II.10; the test for stiffness is that
of E. Hairer, G. Wanner, "... II", section IV.2. Positions and velocities are projected
onto the constraints after every accepted step.
"""

from __future__ import annotations

import math

from numba import boolean, float64, int64, types

from ..compiler.compiling import entry, inner
from ..compiler.tables import Table, TableType
from ..linear.memory import KERNELS, MEMORY
from ..space.layout import F1, F2, SYSTEM, WORK, Reals, Reals2
from .dop853 import END, STAGES, TABLEAU
from .landing import close_step
from .projection import accelerate
from .recording import is_full, move, output_due, share_of_step
from .scales import note_motion, set_scales
from .singular import NEAR, beside_singular, keep_free_part, leave_start
from .step_sizes import (
    all_finite,
    finish_step,
    growth,
    next_step,
    scaled_norm,
    too_small,
)
from .stepping import (
    CHUNK,
    CONTROL,
    CRAWLING,
    FULL,
    NOT_FINITE,
    OFF_CONSTRAINTS,
    REACHED,
    STIFF_PART,
    TOO_SMALL,
    copy,
)

#: The estimated error falls with this power of the step, less one.
ORDER_OF_ERROR = 7
#: For what the estimate overlooks in large steps, and for the dense output inside.
CAUTION = 10.0
#: `finish_step` keeps a Jacobian up to this contraction: there is none.
NO_JACOBIAN = -1.0
#: Steps times the fastest eigenvalue at which stability ends is 6.0 to 6.4.
STABILITY_LIMIT = 4.0
#: A run is given up after so many steps that stability has limited, if at their size
#: it would take so many in all.
PATIENCE, MOST_STEPS = 200, 200_000


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
    return StageSlopes.zeros(Kz=(STAGES, n), Kv=(STAGES, m), **z, **v, p=(m,))


@inner(types.void(F1, float64, F1, F2, int64, F1))
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
    status = accelerate(kernels, system, work, memory, at, slopes.z, slopes.v)
    kernels.rate(system, slopes.z, slopes.v, slopes.Kz[i])
    copy(memory.acceleration, slopes.Kv[i])
    return status


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, TABLEAU, CONTROL, STAGE_SLOPES, float64))
def _error(kernels, system, work, memory, tableau, control, slopes, h):
    """Norm of the error estimate, made of those of order 5 and 3."""
    third = _estimate(kernels, system, work, memory, tableau.third, control, slopes, h)
    fifth = 0.0
    for k in range(len(tableau.fifth)):
        w = tableau.fifth[k]
        one = _estimate(kernels, system, work, memory, w, control, slopes, h)
        fifth = max(fifth, one)
    if fifth == 0.0:
        return 0.0
    return CAUTION * fifth * fifth / math.sqrt(fifth * fifth + 0.01 * third * third)


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, F1, CONTROL, STAGE_SLOPES, float64))
def _estimate(kernels, system, work, memory, weights, control, slopes, h):
    for x, K in ((slopes.dz, slopes.Kz), (slopes.dv, slopes.Kv)):
        for n in range(len(x)):
            x[n] = 0.0
        _add_slopes(x, h, weights, K, END, x)
    z1, v1, dv, p = slopes.z1, slopes.v1, slopes.dv, slopes.p
    keep_free_part(kernels, system, work, memory, control, h, z1, v1, dv, memory.dx, p)
    return scaled_norm(slopes.dz, slopes.dv, control.scale_z, control.scale_v)


@inner(types.void(CONTROL, STAGE_SLOPES, float64))
def _look_for_stiffness(control, slopes, h):
    """Counts steps that reach the end of stability.

    The last stage and the projected end of the step are two states at one time; how
    much their slopes differ tells the fastest eigenvalue.
    """
    for n in range(len(slopes.dz)):
        slopes.dz[n] = slopes.Kz[END, n] - slopes.Kz[END - 1, n]
    for n in range(len(slopes.dv)):
        slopes.dv[n] = slopes.Kv[END, n] - slopes.Kv[END - 1, n]
    fast = scaled_norm(slopes.dz, slopes.dv, control.scale_z, control.scale_v)
    for n in range(len(slopes.dz)):
        slopes.dz[n] = slopes.z1[n] - slopes.z[n]
    for n in range(len(slopes.dv)):
        slopes.dv[n] = slopes.v1[n] - slopes.v[n]
    slow = scaled_norm(slopes.dz, slopes.dv, control.scale_z, control.scale_v)
    if h * fast > STABILITY_LIMIT * slow:
        control.stiff_steps += 1


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, TABLEAU, CONTROL, STAGE_SLOPES, float64))
def _write_outputs(kernels, system, work, memory, tableau, control, slopes, h):
    """Dense output of order 7 at the times wanted inside the step; 0 on success.

    Its three more stages are only computed when there are such times.
    """
    output, share = control.output, control.share
    k = output_due(control, h)
    if k < 0:
        return 0
    for i in range(END + 1, STAGES):
        status = _stage(kernels, system, work, memory, tableau, control, slopes, h, i)
        if status != 0:
            control.output, control.share = output, share
            return status
    copy(slopes.Kv[END], memory.acceleration)
    while k >= 0:
        x = share_of_step(control, k, h)
        _interpolate(tableau, control.z, slopes.z1, slopes.Kz, h, x, control.out_z[k])
        _interpolate(tableau, control.v, slopes.v1, slopes.Kv, h, x, control.out_v[k])
        k = output_due(control, h)
    return 0


@inner(types.void(TABLEAU, F1, F1, F2, float64, float64, F1))
def _interpolate(tableau, y0, y1, K, h, x, y):
    """The polynomial with the states and slopes at both ends, and four terms more."""
    u = 1.0 - x
    first, last = x * u * u, -x * x * u
    end = x - x * u + 2.0 * x * x * u
    for n in range(len(y)):
        y[n] = y0[n] + end * (y1[n] - y0[n])
        y[n] += h * (first * K[0, n] + last * K[END, n])
    term = x * x * u * u
    for j in range(len(tableau.dense)):
        for i in range(STAGES):
            weight = h * term * tableau.dense[j, i]
            if weight != 0.0:
                for n in range(len(y)):
                    y[n] += weight * K[i, n]
        term *= x if j % 2 == 0 else u


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, TABLEAU, CONTROL, STAGE_SLOPES, float64))
def _try_step(kernels, system, work, memory, tableau, control, slopes, h):
    """All stages and the end of a step; 0 on success."""
    for i in range(1, END):
        status = _stage(kernels, system, work, memory, tableau, control, slopes, h, i)
        if status != 0:
            return status
    _add_slopes(control.z, h, tableau.A[END], slopes.Kz, END, slopes.z1)
    _add_slopes(control.v, h, tableau.A[END], slopes.Kv, END, slopes.v1)
    return 0


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, TABLEAU, CONTROL, STAGE_SLOPES, float64))
def _accept(kernels, system, work, memory, tableau, control, slopes, h):
    """Moves to the end of the step, projected onto the constraints; 0 on success."""
    z1, v1, dz, dv = slopes.z1, slopes.v1, slopes.dv, slopes.p
    status = close_step(kernels, system, work, memory, control, h, z1, v1, dz, dv)
    if status != 0:
        return status
    kernels.rate(system, slopes.z1, slopes.v1, slopes.Kz[END])
    copy(memory.acceleration, slopes.Kv[END])
    _look_for_stiffness(control, slopes, h)
    status = _write_outputs(kernels, system, work, memory, tableau, control, slopes, h)
    if status != 0:
        return status
    move(control, h, slopes.z1, slopes.v1)
    return 0


@inner(boolean(MEMORY, CONTROL, float64))
def _crawls(memory, control, h):
    """Whether stability keeps the steps short, and too many of them are to come."""
    stiff = control.stiff_steps
    usual = stiff > PATIENCE and STIFF_PART * stiff > memory.steps
    return usual and control.period > MOST_STEPS * h


@entry(int64(KERNELS, SYSTEM, WORK, MEMORY, TABLEAU, CONTROL, STAGE_SLOPES, int64))
def advance(kernels, system, work, memory, tableau, control, slopes, limit):
    """Steps until the end of the smooth interval or for at most `limit` steps.

    Entered and left with (z, v) on the constraints, accelerations in memory. Returns
    one of the codes of `stepping`.
    """
    for _ in range(limit):
        h = next_step(control)
        if h == 0.0:
            return REACHED
        note_motion(system, memory, control)
        if control.old_step == 0.0:
            h = leave_start(system, memory, control, h)
        if is_full(control, h):
            return FULL
        kernels.rate(system, control.z, control.v, slopes.Kz[0])
        copy(memory.acceleration, slopes.Kv[0])
        failures = 0
        while True:
            if too_small(control, h):
                return TOO_SMALL
            h = beside_singular(control, h, 1.0)
            set_scales(system, control, h)
            error, factor = 0.0, 0.5
            status = _try_step(
                kernels, system, work, memory, tableau, control, slopes, h
            )
            if status == 0 and control.fixed_step == 0:
                error = _error(
                    kernels, system, work, memory, tableau, control, slopes, h
                )
                factor = growth(ORDER_OF_ERROR, error, 1)
            if status == 0 and error < 1.0:
                status = _accept(
                    kernels, system, work, memory, tableau, control, slopes, h
                )
                if status == 0:
                    break
                factor = control.retry
            if control.fixed_step == 1:
                return OFF_CONSTRAINTS
            failures += 1
            memory.rejected += 1
            h *= factor
        finish_step(control, ORDER_OF_ERROR, NO_JACOBIAN, h, error, 1, failures)
        memory.steps += 1
        if not all_finite(control.z, control.v):
            return NOT_FINITE
        if control.fixed_step == 0 and _crawls(memory, control, h):
            return CRAWLING
        if control.crossing == NEAR:
            return CHUNK
    return CHUNK
