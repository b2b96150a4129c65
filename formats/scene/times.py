"""Output times of a scene."""

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from .tables import SceneTables

MAX_OUTPUT_TIMES = 10_000_000


class OutputTimes:
    """Times of the rows of the result [s], increasing; a slice of them is an array.

    Multiples of the output step from the start; the end is one of them if it fits.

    Raises
    ------
    InputError : there are too many, or the scene defines none.
    """

    def __init__(self, scene: SceneTables) -> None:
        self._time = scene.time
        self._span = scene.time.end - scene.time.start
        self._count = len(scene.time.output_times or ())
        step = scene.time.output_step
        if step is None and scene.time.output_times is None:
            raise InputError(
                "neither is given",
                place="time",
                expected="one of output_step and output_times",
            )
        if step is None:
            return
        steps = self._span / step * (1 + 1e-12) + 1e-9
        if not steps < MAX_OUTPUT_TIMES + 1:
            count = int(steps) if steps < 1e15 else f"{steps:.3g}"
            raise InputError(
                f"asks for {count} output times",
                place="time.output_step",
                expected=f"at most {MAX_OUTPUT_TIMES}",
            )
        self._count = int(steps) + 1

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, part: slice) -> NDArray[np.float64]:
        time, last = self._time, self._count - 1
        if time.output_step is None:
            return np.array(time.output_times)[part]
        steps = np.arange(*part.indices(self._count), dtype=np.float64)
        if abs(last * time.output_step - self._span) <= 1e-9 * self._span:
            return time.start + self._span * steps / max(last, 1)
        return time.start + time.output_step * steps


def output_times(scene: SceneTables) -> NDArray[np.float64]:
    """All of them, (nt,)."""
    return OutputTimes(scene)[:]
