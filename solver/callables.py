"""Functions of time that a program gives, as pieces of polynomials.

Each is interpolated in Chebyshev points and halved until the last coefficients are
rounding errors (Trefethen, Approximation Theory and Approximation Practice, ch. 3).
Rates and accelerations are those of the polynomials, so that they fit each other.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import chebyshev

from formats.errors import InputError
from formats.sid import Array

#: A function of time, or one with its first derivative, or with its first two.
Derivatives = Callable[[float], float] | tuple[Callable[[float], float], ...]

DEGREE = 14
#: Tolerated error relative to the largest value.
ERROR = 1e-13
MOST_PIECES = 20_000
#: Pieces shorter than this part of the longest one surround a kink.
SHORT = 1e-4
SHORTEST = 1e-9
#: Tolerated difference of given derivatives from those of the interpolant.
CONSISTENT = (1e-10, 1e-7, 1e-4)

Interpolant = tuple[Array, Array, tuple[float, ...]]


def interpolate(
    program: Derivatives, span: tuple[float, float], place: str, smooth: bool = True
) -> Interpolant:
    """Edges (n + 1,), coefficients on [-1, 1] (n, terms), and the times of kinks.

    smooth : the rate must not jump

    Raises
    ------
    InputError : values that are no numbers, a jump of the value or, of smooth ones, of
        the rate, or derivatives that belong to another function.
    """
    functions = program if isinstance(program, tuple) else (program,)
    if not 1 <= len(functions) <= 3:
        raise InputError(
            f"has {len(functions)} callables",
            place=place,
            expected="a function of time, and at most two derivatives",
        )
    edges, series = _halved(functions[0], span, place)
    if smooth:
        _check_rates(edges, series, place)
    _check_derivatives(functions[1:], edges, series, place)
    terms = np.array(
        [np.pad(p, (0, DEGREE + 1 - len(p))) for p in map(_powers, series)]
    )
    return edges, terms, _kinks(edges)


def _powers(series: Array) -> Array:
    return np.asarray(chebyshev.cheb2poly(series))


def _evaluate(function: Callable[[float], float], times: Array, place: str) -> Array:
    try:
        values = np.array([float(function(float(t))) for t in times])
    except (TypeError, ValueError, ArithmeticError) as error:
        raise InputError(
            f"the callable fails: {error}", place=place, expected="a number"
        ) from None
    if not np.isfinite(values).all():
        t = times[~np.isfinite(values)][0]
        raise InputError(
            f"the callable gives no finite number at t = {t:.9g} s", place=place
        )
    return values


def _halved(
    function: Callable[[float], float], span: tuple[float, float], place: str
) -> tuple[Array, list[Array]]:
    nodes = chebyshev.chebpts1(DEGREE + 1)
    between = np.array([-0.97, -0.61, -0.07, 0.33, 0.83])
    edges = [span[0]]
    series: list[Array] = []
    waiting = [span]
    size = 0.0
    while waiting:
        low, high = waiting.pop()
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        values = _evaluate(function, middle + half * nodes, place)
        size = max(size, float(np.max(np.abs(values))))
        found = _fit(nodes, values, DEGREE)
        tail = np.max(np.abs(found[-2:]))
        limit = ERROR * size + 4e-16 * abs(_slope(found)) * abs(middle) / half
        checks = _evaluate(function, middle + half * between, place)
        error = np.max(np.abs(chebyshev.chebval(between, found) - checks))
        if tail <= limit and error <= 10.0 * limit:
            edges.append(high)
            series.append(found)
        elif half < SHORTEST * (span[1] - span[0]):
            _check_closed(found, values, middle, size, place)
            edges.append(high)
            series.append(_fit(nodes, values, 1))
        elif len(series) + len(waiting) > MOST_PIECES:
            raise InputError(
                f"the callable is not smooth near t = {middle:.9g} s",
                place=place,
                expected="a function with few points at which it is not smooth",
            )
        else:
            waiting += [(middle, high), (low, middle)]
    return np.array(edges), series


def _fit(nodes: Array, values: Array, degree: int) -> Array:
    return np.asarray(chebyshev.chebfit(nodes, values, degree), np.float64)


def _slope(series: Array) -> float:
    """A bound of the derivative on [-1, 1]: the error of rounding the time."""
    return float(np.arange(len(series)) ** 2 @ np.abs(series))


def _check_closed(
    series: Array, values: Array, middle: float, size: float, place: str
) -> None:
    """What is not resolved in the shortest piece must not be a jump of the value."""
    jump = float(np.max(values) - np.min(values))
    if jump > 1e-5 * size:
        raise InputError(
            f"the callable jumps by {jump:.6g} at t = {middle:.9g} s",
            place=place,
            expected="a continuous function; for a force that jumps, pieces of a "
            "polynomial",
        )


def _clusters(edges: Array) -> list[tuple[int, int]]:
    """First and last piece of each group of very short ones."""
    lengths = np.diff(edges)
    short = lengths < SHORT * lengths.max()
    steps = np.diff(np.concatenate([[0], short.astype(int), [0]]))
    starts, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
    return [(int(a), int(b) - 1) for a, b in zip(starts, ends, strict=True)]


def _kinks(edges: Array) -> tuple[float, ...]:
    return tuple(_middle(edges, *cluster) for cluster in _clusters(edges))


def _middle(edges: Array, first: int, last: int) -> float:
    """The middle of the shortest piece of a group."""
    k = first + int(np.argmin(np.diff(edges[first : last + 2])))
    return float(0.5 * (edges[k] + edges[k + 1]))


def _derivative(
    edges: Array, series: list[Array], piece: int, x: float, order: int = 1
) -> float:
    half = 0.5 * (edges[piece + 1] - edges[piece])
    found = chebyshev.chebval(x, chebyshev.chebder(series[piece], order))
    return float(found) / half**order


def _check_rates(edges: Array, series: list[Array], place: str) -> None:
    """Raises rates that change in a group of short pieces more than by acceleration."""
    largest = max(abs(_derivative(edges, series, k, 0.0)) for k in range(len(series)))
    for first, last in _clusters(edges):
        if first == 0 or last + 1 == len(series):
            continue
        sides = ((first - 1, 1.0), (last + 1, -1.0))
        left, right = (_derivative(edges, series, *side) for side in sides)
        bend = max(abs(_derivative(edges, series, *side, order=2)) for side in sides)
        smooth = 4.0 * bend * (edges[last + 1] - edges[first]) + 1e-6 * largest
        if abs(right - left) > smooth:
            raise InputError(
                f"the callable jumps in its rate by {right - left:.6g} at "
                f"t = {_middle(edges, first, last):.9g} s",
                place=place,
                expected="a function whose value and rate are continuous",
            )


def _check_derivatives(
    given: tuple[Callable[[float], float], ...],
    edges: Array,
    series: list[Array],
    place: str,
) -> None:
    names = ("first", "second")
    for order, function in enumerate(given, start=1):
        worst, when, size = 0.0, 0.0, 0.0
        for k, found in enumerate(series):
            half = 0.5 * (edges[k + 1] - edges[k])
            x = np.array([-0.5, 0.0, 0.5])
            times = edges[k] + half * (1.0 + x)
            own = chebyshev.chebval(x, chebyshev.chebder(found, order)) / half**order
            values = _evaluate(function, times, place)
            size = max(size, float(np.max(np.abs(values))))
            if half > SHORT * np.diff(edges).max():
                gap = float(np.max(np.abs(values - own)))
                worst, when = max((worst, when), (gap, float(times[1])))
        if worst > CONSISTENT[order] * max(size, 1e-300):
            raise InputError(
                f"the {names[order - 1]} derivative differs by {worst:.3g} from that "
                f"of the function near t = {when:.6g} s",
                place=place,
                expected="derivatives of the same function",
            )
