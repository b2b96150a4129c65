"""What is told of a run, found when somebody looks at it.

Many runs of one scene are made for their numbers alone. So what was recorded waits
where it is not much, and is looked at in the order of time; of long runs nothing waits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sidtool.formats.result import FlexibleBody
from sidtool.formats.sid import Array

from ..recording.dense import Steps
from ..recording.outputs import Recorded
from ..recording.sampling import Samples
from ..recording.visited import Visited
from ..system.scene import System
from .body_measures import Reached
from .notes import Remarks
from .vibrations import Vibrations

#: Numbers of frames, markers and states that may wait.
MOST = 100_000


class Found(NamedTuple):
    """What flexible bodies met, remarks, vibrations, and states not to be missed."""

    reached: Reached
    remarks: Remarks
    vibrations: Vibrations
    visited: Visited


class Verdicts:
    """What rows and ends of steps of a run tell of it.

    expect : what was said of flexible bodies before it
    """

    def __init__(
        self, system: System, expect: Callable[[], Mapping[str, FlexibleBody]]
    ) -> None:
        self._system, self._expect = system, expect
        self._waiting: list[Callable[[], None]] = []
        self._numbers = 0

    @property
    def waits(self) -> bool:
        """Whether what is added may be kept for later."""
        return self._numbers <= MOST

    def add(self, found: Recorded, t: Array) -> None:
        """Recorded rows."""
        samples = found.samples

        def look() -> None:
            self._found.remarks.add(t, found)
            self._found.vibrations.add(samples)
            self._found.reached.add(samples, t)

        self._later(look, samples.frames.size + samples.points.size)

    def recall(self, samples: Samples, t: Array) -> None:
        """Rows that a run before this one recorded."""
        self._later(lambda: self._found.reached.add(samples, t), samples.frames.size)

    def visit(self, ends: Steps) -> None:
        """Ends of some steps."""
        self._later(lambda: self._found.visited.add(ends), ends.z.size + ends.v.size)

    def go_on(self, times: Array, z: Array) -> None:
        """Rows and ends of steps in the order of time."""
        self._later(lambda: self._found.reached.go_on(times, z), z.size)

    def _later(self, look: Callable[[], None], numbers: int) -> None:
        self._numbers += numbers
        if self.waits:
            self._waiting.append(look)
        else:
            self._look()
            look()

    def _look(self) -> None:
        waiting, self._waiting = self._waiting, []
        for look in waiting:
            look()

    @property
    def found(self) -> Found:
        """What there is, of all that was added."""
        self._look()
        return self._found

    @cached_property
    def _found(self) -> Found:
        system, expected = self._system, self._expect()
        worst = np.array([body.expected.time for body in expected.values()])
        return Found(
            Reached(system, expected),
            Remarks(system),
            Vibrations(system),
            Visited(system, worst),
        )
