"""The lines of a SID file, numbered, stripped and without the blank ones."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TextIO

from ..errors import InputError

CHUNK = 1 << 18
LONGEST_TITLE = 100_000
LONGEST_LINE = 4_096

_NOT_TEXT = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
_BYTE_ORDER_MARK = "\xef\xbb\xbf"


class Lines:
    """Iterates over the non-blank lines of a stream; knows the current line number.

    The stream is read in pieces, so that memory does not grow with the file.

    Raises
    ------
    InputError : while iterating, for bytes that are not text and for endless lines.
    """

    def __init__(self, stream: TextIO, source: str) -> None:
        self.source = source
        self.number = 0
        self._lines = self._read(stream)

    def __iter__(self) -> Iterator[str]:
        return self._lines

    def next(self, inside: str, expected: str) -> str:
        """The next line; the end of the file is an error here."""
        for line in self._lines:
            return line
        raise self.cut_off(inside, expected)

    def error(
        self, problem: str, expected: str | None = None, number: int | None = None
    ) -> InputError:
        """An error at the current line or at line `number`."""
        place = f"line {number or self.number or 1}"
        return InputError(problem, source=self.source, place=place, expected=expected)

    def cut_off(self, inside: str, expected: str) -> InputError:
        """The error of a file that ends too early."""
        return self.error(f"the file ends inside {inside}", expected)

    def _read(self, stream: TextIO) -> Iterator[str]:
        number, longest = 0, LONGEST_TITLE
        rest = stream.read(len(_BYTE_ORDER_MARK)).removeprefix(_BYTE_ORDER_MARK)
        self._check_text(rest, 1)
        while chunk := stream.read(CHUNK):
            self._check_text(chunk, number + 1)
            *complete, rest = (rest + chunk).split("\n")
            for line in complete:
                number += 1
                if len(line) > longest:
                    raise self._too_long(number, longest)
                text = line.strip()
                if text:
                    self.number = number
                    yield text
                longest = LONGEST_LINE
            if len(rest) > longest:
                raise self._too_long(number + 1, longest)
        if rest.strip():
            self.number = number + 1
            yield rest.strip()

    def _check_text(self, chunk: str, number: int) -> None:
        found = _NOT_TEXT.search(chunk)
        if found:
            line = number + chunk.count("\n", 0, found.start())
            code = ord(found.group())
            raise self.error(
                f"contains the byte {code}, which is not text",
                "a SID file in ASCII or HDF5",
                line,
            )

    def _too_long(self, number: int, longest: int) -> InputError:
        return self.error(
            f"the line is longer than {longest} characters",
            "one keyword or one 'key = value' a line",
            number,
        )
