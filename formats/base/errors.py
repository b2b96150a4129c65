"""The one exception that bad input raises, wherever it arises."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from copy import copy

#: What a terminal obeys instead of showing it, and what is no character.
_CONTROL = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufffe\uffff]"
)


def printable(text: str) -> str:
    """A text of a file as a terminal or a picture may show it: "?" for control
    characters and for what is none, such as the bytes of a name that is not UTF-8."""
    return _CONTROL.sub("?", text)


class InputError(Exception):
    """A file or a value that the user gave cannot be used.

    Attributes
    ----------
    problem : what was found
    source : the file (or other origin) it was found in, if known
    place : line number, key or object inside the source, if known
    expected : what would have been right, if it can be stated
    also : sentences on what else is wrong in the source
    """

    def __init__(
        self,
        problem: str,
        *,
        source: str | os.PathLike[str] | None = None,
        place: str | None = None,
        expected: str | None = None,
        also: Iterable[str] = (),
    ) -> None:
        super().__init__(problem)
        self.problem = problem
        self.source = None if source is None else os.fspath(source)
        self.place = place
        self.expected = expected
        self.also = tuple(also)

    def __str__(self) -> str:
        location = ": ".join(part for part in (self.source, self.place) if part)
        text = f"{location}: {self.problem}" if location else self.problem
        text = f"{text}; expected {self.expected}" if self.expected else text
        return printable("\n  also ".join([text, *self.also]))

    def located(self, source: str | os.PathLike[str]) -> InputError:
        """The same error with its file named, unless one is named already."""
        if self.source is not None:
            return self
        error = copy(self)
        error.source = os.fspath(source)
        return error


@contextmanager
def errors_inside(place: str) -> Iterator[None]:
    """Name the place of a table in errors that are raised inside the context."""
    try:
        yield
    except InputError as error:
        inner = copy(error)
        inner.place = f"{place}.{error.place}" if error.place else place
        raise inner from None


class TooManyModes(InputError):
    """More modes are requested than a model has.

    Attributes
    ----------
    available : how many it has
    """

    available: int = 0
