"""Lines of a SID file, the numbers on them, and diagnostics of the reader."""

import re
from collections.abc import Iterator, Sequence
from typing import Any, TextIO

import numpy as np

from ..base.errors import InputError
from ..base.sid import Array
from ..diagnostics import Diagnostic, diagnose

CHUNK = 1 << 18
MAX_TITLE_LENGTH = 100_000
MAX_LINE_LENGTH = 4_096
#: Texts of `ahead` that are not skipped before the file is read line by line.
_MAX_UNUSED_READS = 100

_NOT_TEXT = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
_NOT_TEXT_BYTES = bytes([*range(9), *range(14, 32), 127])
_BYTE_ORDER_MARK = "\xef\xbb\xbf"


class LineReader:
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
        raise self.truncation_error(inside, expected)

    def complete_lines_ahead(self) -> str:
        """The whole lines before the next "end", as far as they are read.

        `skip` passes them. Where that was done too seldom, nothing is given.
        """
        if self._in_vain >= _MAX_UNUSED_READS:
            return ""
        text, at = self._text, self._at
        end = text.find("end", at)
        if end < 0:
            end = text.find("END", at)
        ahead = text[at : text.rfind("\n", at, end if end >= 0 else len(text)) + 1]
        self._in_vain += bool(ahead)
        return ahead

    def skip(self, text: str) -> None:
        """Pass lines that `complete_lines_ahead` gave."""
        self._in_vain -= 1
        self._at += len(text)
        self.number += text.count("\n")

    def error(
        self, problem: str, expected: str | None = None, number: int | None = None
    ) -> InputError:
        """An error at the current line or at line `number`."""
        place = f"line {number or self.number or 1}"
        return InputError(problem, source=self.source, place=place, expected=expected)

    def truncation_error(self, inside: str, expected: str) -> InputError:
        """The error of a file that ends too early."""
        return self.error(f"the file ends inside {inside}", expected)

    def _read(self, stream: TextIO) -> Iterator[str]:
        blank, longest = 0, MAX_TITLE_LENGTH
        self._text = stream.read(len(_BYTE_ORDER_MARK)).removeprefix(_BYTE_ORDER_MARK)
        self._check_text(self._text, 1)
        while chunk := stream.read(CHUNK):
            self._check_text(chunk, self.number + blank + 1)
            self._text, self._at = self._text[self._at :] + chunk, 0
            while (end := self._text.find("\n", self._at)) >= 0:
                line, self._at = self._text[self._at : end], end + 1
                if len(line) > longest:
                    raise self._too_long(self.number + blank + 1, longest)
                longest = MAX_LINE_LENGTH
                text = line.strip()
                if not text:
                    blank += 1
                    continue
                self.number += blank + 1
                blank = 0
                yield text
            if len(self._text) - self._at > longest:
                raise self._too_long(self.number + blank + 1, longest)
        if remaining := self._text[self._at :].strip():
            self._at = len(self._text)
            self.number += blank + 1
            yield remaining

    def _check_text(self, chunk: str, number: int) -> None:
        content = chunk.encode("latin-1", "replace")
        if len(content.translate(None, _NOT_TEXT_BYTES)) == len(content):
            return
        if match := _NOT_TEXT.search(chunk):
            line = number + chunk.count("\n", 0, match.start())
            code = ord(match.group())
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


_NUMBER = re.compile(
    r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[eEdD]([+-]?\d+)|([+-]\d+))?", re.ASCII
)
_INTEGER = re.compile(r"[+-]?\d{1,9}", re.ASCII)

REAL_EXPECTED = "a finite number such as 1.5, -7.065D+02 or 1.0-100"


def parse_reals(
    texts: Sequence[str], numbers: Sequence[int], lines: LineReader
) -> Array:
    """Many numbers at once, (n,); `numbers` are their line numbers.

    Raises
    ------
    InputError : one of them is not a finite number; names its line.
    """
    joined = "\n".join(texts).replace("D", "e").replace("d", "e")
    plain = "_" not in joined
    try:
        values = np.array([float(text) for text in joined.split("\n")] if texts else [])
    except ValueError:
        plain = False
    if plain and np.isfinite(values).all():
        return values
    pairs = zip(texts, numbers, strict=True)
    return np.array([parse_real(text, lines, number) for text, number in pairs])


def parse_real(text: str, lines: LineReader, number: int | None = None) -> float:
    """One number; the exponent letter may be D, E or missing (Fortran's 1.0-100).

    Raises
    ------
    InputError : it is not a number, or not finite.
    """
    match = _NUMBER.fullmatch(text.strip())
    if match is None:
        problem = f"'{shorten(text)}' is not a number"
        raise lines.error(problem, REAL_EXPECTED, number)
    value = float(f"{match[1]}e{match[2] or match[3] or 0}")
    if not np.isfinite(value):
        problem = f"{shorten(text)} is too large for a floating-point number"
        raise lines.error(problem, REAL_EXPECTED, number)
    return value


def parse_integer(text: str, name: str, lines: LineReader) -> int:
    """One integer that is not negative.

    Raises
    ------
    InputError : it is something else.
    """
    value = int(text) if _INTEGER.fullmatch(text) else -1
    if value < 0:
        raise lines.error(
            f"{name} = '{shorten(text)}'", "a small integer, not negative"
        )
    return value


def shorten(text: str) -> str:
    """A text cut to fit into a message."""
    text = " ".join(text.split())
    return text if len(text) <= 60 else f"{text[:57]}..."


class ReadingNotes:
    """Diagnostics of reading, each with its first location and its count."""

    def __init__(self) -> None:
        self._places: dict[tuple[str, tuple[tuple[str, str], ...]], list[str]] = {}

    def add(self, code: str, place: str = "", **values: str) -> None:
        """Note a diagnostic, and the block or node to which it applies."""
        key = code, tuple(values.items())
        self._places.setdefault(key, []).append(place)

    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """Return one diagnostic for each code with the same values."""
        found = []
        for (code, pairs), places in self._places.items():
            values: dict[str, Any] = dict(pairs)
            found.append(diagnose(code, _subject(places), **values))
        return tuple(found)


def _subject(places: list[str]) -> str:
    more = f" and {len(places) - 1} more" if len(places) > 1 else ""
    return f"{places[0]}{more}"
