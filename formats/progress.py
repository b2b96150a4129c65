"""How far long work has come, told to whoever listens.

Work tells it wherever it is; a command line shows it. Nobody has to listen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

#: Is told what is done, and which share of it is, 0 to 1; None where nobody knows.
Listener = Callable[[str, float | None], None]
T = TypeVar("T")

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


def reached(text: str, share: float | None = None) -> None:
    """Tell what is done now, and the share of it that is, 0 to 1."""
    listener = _listener.get()
    if listener is not None:
        listener(text, share)


def is_heard() -> bool:
    """Whether somebody listens."""
    return _listener.get() is not None


def counted(items: Iterable[T], text: str, total: int | None = None) -> Iterator[T]:
    """The items, with the share of them that is done told before each and at the end.

    total : how many there are, of what has no length
    """
    if total is None and isinstance(items, Sized):
        total = len(items)
    for number, item in enumerate(items):
        reached(text, number / total if total else None)
        yield item
    reached(text, 1.0)


@contextmanager
def listening(listener: Listener | None) -> Iterator[None]:
    """Has what is done inside told to a listener."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)
