"""Positions where a piecewise function is not smooth.

A kink appears in one of two ways: pieces become shorter and shorter towards it, or it
is an end of two pieces whose derivatives differ there.
"""

from collections.abc import Iterable

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from .chebyshev import ChebyshevSeries

#: Pieces that surround a kink are shorter than this part of the longest one.
KINK_PIECE = 1e-4
#: They become so many times longer on both sides, the shortest are at most so many;
#: there are more where a function is smooth but quick.
GRADING, MAX_SHORTEST = 64.0, 6
#: So many shortest pieces away from a kink nothing is rounding.
ROUNDING_DISTANCE = 8.0
#: Derivatives that differ by less than this part of the largest are the same.
EQUAL_DERIVATIVES = 1e-6
#: What tolerated errors make of derivatives at the ends of a piece, per order.
ERROR_AMPLIFICATION = (20.0, 2e3, 1e5, 4e6)


def kink_times(
    series: ChebyshevSeries, known: Iterable[float] = ()
) -> tuple[float, ...]:
    """Times at which the function, its rate or its acceleration is not smooth."""
    intervals = _kink_intervals(series.lengths)
    at_piece_ends = kinks_at_piece_ends(series)
    times = {_kink_time(series, *pit) for pit in intervals}
    for t in {*known, *(float(t) for t in at_piece_ends)}:
        if not any(_is_inside(series, *pit, t) for pit in intervals):
            times.add(t)
    return tuple(sorted(times))


def check_rates(series: ChebyshevSeries, place: str) -> None:
    """Refuses jumps of the rate: they would need an impact.

    Raises
    ------
    InputError
        Names the time and the size of the first one.
    """
    times, jumps = _derivative_jumps(series, 1)
    jumps_found = list(zip(times, jumps, strict=True))
    for interval in _kink_intervals(series.lengths):
        t, jump = _kink_time(series, *interval), _rate_jump(series, *interval)
        if jump != 0.0:
            jumps_found.append((t, jump))
    if jumps_found:
        t, jump = min(jumps_found)
        raise InputError(
            f"the callable jumps in its rate by {jump:.6g} at t = {t:.9g} s",
            place=place,
            expected="a function whose value and rate are continuous",
        )


def _derivative_jumps(series: ChebyshevSeries, order: int) -> tuple[Array, Array]:
    """Times where a derivative differs between two pieces, and by how much."""
    first, last = series.at_ends(order)
    jumps = first[1:] - last[:-1]
    noise = ERROR_AMPLIFICATION[order] * series.limits / (0.5 * series.lengths) ** order
    least = EQUAL_DERIVATIVES * max(np.abs(first).max(), np.abs(last).max())
    both = series.resolved[1:] & series.resolved[:-1]
    is_jump = both & (np.abs(jumps) > np.maximum(noise[1:] + noise[:-1], least))
    return series.edges[1:-1][is_jump], jumps[is_jump]


def kinks_at_piece_ends(series: ChebyshevSeries) -> Array:
    """Ends of pieces where the rate or one of its two derivatives jumps."""
    return np.unique(
        np.concatenate([_derivative_jumps(series, order)[0] for order in (1, 2, 3)])
    )


def _kink_intervals(lengths: Array) -> list[tuple[int, int]]:
    """First and last of the shortest pieces around each kink."""
    return [
        (first, last)
        for first, last in short_intervals(lengths, KINK_PIECE)
        if _is_graded(lengths[:first][::-1], lengths[first : last + 1].min())
        and _is_graded(lengths[last + 1 :], lengths[first : last + 1].min())
    ]


def short_intervals(lengths: Array, share: float) -> list[tuple[int, int]]:
    """First and last of pieces that are shorter than those beside them.

    Parameters
    ----------
    share
        Of the longest piece, below which they are.
    """
    intervals: list[tuple[int, int]] = []
    for k in np.flatnonzero(lengths < share * lengths.max()).tolist():
        least = lengths[k]
        if least > lengths[max(k - 1, 0) : k + 2].min() or _contains(intervals, k):
            continue
        first = last = k
        while first > 0 and lengths[first - 1] <= 2.5 * least:
            first -= 1
        while last + 1 < len(lengths) and lengths[last + 1] <= 2.5 * least:
            last += 1
        if last - first < MAX_SHORTEST:
            intervals.append((first, last))
    return intervals


def _contains(intervals: list[tuple[int, int]], k: int) -> bool:
    return bool(intervals) and k <= intervals[-1][1]


def _is_graded(lengths: Array, least: float) -> bool:
    """True if pieces become longer, and none before that as short as the least."""
    long = np.flatnonzero(lengths >= GRADING * least)
    if not len(long):
        return False
    return bool(lengths[: long[0]].min(initial=np.inf) > 2.0 * least)


def _kink_time(series: ChebyshevSeries, first: int, last: int) -> float:
    """The middle of the shortest piece around a kink."""
    k = first + int(np.argmin(series.lengths[first : last + 1]))
    return float(0.5 * (series.edges[k] + series.edges[k + 1]))


def _is_inside(series: ChebyshevSeries, first: int, last: int, t: float) -> bool:
    """True if a time is that of a kink, to the lengths of the pieces around it."""
    off = ROUNDING_DISTANCE * float(series.lengths[first : last + 1].min())
    return bool(series.edges[first] - off <= t <= series.edges[last + 1] + off)


def _rate_jump(series: ChebyshevSeries, first: int, last: int) -> float:
    """How far the rate jumps at a kink, zero if only the acceleration does."""
    off = ROUNDING_DISTANCE * float(series.lengths[first : last + 1].min())
    sides = np.array([series.edges[first] - off, series.edges[last + 1] + off])
    rates = series.at(sides, 1)
    natural = 4.0 * np.abs(series.at(sides, 2)).max() * (sides[1] - sides[0])
    middles = 0.5 * (series.edges[1:] + series.edges[:-1])
    largest = np.abs(series.at(middles, 1)).max()
    jump = float(rates[1] - rates[0])
    return jump if abs(jump) > natural + EQUAL_DERIVATIVES * largest else 0.0
