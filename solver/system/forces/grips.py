"""How joints with friction moved in a run: which slid, which stuck, and since when."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from sidtool.formats.sid import Array

from ...space import layout as at


class Grips:
    """The grips of a run, one after another.

    now : (frictions, N_GRIP) `space.layout.System.grip`, which kernels read

    What is kept tells no side of a load: a state by itself is as smooth without.
    """

    def __init__(self, now: Array) -> None:
        self.now = now
        self._since: list[float] = []
        self._kept: list[Array] = []

    def note(self, t: float) -> None:
        """Keeps what holds from now on."""
        self._since.append(t)
        kept = self.now.copy()
        kept[:, at.SIDE :] = 0.0
        self._kept.append(kept)

    def forget(self) -> None:
        """Nothing is kept any more."""
        self._since.clear()
        self._kept.clear()

    @contextmanager
    def parts(self, times: Array) -> Iterator[Iterator[slice]]:
        """Runs of times with one grip, which is put in place for each.

        A time between two grips belongs to the first one. The present one is back at
        the end.
        """
        present = self.now.copy()
        try:
            yield self._parts(times)
        finally:
            self.now[:] = present

    def _parts(self, times: Array) -> Iterator[slice]:
        if not self._since:
            yield slice(0, len(times))
            return
        index = np.searchsorted(self._since, times, "left") - 1
        edges = np.flatnonzero(np.diff(index)) + 1
        for first, last in zip([0, *edges], [*edges, len(times)], strict=True):
            if first < last:
                self.now[:] = self._kept[max(int(index[first]), 0)]
                yield slice(int(first), int(last))
