"""States at the ends of the steps of a run: what lies between its output times.

Verdicts on flexible bodies look at them, too: output times may be few.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from sidtool.formats.sid import Array

from ..space import layout as at
from ..system.scene import System
from .dense import Steps, joined

#: At most twice as many states are kept; of longer runs every second, fourth, ... one.
MOST = 500
#: Coordinates of states that are handed on together.
NUMBERS = 500_000


class Visited:
    """Keeps states at the ends of steps, and those that verdicts must not miss.

    These are the states of the largest elastic coordinates, of the largest angular
    velocity and accelerations of the frame of each flexible body, of the largest
    acceleration of all, by differences of velocities, and about some times.

    times : (n,) [s]
    """

    def __init__(self, system: System, times: Iterable[float] = ()) -> None:
        self._elastic: list[int] = []
        #: of each frame its velocity and its angular velocity, in all velocities
        self._frames: list[tuple[slice, slice]] = []
        axes = 2 if system.planar else 3
        for row in system.arrays.body[system.arrays.body[:, at.NQ] > 0]:
            last, u, rd = row[at.POS] + row[at.NP], row[at.VEL], row[at.RD]
            self._elastic += range(last - row[at.NQ], last)
            if rd:
                self._frames.append((slice(u, u + axes), slice(u + axes, u + rd)))
        empty = np.zeros((0, system.n_positions)), np.zeros((0, system.n_velocities))
        self._parts = [Steps(np.zeros(0), *empty)]
        #: of each signal; signals that are largest at the same time share a state
        self._peaks: dict[int, Steps] = {}
        self._named: list[Steps] = []
        self._largest = np.zeros(len(self._elastic) + 3 * len(self._frames) + 1)
        self._count, self._seen, self._stride = 0, 0, 1
        self._last = self._parts[0]
        self._times = np.unique(np.array([*times], float))

    def add(self, ends: Steps) -> None:
        """Takes the ends of some steps, in the order of time."""
        if not len(ends.t):
            return
        self._note(joined([self._last, ends]))
        self._last = _rows(ends, slice(-1, None))
        first = -self._seen % self._stride
        self._seen += len(ends.t)
        part = _rows(ends, slice(first, None, self._stride))
        self._parts.append(part)
        self._count += len(part.t)
        if self._count > 2 * MOST:
            kept = _rows(joined(self._parts), slice(None, None, 2))
            self._parts, self._count = [kept], len(kept.t)
            self._stride *= 2

    def _note(self, ends: Steps) -> None:
        """Keeps the state of the largest of each signal, and those about the times."""
        signals = self._signals(ends)
        largest = signals.max(axis=0)
        columns = np.flatnonzero(largest > self._largest)
        rows = signals[:, columns].argmax(axis=0)
        states = {int(k): _rows(ends, slice(k, k + 1)) for k in np.unique(rows)}
        for column, row in zip(columns.tolist(), rows.tolist(), strict=True):
            self._peaks[column] = states[row]
        self._largest = np.maximum(largest, self._largest)
        for row in np.searchsorted(ends.t, self._times):
            if 0 < row < len(ends.t):
                self._named.append(_rows(ends, slice(row - 1, row + 1)))

    def _signals(self, ends: Steps) -> Array:
        """(nt, n): elastic coordinates, motion of frames, largest acceleration."""
        rates = np.diff(ends.v, axis=0, prepend=ends.v[:1])
        lengths = np.diff(ends.t, prepend=-np.inf)
        rates /= np.where(lengths > 0.0, lengths, np.inf)[:, None]
        columns = [*np.abs(ends.z[:, self._elastic]).T]
        for linear, angular in self._frames:
            parts = ends.v[:, angular], rates[:, linear], rates[:, angular]
            columns += [np.linalg.norm(part, axis=1) for part in parts]
        return np.column_stack([*columns, np.abs(rates).max(axis=1, initial=0.0)])

    def until(self, end: float) -> Iterator[Steps]:
        """All that is kept up to a time [s], in the order of time, in blocks."""
        peaks = {id(part): part for part in self._peaks.values()}
        parts = [*self._parts, *peaks.values(), *self._named]
        ends = np.cumsum([len(part.t) for part in parts])
        times, places = np.unique(
            np.concatenate([part.t for part in parts]), return_index=True
        )
        places = places[times <= end]
        block = max(1, NUMBERS // parts[0].z.shape[1])
        for first in range(0, len(places), block):
            wanted = np.sort(places[first : first + block])
            cuts = np.searchsorted(wanted, ends)
            rows = np.split(wanted, cuts[:-1])
            begins = ends - [len(part.t) for part in parts]
            found = zip(parts, rows, begins, strict=True)
            states = joined([_rows(part, k - begin) for part, k, begin in found])
            yield _rows(states, np.argsort(states.t, kind="stable"))


def _rows(steps: Steps, which: slice | np.ndarray) -> Steps:
    return Steps(steps.t[which].copy(), steps.z[which].copy(), steps.v[which].copy())
