"""The output times that a step loop holds: a few of all, refilled as a run goes on."""

from __future__ import annotations

import numpy as np

from sidtool.formats.result.rows import BLOCK
from sidtool.formats.scene import OutputTimes
from sidtool.formats.sid import Array

from ..integrators.stepping import Control

#: Numbers in the states of a window, and the fewest output times that it holds.
NUMBERS, LEAST = 1 << 19, 64


class Window:
    """Which output times come next."""

    def __init__(self, times: OutputTimes, state: int) -> None:
        """state : numbers in a state"""
        self.times = times
        self._first = 0
        rows = max(LEAST, min(BLOCK, NUMBERS // max(state, 1)))
        self.size = min(rows, len(times)) + 1

    def skip(self, count: int) -> None:
        """The first output times are behind the start."""
        self._first = count

    def fill(self, control: Control) -> None:
        """Has the next times in the control, from its first row on."""
        control.output = 0
        coming = self.times[self._first : self._first + len(control.times)]
        control.times[: len(coming)] = coming
        control.times[len(coming) :] = np.inf

    def reached(self, control: Control) -> tuple[Array, Array, Array]:
        """Times and states of the rows so far; see `go_on`."""
        count = control.output
        return control.times[:count], control.out_z[:count], control.out_v[:count]

    def go_on(self, control: Control, full: bool) -> Control:
        """Behind the rows so far.

        full : these are all that there is room for in a step; if there are none, the
            step needs more room
        """
        count = control.output
        self._first += count
        if full and count == 0:
            control = _roomier(control)
        self.fill(control)
        return control


def _roomier(control: Control) -> Control:
    """For twice as many output times; the rows are lost."""
    more = len(control.times)
    z, v = (
        np.zeros((len(rows) + more, rows.shape[1]))
        for rows in (control.out_z, control.out_v)
    )
    return control.replaced(times=np.full(2 * more, np.inf), out_z=z, out_v=v)
