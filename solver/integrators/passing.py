"""How far a step may go without passing over what it cannot see, see `features`."""

from __future__ import annotations

import math

from numba import boolean, float64, int64, types

from ..compiler.compiling import inner
from ..space.layout import F1, WORK
from .stepping import CONTROL, RETRY

#: A step may pass so much more than the reach of a piece: what was foreseen is not
#: exact.
OVER = 1.25
#: So much of the reach may be entered from further away: the end of the step sees it.
ENTERED = 0.25
#: Steps grow at most so much.
GROWTH = 8.0
#: A step ends at a corner of a force when it passes it by less than this part of the
#: way of its measure; so often it is tried.
LANDED, LANDINGS = 1e-6, 4
#: Parts of a step in which the cubic through its ends is asked for a corner, and
#: bisections of the part that has one.
PARTS, BISECTIONS = 8, 30
#: The constraints leave open so much of a way, relative to sizes.
RESOLVED_WAY = 1e-11


@inner(int64(F1, int64, int64, float64))
def _piece(starts, first, last, x):
    """The piece that holds x, from `first` on and before `last`; the first one begins
    at -inf."""
    while last - first > 1:
        middle = (first + last) // 2
        if starts[middle] <= x:
            first = middle
        else:
            last = middle
    return first


@inner(float64(CONTROL, int64, float64, float64))
def passable(control, axis, x, way):
    """How much of a way, with its sign, may be gone from x: at least up to where the
    next piece begins, and as far as it reaches."""
    starts, reaches = control.starts, control.reaches
    first, last = control.features[axis], control.features[axis + 1]
    k, rest = _piece(starts, first, last, x), abs(way)
    if way >= 0.0:
        while k < last and starts[k] < x + rest:
            rest = min(rest, max(reaches[k], starts[k] - x))
            k += 1
        return rest
    rest = min(rest, reaches[k])
    while k > first and starts[k] > x - rest:
        rest = min(rest, max(reaches[k - 1], x - starts[k]))
        k -= 1
    return rest


@inner(boolean(CONTROL, int64, float64, float64))
def _passed(control, axis, x, y):
    """Whether the way from x to y leads through a piece that it cannot have seen."""
    starts, reaches = control.starts, control.reaches
    first, last = control.features[axis], control.features[axis + 1]
    low, high = min(x, y), max(x, y)
    k = _piece(starts, first, last, low)
    while k < last and starts[k] < high:
        end = high
        if k + 1 < last:
            end = min(high, starts[k + 1])
        inside = end - max(low, starts[k])
        if high - low > OVER * reaches[k] and inside > ENTERED * reaches[k]:
            return True
        k += 1
    return False


@inner(int64(CONTROL, int64, float64, float64, float64, float64, float64))
def _look(control, axis, x, furthest, y, pace, h):
    """Looks at the way from x over `furthest` to y, which it leaves at a pace.

    Limits the next step. Returns 0, or 5 where a feature was passed; a fixed step notes
    that and goes on.
    """
    if control.features[axis + 1] - control.features[axis] < 2:
        return 0
    out = _passed(control, axis, x, furthest)
    if out or _passed(control, axis, furthest, y):
        if control.fixed_step == 0:
            return 5
        passed = control.passed[axis - 1]
        if passed[0] == 0.0:
            passed[1] = control.time
        passed[0] += 1.0
    way = GROWTH * h * pace
    allowed = passable(control, axis, y, way)
    if allowed < abs(way):
        control.unturned = min(control.unturned, allowed / abs(pace))
    return 0


@inner(float64(float64, float64, float64, float64, float64))
def _cubic(x, slope, y, end_slope, share):
    """The cubic with values and slopes at both ends, at a share of the way."""
    rest = 1.0 - share
    inside = (slope + x - y) * rest + (y - x - end_slope) * share
    return x * rest + y * share + share * rest * inside


@inner(float64(CONTROL, int64, float64, float64, float64, float64))
def _share_to_corner(control, axis, x, slope, y, end_slope):
    """The share of a step at which a measure first meets a corner of its force; 1 where
    it meets none, or ends there.

    slope, end_slope : rates of the measure at both ends, times the step
    """
    nearest = 1.0
    size = max(abs(x), abs(y), 1e-3 * control.length)
    open_way = max(LANDED * abs(y - x), RESOLVED_WAY * size)
    for k in range(control.features[axis], control.features[axis + 1]):
        corner = control.starts[k]
        if control.corners[k] == 0.0:
            continue
        if abs(corner - x) <= open_way or abs(corner - y) <= open_way:
            continue
        for i in range(PARTS):
            low, high = i / PARTS, (i + 1) / PARTS
            side = _cubic(x, slope, y, end_slope, low) - corner
            if side * (_cubic(x, slope, y, end_slope, high) - corner) < 0.0:
                for _ in range(BISECTIONS):
                    middle = 0.5 * (low + high)
                    if side * (_cubic(x, slope, y, end_slope, middle) - corner) > 0.0:
                        low = middle
                    else:
                        high = middle
                nearest = min(nearest, high)
                break
    return nearest


@inner(int64(WORK, CONTROL, float64))
def _land_on_corner(work, control, h):
    """0, or 6 where a step is to be tried again as it passes a corner of a force."""
    control.retry = RETRY
    if control.fixed_step == 1 or control.corner_tries == LANDINGS:
        control.corner_tries = 0
        return 0
    share = 1.0
    for k in range(len(control.measured)):
        axis = 2 * k + 1
        if control.features[axis + 1] - control.features[axis] > 1:
            x, rate = control.measured[k, 0], control.measured[k, 1]
            y, then = work.measure[k, 0], work.measure[k, 1]
            met = _share_to_corner(control, axis, x, h * rate, y, h * then)
            share = min(share, met)
    if share == 1.0:
        control.corner_tries = 0
        return 0
    control.corner_tries += 1
    control.retry = share
    return 6


@inner(int64(WORK, CONTROL, float64))
def check_ways(work, control, h):
    """Looks at the way that the measures of forces went in a step, just evaluated, and
    at that of their rates.

    Where a measure turns back, its rate falls as a straight line. A rate that turns
    back does so as a parabola whose mean is the way: what it does between the ends of
    the step is seen in the positions. Returns 0, 5 where a feature was passed, or 6
    where a corner of a force was.
    """
    measured = control.measured
    for k in range(len(measured)):
        x, rate = measured[k, 0], measured[k, 1]
        y, then = work.measure[k, 0], work.measure[k, 1]
        furthest = y
        if rate * then < 0.0:
            furthest = x + 0.5 * h * rate * rate / (rate - then)
        status = _look(control, 2 * k + 1, x, furthest, y, then, h)
        bow = (y - x) / h - 0.5 * (rate + then)
        if measured[k, 4] > 0.0:
            turn = measured[k, 4] / h
            bow -= turn * math.floor(bow / turn + 0.5)
        size = max(1.0, control.length, abs(x), abs(y))
        if abs(bow) * h < RESOLVED_WAY * size:
            bow = 0.0
        slope, extreme = then - rate, then
        if abs(slope) < 6.0 * abs(bow):
            share = 0.5 + slope / (12.0 * bow)
            extreme = rate + share * (slope + 6.0 * bow * (1.0 - share))
        pace = (slope - 6.0 * bow) / h
        if status == 0:
            status = _look(control, 2 * k + 2, rate, extreme, then, pace, h)
        if status != 0:
            return status
        measured[k, 2], measured[k, 3] = y, then
    return _land_on_corner(work, control, h)


@inner(types.void(CONTROL))
def keep_ways(control):
    """Makes the measures at the end of a step the current ones."""
    measured = control.measured
    for k in range(len(measured)):
        measured[k, 0], measured[k, 1] = measured[k, 2], measured[k, 3]


@inner(float64(CONTROL, float64, float64))
def unpassed(control, t, h):
    """The step, shortened where it would pass over a feature of a function of time."""
    return passable(control, 0, t, h)
