"""Where a function in pieces is not smooth.

A kink shows in one of two ways: pieces have become shorter and shorter towards it, or
it lies where two pieces join, and derivatives differ there.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.sid import Array

from .chebyshev_pieces import Series

#: Pieces that surround a kink are shorter than this part of the longest one.
SHORT = 1e-4
#: They become so many times longer on both sides, the shortest are at most so many;
#: there are more where a function is smooth but quick.
GRADED, MOST_SHORTEST = 64.0, 6
#: So many shortest pieces away from a kink nothing is rounding.
BESIDE = 8.0
#: Derivatives that differ by less than this part of the largest are the same.
SAME = 1e-6
#: What tolerated errors make of derivatives at the ends of a piece, per order.
AMPLIFIED = (20.0, 2e3, 1e5, 4e6)


def kinks(series: Series, known: Iterable[float] = ()) -> tuple[float, ...]:
    """Times at which the function, its rate or its acceleration is not smooth."""
    pits = _pits(series.lengths)
    joined = joined_kinks(series)
    found = {_middle(series, *pit) for pit in pits}
    for t in {*known, *(float(t) for t in joined)}:
        if not any(_is_inside(series, *pit, t) for pit in pits):
            found.add(t)
    return tuple(sorted(found))


def check_rates(series: Series, place: str) -> None:
    """Refuses jumps of the rate: they would need an impact.

    Raises
    ------
    InputError : names the time and the size of the first one.
    """
    times, jumps = _jumps(series, 1)
    told = list(zip(times, jumps, strict=True))
    for pit in _pits(series.lengths):
        t, jump = _middle(series, *pit), _bend(series, *pit)
        if jump != 0.0:
            told.append((t, jump))
    if told:
        t, jump = min(told)
        raise InputError(
            f"the callable jumps in its rate by {jump:.6g} at t = {t:.9g} s",
            place=place,
            expected="a function whose value and rate are continuous",
        )


def _jumps(series: Series, order: int) -> tuple[Array, Array]:
    """Times where a derivative differs between two pieces, and by how much."""
    first, last = series.at_ends(order)
    jumps = first[1:] - last[:-1]
    noise = AMPLIFIED[order] * series.limits / (0.5 * series.lengths) ** order
    least = SAME * max(np.abs(first).max(), np.abs(last).max())
    both = series.resolved[1:] & series.resolved[:-1]
    told = both & (np.abs(jumps) > np.maximum(noise[1:] + noise[:-1], least))
    return series.edges[1:-1][told], jumps[told]


def joined_kinks(series: Series) -> Array:
    """Ends of pieces where the rate or one of its two derivatives jumps."""
    return np.unique(np.concatenate([_jumps(series, order)[0] for order in (1, 2, 3)]))


def _pits(lengths: Array) -> list[tuple[int, int]]:
    """First and last of the shortest pieces around each kink."""
    return [
        (first, last)
        for first, last in valleys(lengths, SHORT)
        if _grows(lengths[:first][::-1], lengths[first : last + 1].min())
        and _grows(lengths[last + 1 :], lengths[first : last + 1].min())
    ]


def valleys(lengths: Array, share: float) -> list[tuple[int, int]]:
    """First and last of pieces that are shorter than those beside them.

    share : of the longest piece, below which they are
    """
    found: list[tuple[int, int]] = []
    for k in np.flatnonzero(lengths < share * lengths.max()).tolist():
        least = lengths[k]
        if least > lengths[max(k - 1, 0) : k + 2].min() or _holds(found, k):
            continue
        first = last = k
        while first > 0 and lengths[first - 1] <= 2.5 * least:
            first -= 1
        while last + 1 < len(lengths) and lengths[last + 1] <= 2.5 * least:
            last += 1
        if last - first < MOST_SHORTEST:
            found.append((first, last))
    return found


def _holds(pits: list[tuple[int, int]], k: int) -> bool:
    return bool(pits) and k <= pits[-1][1]


def _grows(lengths: Array, least: float) -> bool:
    """Whether pieces become longer, and none before that as short as the least."""
    long = np.flatnonzero(lengths >= GRADED * least)
    return bool(len(long)) and lengths[: long[0]].min(initial=np.inf) > 2.0 * least


def _middle(series: Series, first: int, last: int) -> float:
    """The middle of the shortest piece around a kink."""
    k = first + int(np.argmin(series.lengths[first : last + 1]))
    return float(0.5 * (series.edges[k] + series.edges[k + 1]))


def _is_inside(series: Series, first: int, last: int, t: float) -> bool:
    """Whether a time is that of a kink, to the lengths of the pieces around it."""
    off = BESIDE * float(series.lengths[first : last + 1].min())
    return bool(series.edges[first] - off <= t <= series.edges[last + 1] + off)


def _bend(series: Series, first: int, last: int) -> float:
    """How far the rate jumps at a kink, zero if only the acceleration does."""
    off = BESIDE * float(series.lengths[first : last + 1].min())
    sides = np.array([series.edges[first] - off, series.edges[last + 1] + off])
    rates = series.at(sides, 1)
    natural = 4.0 * np.abs(series.at(sides, 2)).max() * (sides[1] - sides[0])
    middles = 0.5 * (series.edges[1:] + series.edges[:-1])
    largest = np.abs(series.at(middles, 1)).max()
    jump = float(rates[1] - rates[0])
    return jump if abs(jump) > natural + SAME * largest else 0.0
