"""The lines of a SID file, numbered, stripped and without the blank ones."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TextIO

from ..errors import InputError

CHUNK = 1 << 18
LONGEST_TITLE = 100_000
LONGEST_LINE = 4_096
#: Texts of `ahead` that nobody skips before the file is read line by line.
_PATIENCE = 100

_NOT_TEXT = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
_NOT_TEXT_BYTES = bytes([*range(9), *range(14, 32), 127])
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
        self._text, self._at, self._in_vain = "", 0, 0
        self._lines = self._read(stream)

    def __iter__(self) -> Iterator[str]:
        return self._lines

    def next(self, inside: str, expected: str) -> str:
        """The next line; the end of the file is an error here."""
        for line in self._lines:
            return line
        raise self.cut_off(inside, expected)

    def ahead(self) -> str:
        """The whole lines before the next "end", as far as they are read.

        `skip` passes them. Where that was done too seldom, nothing is given.
        """
        if self._in_vain >= _PATIENCE:
            return ""
        text, at = self._text, self._at
        end = text.find("end", at)
        if end < 0:
            end = text.find("END", at)
        ahead = text[at : text.rfind("\n", at, end if end >= 0 else len(text)) + 1]
        self._in_vain += bool(ahead)
        return ahead

    def skip(self, text: str) -> None:
        """Pass lines that `ahead` gave."""
        self._in_vain -= 1
        self._at += len(text)
        self.number += text.count("\n")

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
        blank, longest = 0, LONGEST_TITLE
        self._text = stream.read(len(_BYTE_ORDER_MARK)).removeprefix(_BYTE_ORDER_MARK)
        self._check_text(self._text, 1)
        while chunk := stream.read(CHUNK):
            self._check_text(chunk, self.number + blank + 1)
            self._text, self._at = self._text[self._at :] + chunk, 0
            while (end := self._text.find("\n", self._at)) >= 0:
                line, self._at = self._text[self._at : end], end + 1
                if len(line) > longest:
                    raise self._too_long(self.number + blank + 1, longest)
                longest = LONGEST_LINE
                text = line.strip()
                if not text:
                    blank += 1
                    continue
                self.number += blank + 1
                blank = 0
                yield text
            if len(self._text) - self._at > longest:
                raise self._too_long(self.number + blank + 1, longest)
        if rest := self._text[self._at :].strip():
            self._at = len(self._text)
            self.number += blank + 1
            yield rest

    def _check_text(self, chunk: str, number: int) -> None:
        content = chunk.encode("latin-1", "replace")
        if len(content.translate(None, _NOT_TEXT_BYTES)) == len(content):
            return
        if found := _NOT_TEXT.search(chunk):
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
