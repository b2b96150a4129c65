"""Calls of machine code that signals can end."""

import threading
from collections.abc import Callable
from typing import Any, TypeVar

Value = TypeVar("Value")
#: Name of the threads.
_NAME = "sidtool call"
#: Seconds between two looks at signals, where a wait hides them (Windows).
_SIGNAL_INTERVAL = 0.2


def call_interruptibly(work: Callable[[], Value]) -> Value:
    """Return the result of a function whose machine code knows no signals.

    It runs in a thread. Python handles a signal in the main thread between two
    instructions, which takes as long as the function there. When the handler raises,
    the thread is left alone, see `is_work_left`.
    """
    if threading.current_thread() is not threading.main_thread():
        return work()
    outcome: list[Any] = []
    done = threading.Event()

    def run() -> None:
        try:
            outcome.extend((work(), None))
        except BaseException as error:
            outcome.extend((None, error))
        finally:
            done.set()

    threading.Thread(target=run, name=_NAME, daemon=True).start()
    while not done.wait(_SIGNAL_INTERVAL):
        pass
    value, error = outcome
    if error is not None:
        raise error
    return value


def is_work_left() -> bool:
    """Whether a call that was given up still runs.

    The interpreter must not be torn down under it: `os._exit` ends such a process.
    """
    return any(thread.name == _NAME for thread in threading.enumerate())
