"""Positions of kinks of a function that is known by its values only.

Around a kink of order n, a jump of the n-th derivative, a function is

    f(t) = P(t) + (t - kink)_+^n Q(t)

with polynomials P and Q. The time of the kink is found by a Gauss-Newton fit.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import cache

import numpy as np
from numpy.polynomial import Chebyshev, chebyshev

from sidtool.formats.base.sid import Array

from .chebyshev import ChebyshevSeries
from .piecewise import kinks_at_piece_ends, short_intervals

#: Degrees of P and Q, and the number of values that are fitted.
SMOOTH_DEGREE, KINK_DEGREE, FITTED_VALUES = 12, 3, 64
#: Orders that are tried, the smoothest first: only that and lower ones fit.
KINK_ORDERS = (6, 5, 4, 3, 2, 1)
#: Widths of the bracket beside it that are fitted, the widest that works.
BRACKET_WIDTHS = (12.0, 6.0, 3.0, 1.5)
#: Places of a kink that are tried first, steps of the iteration, and when it ends.
TRIAL_POSITIONS, MAX_ITERATIONS, POSITION_TOLERANCE = 5, 30, 1e-13
#: A residual that is left by more than this part in two steps is that of another order.
REDUCTION_FACTOR = 0.7
#: Tolerated errors that the residual of a fit may be, and that one without a kink has.
ACCEPTED_RESIDUAL, REJECTED_RESIDUAL = 3.0, 10.0
#: How many times smaller a kink makes the residual, beyond what its terms may do for a
#: function without one.
REDUCTION_BY_KINK = 100.0

#: Pieces around a kink are shorter than this part of the longest one.
SHORT_PIECE = 0.5
#: Both sides are known from a length of at least so many shortest pieces.
MIN_SIDE_LENGTH = 4.0
#: Pieces that end at a kink are so many times longer than those that surround it.
MIN_GROWTH = 2.0
#: Part of the pieces beside an end of pieces within which a kink is looked for.
NEAR_EDGE = 0.02
#: Part of the tolerated error below which the last terms are rounding.
TRIM_TOLERANCE = 0.01
#: The derivatives whose jump may be the lowest one, and steps of Newton's iteration.
MAX_ORDER, NEWTON_STEPS = 6, 4
#: Places of kinks up to this order are those of both polynomials, unless the next
#: derivative jumps so much more that this one may be none; of later ones noise moves
#: where derivatives cross by up to 1e-4.
CERTAIN_ORDER = 2
#: Looks at the function between two places that are compared.
CHECKS_PER_INTERVAL = 8
#: Times after which kinks beside others are looked for again.
MAX_ROUNDS = 8
Values = Callable[[Array], Array]
SeriesWithKinks = tuple[ChebyshevSeries, list[float]]


def fit_kink(
    evaluate: Callable[[Array], Array],
    low: float,
    bracket: tuple[float, float],
    high: float,
    limit: float,
) -> float | None:
    """The time of the one kink in a bracket; None if there is none, or another form.

    Parameters
    ----------
    evaluate
        Values (nt,) at times (nt,).
    low, high
        Ends of what is smooth beside the bracket.
    limit
        Tolerated error of values.
    """
    begin, end = bracket
    width = end - begin
    nodes, basis = _smooth_basis()
    for reach in BRACKET_WIDTHS:
        first = max(low, begin - reach * width)
        last = min(high, end + reach * width)
        middle, half = 0.5 * (first + last), 0.5 * (last - first)
        if half == 0.0:
            return None
        values = evaluate(np.clip(middle + half * nodes, first, last))
        bracket_positions = (begin - middle) / half, (end - middle) / half
        remainder = _without(basis, values)
        smooth_residual = float(np.abs(remainder).max())
        if smooth_residual <= REJECTED_RESIDUAL * limit:
            continue
        accepted = min(ACCEPTED_RESIDUAL * limit, smooth_residual / REDUCTION_BY_KINK)
        for order in KINK_ORDERS:
            position = _fit_kink_of_order(
                nodes, remainder, basis, order, bracket_positions, accepted
            )
            if position is not None:
                return float(middle + half * position)
    return None


@cache
def _smooth_basis() -> tuple[Array, Array]:
    """Nodes (nx,) in [-1, 1], and orthonormal columns (nx, terms of P) there."""
    nodes = np.cos(np.pi * (np.arange(FITTED_VALUES) + 0.5) / FITTED_VALUES)[::-1]
    smooth = np.asarray(chebyshev.chebvander(nodes, SMOOTH_DEGREE), np.float64)
    return nodes, np.linalg.qr(smooth)[0]


def _fit_kink_of_order(
    x: Array,
    remainder: Array,
    basis: Array,
    order: int,
    bracket_positions: tuple[float, float],
    limit: float,
) -> float | None:
    """Where in [-1, 1] a kink of one order lies, between two places.

    Parameters
    ----------
    remainder
        Values (nx,) without their part P.
    basis
        Orthonormal columns (nx, terms of P).
    """
    begin, end = bracket_positions
    trials = np.linspace(begin, end, TRIAL_POSITIONS)
    sizes = [_residual_size(x, remainder, basis, order, place) for place in trials]
    position = float(trials[int(np.argmin(sizes))])
    before, stagnating = np.inf, 0
    for _ in range(MAX_ITERATIONS):
        step, size = _gauss_newton_step(x, remainder, basis, order, position)
        stagnating, before = (
            (stagnating + 1 if size > REDUCTION_FACTOR * before else 0),
            size,
        )
        if stagnating > 1 and size > limit:
            return None
        position = min(max(position + step, begin), end)
        if abs(step) <= POSITION_TOLERANCE * (end - begin):
            break
    inside = begin < position < end
    if not inside:
        return None
    size = _residual_size(x, remainder, basis, order, position)
    return position if size <= limit else None


def _residual_size(
    x: Array, remainder: Array, basis: Array, order: int, position: float
) -> float:
    """The largest residual with the kink at a place."""
    powers = _without(basis, _powers_beyond(x, order, position))
    return float(np.abs(_solve_fit(powers, remainder)[1]).max())


def _powers_beyond(x: Array, order: int, position: float) -> Array:
    """(x - kink)_+^n and higher powers, (nx, terms of Q)."""
    beyond = np.maximum(x - position, 0.0)
    return np.asarray(beyond[:, None] ** (order + np.arange(KINK_DEGREE + 1)))


def _without(basis: Array, columns: Array) -> Array:
    """Columns without their part in an orthonormal basis."""
    return np.asarray(columns - basis @ (basis.T @ columns))


def _gauss_newton_step(
    x: Array, remainder: Array, basis: Array, order: int, position: float
) -> tuple[float, float]:
    """The step to a better place of the kink, and the largest residual at this one."""
    powers = _without(basis, _powers_beyond(x, order, position))
    coefficients, residual = _solve_fit(powers, remainder)
    slopes = (order + np.arange(KINK_DEGREE + 1)) * coefficients
    lower = (x > position)[:, None] * _powers_beyond(x, order - 1, position)
    _, projected = _solve_fit(powers, _without(basis, -lower @ slopes))
    steepness = float(projected @ projected)
    step = float(projected @ residual) / steepness if steepness > 0.0 else 0.0
    return step, float(np.abs(residual).max())


def _solve_fit(columns: Array, values: Array) -> tuple[Array, Array]:
    """Coefficients of a fit, and its residuals."""
    scales = np.linalg.norm(columns, axis=0)
    scales[scales == 0.0] = 1.0
    solution = np.linalg.lstsq(columns / scales, values, rcond=1e-14)[0]
    return solution / scales, values - columns / scales @ solution


def fit_with_kinks(
    fit: Callable[[Sequence[float]], ChebyshevSeries], evaluate: Values
) -> SeriesWithKinks:
    """Pieces that end at the kinks of a function, and the times of those kinks.

    What lies close to a kink is seen once that one is an end of pieces.

    Parameters
    ----------
    fit
        The pieces that end at given times.
    """
    known: list[float] = []
    series = fit(known)
    for _ in range(MAX_ROUNDS):
        candidates = _kink_candidates(series, evaluate, known)
        new = (
            _confirmed_kinks(fit([*known, *candidates]), candidates)
            if candidates
            else []
        )
        if not new:
            break
        known = sorted([*known, *new])
        series = fit(known)
    return series, known


def _kink_candidates(
    series: ChebyshevSeries, evaluate: Values, known: Sequence[float]
) -> dict[float, float]:
    """Times of kinks inside short pieces, and the shortest of those."""
    count = len(series.lengths)
    runs = [
        run
        for run in short_intervals(series.lengths, SHORT_PIECE)
        if run[1] - run[0] < count - 1
    ]
    ends = [(series.edges[first], series.edges[last + 1]) for first, last in runs]
    walls = np.sort([series.edges[0], *np.ravel(ends), *known, series.edges[-1]])
    candidates = {}
    for (first, last), (begin, end) in zip(runs, ends, strict=True):
        low = walls[max(np.searchsorted(walls, begin) - 1, 0)]
        high = walls[min(np.searchsorted(walls, end, "right"), len(walls) - 1)]
        limit = float(series.limits[first : last + 1].max())
        t, is_sure = _kink_in_bracket(evaluate, low, (begin, end), high, limit)
        if not is_sure:
            better = fit_kink(evaluate, low, (begin, end), high, limit)
            t = t if better is None else better
        if t is not None:
            candidates[t] = float(series.lengths[first : last + 1].min())
    return _kinks_at_piece_ends(series, evaluate, known, walls) | candidates


def _kinks_at_piece_ends(
    series: ChebyshevSeries, evaluate: Values, known: Sequence[float], walls: Array
) -> dict[float, float]:
    """Kinks so close to ends of pieces, by chance, that no piece is short beside them.

    Parameters
    ----------
    walls
        Ends of what is smooth, sorted.
    """
    candidates: dict[float, float] = {}
    for t in kinks_at_piece_ends(series):
        k = int(np.searchsorted(series.edges, t))
        near = NEAR_EDGE * float(series.lengths[k - 1 : k + 1].min())
        if np.abs(t - np.array([*known, np.inf])).min() <= near:
            continue
        low = walls[max(np.searchsorted(walls, t - near) - 1, 0)]
        high = walls[min(np.searchsorted(walls, t + near, "right"), len(walls) - 1)]
        limit = float(series.limits[k - 1 : k + 1].max())
        position = fit_kink(evaluate, low, (t - near, t + near), high, limit)
        if position is not None:
            candidates[position] = 0.0
    return candidates


def _confirmed_kinks(
    series: ChebyshevSeries, candidates: dict[float, float]
) -> list[float]:
    """The places beside which the pieces of a series that ends there became long."""
    confirmed = []
    for t, least in candidates.items():
        k = int(np.searchsorted(series.edges, t))
        if series.lengths[k - 1 : k + 1].min() > MIN_GROWTH * least:
            confirmed.append(t)
    return confirmed


def _kink_in_bracket(
    evaluate: Values,
    low: float,
    bracket: tuple[float, float],
    high: float,
    limit: float,
) -> tuple[float | None, bool]:
    """Where the polynomial before the bracket ends and the one after it begins, and
    whether no other derivative may be the one that jumps, close by."""
    width = bracket[1] - bracket[0]
    begin, end = bracket[0] - width, bracket[1] + width
    before = _polynomial_on_side(evaluate, begin, low, limit, width)
    after = _polynomial_on_side(evaluate, end, high, limit, width)
    if before is None or after is None:
        return None, False
    orders = {t: k for k, t in _crossing_times(before, after, begin, end)}
    times = sorted(orders)
    check_times = np.interp(
        np.arange(CHECKS_PER_INTERVAL * (len(times) + 1)) / CHECKS_PER_INTERVAL,
        np.arange(len(times) + 2),
        [begin, *times, end],
    )
    values = evaluate(check_times)
    gaps = [np.abs(side(check_times) - values) for side in (before, after)]
    errors = [(float(np.where(check_times < t, *gaps).max()), t) for t in times]
    gap, t = min(errors, default=(np.inf, 0.0))
    if not gap <= 10.0 * limit:
        return None, False
    jump, next_jump = (
        float(abs(after.deriv(k)(t) - before.deriv(k)(t)))
        for k in (orders[t], orders[t] + 1)
    )
    return t, orders[t] <= CERTAIN_ORDER and jump > width * next_jump


def _polynomial_on_side(
    evaluate: Values, near: float, far: float, limit: float, width: float
) -> Chebyshev | None:
    """The polynomial that follows the function from `near` on, as far as one does."""
    degree = 14
    nodes = chebyshev.chebpts1(2 * degree)
    while abs(far - near) > MIN_SIDE_LENGTH * width:
        low, high = min(near, far), max(near, far)
        times = near + 0.5 * (far - near) * (1.0 + nodes)
        values = evaluate(np.clip(times, low, high))
        fit = Chebyshev.fit(times, values, degree, domain=[low, high])
        gap = np.abs(fit(times) - values).max()
        if np.abs(fit.coef[-2:]).max() <= limit and gap <= 10.0 * limit:
            return fit.trim(TRIM_TOLERANCE * limit)
        far = near + 0.5 * (far - near)
    return None


def _crossing_times(
    before: Chebyshev, after: Chebyshev, begin: float, end: float
) -> Iterator[tuple[int, float]]:
    """Where the value, the rate, ...

    of both polynomials are equal, one place each, and the order of the derivative that
    jumps there.

    After a jump of the derivative of order k both differ as (t - kink)^k: the one of
    order k - 1 crosses zero there.
    """
    for order in range(MAX_ORDER):
        t = 0.5 * (begin + end)
        for _ in range(NEWTON_STEPS):
            gap, slope = (
                after.deriv(m)(t) - before.deriv(m)(t) for m in (order, order + 1)
            )
            t = float(t - gap / slope) if slope != 0.0 else np.inf
            if not begin < t < end:
                break
        else:
            yield order + 1, t
