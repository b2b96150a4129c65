"""Progress of long computations.

A computation reports stages with `report_stage`; the command line shows them. Without
a listener the reports have no effect.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sized
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import TypeVar

#: Called with the stage and the share that is done, 0 to 1; None if unknown.
Listener = Callable[[str, float | None], None]
T = TypeVar("T")
W = TypeVar("W", bound="TotalProgress")

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)
#: Work in progress, the innermost first.
_totals: ContextVar[tuple[TotalProgress, ...]] = ContextVar("wholes", default=())


def report_stage(text: str, share: float | None = None) -> None:
    """Report the current stage, and the share of it that is done, 0 to 1.

    Inside `count_within` that is the share of the part that began last.
    """
    listener = _listener.get()
    if listener is not None:
        for total in _totals.get():
            share = total.share(share or 0.0)
        listener(text, share)


class TotalProgress:
    """Work in parts: the share of all of it that is done, which never falls.

    How long parts take is an estimate, which the end of each part puts right.
    """

    def __init__(self) -> None:
        self._now, self._largest_share = (0.0, 0.0), 0.0

    def share(self, of_part: float) -> float:
        """The share of the whole, of that of the part that is done now."""
        begin, end = self._now
        self._largest_share = max(
            self._largest_share, begin + (end - begin) * min(max(of_part, 0.0), 1.0)
        )
        return self._largest_share


class NamedStages(TotalProgress):
    """Parts that have names."""

    def __init__(self, lengths: Mapping[str, float]) -> None:
        """
        lengths : about how much of the time each part takes, in their order, in any
            unit
        """
        super().__init__()
        total = sum(lengths.values())
        self._parts, begin = {}, 0.0
        for name, length in lengths.items():
            self._parts[name] = begin / total, (begin + length) / total
            begin += length

    def enter(self, name: str) -> None:
        """The part that is done from now on; those before it are done."""
        self._now = self._parts[name]


class EqualStages(TotalProgress):
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
def count_within(total: W) -> Iterator[W]:
    """Count shares reported inside within the parts of a whole."""
    token = _totals.set((total, *_totals.get()))
    try:
        yield total
    finally:
        _totals.reset(token)


@dataclass
class TimeEstimate:
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
        """Return the expected remaining time [s] at the pace so far, or None."""
        if self.first is None:
            return None
        seconds, share = (b - a for a, b in zip(self.first, self.last, strict=True))
        return (1.0 - self.last[1]) * seconds / share if share > 0.0 else None


def has_listener() -> bool:
    """Check whether there is a listener."""
    return _listener.get() is not None


def iterate_with_progress(
    items: Iterable[T], text: str, total: int | None = None
) -> Iterator[T]:
    """Iterate over items and report the share that is done before each and at the end.

    Parameters
    ----------
    total : number of items without a length
    """
    if total is None and isinstance(items, Sized):
        total = len(items)
    for number, item in enumerate(items):
        report_stage(text, number / total if total else None)
        yield item
    report_stage(text, 1.0)


@contextmanager
def use_listener(listener: Listener | None) -> Iterator[None]:
    """Pass the reports inside the context to a listener."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)
