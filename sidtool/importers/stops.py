"""All that stops a file, told together."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager

from sidtool.formats.errors import InputError

#: What names of numbers are left out of, to tell alike refusals once.
_NUMBERS = re.compile(r"[-+]?\d[\d.+-]*")
#: What may follow from another refusal, as of an element set.
_FOLLOWING = ("not defined", "there is no ", "is empty", "stands alone")
#: Different refusals that are told.
_MOST = 40


class Stops:
    """Refusals of a file, in order.

    Refusals that differ in numbers alone are told once, with their count; what another
    refusal may have caused is left out behind it.
    """

    def __init__(self) -> None:
        self._found: dict[str, list[InputError]] = {}
        self._ignorable: dict[str, None] = {}

    @property
    def count(self) -> int:
        """How many there are."""
        return sum(map(len, self._found.values()))

    @contextmanager
    def collected(self) -> Iterator[None]:
        """Keep an InputError for `check` instead of raising it."""
        try:
            yield
        except InputError as error:
            self.add(error)

    def add(self, error: InputError, ignorable: str = "") -> None:
        """Keep a refusal.

        Parameters
        ----------
        ignorable : the keyword, card or command that `geometry.ignore` may leave out
        """
        if ignorable:
            self._ignorable[ignorable] = None
        if self._found and any(word in error.problem for word in _FOLLOWING):
            return
        key = error.problem if ignorable else _NUMBERS.sub("#", error.problem)
        self._found.setdefault(key, []).append(error)

    def check(self) -> None:
        """Whether there was none.

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
            f"{error}{_more(count)}"
            for error, count in zip(others[:_MOST], counts[1:], strict=False)
        ]
        if len(others) > _MOST:
            also.append(f"{len(others) - _MOST} further refusals")
        if len(self._ignorable) > 1:
            listed = json.dumps(list(self._ignorable))
            also.append(f"geometry.ignore = {listed} leaves all of these out")
        raise InputError(
            first.problem + _more(counts[0]),
            source=first.source,
            place=first.place,
            expected=first.expected,
            also=(*first.also, *also),
        )


def _more(count: int) -> str:
    return f" (and {count - 1} more alike)" if count > 1 else ""
