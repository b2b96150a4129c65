"""Limits of differences that fall slowly with their step, as those of x^(3/2) at 0.

A force like c max(x, 0)^p with 1 < p < 2 has a slope at zero, but no curvature: a
difference over the step h is off by a power of h. Over steps of equal ratio such errors
are a geometric series, whose limit Aitken's method finds (J. Stoer, R. Bulirsch,
"Introduction to Numerical Analysis", section 5.10).
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from sidtool.formats.base.sid import Array

#: So many differences show a power law.
POWER_LAW = 4
#: Largest error of a limit that is used, relative to the limit.
LIMIT_TOLERANCE = 1e-5
#: Limits below this part of the first difference count as zero.
ZERO_SLOPE = 1e-4
#: Differences of successive steps have a limit where they fall at least as much.
SLOWEST = 0.95


def limits(differences: Sequence[Array]) -> tuple[Array, Array]:
    """Limits of differences over ever shorter steps of equal ratio, and their errors.

    Of all four in a row those whose limit changes least with the last one: long steps
    have higher powers, short ones rounding.

    Parameters
    ----------
    differences : four or more; a component that does not converge keeps the last
        difference.

    Returns
    -------
    limits and errors, each of the shape of a difference
    """
    found = [
        _limit(*three)
        for three in zip(*(differences[k:] for k in range(3)), strict=False)
    ]
    pairs = [(after, np.abs(after - one)) for one, after in pairwise(found)]
    return min(pairs, key=lambda pair: float(pair[1].max(initial=0.0)))


def power_law_limit(differences: Sequence[Array], otherwise: Array) -> Array:
    """Limits of the components whose differences fall as a power of the step."""
    if len(differences) < POWER_LAW:
        return otherwise
    limit, error = limits(differences)
    size = np.maximum(np.abs(limit), ZERO_SLOPE * np.abs(differences[0]))
    return np.where(error <= LIMIT_TOLERANCE * size, limit, otherwise)


def _limit(first: Array, second: Array, third: Array) -> Array:
    """Limits (...) of the components of three differences (...) of successive steps."""
    change, next_change = second - first, third - second
    ratio = next_change / np.where(change == 0.0, np.inf, change)
    falls = (ratio > 0.0) & (ratio < SLOWEST)
    ratio = np.where(falls, ratio, 0.0)
    return third + next_change * ratio / (1.0 - ratio)
