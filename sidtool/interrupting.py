"""Ctrl-C and SIGTERM during a run: it ends at its next step and keeps what there is."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Any

from sidtool.formats.storage.operating_system import (
    DEFAULT,
    handle_signal,
    present_signals,
    signal_handler,
    signal_name,
)

if TYPE_CHECKING:
    from sidtool.solver.system.scene import System

    from .results import Result

Programs = Mapping[str, Any] | None


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during `sidtool.simulate`.

    Attributes
    ----------
    result : everything that was computed until then, unfinished
    """

    def __init__(self, message: str, result: Any) -> None:
        super().__init__(message)
        self.result = result


class Ending:
    """Whether a signal has asked a run to end; `number` is that of the signal."""

    def __init__(self) -> None:
        self.number = 0
        self.before: dict[int, Any] = {}

    def __call__(self) -> str:
        """Why the run is to end; empty while it is not."""
        if not self.number:
            return ""
        return f"ended by {signal_name(self.number)}"

    def take(self, number: int, frame: FrameType | None) -> None:
        """The first signal asks; the second one does what it did before."""
        self.number = number
        handle_signal(number, self.before[number])
        if sys.stderr.isatty():
            os.write(2, b"sidtool: ends at the next step; again: at once\n")


@contextmanager
def ending(*names: str, asked: Ending | None = None) -> Iterator[Ending]:
    """Signals inside ask instead of ending the program; ignored ones stay so.

    asked : what is told, default a new one
    """
    asked = asked or Ending()
    present: Sequence[int] = present_signals(names)
    if threading.current_thread() is not threading.main_thread():
        present = []
    for number in present:
        before = signal_handler(number)
        if callable(before) or before is DEFAULT:
            asked.before[number] = before
            handle_signal(number, asked.take)
    try:
        yield asked
    finally:
        for number, handler in asked.before.items():
            handle_signal(number, handler)


@contextmanager
def answered(*programs: Programs) -> Iterator[Ending]:
    """Errors inside carry results as users have them.

    programs : drives and forces of a program, by name

    Raises
    ------
    sidtool.Interrupted : Ctrl-C; its `result` holds what there is.
    sidtool.SimulationError : the run stopped; its `result` holds what there is.
    """
    from sidtool.solver.errors import SimulationError

    from .results import answering

    asked = Ending()
    try:
        yield asked
    except SimulationError as error:
        if error.result is not None:
            error.result = answering(error.result, *programs)
        if asked.number:
            raise Interrupted(str(error), error.result) from None
        raise


def ran(system: System, asked: Ending, *programs: Programs, **settings: Any) -> Result:
    """The result of a run, with the settings of `sidtool.solver.simulate`."""
    from sidtool.solver import simulate

    from .results import answering, warn_of_validity

    with ending("SIGINT", asked=asked):
        result = simulate(system, stop=asked, warn=warn_of_validity, **settings)
    return answering(result, *programs)
