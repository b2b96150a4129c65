"""How far a step may go without passing over what it cannot see, see `features`."""

from __future__ import annotations

import math

from numba import boolean, float64, int64, types

from ..compiler.compiling import inner
from ..space.layout import F1, WORK
from .stepping import CONTROL

#: A step may pass so much more than the reach of a piece: what was foreseen is not
#: exact.
OVER = 1.25
#: So much of the reach may be entered from further away: the end of the step sees it.
ENTERED = 0.25
#: Steps grow at most so much.
GROWTH = 8.0
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


@inner(int64(WORK, CONTROL, float64))
def check_ways(work, control, h):
    """Looks at the way that the measures of forces went in a step, just evaluated, and
    at that of their rates.

    Where a measure turns back, its rate falls as a straight line. A rate that turns
    back does so as a parabola whose mean is the way: what it does between the ends of
    the step is seen in the positions. Returns 0, or 5 where a feature was passed.
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
    return 0


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
