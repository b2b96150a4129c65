"""Functions of time as pieces of Chebyshev series, found by halving.

A piece is halved until the last coefficients are below the tolerated error (Trefethen,
Approximation Theory and Approximation Practice, ch. 3), and until the series meets the
function between its nodes, at both ends, and at times of a scan of the whole span:
without that scan, what is short and lies between the nodes of a long piece is lost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from sidtool.formats.errors import InputError
from sidtool.formats.sid import Array

MOST_PIECES = 20_000
#: Pieces are not halved below this part of the span.
SHORTEST = 1e-9
#: A change in a piece of that length is a jump when after so many more halvings a tenth
#: of it is left, and more than this part of the largest value.
FURTHER, JUMP = 10, 1e-7
#: Where a series is compared with the function, beside the scan.
BETWEEN = np.array([-1.0, -0.97, -0.61, -0.07, 0.33, 0.83, 1.0])


@dataclass(frozen=True, eq=False)
class Series:
    """Chebyshev series on pieces of a span.

    edges : (n + 1,) growing
    terms : (n, terms) coefficients on [-1, 1]
    limits : (n,) tolerated errors
    resolved : (n,) whether a piece meets them; another one is a straight line across
        what is too short to be followed
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
class Scan:
    """Times and values that every series has to meet."""

    times: Array
    values: Array

    def inside(self, low: float, high: float) -> tuple[Array, Array]:
        first, last = np.searchsorted(self.times, [low, high])
        return self.times[first:last], self.values[first:last]


def halved(
    evaluate: Callable[[Array], Array],
    edges: Array,
    scan: Scan,
    degree: int,
    tolerance: float,
    place: str,
) -> Series:
    """Pieces that follow a function, none across one of the `edges`.

    evaluate : values (nt,) at times (nt,)
    tolerance : tolerated error, relative to the largest value

    Raises
    ------
    InputError : a jump, or a function that is nowhere smooth.
    """
    nodes = chebyshev.chebpts1(degree + 1)
    looks = np.concatenate([nodes, BETWEEN])
    fit = np.linalg.inv(chebyshev.chebvander(nodes, degree))
    check = chebyshev.chebvander(BETWEEN, degree)
    span = edges[-1] - edges[0]
    size = float(np.max(np.abs(scan.values), initial=0.0))
    found: list[tuple[float, Array, float, bool]] = []
    waiting = list(zip(edges[:-1], edges[1:], strict=True))[::-1]
    while waiting:
        low, high = waiting.pop()
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        values = evaluate(np.clip(middle + half * looks, low, high))
        size = max(size, float(np.max(np.abs(values))))
        terms = fit @ values[: degree + 1]
        error = np.max(np.abs(check @ terms - values[degree + 1 :]))
        limit = tolerance * size + 4e-16 * _slope(terms) * abs(middle) / half
        followed = np.max(np.abs(terms[-2:])) <= limit and error <= 10.0 * limit
        if followed and _meets(terms, scan, low, high, 10.0 * limit):
            found.append((high, terms, limit, True))
        elif half < SHORTEST * span:
            _check_closed(evaluate, low, high, size, place)
            line = np.zeros(degree + 1)
            line[:2] = chebyshev.chebfit(looks, values, 1)
            found.append((high, line, limit, False))
        elif len(found) + len(waiting) > MOST_PIECES:
            raise InputError(
                f"the callable is not smooth near t = {middle:.9g} s",
                place=place,
                expected="a function with few points at which it is not smooth",
            )
        else:
            waiting += [(middle, high), (low, middle)]
    ends, series, limits, resolved = zip(*found, strict=True)
    return Series(
        np.array([edges[0], *ends]),
        np.array(series),
        np.array(limits),
        np.array(resolved),
    )


def _meets(terms: Array, scan: Scan, low: float, high: float, limit: float) -> bool:
    times, values = scan.inside(low, high)
    x = (2.0 * times - (low + high)) / (high - low)
    gap = np.abs(chebyshev.chebval(x, terms) - values)
    return bool(np.max(gap, initial=0.0) <= limit)


def _slope(terms: Array) -> float:
    """A bound of the derivative on [-1, 1]: the error of rounding the time."""
    return float(np.arange(len(terms)) ** 2 @ np.abs(terms))


def _check_closed(
    evaluate: Callable[[Array], Array], low: float, high: float, size: float, place: str
) -> None:
    """What is not resolved in the shortest piece must not be a jump of the value.

    A jump stays the same in ever shorter parts of the piece.
    """
    values = evaluate(np.array([low, high]))
    least = max(JUMP * size, 0.1 * abs(float(values[1] - values[0])))
    for _ in range(FURTHER):
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
