"""Samples of laws with a sample time: steps end there, values are held between them."""

from __future__ import annotations

import numpy as np

from sidtool.formats.scene import OutputTimes, Time
from sidtool.formats.sid import Array

from ...equations.equations import law_at
from ...space import layout as at
from ..scene import System
from .elements import Element

#: A sample is at a break that is nearer than this part of the sample time.
SAME = 1e-6


def with_samples(
    breaks: tuple[float, ...], elements: tuple[Element, ...], time: Time
) -> tuple[float, ...]:
    """Breaks of functions and the samples of all laws inside the span, growing."""
    found = np.array(breaks)
    for period in sorted({e.sampled for e in elements if e.sampled}):
        count = int(np.ceil((time.end - time.start) / period))
        samples = time.start + period * np.arange(1, count)
        near = np.searchsorted(found, samples)
        gaps = [
            np.abs(found[np.clip(near - side, 0, len(found) - 1)] - samples)
            for side in (0, 1)
        ]
        new = samples[np.minimum(*gaps) > SAME * period]
        new = new[new < time.end - SAME * period]
        found = np.sort(np.concatenate([found, new]))
    return tuple(float(t) for t in found)


class SampledTimes(OutputTimes):
    """Output times, of which those at a sample stand at the break that it is.

    What is recorded there holds just before the sample, in the step that ends at the
    break. Numbers of files have some digits only: an output time may lie by 1e-11 s
    behind the sample that it is meant to be at.
    """

    def __init__(self, system: System) -> None:
        super().__init__(system.scene)
        periods = [element.sampled for element in system.forces if element.sampled]
        self._instants = np.array(system.breaks if periods else ())
        start, shortest = system.scene.time.start, np.full(len(self._instants), np.inf)
        for period in periods:
            due = _is_due(self._instants - start, period)
            shortest[due] = np.minimum(shortest[due], period)
        self._instants = self._instants[np.isfinite(shortest)]
        self._near = SAME * shortest[np.isfinite(shortest)]

    def __getitem__(self, part: slice) -> Array:
        times = np.array(super().__getitem__(part))
        if len(self._instants):
            after = np.searchsorted(self._instants, times)
            for side in (0, 1):
                k = np.clip(after - side, 0, len(self._instants) - 1)
                at_sample = np.abs(times - self._instants[k]) <= self._near[k]
                times[at_sample] = self._instants[k][at_sample]
        return times


def _is_due(passed: Array, period: float) -> Array:
    """Whether a law is sampled a time (n,) after the start."""
    counts = np.asarray(passed) / period
    return np.asarray(np.abs(counts - np.round(counts)) <= SAME)


class Samplers:
    """The sampled laws of a system, as rows of its force table."""

    def __init__(self, system: System) -> None:
        self._system, self._last = system, -np.inf
        self._rows = [k for k, e in enumerate(system.forces) if e.sampled]

    def take(self, work: at.Work, t: float, v: Array) -> bool:
        """Sets the states in v of the laws that are sampled at t, from the state that
        was just evaluated, once at each time; whether there are any."""
        if t == self._last:
            return False
        start, self._last = self._system.scene.time.start, t
        due = []
        for k in self._rows:
            if _is_due(np.array(t - start), self._system.forces[k].sampled):
                due.append(k)
        arrays = self._system.arrays
        values = [law_at(arrays, work, k, t) for k in due]
        for k, value in zip(due, values, strict=True):
            v[arrays.body[arrays.force[k, at.F_B], at.VEL]] = value
        return bool(due)
