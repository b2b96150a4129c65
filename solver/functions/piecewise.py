"""Functions of time in the forms that kernels evaluate: data, breaks and features.

Features of functions and forces that no step may skip.

An integrator samples a function of time, or the force of a spring, at the stages of its
steps only. Features are pieces: how far a polynomial of low degree follows the function
from a position on. Steps inside a piece are no longer than its length.

Positions where a piecewise function is not smooth.

A kink appears in one of two ways: pieces become shorter and shorter towards it, or it
is an end of two pieces whose derivatives differ there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.polynomial.polynomial import polyval

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import Input, SineRamp

from ..spatial import system_arrays as at
from .chebyshev import ChebyshevSeries, FitSamples, bisected_fit

#: Part of its period in which a polynomial of `features` follows a harmonic.
RESOLVED_PERIOD = 0.5
#: Coefficients of a piece of an input, as of the cubic between values of a smooth one.
N_INPUT_TERMS = 4


@dataclass(frozen=True, eq=False)
class PiecewisePolynomial:
    """Polynomials in powers of (t - start), lowest first.

    Attributes
    ----------
    starts : (n,)
        Growing; the first piece also holds before, the last one after.
    terms : (n, terms)
        Coefficients.
    """

    starts: Array
    terms: Array

    kind = at.POLYNOMIAL

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.starts), self.terms.shape[1]

    def data(self) -> Array:
        return np.concatenate([self.starts, self.terms.ravel()])

    def breaks(self) -> list[float]:
        return [float(t) for t in self.starts[1:]]

    def features(self, span: tuple[float, float]) -> Features:
        return polynomial_features(self.starts, self.terms, span)


@dataclass(frozen=True, eq=False)
class SmoothCurve:
    """A smooth function in pieces, each a polynomial in x from -1 to 1.

    Attributes
    ----------
    edges : (n + 1,)
        Growing.
    terms : (n, terms)
        Coefficients of powers of x, lowest first.
    kinks
        Times at which the curve is not smooth.
    """

    edges: Array
    terms: Array
    kinks: tuple[float, ...]

    kind = at.SMOOTH

    @property
    def shape(self) -> tuple[int, int]:
        return self.terms.shape[0], self.terms.shape[1]

    def data(self) -> Array:
        return np.concatenate([self.edges, self.terms.ravel()])

    def breaks(self) -> list[float]:
        return list(self.kinks)

    def features(self, span: tuple[float, float]) -> Features:
        return curve_features(self._values, self.edges, self.kinks, span)

    def _values(self, t: Array) -> Array:
        k = np.searchsorted(self.edges, t, side="right") - 1
        k = np.clip(k, 0, len(self.terms) - 1)
        x = 2.0 * (t - self.edges[k]) / np.diff(self.edges)[k] - 1.0
        return np.asarray(polyval(x, self.terms[k].T, tensor=False))


@dataclass(frozen=True)
class HarmonicFunction:
    """offset + amplitude sin(omega t + phase)."""

    offset: float
    amplitude: float
    omega: float
    phase: float

    kind = at.HARMONIC
    shape = (1, 0)

    def data(self) -> Array:
        return np.array([self.offset, self.amplitude, self.omega, self.phase])

    def breaks(self) -> list[float]:
        return []

    def features(self, span: tuple[float, float]) -> Features:
        if self.amplitude == 0.0 or self.omega == 0.0:
            return NO_FEATURES
        part = np.array([RESOLVED_PERIOD * 2.0 * math.pi / abs(self.omega)])
        return Features(NO_FEATURES.starts, part)


@dataclass(frozen=True)
class SineRampFunction:
    """A sine ramp, see `formats.scene.SineRamp`."""

    ramp: SineRamp

    kind = at.RAMP
    shape = (2, 0)

    def data(self) -> Array:
        ramp = self.ramp
        of_rate = ramp.of == "rate"
        before, rate = (ramp.offset, ramp.start) if of_rate else (ramp.start, 0.0)
        change = ramp.end - ramp.start
        return np.array(
            [ramp.from_, ramp.to, before, change, float(of_rate), rate], float
        )

    def breaks(self) -> list[float]:
        return [self.ramp.from_, self.ramp.to]

    def features(self, span: tuple[float, float]) -> Features:
        part = RESOLVED_PERIOD * (self.ramp.to - self.ramp.from_)
        starts = np.array([-np.inf, self.ramp.from_, self.ramp.to])
        return Features(starts, np.array([np.inf, part, np.inf]))


def input_pieces(signal: Input, start: float) -> PiecewisePolynomial | None:
    """Constant pieces of an input from the start of a run on, which a plant rewrites;
    None if the input has a table that is no sequence of constants."""
    times, values = signal.times or (), signal.values or ()
    if times and signal.interpolation != "hold":
        return None
    before = np.searchsorted(times, start, side="right")
    first = values[before - 1] if before else signal.initial
    held = np.array([first, *values[before:]])
    terms = np.column_stack([held, np.zeros((len(held), N_INPUT_TERMS - 1))])
    return PiecewisePolynomial(np.array([start, *times[before:]]), terms)


CompiledFunction = (
    PiecewisePolynomial | SmoothCurve | HarmonicFunction | SineRampFunction
)


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

#: Degree of the polynomials, and their error relative to the largest value.
DEGREE, ERROR = 8, 1e-6
#: Pieces of a function of time below this part of the span are rounding at a kink.
MIN_PIECE = 1e-7
#: Where the pieces of a function that is known are looked at, -1 to 1.
SAMPLE_POINTS = np.array([-0.8, -0.4, 0.0, 0.4, 0.8])
#: Where friction changes, in units of its speed: tanh there in pieces of a polynomial.
FRICTION_EDGES = np.array([-4.0, -4.0 / 3.0, 4.0 / 3.0, 4.0])
#: Neighbouring pieces of a table are one when a polynomial follows them so well,
#: relative to how much each changes.
MERGE_TOLERANCE = 0.1
#: Steps end where the slope of a force changes by more than this part of the largest.
CORNER_TOLERANCE = 0.05


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


@dataclass(frozen=True, eq=False)
class Features:
    """Pieces of an axis, from -inf to inf.

    Attributes
    ----------
    starts : (n,)
        Growing, where the pieces begin; the first is -inf.
    lengths : (n,)
        How far a step may go inside them.
    corners
        Of the starts, those at which the slope jumps: steps end there.
    """

    starts: Array
    lengths: Array
    corners: tuple[float, ...] = ()


NO_FEATURES = Features(np.array([-np.inf]), np.array([np.inf]))


def merge_features(parts: Sequence[Features]) -> Features:
    """The shortest lengths of all."""
    if len(parts) == 1:
        return parts[0]
    starts = np.unique(np.concatenate([NO_FEATURES.starts, *(p.starts for p in parts)]))
    lengths = np.full(len(starts), np.inf)
    for part in parts:
        k = np.searchsorted(part.starts, starts, side="right") - 1
        lengths = np.minimum(lengths, part.lengths[k])
    is_kept = np.concatenate([[True], lengths[1:] != lengths[:-1]])
    is_kept |= np.isfinite(lengths)
    return Features(starts[is_kept], lengths[is_kept])


def curve_features(
    value: Callable[[Array], Array],
    edges: Array,
    kinks: Sequence[float],
    span: tuple[float, float],
) -> Features:
    """Of a function of time that is known on pieces, smooth but for its kinks.

    What is straight to the tolerated error needs no look inside.
    """
    inner = [t for t in kinks if span[0] < t < span[1]]
    halves = 0.5 * np.diff(edges)
    times = (edges[:-1, None] + halves[:, None] * (1.0 + SAMPLE_POINTS)).ravel()
    scan = FitSamples(times, value(times))
    outer = np.array([span[0], *inner, span[1]])
    series = bisected_fit(value, outer, scan, DEGREE, ERROR, "")
    curvature = np.abs(series.terms[:, 2:]).sum(axis=1)
    size = float(np.max(np.abs(scan.values), initial=0.0))
    is_curved = (curvature > ERROR * size) & (
        series.lengths > MIN_PIECE * (span[1] - span[0])
    )
    return _with_unbounded_ends(
        series.edges, np.where(is_curved, series.lengths, np.inf)
    )


def polynomial_features(
    starts: Array, terms: Array, span: tuple[float, float]
) -> Features:
    """Of polynomials in time, lowest power first, between which steps end anyway."""
    ends = np.append(starts[1:], max(span[1], starts[-1]))
    begins = np.append(min(span[0], starts[0]), starts[1:])
    edges = np.clip(np.append(begins, span[1]), *span)
    lengths, inside = ends - begins, np.diff(edges) > 0.0
    powers = np.arange(terms.shape[1])
    sizes = np.abs(terms) * np.maximum(ends - starts, lengths)[:, None] ** powers
    matter = sizes > ERROR * sizes.sum(axis=1).max(initial=0.0)
    degree = np.max(np.where(matter, powers, 0), axis=1)
    followed = lengths * DEGREE / np.maximum(degree, 1)
    reaches = np.where(degree > 1, followed, np.inf)
    return _with_unbounded_ends(np.append(edges[:-1][inside], span[1]), reaches[inside])


def characteristic_features(value: Callable[[Array], Array], knots: Array) -> Features:
    """Of a force over a measure of the motion, straight outside of its knots."""
    knots = np.unique(knots)
    if len(knots) < 2:
        return NO_FEATURES
    edges = [float(knots[0])]
    waiting = [(0, len(knots) - 1)]
    while waiting:
        i, j = waiting.pop()
        if j == i + 1 or _is_one_polynomial(value, knots[i : j + 1]):
            edges.append(float(knots[j]))
        else:
            middle = (i + j) // 2
            waiting += [(middle, j), (i, middle)]
    return _with_unbounded_ends(np.array(edges), np.diff(edges))


def add_corners(known: Features, x: Array, y: Array) -> Features:
    """With the corners of a force over a measure that is straight between points."""
    slopes = np.diff(y) / np.diff(x)
    changes = np.abs(np.diff(slopes))
    corners = x[1:-1][changes > CORNER_TOLERANCE * np.abs(slopes).max()]
    starts = np.union1d(known.starts, corners)
    k = np.searchsorted(known.starts, starts, side="right") - 1
    return Features(starts, known.lengths[k], tuple(corners.tolist()))


def friction_features(speed: float) -> Features:
    """Of friction over the relative speed, which it rotates with within
    some `speed`.
    """
    edges = speed * FRICTION_EDGES
    return _with_unbounded_ends(edges, np.diff(edges))


def _is_one_polynomial(value: Callable[[Array], Array], knots: Array) -> bool:
    """True if one polynomial follows all pieces between knots."""
    shares = np.linspace(0.0, 1.0, 6)
    x = knots[:-1, None] + np.diff(knots)[:, None] * shares
    y = value(x.ravel()).reshape(x.shape)
    u = 2.0 * (x - knots[0]) / (knots[-1] - knots[0]) - 1.0
    fit = chebyshev.chebfit(u.ravel(), y.ravel(), DEGREE)
    gap = np.abs(chebyshev.chebval(u, fit) - y).max(axis=1)
    return bool((gap <= MERGE_TOLERANCE * np.ptp(y, axis=1) + 1e-9 * np.ptp(y)).all())


def _with_unbounded_ends(edges: Array, lengths: Array) -> Features:
    """Nothing is known outside."""
    starts = np.concatenate([NO_FEATURES.starts, edges])
    return Features(
        starts, np.concatenate([NO_FEATURES.lengths, lengths, NO_FEATURES.lengths])
    )
