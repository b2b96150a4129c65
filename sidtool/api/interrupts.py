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
    from sidtool.solver.system.system import System

    from .result import Result

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


class StopRequest:
    """Request of a signal to end a run; `number` is that of the signal."""

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
def stop_on_signals(
    *names: str, stop: StopRequest | None = None
) -> Iterator[StopRequest]:
    """Turn signals inside the context into stop requests; ignored signals stay ignored.

    Parameters
    ----------
    stop : the request to set, default a new one
    """
    stop = stop or StopRequest()
    present: Sequence[int] = present_signals(names)
    if threading.current_thread() is not threading.main_thread():
        present = []
    for number in present:
        before = signal_handler(number)
        if callable(before) or before is DEFAULT:
            stop.before[number] = before
            handle_signal(number, stop.take)
    try:
        yield stop
    finally:
        for number, handler in stop.before.items():
            handle_signal(number, handler)


@contextmanager
def wrap_errors(*programs: Programs) -> Iterator[StopRequest]:
    """Convert results of errors inside the context to those of users.

    Parameters
    ----------
    programs : drives and forces of a program, by name

    Raises
    ------
    sidtool.Interrupted : Ctrl-C; its `result` holds the motion so far.
    sidtool.SimulationError : the run stopped; its `result` holds the motion so far.
    """
    from sidtool.solver.system.errors import SimulationError

    from .result import to_user_result

    stop = StopRequest()
    try:
        yield stop
    except SimulationError as error:
        if error.result is not None:
            error.result = to_user_result(error.result, *programs)
        if stop.number:
            raise Interrupted(str(error), error.result) from None
        raise


def run_interruptible(
    system: System, stop: StopRequest, *programs: Programs, **settings: Any
) -> Result:
    """The result of a run, with the settings of `sidtool.solver.simulate`."""
    from sidtool.solver import simulate

    from .result import to_user_result, warn_of_validity

    with stop_on_signals("SIGINT", stop=stop):
        result = simulate(system, stop=stop, warn=warn_of_validity, **settings)
    return to_user_result(result, *programs)
