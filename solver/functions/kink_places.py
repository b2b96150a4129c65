"""Where exactly the kinks of a function of time lie, found from its values.

A function that is smooth on both sides of a kink is followed there by two polynomials,
of which one holds before it and the other after it. Between pieces that end at the kink
nothing has to be halved: short pieces would meet the values, but rounding of values
becomes an acceleration as the inverse square of their lengths.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.polynomial import Chebyshev, chebyshev

from sidtool.formats.sid import Array

from .chebyshev_pieces import Series
from .kink_fits import fitted_kink
from .smoothness import joined_kinks, valleys

#: Pieces around a kink are shorter than this part of the longest one.
SHORT = 0.5
#: Both sides are known from a length of at least so many shortest pieces.
LEAST_SIDE = 4.0
#: Pieces that end at a kink are so many times longer than those that surround it.
LONGER = 2.0
#: Part of the pieces beside an end of pieces within which a kink is looked for.
CLOSE = 0.02
#: Part of the tolerated error below which the last terms are rounding.
TRIMMED = 0.01
#: The derivatives whose jump may be the lowest one, and steps of Newton's iteration.
ORDERS, STEPS = 6, 4
#: Places of kinks up to this order are those of both polynomials, unless the next
#: derivative jumps so much more that this one may be none; of later ones noise moves
#: where derivatives cross by up to 1e-4.
SURE = 2
#: Looks at the function between two places that are compared.
LOOKS = 8

#: Times after which kinks beside others are looked for again.
ROUNDS = 8

Values = Callable[[Array], Array]
Kinked = tuple[Series, list[float]]


def with_kinks(fitted: Callable[[Sequence[float]], Series], evaluate: Values) -> Kinked:
    """Pieces that end at the kinks of a function, and the times of those kinks.

    fitted : the pieces that end at given times

    What lies close to a kink is seen once that one is an end of pieces.
    """
    known: list[float] = []
    series = fitted(known)
    for _ in range(ROUNDS):
        found = _places(series, evaluate, known)
        new = _helpful(fitted([*known, *found]), found) if found else []
        if not new:
            break
        known = sorted([*known, *new])
        series = fitted(known)
    return series, known


def _places(
    series: Series, evaluate: Values, known: Sequence[float]
) -> dict[float, float]:
    """Times of kinks inside short pieces, and the shortest of those."""
    count = len(series.lengths)
    runs = [
        run for run in valleys(series.lengths, SHORT) if run[1] - run[0] < count - 1
    ]
    ends = [(series.edges[first], series.edges[last + 1]) for first, last in runs]
    walls = np.sort([series.edges[0], *np.ravel(ends), *known, series.edges[-1]])
    found = {}
    for (first, last), (begin, end) in zip(runs, ends, strict=True):
        low = walls[max(np.searchsorted(walls, begin) - 1, 0)]
        high = walls[min(np.searchsorted(walls, end, "right"), len(walls) - 1)]
        limit = float(series.limits[first : last + 1].max())
        t, is_sure = _between(evaluate, low, (begin, end), high, limit)
        if not is_sure:
            better = fitted_kink(evaluate, low, (begin, end), high, limit)
            t = t if better is None else better
        if t is not None:
            found[t] = float(series.lengths[first : last + 1].min())
    return _beside_ends(series, evaluate, known, walls) | found


def _beside_ends(
    series: Series, evaluate: Values, known: Sequence[float], walls: Array
) -> dict[float, float]:
    """Kinks so close to ends of pieces, by chance, that no piece is short beside them.

    walls : ends of what is smooth, sorted
    """
    found: dict[float, float] = {}
    for t in joined_kinks(series):
        k = int(np.searchsorted(series.edges, t))
        near = CLOSE * float(series.lengths[k - 1 : k + 1].min())
        if np.abs(t - np.array([*known, np.inf])).min() <= near:
            continue
        low = walls[max(np.searchsorted(walls, t - near) - 1, 0)]
        high = walls[min(np.searchsorted(walls, t + near, "right"), len(walls) - 1)]
        limit = float(series.limits[k - 1 : k + 1].max())
        place = fitted_kink(evaluate, low, (t - near, t + near), high, limit)
        if place is not None:
            found[place] = 0.0
    return found


def _helpful(series: Series, found: dict[float, float]) -> list[float]:
    """The places beside which the pieces of a series that ends there became long."""
    kept = []
    for t, least in found.items():
        k = int(np.searchsorted(series.edges, t))
        if series.lengths[k - 1 : k + 1].min() > LONGER * least:
            kept.append(t)
    return kept


def _between(
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
    before = _side(evaluate, begin, low, limit, width)
    after = _side(evaluate, end, high, limit, width)
    if before is None or after is None:
        return None, False
    orders = {t: k for k, t in _crossings(before, after, begin, end)}
    times = sorted(orders)
    looks = np.interp(
        np.arange(LOOKS * (len(times) + 1)) / LOOKS,
        np.arange(len(times) + 2),
        [begin, *times, end],
    )
    values = evaluate(looks)
    gaps = [np.abs(side(looks) - values) for side in (before, after)]
    worst = [(float(np.where(looks < t, *gaps).max()), t) for t in times]
    gap, t = min(worst, default=(np.inf, 0.0))
    if not gap <= 10.0 * limit:
        return None, False
    jump, next_jump = (
        float(abs(after.deriv(k)(t) - before.deriv(k)(t)))
        for k in (orders[t], orders[t] + 1)
    )
    return t, orders[t] <= SURE and jump > width * next_jump


def _side(
    evaluate: Values, near: float, far: float, limit: float, width: float
) -> Chebyshev | None:
    """The polynomial that follows the function from `near` on, as far as one does."""
    degree = 14
    nodes = chebyshev.chebpts1(2 * degree)
    while abs(far - near) > LEAST_SIDE * width:
        low, high = min(near, far), max(near, far)
        times = near + 0.5 * (far - near) * (1.0 + nodes)
        values = evaluate(np.clip(times, low, high))
        fit = Chebyshev.fit(times, values, degree, domain=[low, high])
        gap = np.abs(fit(times) - values).max()
        if np.abs(fit.coef[-2:]).max() <= limit and gap <= 10.0 * limit:
            return fit.trim(TRIMMED * limit)
        far = near + 0.5 * (far - near)
    return None


def _crossings(
    before: Chebyshev, after: Chebyshev, begin: float, end: float
) -> Iterator[tuple[int, float]]:
    """Where the value, the rate, ... of both polynomials are equal, one place each, and
    the order of the derivative that jumps there.

    After a jump of the derivative of order k both differ as (t - kink)^k: the one of
    order k - 1 crosses zero there.
    """
    for order in range(ORDERS):
        t = 0.5 * (begin + end)
        for _ in range(STEPS):
            gap, slope = (
                after.deriv(m)(t) - before.deriv(m)(t) for m in (order, order + 1)
            )
            t = float(t - gap / slope) if slope != 0.0 else np.inf
            if not begin < t < end:
                break
        else:
            yield order + 1, t
