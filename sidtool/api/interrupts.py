"""Ctrl-C and SIGTERM: end a run at its next step and keep the motion so far."""

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
    """Raised after Ctrl-C during `sidtool.simulate`.

    Attributes
    ----------
    result : the motion so far, marked as unfinished
    """

    def __init__(self, message: str, result: Any) -> None:
        super().__init__(message)
        self.result = result


class StopRequest:
    """Request to end a run; `number` is the number of the signal."""

    def __init__(self) -> None:
        self.number = 0
        self.before: dict[int, Any] = {}

    def __call__(self) -> str:
        """Return the reason to end the run, or an empty text."""
        if not self.number:
            return ""
        return f"ended by {signal_name(self.number)}"

    def handle_request(self, number: int, frame: FrameType | None) -> None:
        """Handle a signal: the first one sets the request; for the second one the
        previous handler applies.
        """
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
            handle_signal(number, stop.handle_request)
    try:
        yield stop
    finally:
        for number, handler in stop.before.items():
            handle_signal(number, handler)


@contextmanager
def wrap_errors(*programs: Programs) -> Iterator[StopRequest]:
    """Convert errors of the solver inside the context to the public classes.

    Parameters
    ----------
    programs : callables for drives and forces, by name

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
    """Run a compiled scene with the settings of `sidtool.solver.simulate`."""
    from sidtool.formats.diagnostics.record import warn_of
    from sidtool.solver import simulate

    from .result import to_user_result

    with stop_on_signals("SIGINT", stop=stop):
        result = simulate(system, stop=stop, **{"emit_warning": warn_of, **settings})
    return to_user_result(result, *programs)
