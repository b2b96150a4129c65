"""Energy dissipated and supplied: powers integrated along the steps of a run.

In every step the powers at the points of its dense output are integrated as the
polynomial through them. The balance of energies tells the size of the error.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from sidtool.formats.scene import SceneFile, parse_output
from sidtool.formats.sid import Array

from .dense import BATCH, Points, Steps
from .energies import dissipation, supply
from .interpolation import interpolated
from .sampling import Sampler
from .told import Told
from .whole_scene import whole_motion

INTEGRATED = frozenset(["dissipated", "supplied", "balance"])


class History:
    """Energies dissipated and supplied since the start; of the last steps in detail."""

    def __init__(
        self, sampler: Sampler, points: Points, before: Array | None = None
    ) -> None:
        """before : both energies at the start, zero by default [J]"""
        self._sampler, self.points = sampler, points
        self._steps: list[Steps] = []
        self._before = np.zeros(2) if before is None else before

    def add(self, steps: Steps) -> None:
        if len(steps.t):
            self._steps.append(steps)

    @property
    def is_long(self) -> bool:
        """Whether `until` should be asked for all that is wanted, and then `forget`."""
        return sum(len(s.t) for s in self._steps) > BATCH * self.points.count

    def until(self, times: Array) -> tuple[Array, Array]:
        """Energies dissipated and supplied until times since the last `forget`, (nt,)
        each [J]."""
        if not self._steps:
            nothing = np.zeros(len(times))
            return nothing + self._before[0], nothing + self._before[1]
        t, powers = self._powers
        lost, given = (
            before + self.points.integral(t, power, times)
            for before, power in zip(self._before, powers, strict=True)
        )
        return lost, given

    def forget(self) -> None:
        """Goes on from the end of the steps so far."""
        if self._steps:
            self._before = np.ravel(self.until(self._steps[-1].t[-1:]))
        self._steps = []
        self.__dict__.pop("_powers", None)

    @cached_property
    def _powers(self) -> tuple[Array, list[Array]]:
        """Times of all points, and both powers there [W]."""
        t, powers = [], []
        for steps in self.points.batches(self._steps):
            samples = self._sampler.sample(steps.t, steps.z.copy(), steps.v.copy())
            whole, motion = whole_motion(self._sampler.system, steps.t, samples)
            told = Told(whole, motion, steps.t)
            powers.append((dissipation(told), supply(told)))
            t.append(steps.t)
        return np.concatenate(t), [np.concatenate(p) for p in zip(*powers, strict=True)]


def is_wanted(scene: SceneFile) -> bool:
    """True when an output needs the powers along the run."""
    names = [parse_output(text) for text in scene.outputs.record]
    return any(n.owner == "energy" and n.quantity in INTEGRATED for n in names)


def history_between(sampler: Sampler, times: Array, z: Array, v: Array) -> History:
    """A history of motion that is known at some times only.

    Between them it is interpolated by cubic Hermite polynomials of positions and of
    velocities. Of fewer than two times there is nothing to tell.
    """
    history = History(sampler, Points(3))
    if len(times) < 2:
        return history
    lengths = np.diff(times)[:, None]
    nodes = times[:-1, None] + lengths * history.points.shares
    nodes[:, 0], nodes[:, -1] = np.nextafter(times[:-1], np.inf), times[1:]
    nodes[:, -1] = np.nextafter(nodes[:, -1], -np.inf)
    found = interpolated(sampler, (times, z, v), nodes.ravel())
    history.add(Steps(nodes.ravel(), *found))
    return history
