"""Functions of time that a program gives, as pieces of polynomials.

Rates and accelerations are those of the polynomials, so that they fit each other.
What is seen of a function are its values at many times, see `Timed`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from sidtool.formats.errors import InputError
from sidtool.formats.sid import Array

from .chebyshev_pieces import Scan, Series, halved
from .kink_places import with_kinks
from .returned_values import real_number
from .smoothness import SHORT, check_rates, kinks

#: A function of time, or one with its first derivative, or with its first two.
Functions = Callable[[float], float] | tuple[Callable[[float], float], ...]

DEGREE = 14
#: Tolerated error relative to the largest value.
ERROR = 1e-13
#: Part of the run that the shortest feature lasts which is surely seen, and the number
#: of times that it is looked at.
SEEN, LOOKS = 1.0 / 4096.0, 4
#: The shortest feature that can be asked for, as a part of the run.
SHORTEST_SEEN = 1e-6
#: Tolerated difference of given derivatives from those of the interpolant.
CONSISTENT = (1e-10, 1e-7, 1e-4)


@dataclass(frozen=True)
class Timed:
    """A function of time, and what is known of its features.

    A program can be asked for values only, so that nothing shorter than the distance
    between two looks at it can be known. It is looked at often enough to see, wherever
    it lies, whatever lasts at least `shortest`; what is seen at all is then followed
    to rounding. Shorter features are surely seen only at the `times` that are named.

    Attributes
    ----------
    function : f(t), or a tuple of f and its first, or first two, derivatives
    times : where features of any width begin, end or have their largest value [s]
    shortest : duration of the shortest feature [s], 1/4096 of the run by default; a
        callable is asked for 4 values in that time
    """

    function: Functions
    times: Sequence[float] = ()
    shortest: float | None = None


#: What replaces a function of time.
Derivatives = Functions | Timed

Interpolant = tuple[Array, Array, tuple[float, ...]]


def interpolate(
    program: Derivatives, span: tuple[float, float], place: str, smooth: bool = True
) -> Interpolant:
    """Edges (n + 1,), coefficients on [-1, 1] (n, terms), and the times of kinks.

    smooth : the rate must not jump

    Kinks are jumps of the first three derivatives: all of 900 at random places, in
    functions of five kinds, were found, to 1e-7 of the span. Of jumps of the fourth
    derivative a tenth is not found, of later ones more; there pieces follow the
    function to 1e-13, but no step ends at the kink.

    Raises
    ------
    InputError : values that are no numbers, a jump of the value or, of smooth ones, of
        the rate, derivatives that belong to another function, or features that cannot
        be looked for.
    """
    timed = program if isinstance(program, Timed) else Timed(program)
    given = timed.function
    functions = given if isinstance(given, tuple) else (given,)
    if not 1 <= len(functions) <= 3:
        raise InputError(
            f"has {len(functions)} callables",
            place=place,
            expected="a function of time, and at most two derivatives",
        )

    def evaluate(times: Array) -> Array:
        return _evaluate(functions[0], times, place)

    inside = {float(t) for t in timed.times if span[0] < t < span[1]}
    edges = np.array([span[0], *sorted(inside), span[1]])
    times = _looks(program, span, place)
    scan = Scan(times, evaluate(times))

    def fitted(kinks: Sequence[float]) -> Series:
        ends = np.unique([*edges, *kinks])
        return halved(evaluate, ends, scan, DEGREE, ERROR, place)

    series, known = with_kinks(fitted, evaluate)
    if smooth:
        check_rates(series, place)
    _check_derivatives(functions[1:], series, place)
    powers = np.array([_powers(unit) for unit in np.eye(DEGREE + 1)])
    return series.edges, series.terms @ powers, kinks(series, known)


def shortest_seen(program: Derivatives, span: tuple[float, float]) -> float:
    """Duration of the shortest feature that is surely seen [s]."""
    asked = program.shortest if isinstance(program, Timed) else None
    return SEEN * (span[1] - span[0]) if asked is None else asked


def _looks(program: Derivatives, span: tuple[float, float], place: str) -> Array:
    """Times of the scan, (nt,)."""
    length, shortest = span[1] - span[0], shortest_seen(program, span)
    if not shortest >= SHORTEST_SEEN * length:
        raise InputError(
            f"features of {shortest:.6g} s in a run of {length:.6g} s cannot be looked "
            "for",
            place=place,
            expected=f"at least {SHORTEST_SEEN * length:.6g} s; of shorter ones, the "
            "`times` at which they are",
        )
    count = max(1, math.ceil(LOOKS * length / shortest))
    return np.asarray(span[0] + length * (np.arange(count) + 0.5) / count)


def _powers(series: Array) -> Array:
    found = np.zeros(DEGREE + 1)
    powers = chebyshev.cheb2poly(series)
    found[: len(powers)] = powers
    return found


def _evaluate(function: Callable[[float], float], times: Array, place: str) -> Array:
    try:
        values = np.array([real_number(function(t)) for t in times.tolist()])
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


def _check_derivatives(
    given: tuple[Callable[[float], float], ...], series: Series, place: str
) -> None:
    """Compares at a quarter, the middle and three quarters of every long piece."""
    long = series.lengths > SHORT * series.lengths.max()
    starts, lengths = series.edges[:-1][long], series.lengths[long]
    times = np.add.outer([0.25, 0.5, 0.75], np.zeros(len(starts))) * lengths + starts
    for order, function in enumerate(given, start=1):
        values = _evaluate(function, times.ravel(), place)
        gaps = np.abs(values - series.at(times.ravel(), order))
        worst = int(np.argmax(gaps))
        if gaps[worst] > CONSISTENT[order] * max(np.abs(values).max(), 1e-300):
            name = ("first", "second")[order - 1]
            raise InputError(
                f"the {name} derivative differs by {gaps[worst]:.3g} from that of the "
                f"function near t = {times.ravel()[worst]:.6g} s",
                place=place,
                expected="derivatives of the same function",
            )
