"""How far long work has come, told to whoever listens.

Work tells it wherever it is; a command line shows it. Nobody has to listen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sized
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TypeVar

#: Is told what is done, and which share of it is, 0 to 1; None where nobody knows.
Listener = Callable[[str, float | None], None]
T = TypeVar("T")
W = TypeVar("W", bound="Whole")

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)
#: What is on its way, the innermost first.
_wholes: ContextVar[tuple[Whole, ...]] = ContextVar("wholes", default=())


def reached(text: str, share: float | None = None) -> None:
    """Tell what is done now, and the share of it that is, 0 to 1.

    Inside `along` that is the share of the part that began last.
    """
    listener = _listener.get()
    if listener is not None:
        for whole in _wholes.get():
            share = whole.share(share or 0.0)
        listener(text, share)


class Whole:
    """Work in parts: the share of all of it that is done, which never falls.

    How long parts take is an estimate, which the end of each part puts right.
    """

    def __init__(self) -> None:
        self._now, self._far = (0.0, 0.0), 0.0

    def share(self, of_part: float) -> float:
        """The share of the whole, of that of the part that is done now."""
        begin, end = self._now
        self._far = max(self._far, begin + (end - begin) * min(max(of_part, 0.0), 1.0))
        return self._far


class Course(Whole):
    """Parts that have names."""

    def __init__(self, lengths: Mapping[str, float]) -> None:
        """
        lengths : about how much of the time each part takes, in their order, in any
            unit
        """
        super().__init__()
        whole = sum(lengths.values())
        self._parts, begin = {}, 0.0
        for name, length in lengths.items():
            self._parts[name] = begin / whole, (begin + length) / whole
            begin += length

    def enter(self, name: str) -> None:
        """The part that is done from now on; those before it are done."""
        self._now = self._parts[name]


class Steps(Whole):
    """Parts of about equal length, of which it is not known how many there will be.

    expected : about how many; where there are more, each is taken to be the last
    """

    def __init__(self, expected: float) -> None:
        super().__init__()
        self._expected, self._begun = expected, 0

    def next(self) -> None:
        """Another one begins; those before it are done."""
        self._begun += 1
        count = max(self._expected, self._begun)
        self._now = (self._begun - 1) / count, self._begun / count


@contextmanager
def along(whole: W) -> Iterator[W]:
    """Has shares that are told inside count within the parts of a whole."""
    token = _wholes.set((whole, *_wholes.get()))
    try:
        yield whole
    finally:
        _wholes.reset(token)


@dataclass
class Pace:
    """How long work takes, of the shares of it that were done at some times [s]."""

    first: tuple[float, float] | None = None
    last: tuple[float, float] = (0.0, 0.0)

    def at(self, now: float, share: float) -> None:
        """The share that is done now."""
        if self.first is None:
            self.first = now, share
        if share > self.last[1] or self.first == (now, share):
            self.last = now, share

    def left(self) -> float | None:
        """Seconds that the rest takes at the pace so far; None where none is seen."""
        if self.first is None:
            return None
        seconds, share = (b - a for a, b in zip(self.first, self.last, strict=True))
        return (1.0 - self.last[1]) * seconds / share if share > 0.0 else None


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
