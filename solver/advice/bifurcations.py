"""Singular configurations that a run passed: when, and how near.

There some constraints depend on others and motions cross (a bifurcation). Steps go
straight on; a mechanism that misses such a configuration by less than the tolerance,
or than its dimensions are rounded, could as well turn aside. One that misses it by d of
its size passes with an independence of about the root of d. Constraints of long chains
keep little independence wherever they are, about the inverse of the links: only what
falls beside that is a passage.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from sidtool.formats.sid import Array

from ..integrators import recording, stepping
from ..integrators.bifurcations import BEGAN, LASTED, MOST, STATES
from ..linear.memory import Kernels
from ..space import layout as at
from ..space.coordinates import rate
from ..space.layout import Work
from ..start import large_scenes
from ..start.consistent import dense_jacobian, names_of_rows, of_length_one
from ..system import kernel_calls
from ..system.scene import System
from ..system.sizes import coordinate_sizes, row_sizes
from ..system.storage import new_memory, new_work

#: Passages that are told one by one.
TOLD = 3
#: Independence below which motions can be confused, or this times the root of the
#: tolerated error, and at most the last: with it a mechanism misses the configuration
#: by ten times the tolerated error.
CLOSE, TIMES_ROOT, AT_MOST = 3e-3, 20.0**0.5, 0.05
#: Parts of the independence at other times that are not near.
USUAL = 0.5
#: Constraints have a part in a dependency when their share of it is larger.
INVOLVED = 0.05
#: Points of a step at which its course is seen, by which its way is longer at most.
SEEN, LONGER = 3, 2.0
#: Points of a step that are compared, and halvings around the best one, which end when
#: independence changes by less than this part, or as little is left. With less, large
#: scenes do not tell its rows from redundant ones.
POINTS, HALVINGS, SETTLED, NONE_LEFT = 33, 40, 1e-6, 1e-6
#: Of a rate, for its derivative by differences.
STEP = 1e-6


@dataclass(frozen=True)
class Passing:
    """The nearest point of a passage.

    independence : least singular value of the constraints, rows and coordinates scaled;
        of a step over a configuration that meets them, or nearly
    names : of joints and drives that depend on each other there
    """

    t: float
    independence: float
    names: tuple[str, ...]


def crossings(
    system: System,
    kernels: Kernels,
    control: stepping.Control,
    rtol: float,
    begin: Array,
) -> Iterator[str]:
    """Sentences on the passages of a run that are too near to be sure of what follows.

    rtol : tolerated error
    begin : z_I at the beginning
    """
    steps = control.crossings
    if not steps:
        return
    limit = min(AT_MOST, max(CLOSE, TIMES_ROOT * rtol**0.5))
    usual = _independence_at(system, begin)
    found: list[Passing] = []
    for row in control.crossed[: min(MOST, steps)]:
        nearest = _Path(system, kernels, row).nearest(limit, usual)
        if nearest is None:
            continue
        if found and nearest.t - found[-1].t < 2.0 * row[LASTED]:
            found[-1] = min(found[-1], nearest, key=lambda p: p.independence)
        else:
            found.append(nearest)
    for passing in found[:TOLD]:
        names, near = ", ".join(passing.names), passing.independence
        yield (
            f"at t = {passing.t:.6g} s the run passes a singular configuration: the "
            f"constraints of {names} keep {near:.0e} of their independence. Motions "
            "cross there (a bifurcation); which of them goes on may be decided by "
            "rounding, tolerance and integrator, not by the model"
        )
    more, many = len(found) - TOLD, " or more" if steps > MOST else ""
    if more > 0:
        yield f"the run passes singular configurations {more}{many} times later"


class _Path:
    """Motion inside a step: quintic through the states and slopes at its ends."""

    def __init__(self, system: System, kernels: Kernels, row: Array) -> None:
        self.system, self.kernels = system, kernels
        self.work, self.memory = new_work(system), new_memory(system, 0)
        self.begin, self.h = float(row[BEGAN]), float(row[LASTED])
        n, m = system.n_positions, system.n_velocities
        first, last = row[STATES : STATES + n + m], row[STATES + n + m :]
        middle = np.array([self.begin + 0.5 * self.h])
        self.work.clock[0] = system.clocks(middle)[0]
        self.ends = [
            self._slopes(self.begin, first[:n], first[n:]),
            self._slopes(self.begin + self.h, last[:n], last[n:]),
        ]

    def nearest(self, limit: float, usual: float) -> Passing | None:
        """Where the constraints are least independent, if that is near.

        limit : independence that is not near
        usual : independence at another time
        """
        seen = [self._rows(x) for x in np.linspace(0.0, 1.0, SEEN)]
        values = [_least(self.system, B)[1] for B in seen]
        limit = min(limit, USUAL * max(usual, *values))
        ways = [LONGER * _distance(A, B) for A, B in pairwise(seen)]
        sums = [a + b for a, b in pairwise(values)]
        if all(s - way > 2.0 * limit for s, way in zip(sums, ways, strict=True)):
            return None
        best, least = self._minimum()
        B = self._rows(best)
        sizes = row_sizes(self.system)
        opening = np.abs(self.work.row[:, at.C_VALUE]) / sizes
        near = max(least, float(np.sqrt(2.0 * opening.max())))
        if near > limit:
            return None
        left, _ = _least(self.system, B)
        rows = np.flatnonzero(np.abs(left) > INVOLVED)
        names = dict.fromkeys(names_of_rows(self.system, tuple(map(int, rows))))
        return Passing(self.begin + best * self.h, near, tuple(sorted(names)))

    def _minimum(self) -> tuple[float, float]:
        """The share of the step with the least independence, and that."""
        shares = np.linspace(0.0, 1.0, POINTS)
        heights = [self._independence(x) for x in shares]
        k, reach = int(np.argmin(heights)), 1.0 / (POINTS - 1)
        best, least = float(shares[k]), heights[k]
        for _ in range(HALVINGS):
            if least <= NONE_LEFT:
                break
            sides = [max(0.0, best - reach), min(1.0, best + reach)]
            beside = [self._independence(x) for x in sides]
            if np.ptp([least, *beside]) <= SETTLED * least:
                break
            if min(beside) < least:
                best, least = sides[int(np.argmin(beside))], min(beside)
            reach *= 0.5
        return best, least

    def _slopes(self, t: float, z: Array, v: Array) -> tuple[Array, Array, Array]:
        """z and its first two derivatives."""
        system = self.system
        recording.begin(
            self.kernels, system.arrays, self.work, self.memory, t, z.copy(), v.copy()
        )
        first, ahead = np.zeros_like(z), np.zeros_like(z)
        rate(system.arrays, z.copy(), v.copy(), first)
        a, small = self.memory.acceleration, STEP * self.h
        rate(system.arrays, z + small * first, v + small * a, ahead)
        return z, first, (ahead - first) / small

    def _independence(self, share: float) -> float:
        return _least(self.system, self._rows(share))[1]

    def _rows(self, share: float) -> Any:
        """Constraints evaluated at a share of the step."""
        z0, d0, c0 = self.ends[0]
        z1, d1, c1 = self.ends[1]
        h, x = self.h, share
        start = z0 + h * d0 * x + 0.5 * h * h * c0 * x * x
        gap = z1 - z0 - h * d0 - 0.5 * h * h * c0
        slope, bend = h * (d1 - d0 - h * c0), h * h * (c1 - c0)
        z = start + x**3 * (
            (10.0 - 15.0 * x + 6.0 * x * x) * gap
            + (-4.0 + 7.0 * x - 3.0 * x * x) * slope
            + 0.5 * (1.0 - 2.0 * x + x * x) * bend
        )
        return _rows_at(self.system, self.work, self.begin + x * h, z)


def _independence_at(system: System, begin: Array) -> float:
    """Independence at the beginning of a run."""
    work, t = new_work(system), system.scene.time.start
    work.clock[0] = 0.5 * (t + system.breaks[0])
    return _least(system, _rows_at(system, work, t, begin))[1]


def _rows_at(system: System, work: Work, t: float, z: Array) -> Any:
    """Constraints for relative changes, rows of length 1; sparse in large scenes."""
    kernel_calls.evaluate(system, work, t, z, np.zeros(system.n_velocities))
    if system.n_rows >= large_scenes.MANY:
        return large_scenes.of_length_one(large_scenes.scaled_jacobian(system, work.C))
    return of_length_one(dense_jacobian(system, work.C) * coordinate_sizes(system))


def _least(system: System, B: Any) -> tuple[Array, float]:
    """Rows (rows,) that depend on each other most, and how little they do not."""
    last = system.n_rows - len(system.redundant) - 1
    if not 0 <= last < min(B.shape):
        return np.zeros(system.n_rows), 1.0
    if system.n_rows >= large_scenes.MANY:
        return large_scenes.least_independent(B, len(system.redundant))
    left, sizes, _ = np.linalg.svd(B, full_matrices=False)
    return left[:, last], float(sizes[last])


def _distance(A: Any, B: Any) -> float:
    """More than singular values of matrices can differ by, in the spectral norm."""
    difference = abs(A - B)
    ways = [float(difference.sum(axis=k).max()) for k in (0, 1)]
    return float(np.sqrt(ways[0] * ways[1]))
