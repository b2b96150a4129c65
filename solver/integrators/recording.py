"""States that are recorded: dense output inside steps, and projection of it."""

from __future__ import annotations

import math

from numba import boolean, float64, int64, types

from ..compiler.compiling import entry, inner
from ..linear.friction import along, pressure
from ..linear.memory import KERNELS, MEMORY
from ..space.layout import (
    C_GAMMA,
    C_RATE,
    C_VALUE,
    F1,
    F2,
    F3,
    MOST_PLACES,
    R_PLACES,
    SYSTEM,
    TURNED,
    WORK,
)
from .passing import keep_ways
from .projection import accelerate, project
from .step_sizes import time_resolution
from .stepping import CONTROL, copy


@inner(boolean(CONTROL, int64, float64))
def is_inside(control, k, h):
    """Whether an output time lies in the next step of length h."""
    t = control.time
    return control.times[k] <= t + h + 1e-12 * max(h, abs(t))


@inner(boolean(CONTROL, float64))
def is_full(control, h):
    """Whether a step of length h may have more output times than the control holds."""
    return is_inside(control, len(control.times) - 1, h)


@inner(int64(CONTROL, float64))
def output_due(control, h):
    """The row of the next state that is wanted inside the step, or -1."""
    k, t = control.output, control.time
    if k < len(control.times) and is_inside(control, k, h):
        control.output += 1
        return k
    i = control.share
    if i == len(control.shares):
        return -1
    control.share += 1
    if control.shares[i] < 0.0:
        return -1
    control.moments[i] = t + control.shares[i] * h
    return len(control.times) + i


@inner(float64(CONTROL, int64, float64))
def share_of_step(control, k, h):
    """Where the state of row k lies in the step, from 0 to 1."""
    count = len(control.times)
    if k < count:
        return (control.times[k] - control.time) / h
    return control.shares[k - count]


@inner(types.void(CONTROL, float64, F1, F1))
def move(control, h, z, v):
    """Makes the state at the end of a step the current one."""
    copy(z, control.z)
    copy(v, control.v)
    keep_ways(control)
    control.time += h
    if control.stop - control.time <= time_resolution(control, control.stop):
        control.time = control.stop


@inner(types.void(KERNELS, SYSTEM, MEMORY, CONTROL, float64, F1, F1, F1, F1, F1))
def write_cubic(kernels, system, memory, control, h, z1, v1, rate0, acc0, rate1):
    """Dense output: the cubic with the states and slopes at both ends of the step."""
    k = output_due(control, h)
    if k < 0:
        return
    kernels.rate(system, z1, v1, rate1)
    acc1 = memory.acceleration
    while k >= 0:
        s = share_of_step(control, k, h)
        end = s * s * (3.0 - 2.0 * s)
        first, last = h * s * (1.0 - s) * (1.0 - s), h * s * s * (s - 1.0)
        for i in range(len(z1)):
            control.out_z[k, i] = (1.0 - end) * control.z[i] + end * z1[i]
            control.out_z[k, i] += first * rate0[i] + last * rate1[i]
        for i in range(len(v1)):
            control.out_v[k, i] = (1.0 - end) * control.v[i] + end * v1[i]
            control.out_v[k, i] += first * acc0[i] + last * acc1[i]
        k = output_due(control, h)


@entry(int64(KERNELS, SYSTEM, WORK, MEMORY, float64, F1, F1))
def begin(kernels, system, work, memory, t, z, v):
    """`accelerate` for callers in Python."""
    return accelerate(kernels, system, work, memory, t, z, v)


# Columns of what is told of a joint with friction
RUB_FORCE, RUB_LOAD, RUB_RATE, RUB_PUSH, RUB_PLACE, RUB_PRESS = range(6)
N_RUB = RUB_PRESS + MOST_PLACES


@inner(types.void(SYSTEM, WORK, MEMORY, F2))
def tell_friction(system, work, memory, told):
    """Force, load, rate, acceleration and value of the coordinates with friction.

    Then what presses their places of contact in the first direction.
    """
    for j in range(len(told)):
        row = work.sliding.row[j]
        told[j, RUB_FORCE], told[j, RUB_LOAD] = work.rub[j], work.load[j]
        told[j, RUB_RATE], told[j, RUB_PLACE] = row[C_RATE], row[C_VALUE]
        push = along(system, work, j, memory.acceleration)
        told[j, RUB_PUSH] = push - row[C_GAMMA]
        for place in range(system.friction[j, R_PLACES]):
            press, _ = pressure(system, j, place, memory.multiplier)
            told[j, RUB_PRESS + place] = press


@entry(types.void(KERNELS, SYSTEM, WORK, MEMORY, F1, F2, F2, F3))
def rub(kernels, system, work, memory, times, z, v, told):
    """What joints with friction do in some states of one smooth interval, as they are.

    NaN where eq. (3) is singular.
    """
    for k in range(len(times)):
        status = accelerate(kernels, system, work, memory, times[k], z[k], v[k])
        tell_friction(system, work, memory, told[k])
        if status != 0:
            for j in range(told.shape[1]):
                told[k, j, RUB_FORCE] = told[k, j, RUB_PUSH] = math.nan


@entry(types.void(KERNELS, SYSTEM, WORK, F1, F1, F2, F2, F2))
def jacobians(kernels, system, work, times, clocks, z, v, C):
    """`Work.C` of some states, into the rows of C."""
    for k in range(len(times)):
        work.clock[0] = clocks[k]
        kernels.evaluate(system, work, times[k], z[k], v[k])
        copy(work.C, C[k])


@entry(
    types.void(
        *[KERNELS, SYSTEM, WORK, MEMORY, F2, F1, F1, F2, F2, F2, F2, F3, F3],
        *[F2, F2, F2, F3],
    )
)
def sample(
    kernels,
    system,
    work,
    memory,
    closed,
    times,
    edges,
    z,
    v,
    step_z,
    step_v,
    frames,
    points,
    acc,
    lam,
    factors,
    told,
):
    """Projects recorded states onto the constraints and solves eq. (3) there.

    Dense output meets the constraints to the tolerance of the run only; what is
    recorded meets them to `closed`, see `Control`. States that cannot be projected stay
    as they are; accelerations are NaN where eq. (3) is singular. step_z and step_v
    are scratch, of one and three rows.
    """
    for k in range(len(times)):
        i = 0
        while i + 2 < len(edges) and edges[i + 1] < times[k]:
            i += 1
        work.clock[0] = 0.5 * (edges[i] + edges[i + 1])
        copy(z[k], step_z[0])
        copy(v[k], step_v[0])
        status = project(
            kernels,
            system,
            work,
            memory,
            times[k],
            step_z[0],
            step_v[0],
            step_v[1],
            step_v[2],
            closed,
        )
        if status == 0:
            copy(step_z[0], z[k])
            copy(step_v[0], v[k])
        else:
            status = accelerate(kernels, system, work, memory, times[k], z[k], v[k])
        first = z.shape[1] - system.n_turns
        for i in range(system.n_turns):
            z[k, first + i] = work.turn[i, TURNED]
        copy(memory.acceleration, acc[k])
        copy(memory.multiplier, lam[k])
        copy(work.factor, factors[k])
        tell_friction(system, work, memory, told[k])
        if status != 0:
            for n in range(acc.shape[1]):
                acc[k, n] = math.nan
            for n in range(lam.shape[1]):
                lam[k, n] = math.nan
        kernels.complete(system, work, acc[k])
        for b in range(work.frame.shape[0]):
            copy(work.frame[b], frames[k, b])
        for m in range(work.point.shape[0]):
            copy(work.point[m], points[k, m])
