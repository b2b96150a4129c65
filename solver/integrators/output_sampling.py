"""Recorded states: dense output inside steps, projected onto the constraints."""

import math

from ..compiler.kernels import entry, inner
from ..compiler.types import boolean, float64, int64, void
from ..linear.factor_storage import KERNELS, MEMORY
from ..linear.joint_friction import contact_force, coordinate_rate
from ..linear.mass_matrix import (
    constraint_blocks,
    constraint_independence,
    constraint_scale,
    row_independence,
)
from ..linear.saddle_point import REGULARISATION
from ..spatial.system_arrays import (
    C_GAMMA,
    C_RATE,
    C_VALUE,
    F1,
    F2,
    F3,
    I1,
    I2,
    MAX_CONTACTS,
    R_CONTACTS,
    ROTATION_VALUE,
    SYSTEM,
    WORK,
)
from .loop_state import CONTROL, copy
from .projection import evaluate_accelerations, project_state
from .singular_configurations import SINGULAR
from .step_limits import store_measures
from .step_size import time_resolution

#: Where constraints are less independent than this, multipliers are recorded if their
#: relative change within the tolerance of the constraints is at most so large, or, for
#: those without load, the change is so small a part of the largest one of the scene,
#: or of all states where the whole scene is without load.
NEARLY_SINGULAR, MULTIPLIER_ERROR, UNLOADED = 0.01, 1e-3, 1e-6


@inner(boolean(CONTROL, int64, float64))
def has_output_time(control, k, h):
    """True if an output time lies in the next step of length h."""
    t = control.time
    return control.output_times[k] <= t + h + 1e-12 * max(h, abs(t))


@inner(boolean(CONTROL, float64))
def exceeds_output_rows(control, h):
    """True if a step of length h may have more output times than the control holds."""
    return has_output_time(control, len(control.output_times) - 1, h)


@inner(int64(CONTROL, float64))
def next_output_row(control, h):
    """Row of the next requested state inside the step, or -1."""
    k, t = control.next_output, control.time
    if k < len(control.output_times) and has_output_time(control, k, h):
        control.next_output += 1
        return k
    i = control.fraction_index
    if i == len(control.output_fractions):
        return -1
    control.fraction_index += 1
    if control.output_fractions[i] < 0.0:
        return -1
    control.fraction_times[i] = t + control.output_fractions[i] * h
    return len(control.output_times) + i


@inner(float64(CONTROL, int64, float64))
def step_fraction(control, k, h):
    """Where the state of row k lies in the step, from 0 to 1."""
    count = len(control.output_times)
    if k < count:
        return (control.output_times[k] - control.time) / h
    return control.output_fractions[k - count]


@inner(void(CONTROL, float64, F1, F1))
def advance_state(control, h, z, v):
    """Make the state at the end of a step the current one."""
    copy(z, control.z)
    copy(v, control.v)
    store_measures(control)
    control.time += h
    if control.stop - control.time <= time_resolution(control, control.stop):
        control.time = control.stop


@inner(void(KERNELS, SYSTEM, MEMORY, CONTROL, float64, F1, F1, F1, F1, F1))
def write_cubic(kernels, system, memory, control, h, z1, v1, rate0, acc0, rate1):
    """Dense output: the cubic with the states and slopes at both ends of the step."""
    k = next_output_row(control, h)
    if k < 0:
        return
    kernels.rate(system, z1, v1, rate1)
    acc1 = memory.acceleration
    while k >= 0:
        s = step_fraction(control, k, h)
        end = s * s * (3.0 - 2.0 * s)
        first, last = h * s * (1.0 - s) * (1.0 - s), h * s * s * (s - 1.0)
        for i in range(len(z1)):
            control.output_z[k, i] = (1.0 - end) * control.z[i] + end * z1[i]
            control.output_z[k, i] += first * rate0[i] + last * rate1[i]
        for i in range(len(v1)):
            control.output_v[k, i] = (1.0 - end) * control.v[i] + end * v1[i]
            control.output_v[k, i] += first * acc0[i] + last * acc1[i]
        k = next_output_row(control, h)


@entry(int64(KERNELS, SYSTEM, WORK, MEMORY, float64, F1, F1))
def evaluate_start(kernels, system, work, memory, t, z, v):
    """`evaluate_accelerations` for callers in Python."""
    return evaluate_accelerations(kernels, system, work, memory, t, z, v)


# Columns of the output of a joint with friction
(
    OUTPUT_FRICTION,
    OUTPUT_LOAD,
    OUTPUT_RATE,
    OUTPUT_ACCELERATION,
    OUTPUT_POSITION,
    OUTPUT_CONTACT_FORCE,
) = range(6)
N_FRICTION_OUTPUT = OUTPUT_CONTACT_FORCE + MAX_CONTACTS


@inner(void(SYSTEM, WORK, MEMORY, F2))
def write_friction_output(system, work, memory, output):
    """Force, load, rate, acceleration and value of the coordinates with friction.

    Then what presses their contact points in the first direction.
    """
    for j in range(len(output)):
        row = work.friction_subsystem.row[j]
        output[j, OUTPUT_FRICTION], output[j, OUTPUT_LOAD] = (
            work.friction_force[j],
            work.joint_load[j],
        )
        output[j, OUTPUT_RATE], output[j, OUTPUT_POSITION] = row[C_RATE], row[C_VALUE]
        acceleration = coordinate_rate(system, work, j, memory.acceleration)
        output[j, OUTPUT_ACCELERATION] = acceleration - row[C_GAMMA]
        for contact in range(system.friction[j, R_CONTACTS]):
            contact_force_, _ = contact_force(system, j, contact, memory.multiplier)
            output[j, OUTPUT_CONTACT_FORCE + contact] = contact_force_


@entry(void(KERNELS, SYSTEM, WORK, MEMORY, F1, F2, F2, F3))
def evaluate_friction(kernels, system, work, memory, times, z, v, output):
    """Evaluate joint friction in some states of one smooth interval, with the given
    friction states.

    NaN where eq. (3) is singular.
    """
    for k in range(len(times)):
        status = evaluate_accelerations(
            kernels, system, work, memory, times[k], z[k], v[k]
        )
        write_friction_output(system, work, memory, output[k])
        if status != 0:
            for j in range(output.shape[1]):
                output[k, j, OUTPUT_FRICTION] = output[k, j, OUTPUT_ACCELERATION] = (
                    math.nan
                )


@entry(void(KERNELS, SYSTEM, WORK, F1, F1, F2, F2, F2))
def evaluate_jacobians(kernels, system, work, times, interval_times, z, v, C):
    """`WorkArrays.C` of some states, into the rows of C."""
    for k in range(len(times)):
        work.interval_time[0] = interval_times[k]
        kernels.evaluate(system, work, times[k], z[k], v[k])
        copy(work.C, C[k])


@inner(
    void(
        *[KERNELS, SYSTEM, WORK, MEMORY, F2, float64, float64],
        *[F1, F1, F1, F1, F1, I1, I1, F1],
    )
)
def _remove_uncertain_multipliers(
    kernels,
    system,
    work,
    memory,
    constraint_tolerance,
    least,
    t,
    z,
    v,
    dz,
    dv,
    multiplier,
    block,
    is_uncertain,
    largest,
):
    """Set multipliers to NaN that change within the tolerance of the constraints.

    A change counts relative to the largest multiplier of those constraints that act on
    each other, or to a small part of the largest one of all, each measured by the
    acceleration that it causes; changes below `least` do not count. It is that by what
    is left of the constraints, and by violations of their rates within the tolerance
    that change the multipliers most, by a step of the power method; states with once
    and twice of both are looked at.
    (Violations of positions would load stiff bodies.) The state must have been
    evaluated; z, v and what was evaluated are overwritten, dz, dv and the last three,
    of one entry per row, are scratch.
    """
    n = system.n_rows
    constraint_blocks(system, memory, block)
    for i in range(n):
        largest[i], is_uncertain[i] = 0.0, 0
    for i in range(n):
        size = constraint_scale(system, memory, i) * abs(multiplier[i])
        largest[block[i]] = max(largest[block[i]], size)
        if row_independence(system, memory, i) < SINGULAR:
            is_uncertain[block[i]] = 1
        memory.multiplier[i] = 1.0 / (1.0 + i)
    for i in range(n):
        least = max(least, UNLOADED * largest[i])
    failed = False
    for attempt in range(2):
        for i in range(n):
            weight = memory.multiplier[i]
            if attempt > 0:
                weight = math.copysign(1.0, weight)
            if is_uncertain[block[i]] == 1:
                weight = work.row[i, C_VALUE] = 0.0
            work.row[i, C_RATE] = weight * constraint_tolerance[i, 1]
        status = kernels.project_once(system, work, memory, REGULARISATION, dz, dv)
        failed = failed or status != 0
    for _ in range(2):
        kernels.retract(system, work.frame, z, dz)
        for i in range(len(v)):
            v[i] += dv[i]
        status = evaluate_accelerations(kernels, system, work, memory, t, z, v)
        failed = failed or status != 0
        for i in range(n):
            change = constraint_scale(system, memory, i)
            change *= abs(memory.multiplier[i] - multiplier[i])
            if not change <= max(MULTIPLIER_ERROR * largest[block[i]], least):
                is_uncertain[block[i]] = 1
    for i in range(n):
        if failed or is_uncertain[block[i]] == 1:
            multiplier[i] = math.nan


@inner(float64(F1, float64))
def _inside_interval(edges, t):
    """A time inside the smooth interval of t."""
    i = 0
    while i + 2 < len(edges) and edges[i + 1] < t:
        i += 1
    return 0.5 * (edges[i] + edges[i + 1])


@inner(float64(SYSTEM, MEMORY, F1))
def _largest_multiplier(system, memory, multiplier):
    """The largest acceleration by one of them that has a value."""
    largest = 0.0
    for i in range(len(multiplier)):
        if not math.isnan(multiplier[i]):
            size = constraint_scale(system, memory, i) * abs(multiplier[i])
            largest = max(largest, size)
    return largest


@entry(
    void(
        *[KERNELS, SYSTEM, WORK, MEMORY, F2, F1, F1, F2, F2, F2, F2, F3, F3],
        *[F2, F2, F2, F3, I2, F1, F1, F1],
    )
)
def sample(
    kernels,
    system,
    work,
    memory,
    constraint_tolerance,
    times,
    edges,
    z,
    v,
    step_z,
    step_v,
    frames,
    points,
    acc,
    lambda_,
    factors,
    output,
    row_blocks,
    row_sizes,
    sizes,
    largest,
):
    """Projects recorded states onto the constraints and solves eq. (3) there.

    Dense output meets the constraints to the tolerance of the run only; what is
    recorded meets them to `constraint_tolerance`, see `StepLoopState`. States that
    cannot be projected stay as they are; accelerations are NaN where eq. (3) is
    singular, multipliers also near such states where they are uncertain. step_z and
    step_v are scratch, of one and three rows, as are row_blocks, of two, row_sizes, and
    sizes, of one entry per state. `largest`, of one entry, is the largest multiplier of
    all states so far.
    """
    for k in range(len(times)):
        work.interval_time[0] = _inside_interval(edges, times[k])
        copy(z[k], step_z[0])
        copy(v[k], step_v[0])
        status = project_state(
            kernels,
            system,
            work,
            memory,
            times[k],
            step_z[0],
            step_v[0],
            step_v[1],
            step_v[2],
            constraint_tolerance,
        )
        if status == 0:
            copy(step_z[0], z[k])
            copy(step_v[0], v[k])
        else:
            status = evaluate_accelerations(
                kernels, system, work, memory, times[k], z[k], v[k]
            )
        first = z.shape[1] - system.n_rotation_counters
        for i in range(system.n_rotation_counters):
            z[k, first + i] = work.rotation_counter[i, ROTATION_VALUE]
        copy(memory.acceleration, acc[k])
        copy(memory.multiplier, lambda_[k])
        copy(work.force_scale, factors[k])
        write_friction_output(system, work, memory, output[k])
        if status != 0:
            for n in range(acc.shape[1]):
                acc[k, n] = math.nan
            for n in range(lambda_.shape[1]):
                lambda_[k, n] = math.nan
        elif constraint_independence(system, memory) < NEARLY_SINGULAR:
            sizes[k] = _largest_multiplier(system, memory, lambda_[k])
            _remove_uncertain_multipliers(
                kernels,
                system,
                work,
                memory,
                constraint_tolerance,
                0.0,
                times[k],
                step_z[0],
                step_v[0],
                step_v[1],
                step_v[2],
                lambda_[k],
                row_blocks[0],
                row_blocks[1],
                row_sizes,
            )
            evaluate_accelerations(kernels, system, work, memory, times[k], z[k], v[k])
        largest[0] = max(largest[0], _largest_multiplier(system, memory, lambda_[k]))
        kernels.complete(system, work, acc[k])
        for b in range(work.frame.shape[0]):
            copy(work.frame[b], frames[k, b])
        for m in range(work.point.shape[0]):
            copy(work.point[m], points[k, m])
    for k in range(len(times)):
        if not 0.0 <= sizes[k] <= UNLOADED * largest[0]:
            continue
        work.interval_time[0] = _inside_interval(edges, times[k])
        copy(z[k], step_z[0])
        copy(v[k], step_v[0])
        evaluate_accelerations(
            kernels, system, work, memory, times[k], step_z[0], step_v[0]
        )
        copy(memory.multiplier, lambda_[k])
        _remove_uncertain_multipliers(
            kernels,
            system,
            work,
            memory,
            constraint_tolerance,
            UNLOADED * largest[0],
            times[k],
            step_z[0],
            step_v[0],
            step_v[1],
            step_v[2],
            lambda_[k],
            row_blocks[0],
            row_blocks[1],
            row_sizes,
        )
