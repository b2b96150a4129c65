"""Which engine solves the equations of a run, and who hears how far it is.

Both hold for everything that happens inside ``with running(...)``, so that the
reduction methods in between need not pass them on.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from sidtool.formats.progress import reached

Listener = Callable[[str], None]

#: Counts of a loop are told no more often than this [s].
_INTERVAL = 0.5

_ENGINE: ContextVar[str | None] = ContextVar("engine", default=None)
_LISTENER: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def running(
    engine: str | None = None, progress: Listener | None = None
) -> Iterator[None]:
    """Use an engine, one of `factors.ENGINES`, and tell a listener of the progress."""
    engine_before, listener_before = _ENGINE.set(engine), _LISTENER.set(progress)
    try:
        yield
    finally:
        _ENGINE.reset(engine_before)
        _LISTENER.reset(listener_before)


def asked_engine() -> str | None:
    """The engine of this run, if one was asked for."""
    return _ENGINE.get()


def tell(text: str) -> None:
    """Tell the listener of this run, if there is one, what begins now."""
    reached(text)
    _call(text)


def _call(text: str) -> None:
    listener = _LISTENER.get()
    if listener is not None:
        listener(text)


class Counter:
    """Tells how often something was done, from time to time."""

    def __init__(self, text: str, expected: float) -> None:
        """`text` with a place ``{}`` for the count; about how often it will be done."""
        self._text, self._count, self._expected = text, 0, expected
        self._last = time.monotonic()

    def __call__(self) -> None:
        self._count += 1
        text = self._text.format(self._count)
        reached(text, self._count / self._expected)
        now = time.monotonic()
        if now - self._last > _INTERVAL:
            self._last = now
            _call(text)
