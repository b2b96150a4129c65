"""Dense output of whole steps: states at points, and the polynomial through them.

The points of a step are Chebyshev's extrema, two more than the degree of the dense
output. Formula between them: J.-P. Berrut, L. N. Trefethen, "Barycentric Lagrange
interpolation", SIAM Review 46 (2004), eq. (4.2) and (5.4).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import chebyshev

from sidtool.formats.sid import Array

from ..integrators.stepping import Control

#: Steps that a control keeps the points of.
CHUNK = 20
#: The same where only ends of steps are wanted; of fixed steps, which are short, those
#: of so many ones.
END_CHUNK, FIXED = 500, 10
#: Steps that are evaluated together.
BATCH = 500


@dataclass(frozen=True, eq=False)
class Steps:
    """States at the points of some steps, one step after another.

    The first and the last time of a step lie inside it by the last digit, so that they
    belong to the smooth interval of the step.
    """

    t: Array
    z: Array
    v: Array


def joined(parts: Sequence[Steps]) -> Steps:
    """Some steps after others."""
    return Steps(
        *(np.concatenate([getattr(p, name) for p in parts]) for name in ("t", "z", "v"))
    )


class Points:
    """The points of a step.

    Attributes
    ----------
    count : their number
    shares : where they lie, 0 to 1
    """

    def __init__(self, degree: int) -> None:
        self.count = degree + 2
        k = np.arange(self.count)
        self.shares = 0.5 - 0.5 * np.cos(np.pi * k / (self.count - 1))
        self._weights = (-1.0) ** k
        self._weights[[0, -1]] *= 0.5

    def wanted(self) -> Array:
        """`Control.shares` for `CHUNK` steps."""
        return np.tile([*self.shares, -1.0], CHUNK)

    def ends(self, steps: Steps) -> Steps:
        """The last point of each step."""
        last = slice(self.count - 1, None, self.count)
        return Steps(steps.t[last], steps.z[last], steps.v[last])

    def state(self, steps: Steps, t: float) -> tuple[Array, Array]:
        """z and v at a time inside the steps."""
        ends = steps.t[self.count - 1 :: self.count]
        first = self.count * min(int(np.searchsorted(ends, t)), len(ends) - 1)
        part = slice(first, first + self.count)
        distance = t - steps.t[part]
        if (distance == 0.0).any():
            k = first + int(np.argmin(np.abs(distance)))
            return steps.z[k].copy(), steps.v[k].copy()
        weights = self._weights / distance
        weights /= weights.sum()
        return weights @ steps.z[part], weights @ steps.v[part]

    def integral(self, t: Array, values: Array, until: Array) -> Array:
        """Integral of values at all points from the first until some times, (nt,)."""
        starts = t[:: self.count]
        lengths = t[self.count - 1 :: self.count] - starts
        basis = chebyshev.chebvander(2.0 * self.shares - 1.0, self.count - 1)
        terms = np.linalg.solve(basis, values.reshape(-1, self.count).T)
        sums = 0.5 * lengths * chebyshev.chebint(terms, lbnd=-1)
        before = np.concatenate([[0.0], np.cumsum(chebyshev.chebval(1.0, sums))])
        k = np.clip(np.searchsorted(starts, until, "right") - 1, 0, len(starts) - 1)
        share = np.clip((until - starts[k]) / lengths[k], 0.0, 1.0)
        return before[k] + chebyshev.chebval(2.0 * share - 1.0, sums[:, k], False)

    def batches(self, parts: Sequence[Steps]) -> Iterator[Steps]:
        """The same steps in groups that are neither many nor large."""
        steps, size = joined(parts), BATCH * self.count
        t, z, v = steps.t, steps.z, steps.v
        for i in range(0, len(t), size):
            yield Steps(t[i : i + size], z[i : i + size], v[i : i + size])


@cache
def points(degree: int) -> Points:
    """Those of steps whose dense output has a degree."""
    return Points(degree)


@cache
def wanted_ends(fixed: bool) -> Array:
    """`Control.shares` for `END_CHUNK` steps, of which the ends are wanted."""
    if fixed:
        return np.tile([1.0] + [-1.0] * FIXED, END_CHUNK // FIXED)
    return np.tile([1.0, -1.0], END_CHUNK)


def taken_ends(control: Control) -> Steps:
    """Ends of steps since the last call, by `wanted_ends`; the control forgets them."""
    used = control.share
    control.share = 0
    inside = np.flatnonzero(control.shares[:used] > 0.0)
    rows = len(control.times) + inside
    return Steps(control.moments[inside], control.out_z[rows], control.out_v[rows])


def taken(control: Control) -> Steps:
    """The steps since the last call, which the control forgets."""
    used = control.share
    control.share = 0
    shares = control.shares[:used]
    inside = np.flatnonzero(shares >= 0.0)
    t = control.moments[inside]
    first, last = shares[inside] == 0.0, shares[inside] == 1.0
    starts = t[first]
    ends = [*starts[1:], control.time] if used else []
    t[first] = np.nextafter(starts, np.inf)
    t[last] = np.nextafter(ends, -np.inf)
    rows = len(control.times) + inside
    return Steps(t, control.out_z[rows], control.out_v[rows])
