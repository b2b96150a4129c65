"""Error norm, tolerated errors, and the choice of the next step, eq. (22)."""

import math

from ..compiler.kernels import inner
from ..compiler.types import boolean, float64, int64, void
from ..linear.factor_storage import MEMORY
from ..spatial.system_arrays import F1, LAW_STATE, SYSTEM
from .loop_state import CONTROL, END_TOLERANCE
from .newton_iteration import LIMIT_GROWTH, NEWTON_LIMIT
from .step_limits import limit_step_by_features

SAFETY = 0.9
#: For methods that a change of the step disturbs: the factor by which steps grow, and
#: the number of steps after which the last change has died out.
GROWTH_FACTOR, SETTLED_STEPS = 1.5, 10

#: Relative to the motion of the mechanism: the elastic displacement below which the
#: error of a deformation is not resolved any further.
SMALLEST_DEFORMATION = 1e-7
#: Rounding in a step, relative to positions; so many times as much may be requested,
#: the second one of steps whose errors add up. Deformations are small numbers.
ROUNDED, RESOLVED, RESOLVED_PART = 1e-15, 10.0, 3.0
ROUNDED_DEFORMATION = 1e-17
#: The same of states of laws, relative to the mechanism or, if that is less, to one.
SMALLEST_STATE, ROUNDED_STATE = 1e-9, 1e-14
#: An error of velocities goes on to displace for so much of the run where motions are
#: as large as bodies: free ones, and those whose period depends on their amplitude.
LASTING_FRACTION = 0.1
#: Radians (or sizes of the mechanism) in a run from which on such errors add up: there
#: are as many of them as of turns. Methods of long steps begin with fewer of them.
ACCUMULATION_RADIANS = 200.0
SMALLEST_NUMBER = 1e-300


@inner(float64(F1, F1, F1, F1))
def scaled_norm(dz, dv, scale_z, scale_v):
    """Root mean square of an error relative to the tolerated one, eq. (22)."""
    total = 0.0
    for i in range(len(scale_z)):
        part = dz[i] / scale_z[i]
        total += part * part
    for i in range(len(dv)):
        part = dv[i] / scale_v[i]
        total += part * part
    return math.sqrt(total / max(1, len(scale_z) + len(dv)))


@inner(boolean(F1, F1))
def all_finite(z, v):
    total = 0.0
    for i in range(len(z)):
        total += abs(z[i])
    for i in range(len(v)):
        total += abs(v[i])
    return math.isfinite(total)


@inner(float64(CONTROL, float64))
def time_resolution(control, t):
    """Shortest step that floating-point numbers resolve near a time.

    At time zero it is a fraction of the run that is far below any step.
    """
    return max(1e-13 * abs(t), 1e-16 * control.duration)


@inner(float64(CONTROL))
def next_step(control):
    """Proposed step, stretched or halved so that the interval ends without a stub, and
    short enough to see what functions of time do.

    Zero when the end of the interval is reached.
    """
    remaining = control.stop - control.time
    if remaining <= time_resolution(control, control.stop):
        return 0.0
    fixed = control.fixed_step == 1
    h = control.step
    if not fixed:
        h = limit_step_by_features(
            control,
            control.time,
            min(h, control.largest_step, control.rotation_step_limit),
        )
    if h >= remaining * (1.0 - (END_TOLERANCE if fixed else 1e-9)):
        return remaining
    if h > 0.5 * remaining and not fixed:
        return 0.5 * remaining
    return h


@inner(boolean(CONTROL, float64))
def is_below_time_resolution(control, h):
    """True if the time does not resolve a step."""
    return h <= time_resolution(control, control.time)


@inner(float64(int64, float64, int64))
def step_size_factor(order, error, iterations):
    """Factor for the next step from an error estimate of size h^(order + 1)."""
    if not math.isfinite(error):
        return 0.1
    safety = SAFETY * (2 * NEWTON_LIMIT + 1) / (2 * NEWTON_LIMIT + iterations)
    return min(8.0, max(0.15, safety * max(error, 1e-10) ** (-1.0 / (order + 1))))


@inner(void(CONTROL, int64, float64, float64, float64, int64, int64))
def choose_next_step(
    control, order, jacobian_contraction, h, error, iterations, failures
):
    """Chooses the next step (Gustafsson); says whether the Jacobian still serves.

    It does while Newton's iteration contracts the error by `jacobian_contraction`.
    """
    control.needs_jacobian = 1 if control.contraction > jacobian_contraction else 0
    if control.fixed_step == 1:
        control.old_step = h
        return
    factor = step_size_factor(order, error, iterations)
    if control.old_step > 0.0 and control.old_error > 0.0:
        ratio = h / control.old_step
        change = (control.old_error / max(error, 1e-10)) ** (1.0 / (order + 1))
        factor = min(factor, max(0.15, factor * ratio * change))
    if failures > 0:
        factor = min(factor, 1.0)
    factor = min(factor, control.newton_step_limit / h)
    control.newton_step_limit *= LIMIT_GROWTH
    control.steps_since_failure += 1
    control.old_step = h
    control.old_error = max(1e-2, error)
    if control.needs_jacobian == 0 and 1.0 <= factor < 1.2:
        factor = 1.0
    control.step = h * factor


@inner(void(CONTROL, int64, float64, float64, float64, int64, int64))
def choose_next_step_in_stages(
    control, order, jacobian_contraction, h, error, iterations, failures
):
    """`choose_next_step` of methods that a change of the step disturbs.

    Steps are lengthened when the last change has died out, by one factor or not at all.
    """
    control.needs_jacobian = 1 if control.contraction > jacobian_contraction else 0
    same = abs(h - control.old_step) <= END_TOLERANCE * h
    control.equal_steps = control.equal_steps + 1 if same else 0
    control.old_step = h
    if control.fixed_step == 1:
        return
    control.step = h
    if (
        control.equal_steps >= SETTLED_STEPS
        and step_size_factor(order, error, iterations) > GROWTH_FACTOR
    ):
        control.step = GROWTH_FACTOR * h


@inner(void(SYSTEM, MEMORY, CONTROL))
def update_error_scales(system, memory, control):
    """Update the largest motion so far, and its present rate of change."""
    z, v, a = control.z, control.v, memory.acceleration
    motion_rate = motion_acceleration = rotation_rate = rotation_acceleration = 0.0
    for b in range(len(system.body)):
        row = system.body[b]
        rd, nq, u, p = row.rd, row.nq, row.vel, row.pos
        rigid = row.np - nq
        axes = 2 if rd == 2 or (rd == 3 and rigid == 3) else 3
        path = _distance(z, control.initial_position, p, p + min(axes, rigid))
        speed_, acceleration = (
            _norm(v, u, u + min(axes, rd)),
            _norm(a, u, u + min(axes, rd)),
        )
        control.largest_speed = max(control.largest_speed, speed_)
        if rd > axes:
            angle = _distance(z, control.initial_position, p + axes, p + rigid)
            if rigid == 7:
                angle *= 2.0
            spin, angular_acceleration = (
                _norm(v, u + axes, u + rd),
                _norm(a, u + axes, u + rd),
            )
            control.largest_rotation = max(control.largest_rotation, angle)
            control.largest_angular_velocity = max(
                control.largest_angular_velocity, spin
            )
            rotation_rate, rotation_acceleration = (
                max(rotation_rate, spin),
                max(rotation_acceleration, angular_acceleration),
            )
            extent = control.extent[b]
            path, speed_ = max(path, extent * angle), max(speed_, extent * spin)
            acceleration = max(acceleration, extent * angular_acceleration)
        motion_rate, motion_acceleration = (
            max(motion_rate, speed_),
            max(motion_acceleration, acceleration),
        )
        deformation = _update_deformation(system, memory, control, b)
        control.largest_motion = max(control.largest_motion, path, deformation)
    control.motion_speed, control.motion_acceleration = motion_rate, motion_acceleration
    control.rotation_speed, control.rotation_acceleration = (
        rotation_rate,
        rotation_acceleration,
    )


@inner(float64(SYSTEM, MEMORY, CONTROL, int64))
def _update_deformation(system, memory, control, b):
    """Update the scales of elastic coordinates and the largest elastic displacement.

    Within a step they do not exceed their static deflection and a vibration.
    """
    row, deformation_rates = system.body[b], control.deformation_rates[b]
    first, q = row.vel + row.rd, row.pos + row.np - row.nq
    for i in range(len(deformation_rates)):
        deformation_rates[i] = 0.0
    for k in range(row.nq):
        i = first + k
        if row.flags & LAW_STATE:
            control.largest_deformation[b] = max(
                control.largest_deformation[b], abs(control.v[i])
            )
            deformation_rates[1] = abs(memory.acceleration[i])
            return 0.0
        size, omega = control.amplitude[i], max(control.frequency[i], SMALLEST_NUMBER)
        speed_, acceleration = (
            size * abs(control.v[i]),
            size * abs(memory.acceleration[i]),
        )
        deformation = size * abs(control.z[q + k] - control.initial_position[q + k])
        control.largest_deformation[b] = max(
            control.largest_deformation[b], deformation
        )
        control.largest_deformation[b] = max(
            control.largest_deformation[b], size * abs(control.z[q + k])
        )
        deformation_rates[0], deformation_rates[1] = (
            max(deformation_rates[0], speed_),
            max(deformation_rates[1], acceleration),
        )
        deformation_rates[2] = max(deformation_rates[2], speed_ / omega)
        deformation_rates[3] = max(
            deformation_rates[3], 2.0 * acceleration / (omega * omega)
        )
    return control.largest_deformation[b]


@inner(float64(F1, int64, int64))
def _norm(x, first, end):
    total = 0.0
    for i in range(first, end):
        total += x[i] * x[i]
    return math.sqrt(total)


@inner(float64(F1, F1, int64, int64))
def _distance(x, y, first, end):
    total = 0.0
    for i in range(first, end):
        total += (x[i] - y[i]) ** 2
    return math.sqrt(total)


@inner(void(SYSTEM, CONTROL, float64))
def set_error_tolerances(system, control, h):
    """Set the tolerated errors of a step.

    An error of elastic velocities may be as large as the frequency times that of the
    deformation; of others as large as the motion that it causes until it is damped out.
    A deformation counts with what it can reach in the step, and in the run where steps
    share the tolerance: the share and a deformation of h^2 would ask for errors of h^3,
    which a method of second order has at any step.
    """
    length, period = control.mechanism_length, control.duration
    control.tolerance_share, rounding_floor = 1.0, RESOLVED * ROUNDED
    reach = h
    if control.shares_tolerance == 1:
        reach = period
        control.tolerance_share, rounding_floor = h / period, RESOLVED_PART * ROUNDED
    tolerance = control.relative_tolerance * control.tolerance_share
    resolved = max(tolerance, rounding_floor)
    motion = h * (control.motion_speed + 0.5 * h * control.motion_acceleration)
    motion = min(max(motion, control.largest_motion), length)
    rotation = h * (control.rotation_speed + 0.5 * h * control.rotation_acceleration)
    rotation = min(max(rotation, control.largest_rotation, motion / length), 1.0)
    speed = max(
        control.motion_speed + h * control.motion_acceleration,
        ROUNDED * length / period,
    )
    speed = max(control.largest_speed, speed)
    spin = control.rotation_speed + h * control.rotation_acceleration
    spin = max(control.largest_angular_velocity, spin, speed / length)
    lasting, tolerated = 0.0, tolerance
    if control.errors_accumulate == 1:
        lasting = LASTING_FRACTION * rotation * period
    if control.shares_tolerance == 0 and control.errors_accumulate == 1:
        radians = spin * period
        reduction = min(radians / control.accumulation_radians, control.max_reduction)
        tolerated /= max(1.0, reduction, radians / ACCUMULATION_RADIANS)
    control.rounding_noise, smallest_size = 0.0, min(length, 1.0)
    for b in range(len(system.body)):
        row = system.body[b]
        rd, nq, u, p = row.rd, row.nq, row.vel, row.pos
        rigid = row.np - nq
        axes = 2 if rd == 2 or (rd == 3 and rigid == 3) else 3
        for k in range(rigid):
            size, full_size = (motion, length) if k < axes else (rotation, 1.0)
            extent = max(full_size, abs(control.z[p + k]))
            control.scale_z[p + k] = max(tolerance * size, rounding_floor * extent)
            noise = ROUNDED * extent / control.scale_z[p + k]
            control.rounding_noise = max(control.rounding_noise, noise)
        for k in range(rd):
            size, rate, full_size = motion, speed, length
            if k >= axes:
                size, rate, full_size = rotation, spin, 1.0
            control.largest_velocity[u + k] = rate
            duration = min(max(size / rate + lasting, SMALLEST_NUMBER), period)
            tolerance_ = max(tolerated * size, rounding_floor * full_size) / duration
            control.scale_v[u + k] = max(tolerance_, rounding_floor * rate)
            noise = ROUNDED * rate / control.scale_v[u + k]
            control.rounding_noise = max(control.rounding_noise, noise)
        deformation_rates = control.deformation_rates[b]
        if row.flags & LAW_STATE:
            size = max(
                control.largest_deformation[b],
                h * deformation_rates[1],
                SMALLEST_STATE * smallest_size,
            )
            control.largest_velocity[u] = size
            control.scale_v[u] = max(resolved * size, ROUNDED_STATE * smallest_size)
            control.scale_z[p] = control.scale_v[u] * period
            continue
        size = min(reach * deformation_rates[0], deformation_rates[2]) + min(
            0.5 * reach * reach * deformation_rates[1], deformation_rates[3]
        )
        size = max(size, control.largest_deformation[b], SMALLEST_DEFORMATION * motion)
        size = max(size, ROUNDED_DEFORMATION / control.relative_tolerance * length)
        for k in range(nq):
            i = u + rd + k
            control.largest_velocity[i] = size / control.amplitude[i]
            control.scale_z[p + rigid + k] = resolved * control.largest_velocity[i]
            control.largest_velocity[i] *= max(control.frequency[i], 1.0 / period)
            control.scale_v[i] = resolved * control.largest_velocity[i]
