"""Where a kink lies, by a fit of what holds before it and what a kink adds after it.

Around a kink of order n, a jump of the n-th derivative, a function is

    f(t) = P(t) + (t - kink)_+^n Q(t)

with polynomials P and Q. Both are linear in the values of f, the kink is found by
variable projection (G. Golub, V. Pereyra, SIAM J. Numer. Anal. 10 (1973), with
L. Kaufman's simpler slope, BIT 15 (1975)). The values are those on both sides of the
kink, so that it is known far better than the pieces around it are short.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import chebyshev

from sidtool.formats.sid import Array

#: Degrees of P and Q, and the number of values that are fitted.
DEGREE, ADDED, VALUES = 12, 3, 64
#: Orders that are tried, the smoothest first: only that and lower ones fit.
ORDERS = (6, 5, 4, 3, 2, 1)
#: Widths of the bracket beside it that are fitted, the widest that works.
REACHES = (12.0, 6.0, 3.0, 1.5)
#: Places of a kink that are tried first, steps of the iteration, and when it ends.
PLACES, STEPS, SETTLED = 5, 30, 1e-13
#: A residual that is left by more than this part in two steps is that of another order.
SHRINKS = 0.7
#: Tolerated errors that the residual of a fit may be, and that one without a kink has.
FITS, MISSES = 3.0, 10.0
#: How many times smaller a kink makes the residual, beyond what its terms may do for a
#: function without one.
EXPLAINS = 100.0


def fitted_kink(
    evaluate: Callable[[Array], Array],
    low: float,
    bracket: tuple[float, float],
    high: float,
    limit: float,
) -> float | None:
    """The time of the one kink in a bracket; None if there is none, or another form.

    Parameters
    ----------
    evaluate : values (nt,) at times (nt,)
    low, high : ends of what is smooth beside the bracket
    limit : tolerated error of values
    """
    begin, end = bracket
    width = end - begin
    nodes = np.cos(np.pi * (np.arange(VALUES) + 0.5) / VALUES)[::-1]
    for reach in REACHES:
        first = max(low, begin - reach * width)
        last = min(high, end + reach * width)
        middle, half = 0.5 * (first + last), 0.5 * (last - first)
        values = evaluate(np.clip(middle + half * nodes, first, last))
        smooth = np.asarray(chebyshev.chebvander(nodes, DEGREE), np.float64)
        places = (begin - middle) / half, (end - middle) / half
        missed = _solved(smooth, values)[1]
        if missed <= MISSES * limit:
            continue
        enough = min(FITS * limit, missed / EXPLAINS)
        for order in ORDERS:
            place = _fitted(nodes, values, smooth, order, places, enough)
            if place is not None:
                return float(middle + half * place)
    return None


def _fitted(
    x: Array,
    values: Array,
    smooth: Array,
    order: int,
    places: tuple[float, float],
    limit: float,
) -> float | None:
    """Where in [-1, 1] a kink of one order lies, between two places."""
    begin, end = places
    tried = np.linspace(begin, end, PLACES)
    sizes = [_at(x, values, smooth, order, place)[1] for place in tried]
    place = float(tried[int(np.argmin(sizes))])
    before, stays = np.inf, 0
    for _ in range(STEPS):
        step, size = _at(x, values, smooth, order, place)
        stays, before = (stays + 1 if size > SHRINKS * before else 0), size
        if stays > 1 and size > limit:
            return None
        place = min(max(place + step, begin), end)
        if abs(step) <= SETTLED * (end - begin):
            break
    inside = begin < place < end
    size = _at(x, values, smooth, order, place)[1]
    return place if inside and size <= limit else None


def _at(
    x: Array, values: Array, smooth: Array, order: int, place: float
) -> tuple[float, float]:
    """The step to a better place of the kink, and the largest residual at this one."""
    beyond = np.maximum(x - place, 0.0)
    powers = beyond[:, None] ** (order + np.arange(ADDED + 1))
    columns = np.hstack([smooth, powers])
    coefficients, size, residual = _solved(columns, values)
    slopes = (order + np.arange(ADDED + 1)) * coefficients[smooth.shape[1] :]
    lower = np.where(beyond > 0.0, 1.0, 0.0)[:, None] * (
        beyond[:, None] ** (order - 1 + np.arange(ADDED + 1))
    )
    slope = -lower @ slopes
    _, _, across = _solved(columns, slope)
    steepness = float(across @ across)
    step = float(across @ residual) / steepness if steepness > 0.0 else 0.0
    return step, size


def _solved(columns: Array, values: Array) -> tuple[Array, float, Array]:
    """Coefficients of a fit, its largest residual, and all residuals."""
    scales = np.linalg.norm(columns, axis=0)
    scales[scales == 0.0] = 1.0
    found = np.linalg.lstsq(columns / scales, values, rcond=1e-14)[0]
    residual = values - columns / scales @ found
    return found / scales, float(np.abs(residual).max()), residual
