"""Limits of a step by features of functions and forces that it must not skip."""

import math

from ..compiler.kernels import inner
from ..compiler.types import boolean, float64, int64, void
from ..spatial.system_arrays import F1, WORK
from .loop_state import CONTROL, RETRY_FRACTION

#: A step may pass so much more than the reach of a piece: what was foreseen is not
#: exact.
OVERSHOOT = 1.25
#: So much of the reach may be entered from further away: the end of the step sees it.
ENTRY_FRACTION = 0.25
#: Steps grow at most so much.
MAX_GROWTH = 8.0
#: A step ends at a corner of a force when it passes it by less than this part of the
#: way of its measure; so often it is tried.
CORNER_DISTANCE, MAX_CORNER_TRIES = 1e-6, 4
#: Parts of a step in which the cubic through its ends is searched for a corner, and
#: bisections of the part that has one.
CORNER_INTERVALS, BISECTIONS = 8, 30
#: The constraints leave open so much of a way, relative to sizes.
RESOLVED_PATH = 1e-11


@inner(int64(F1, int64, int64, float64))
def _piece_index(starts, first, last, x):
    """Index of the piece that contains x, from `first` and before `last`; the first
    begins at -inf.
    """
    while last - first > 1:
        middle = (first + last) // 2
        if starts[middle] <= x:
            first = middle
        else:
            last = middle
    return first


@inner(float64(CONTROL, int64, float64, float64))
def limit_step_by_force_pieces(control, axis, x, path):
    """Fraction of a path, with its sign, that a step may go from x.

    At least up to the beginning of the next piece, and as far as its length allows.
    """
    starts, reaches = control.feature_starts, control.feature_lengths
    first, last = control.feature_offsets[axis], control.feature_offsets[axis + 1]
    k, allowed = _piece_index(starts, first, last, x), abs(path)
    if path >= 0.0:
        while k < last and starts[k] < x + allowed:
            allowed = min(allowed, max(reaches[k], starts[k] - x))
            k += 1
        return allowed
    allowed = min(allowed, reaches[k])
    while k > first and starts[k] > x - allowed:
        allowed = min(allowed, max(reaches[k - 1], x - starts[k]))
        k -= 1
    return allowed


@inner(boolean(CONTROL, int64, float64, float64))
def _passes_feature(control, axis, x, y):
    """True if the way from x to y leads through a piece that it cannot have seen."""
    starts, reaches = control.feature_starts, control.feature_lengths
    first, last = control.feature_offsets[axis], control.feature_offsets[axis + 1]
    low, high = min(x, y), max(x, y)
    k = _piece_index(starts, first, last, low)
    while k < last and starts[k] < high:
        end = high
        if k + 1 < last:
            end = min(high, starts[k + 1])
        inside = end - max(low, starts[k])
        if high - low > OVERSHOOT * reaches[k] and inside > ENTRY_FRACTION * reaches[k]:
            return True
        k += 1
    return False


@inner(int64(CONTROL, int64, float64, float64, float64, float64, float64))
def _check_path(control, axis, x, turning_value, y, end_rate, h):
    """Looks at the way from x over `turning_value` to y, which it leaves at a pace.

    Limits the next step. Returns 0, or 5 where a feature was passed; a fixed step notes
    that and goes on.
    """
    if control.feature_offsets[axis + 1] - control.feature_offsets[axis] < 2:
        return 0
    passes_outward = _passes_feature(control, axis, x, turning_value)
    if passes_outward or _passes_feature(control, axis, turning_value, y):
        if control.fixed_step == 0:
            return 5
        passed = control.passed_features[axis - 1]
        if passed[0] == 0.0:
            passed[1] = control.time
        passed[0] += 1.0
    path = MAX_GROWTH * h * end_rate
    allowed_path = limit_step_by_force_pieces(control, axis, y, path)
    if allowed_path < abs(path):
        control.rotation_step_limit = min(
            control.rotation_step_limit, allowed_path / abs(end_rate)
        )
    return 0


@inner(float64(float64, float64, float64, float64, float64))
def _hermite_cubic(x, slope, y, end_slope, fraction):
    """Cubic with given values and slopes at both ends, at a fraction of the
    interval.
    """
    remaining = 1.0 - fraction
    inside = (slope + x - y) * remaining + (y - x - end_slope) * fraction
    return x * remaining + y * fraction + fraction * remaining * inside


@inner(float64(CONTROL, int64, float64, float64, float64, float64))
def _fraction_to_corner(control, axis, x, slope, y, end_slope):
    """The share of a step at which a measure first meets a corner of its force; 1 where
    it meets none, or ends there.

    Parameters
    ----------
    slope, end_slope
        Rates of the measure at both ends, times the step.
    """
    nearest = 1.0
    size = max(abs(x), abs(y), 1e-3 * control.mechanism_length)
    tolerance = max(CORNER_DISTANCE * abs(y - x), RESOLVED_PATH * size)
    for k in range(control.feature_offsets[axis], control.feature_offsets[axis + 1]):
        corner = control.feature_starts[k]
        if control.feature_corners[k] == 0.0:
            continue
        if abs(corner - x) <= tolerance or abs(corner - y) <= tolerance:
            continue
        for i in range(CORNER_INTERVALS):
            low, high = i / CORNER_INTERVALS, (i + 1) / CORNER_INTERVALS
            side = _hermite_cubic(x, slope, y, end_slope, low) - corner
            if side * (_hermite_cubic(x, slope, y, end_slope, high) - corner) < 0.0:
                for _ in range(BISECTIONS):
                    middle = 0.5 * (low + high)
                    if (
                        side * (_hermite_cubic(x, slope, y, end_slope, middle) - corner)
                        > 0.0
                    ):
                        low = middle
                    else:
                        high = middle
                nearest = min(nearest, high)
                break
    return nearest


@inner(int64(WORK, CONTROL, float64))
def _end_step_at_corner(work, control, h):
    """0, or 6 where a step is to be tried again as it passes a corner of a force."""
    control.retry_fraction = RETRY_FRACTION
    if control.fixed_step == 1 or control.corner_tries == MAX_CORNER_TRIES:
        control.corner_tries = 0
        return 0
    fraction = 1.0
    for k in range(len(control.force_measures)):
        axis = 2 * k + 1
        if control.feature_offsets[axis + 1] - control.feature_offsets[axis] > 1:
            x, rate = control.force_measures[k, 0], control.force_measures[k, 1]
            y, rate_at_end = work.measure[k, 0], work.measure[k, 1]
            corner_fraction = _fraction_to_corner(
                control, axis, x, h * rate, y, h * rate_at_end
            )
            fraction = min(fraction, corner_fraction)
    if fraction == 1.0:
        control.corner_tries = 0
        return 0
    control.corner_tries += 1
    control.retry_fraction = fraction
    return 6


@inner(int64(WORK, CONTROL, float64))
def check_measure_paths(work, control, h):
    """Check the paths of the measures of forces, and of their rates, in the evaluated
    step.

    Where a measure reverses, its rate is taken as linear; a rate that reverses as a
    parabola whose mean is the change of the measure. Returns 0, 5 if a feature was
    skipped, or 6 for a corner of a force.
    """
    measured = control.force_measures
    for k in range(len(measured)):
        x, rate = measured[k, 0], measured[k, 1]
        y, rate_at_end = work.measure[k, 0], work.measure[k, 1]
        turning_value = y
        if rate * rate_at_end < 0.0:
            turning_value = x + 0.5 * h * rate * rate / (rate - rate_at_end)
        status = _check_path(control, 2 * k + 1, x, turning_value, y, rate_at_end, h)
        rate_deviation = (y - x) / h - 0.5 * (rate + rate_at_end)
        if measured[k, 4] > 0.0:
            full_turn_rate = measured[k, 4] / h
            rate_deviation -= full_turn_rate * math.floor(
                rate_deviation / full_turn_rate + 0.5
            )
        size = max(1.0, control.mechanism_length, abs(x), abs(y))
        if abs(rate_deviation) * h < RESOLVED_PATH * size:
            rate_deviation = 0.0
        slope, extreme = rate_at_end - rate, rate_at_end
        if abs(slope) < 6.0 * abs(rate_deviation):
            fraction = 0.5 + slope / (12.0 * rate_deviation)
            extreme = rate + fraction * (
                slope + 6.0 * rate_deviation * (1.0 - fraction)
            )
        end_rate = (slope - 6.0 * rate_deviation) / h
        if status == 0:
            status = _check_path(
                control, 2 * k + 2, rate, extreme, rate_at_end, end_rate, h
            )
        if status != 0:
            return status
        measured[k, 2], measured[k, 3] = y, rate_at_end
    return _end_step_at_corner(work, control, h)


@inner(void(CONTROL))
def store_measures(control):
    """Store the measures at the end of a step as the current ones."""
    measured = control.force_measures
    for k in range(len(measured)):
        measured[k, 0], measured[k, 1] = measured[k, 2], measured[k, 3]


@inner(float64(CONTROL, float64, float64))
def limit_step_by_features(control, t, h):
    """The step, shortened where it would pass over a feature of a function of time."""
    return limit_step_by_force_pieces(control, 0, t, h)
