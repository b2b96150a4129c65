"""Collect all reasons to refuse a file and report them together."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager

from sidtool.formats.base.errors import InputError

#: Numbers are removed to compare refusals.
_NUMBERS = re.compile(r"[-+]?\d[\d.+-]*")
#: Texts of refusals that may follow from another one, as of an element set.
_CONSEQUENCE_TEXTS = ("not defined", "there is no ", "is empty", "stands alone")
#: Largest number of different refusals in a report.
_MAX_REFUSALS = 40


class RefusalCollector:
    """Reasons to refuse a file, in order.

    Refusals that differ in numbers only are reported once, with their count. Refusals
    that another one may have caused are omitted after it.
    """

    def __init__(self) -> None:
        self._found: dict[str, list[InputError]] = {}
        self._ignorable: dict[str, None] = {}

    @property
    def count(self) -> int:
        """How many there are."""
        return sum(map(len, self._found.values()))

    @contextmanager
    def collect_errors(self) -> Iterator[None]:
        """Keep an InputError for `check` instead of raising it."""
        try:
            yield
        except InputError as error:
            self.add(error)

    def add(self, error: InputError, ignorable: str = "") -> None:
        """Store a refusal.

        Parameters
        ----------
        ignorable : the keyword, card or command that `geometry.ignore` may ignore
        """
        if ignorable:
            self._ignorable[ignorable] = None
        if self._found and any(word in error.problem for word in _CONSEQUENCE_TEXTS):
            return
        key = error.problem if ignorable else _NUMBERS.sub("#", error.problem)
        self._found.setdefault(key, []).append(error)

    def check(self) -> None:
        """Raise the refusals, if there are any.

        Raises
        ------
        InputError : the first one, and all others in its `also`.
        """
        if not self._found:
            return
        alike = list(self._found.values())
        first, *others = [own[0] for own in alike]
        counts = [len(own) for own in alike]
        also = [
            f"{error}{_more_text(count)}"
            for error, count in zip(others[:_MAX_REFUSALS], counts[1:], strict=False)
        ]
        if len(others) > _MAX_REFUSALS:
            also.append(f"{len(others) - _MAX_REFUSALS} further refusals")
        if len(self._ignorable) > 1:
            listed = json.dumps(list(self._ignorable))
            also.append(f"geometry.ignore = {listed} leaves all of these out")
        raise InputError(
            first.problem + _more_text(counts[0]),
            source=first.source,
            place=first.place,
            expected=first.expected,
            also=(*first.also, *also),
        )


def _more_text(count: int) -> str:
    return f" (and {count - 1} more alike)" if count > 1 else ""
