"""Functions of time as piecewise Chebyshev series, by bisection.

A piece is halved until its last coefficients are below the tolerated error, and until
the series agrees with the function between its nodes, at both ends, and at the times of
a scan of the whole span. The scan finds short features between the nodes of a long
piece.

References
----------
L. N. Trefethen: Approximation Theory and Approximation Practice, chapter 3.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

MAX_PIECES = 20_000
#: Pieces are not halved below this part of the span.
MIN_PIECE_FRACTION = 1e-9
#: A change in a piece of that length is a jump when after so many more halvings a tenth
#: of it is left, and more than this part of the largest value.
EXTRA_HALVINGS, MIN_JUMP = 10, 1e-7
#: Where a series is compared with the function, beside the scan.
CHECK_POINTS = np.array([-1.0, -0.97, -0.61, -0.07, 0.33, 0.83, 1.0])


@dataclass(frozen=True, eq=False)
class ChebyshevSeries:
    """Chebyshev series on pieces of a span.

    Attributes
    ----------
    edges : (n + 1,)
        Growing.
    terms : (n, terms)
        Coefficients on [-1, 1].
    limits : (n,)
        Tolerated errors.
    resolved : (n,)
        Whether a piece meets them; another one is a straight line across what is too
        short to be followed.
    """

    edges: Array
    terms: Array
    limits: Array
    resolved: NDArray[np.bool_]

    @property
    def lengths(self) -> Array:
        return np.diff(self.edges)

    def at(self, times: Array, order: int = 0) -> Array:
        """Values, or derivatives, at times (nt,)."""
        pieces = np.searchsorted(self.edges, times, side="right") - 1
        k = np.clip(pieces, 0, len(self.terms) - 1)
        half = 0.5 * self.lengths[k]
        x = (times - self.edges[k]) / half - 1.0
        terms = chebyshev.chebder(self.terms, order, axis=1)[k]
        return np.asarray(chebyshev.chebval(x, terms.T, tensor=False)) / half**order

    def at_ends(self, order: int) -> tuple[Array, Array]:
        """Derivatives at the beginning and at the end of every piece, (n,) each.

        T_n at 1 has the derivatives prod_{k < order} (n^2 - k^2) / (2 k + 1).
        """
        n = np.arange(self.terms.shape[1])
        last = np.ones(len(n))
        for k in range(order):
            last = last * (n**2 - k**2) / (2 * k + 1)
        first = last * (-1.0) ** (n + order)
        scale = (0.5 * self.lengths) ** order
        return self.terms @ first / scale, self.terms @ last / scale


@dataclass(frozen=True, eq=False)
class FitSamples:
    """Times and values that every series has to meet."""

    times: Array
    values: Array

    def inside(self, low: float, high: float) -> tuple[Array, Array]:
        first, last = np.searchsorted(self.times, [low, high])
        return self.times[first:last], self.values[first:last]


def bisected_fit(
    evaluate: Callable[[Array], Array],
    edges: Array,
    scan: FitSamples,
    degree: int,
    tolerance: float,
    place: str,
) -> ChebyshevSeries:
    """Pieces that follow a function, none across one of the `edges`.

    Parameters
    ----------
    evaluate
        Values (nt,) at times (nt,).
    tolerance
        Tolerated error, relative to the largest value.

    Raises
    ------
    InputError
        A jump, or a function that is nowhere smooth.
    """
    nodes = chebyshev.chebpts1(degree + 1)
    points = np.concatenate([nodes, CHECK_POINTS])
    fit = np.linalg.inv(chebyshev.chebvander(nodes, degree))
    check = chebyshev.chebvander(CHECK_POINTS, degree)
    span = edges[-1] - edges[0]
    size = float(np.max(np.abs(scan.values), initial=0.0))
    pieces: list[tuple[float, Array, float, bool]] = []
    waiting = list(zip(edges[:-1], edges[1:], strict=True))[::-1]
    while waiting:
        low, high = waiting.pop()
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        values = evaluate(np.clip(middle + half * points, low, high))
        size = max(size, float(np.max(np.abs(values))))
        terms = fit @ values[: degree + 1]
        error = np.max(np.abs(check @ terms - values[degree + 1 :]))
        limit = tolerance * size + 4e-16 * _derivative_bound(terms) * abs(middle) / half
        resolved_ = np.max(np.abs(terms[-2:])) <= limit and error <= 10.0 * limit
        if resolved_ and _fits_samples(terms, scan, low, high, 10.0 * limit):
            pieces.append((high, terms, limit, True))
        elif half < MIN_PIECE_FRACTION * span:
            _check_continuous(evaluate, low, high, size, place)
            line = np.zeros(degree + 1)
            line[:2] = chebyshev.chebfit(points, values, 1)
            pieces.append((high, line, limit, False))
        elif len(pieces) + len(waiting) > MAX_PIECES:
            raise InputError(
                f"the callable is not smooth near t = {middle:.9g} s",
                place=place,
                expected="a function with few points at which it is not smooth",
            )
        else:
            waiting += [(middle, high), (low, middle)]
    ends, series, limits, resolved = zip(*pieces, strict=True)
    return ChebyshevSeries(
        np.array([edges[0], *ends]),
        np.array(series),
        np.array(limits),
        np.array(resolved),
    )


def _fits_samples(
    terms: Array, scan: FitSamples, low: float, high: float, limit: float
) -> bool:
    times, values = scan.inside(low, high)
    x = (2.0 * times - (low + high)) / (high - low)
    gap = np.abs(chebyshev.chebval(x, terms) - values)
    return bool(np.max(gap, initial=0.0) <= limit)


def _derivative_bound(terms: Array) -> float:
    """A bound of the derivative on [-1, 1]: the error of rounding the time."""
    return float(np.arange(len(terms)) ** 2 @ np.abs(terms))


def _check_continuous(
    evaluate: Callable[[Array], Array], low: float, high: float, size: float, place: str
) -> None:
    """What is not resolved in the shortest piece must not be a jump of the value.

    A jump stays the same in ever shorter parts of the piece.
    """
    values = evaluate(np.array([low, high]))
    least = max(MIN_JUMP * size, 0.1 * abs(float(values[1] - values[0])))
    for _ in range(EXTRA_HALVINGS):
        middle = 0.5 * (low + high)
        half = evaluate(np.array([middle]))[0]
        if abs(half - values[0]) > abs(values[1] - half):
            high, values = middle, np.array([values[0], half])
        else:
            low, values = middle, np.array([half, values[1]])
    jump = float(values[1] - values[0])
    if abs(jump) > least:
        raise InputError(
            f"the callable jumps by {jump:.6g} at t = {low:.9g} s",
            place=place,
            expected="a continuous function; for a force that jumps, pieces of a "
            "polynomial",
        )
