"""Singular configurations: predicted, approached and passed by steps of any method.

In a singular configuration some constraints become dependent. Steps keep their ends
and stages away from it, pass it in one step, or are projected with a reduced set of
constraints beside it.
"""

import math

from ..compiler.kernels import inner
from ..compiler.types import boolean, float64, int64, void
from ..linear.factor_storage import KERNELS, MEMORY
from ..linear.mass_matrix import constraint_independence
from ..linear.saddle_point import REGULARISATION
from ..spatial.system_arrays import C_RATE, C_VALUE, F1, SYSTEM, WORK
from .loop_state import CONTROL
from .projection import (
    constraint_velocities,
    count_rotations,
    evaluate_accelerations,
    project_state,
    record_drift,
)
from .step_limits import check_measure_paths
from .step_size import scaled_norm

#: How a step lies to a singular position: it may be before it, or behind.
FAR_FROM_SINGULAR, PAST_SINGULAR, NEAR_SINGULAR = range(3)
#: The part of a step that lies before a singular position when it passes it; the least
#: and the most with which it does; and the most of which it is near.
PASSING_FRACTION, MIN_PASSING, MAX_PASSING, NEAR_FRACTION = 0.43, 0.2, 0.5, 4.0
#: Constraints of which so much is independent are far from a singular position; with
#: less than the second one a step has to take care before it fails.
INDEPENDENT, DEPENDENT = 0.5, 0.12
#: A singular position leaves less independence than this; the first step out of one is
#: so many times as long as the way on which rounding is seen.
SINGULAR, LEAVING_FACTOR = 1e-6, 10.0
#: Near a singular position: projections, their regularisation times the tolerance, and
#: the largest change of velocities, relative to the largest ones.
MAX_PROJECTIONS, SINGULAR_REGULARISATION, MAX_VELOCITY_CHANGE = 2, 1e-14, 0.1
#: Part of the independence that is left where a singular position is certain.
LOST_INDEPENDENCE = 0.01
#: Motions are alike, within what projection leaves open, with less independence than
#: this; and with less than this part of that at which rounding is seen.
INDISTINGUISHABLE, TOO_NEAR = 1e-5, 0.03

#: Steps that are kept.
MAX_CROSSINGS = 24
#: Independence falls straight towards a singular configuration and rises straight
#: behind it: parts of that by which steps over it are known.
RISE_FACTOR, FALL_FACTOR = 1.5, 0.9
#: Independence that steps which resolve a passage see at its least.
LOW_INDEPENDENCE = 0.05


@inner(float64(CONTROL))
def rounding_threshold(control):
    """Independence below which rounding is detected, where it has been much larger."""
    noise = math.sqrt(SINGULAR_REGULARISATION / control.relative_tolerance)
    return min(LOST_INDEPENDENCE * control.largest_independence, noise)


@inner(float64(CONTROL, float64, float64))
def step_avoiding_singularity(control, h, reach):
    """A step, h or less, that keeps its ends and stages away from a singular
    configuration.

    It passes it, or is one of a few equal steps before one that does. Each is at most
    as long as the one before, the passing one times `reach`.
    """
    time_left, old = control.singular_time - control.time, control.old_step
    control.singular_proximity = (
        PAST_SINGULAR
        if control.independence < rounding_threshold(control)
        else FAR_FROM_SINGULAR
    )
    is_dependent = control.independence < DEPENDENT or control.step_failures > 0
    if abs(time_left) < NEAR_FRACTION * h and is_dependent:
        control.singular_proximity = (
            NEAR_SINGULAR if time_left >= 0.0 else PAST_SINGULAR
        )
    if control.fixed_step == 1 or control.singular_proximity != NEAR_SINGULAR:
        return h
    if old == 0.0:
        return min(h, time_left / NEAR_FRACTION) if time_left > 0.0 else h
    passing, longest = min(h, reach * old), min(h, 2.0 * reach * old)
    if time_left < MIN_PASSING * passing:
        return passing
    if time_left < MAX_PASSING * longest:
        return min(longest, time_left / PASSING_FRACTION)
    longest = min(h, old if time_left < NEAR_FRACTION * old else 2.0 * old)
    before = max(1.0, math.ceil(time_left / longest - MAX_PASSING * reach))
    return min(h, time_left / (before + PASSING_FRACTION * reach))


@inner(boolean(CONTROL, float64))
def ends_near_singularity(control, h):
    """True if a step ends where rounding of positions would spoil velocities."""
    time_left = abs(control.singular_time - control.time - h)
    if time_left < NEAR_FRACTION * h and control.independence < DEPENDENT:
        return True
    return control.independence < rounding_threshold(control)


@inner(int64(SYSTEM, MEMORY, CONTROL, float64))
def predict_singularity(system, memory, control, h):
    """When constraints become dependent: the next zero of a parabola.

    It goes through the independence at the ends of the last three steps, of which this
    is one. A singular configuration that was passed is kept. Returns 0, or 5 when the
    step ends where the motions that meet there cannot be separated.
    """
    old, now = control.old_step, constraint_independence(system, memory)
    is_ahead = control.singular_time > control.time
    too_near = min(
        LOST_INDEPENDENCE * control.largest_independence,
        max(INDISTINGUISHABLE, TOO_NEAR * rounding_threshold(control)),
    )
    if (
        is_ahead
        and control.singular_proximity == NEAR_SINGULAR
        and now < min(control.independence, too_near)
    ):
        return 5
    mean = (now - control.independence) / h
    known = control.independence_slope < 0.0
    curvature = (mean - control.independence_slope) / (h + old) if known else 0.0
    slope = mean + curvature * h
    root = slope * slope - 4.0 * curvature * now
    is_falling = max(mean, slope) < 0.0 and (
        known or is_ahead and control.singular_time < math.inf
    )
    control.independence, control.largest_independence = (
        now,
        max(now, control.largest_independence),
    )
    control.independence_slope = mean
    if is_falling and now < INDEPENDENT and root >= 0.0:
        time_left = 2.0 * now / (math.sqrt(root) - slope)
        control.singular_time = control.time + h + time_left
    elif control.singular_time > control.time + h:
        control.singular_time = math.inf
    return 0


@inner(float64(SYSTEM, MEMORY, CONTROL, float64))
def first_step_from_singularity(system, memory, control, h):
    """The first step, h or what leads out of a singular configuration.

    There it ends where rounding does not spoil velocities. A fixed step stays.
    """
    min_step = _min_first_step(system, memory, control)
    if control.fixed_step == 1:
        return h
    return max(h, min(min_step, 0.1 * (control.stop - control.time)))


@inner(float64(SYSTEM, MEMORY, CONTROL))
def _min_first_step(system, memory, control):
    """Looks for a singular configuration at a start; returns the least step
    out of it.
    """
    control.independence = constraint_independence(system, memory)
    control.independence_slope = 0.0
    if control.independence > SINGULAR:
        return 0.0
    control.singular_time, control.largest_independence = control.time, 1.0
    rate = max(
        control.largest_speed / control.mechanism_length,
        control.largest_angular_velocity,
        1.0 / control.duration,
    )
    return (
        LEAVING_FACTOR
        * math.sqrt(SINGULAR_REGULARISATION / control.relative_tolerance)
        / rate
    )


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, float64, F1, F1, F1, F1))
def project_near_singularity(kernels, system, work, memory, control, t, z, v, dz, dv):
    """`project_state` near a singular configuration, where some constraints hardly add
    to others.

    What these leave open is rounding, which velocities would get multiplied with large
    numbers: so much is left as it is. Returns 0, or a code also when velocities would
    have to change too much: then the step has left the motion.
    """
    regularisation = SINGULAR_REGULARISATION / control.relative_tolerance
    for _ in range(MAX_PROJECTIONS):
        kernels.evaluate(system, work, t, z, v)
        memory.evaluations += 1
        memory.projections += 1
        status = kernels.project_once(system, work, memory, regularisation, dz, dv)
        jump = scaled_norm(dv, dv, control.largest_velocity, control.largest_velocity)
        if status != 0 or not jump < MAX_VELOCITY_CHANGE:
            return max(status, 4)
        kernels.retract(system, work.frame, z, dz)
        for i in range(len(v)):
            v[i] += dv[i]
    return evaluate_accelerations(kernels, system, work, memory, t, z, v)


@inner(void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, float64, F1, F1, F1, F1, F1))
def project_velocity_error(
    kernels, system, work, memory, control, h, z1, v1, error, dz, dv
):
    """Takes from an error of velocities what projection takes at the end of the step.

    Far from singular configurations all of it counts. dz and dv are scratch.
    """
    if control.singular_proximity == FAR_FROM_SINGULAR:
        return
    kernels.evaluate(system, work, control.time + h, z1, v1)
    memory.evaluations += 1
    for i in range(system.n_rows):
        work.row[i, C_VALUE] = 0.0
    constraint_velocities(system, work, error, C_RATE)
    constraint_velocities(
        system.friction_subsystem, work.friction_subsystem, error, C_RATE
    )
    if kernels.project_once(system, work, memory, REGULARISATION, dz, dv) == 0:
        for i in range(len(error)):
            error[i] += dv[i]


#: Columns of `Control.crossed` before both states of a step.
STEP_START, STEP_LENGTH, STEP_STATES = range(3)


@inner(void(CONTROL, float64, float64, float64, F1, F1))
def record_crossing(control, h, before, slope, z1, v1):
    """Stores the states at both ends of a step that may pass a singular configuration.

    Parameters
    ----------
    before, slope
        Of the independence, at its beginning and over the step before.
    """
    now, decrease = control.independence, -slope * h
    passes = (
        before + now < RISE_FACTOR * decrease and now > before - FALL_FACTOR * decrease
    )
    turns_back = decrease > 0.0 and before < LOW_INDEPENDENCE and now > before
    if not (passes or turns_back):
        return
    k = control.n_crossings
    control.n_crossings += 1
    if k >= control.crossing_steps.shape[0]:
        return
    stored, n, m = control.crossing_steps[k], len(z1), len(v1)
    stored[STEP_START], stored[STEP_LENGTH] = control.time, h
    for i in range(n):
        stored[STEP_STATES + i] = control.z[i]
        stored[STEP_STATES + n + m + i] = z1[i]
    for i in range(m):
        stored[STEP_STATES + n + i] = control.v[i]
        stored[STEP_STATES + n + m + n + i] = v1[i]


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, float64, F1, F1, F1, F1))
def project_step_end(kernels, system, work, memory, control, h, z1, v1, dz, dv):
    """Projects the end of a step onto the constraints and notes what is left open.

    dz and dv are scratch. Returns 0, or the code of `project_state`, `count_rotations`
    or `check_measure_paths`.
    """
    at, constraint_tolerance = control.time + h, control.constraint_tolerance
    if ends_near_singularity(control, h):
        status = project_near_singularity(
            kernels, system, work, memory, control, at, z1, v1, dz, dv
        )
    else:
        status = project_state(
            kernels, system, work, memory, at, z1, v1, dz, dv, constraint_tolerance
        )
    if status == 0:
        record_drift(system, work, control)
        status = count_rotations(system, work, control, h, z1)
    if status == 0:
        status = check_measure_paths(work, control, h)
    if status == 0:
        before, slope = control.independence, control.independence_slope
        status = predict_singularity(system, memory, control, h)
        if status == 0:
            record_crossing(control, h, before, slope, z1, v1)
    return status
