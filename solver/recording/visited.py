"""States at the ends of the steps of a run: what lies between its output times.

Verdicts on flexible bodies look at them, too: output times may be few.
"""

from __future__ import annotations

import numpy as np

from ..kernels import layout as at
from ..system.scene import System
from .dense import Steps

#: At most twice as many states are kept; of longer runs every second, fourth, ... one.
MOST = 500


class Visited:
    """Keeps states at the ends of steps, and those of the largest deformations."""

    def __init__(self, system: System) -> None:
        self._elastic = np.concatenate(
            [
                np.arange(
                    row[at.POS] + row[at.NP] - row[at.NQ], row[at.POS] + row[at.NP]
                )
                for row in system.arrays.body
            ]
        ).astype(int)
        empty = np.zeros((0, system.n_positions)), np.zeros((0, system.n_velocities))
        self._parts = [Steps(np.zeros(0), *empty)]
        self._peaks: dict[int, Steps] = {}
        self._largest = np.zeros(len(self._elastic))
        self._count, self._seen, self._stride = 0, 0, 1

    def add(self, ends: Steps) -> None:
        """Takes the ends of some steps, in the order of time."""
        if not len(ends.t):
            return
        self._note_peaks(ends)
        first = -self._seen % self._stride
        self._seen += len(ends.t)
        part = _rows(ends, slice(first, None, self._stride))
        self._parts.append(part)
        self._count += len(part.t)
        if self._count > 2 * MOST:
            kept = _rows(_joined(self._parts), slice(None, None, 2))
            self._parts, self._count = [kept], len(kept.t)
            self._stride *= 2

    def _note_peaks(self, ends: Steps) -> None:
        """Keeps the state of the largest magnitude of each elastic coordinate."""
        sizes = np.abs(ends.z[:, self._elastic])
        largest = sizes.max(axis=0)
        for column in map(int, np.flatnonzero(largest > self._largest)):
            row = int(sizes[:, column].argmax())
            self._peaks[column] = _rows(ends, slice(row, row + 1))
        self._largest = np.maximum(largest, self._largest)

    def until(self, end: float) -> Steps:
        """All that is kept up to a time [s], in the order of time."""
        parts = [*self._parts, *self._peaks.values()]
        states = _joined(parts)
        times, rows = np.unique(states.t, return_index=True)
        return _rows(states, rows[times <= end])


def _rows(steps: Steps, which: slice | np.ndarray) -> Steps:
    return Steps(steps.t[which].copy(), steps.z[which].copy(), steps.v[which].copy())


def _joined(parts: list[Steps]) -> Steps:
    return Steps(
        *(np.concatenate([getattr(p, name) for p in parts]) for name in ("t", "z", "v"))
    )
