"""Singular configurations that a run passed: when, and how near.

There some constraints depend on others and motions cross (a bifurcation). Steps go
straight on; a mechanism that misses such a configuration by less than the tolerance,
or than its dimensions are rounded, could as well turn aside. One that misses it by d of
its size passes with an independence of about the root of d.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sidtool.formats.sid import Array

from ..integrators import recording, stepping
from ..integrators.bifurcations import BEGAN, LASTED, MOST, STATES
from ..kernels import layout as at
from ..kernels.coordinates import rate
from ..kernels.newton import Kernels
from ..start.consistent import dense_jacobian, names_of_rows
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
#: Constraints have a part in a dependency when their share of it is larger.
INVOLVED = 0.05
#: Points of a step that are compared, and halvings around the best one.
POINTS, HALVINGS = 33, 40
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
    system: System, kernels: Kernels, control: stepping.Control, rtol: float
) -> Iterator[str]:
    """Sentences on the passages of a run that are too near to be sure of what follows.

    rtol : tolerated error
    """
    limit = min(AT_MOST, max(CLOSE, TIMES_ROOT * rtol**0.5))
    steps = int(control.whole[stepping.CROSSED])
    found: list[Passing] = []
    for row in control.crossed[: min(MOST, steps)]:
        nearest = _Path(system, kernels, row).nearest()
        if nearest.independence > limit:
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

    def nearest(self) -> Passing:
        """Where the constraints are least independent."""
        shares = np.linspace(0.0, 1.0, POINTS)
        heights = [self._independence(x) for x in shares]
        best, reach = float(shares[int(np.argmin(heights))]), 1.0 / (POINTS - 1)
        for _ in range(HALVINGS):
            sides = [max(0.0, best - reach), best, min(1.0, best + reach)]
            best = min(sides, key=self._independence)
            reach *= 0.5
        least = self._independence(best)
        sizes = row_sizes(self.system)
        opening = np.abs(self.work.row[:, at.C_VALUE]) / sizes
        left, _ = self._decomposed()
        rows = np.flatnonzero(np.abs(left) > INVOLVED)
        names = dict.fromkeys(names_of_rows(self.system, tuple(map(int, rows))))
        near = max(least, float(np.sqrt(2.0 * opening.max())))
        return Passing(self.begin + best * self.h, near, tuple(sorted(names)))

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
        system, rest = self.system, np.zeros(self.system.n_velocities)
        kernel_calls.evaluate(system, self.work, self.begin + x * h, z, rest)
        return self._decomposed()[1]

    def _decomposed(self) -> tuple[Array, float]:
        """Rows (rows,) that depend on each other most, and how little they do not."""
        system = self.system
        C = dense_jacobian(system, self.work.C) * coordinate_sizes(system)
        norms = np.linalg.norm(C, axis=1)
        C /= np.where(norms > 0.0, norms, 1.0)[:, None]
        left, sizes, _ = np.linalg.svd(C, full_matrices=False)
        last = system.n_rows - len(system.redundant) - 1
        if not 0 <= last < len(sizes):
            return np.zeros(system.n_rows), 1.0
        return left[:, last], float(sizes[last])
