"""Files that a deck takes in: a circle or a cascade of them is refused.

A deck of somebody else may name any file of the reader's. What such a file says is not
quoted in messages, which may be seen by others; its keywords and numbers are.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from sidtool.formats.errors import InputError

from .imported import read_lines

#: Lines of INCLUDE that one deck may follow; ten files that name each other ten
#: times would be ten thousand million.
MOST = 1000
#: A line that takes in a file, of `.inp` and of `.bdf`.
_TAKES_IN = re.compile(
    r"\s*\*.*\bINPUT\s*=\s*(?P<inp>[^,]+)|\s*INCLUDE\s+(?P<bdf>\S.*)", re.IGNORECASE
)
#: Lines that are of a deck by their form: the keyword is what they begin with.
_KEYWORD = re.compile(r"\s*\*[A-Z][A-Z -]*(?=,|$)", re.IGNORECASE)
_CARD = re.compile(r"[A-Z][A-Z0-9]{0,7}\*?(?=(?: *,| ) *[-+.0-9])", re.IGNORECASE)
_QUOTED_OR_WORD = re.compile(r"'[^'\n]*'|\"[^\"\n]*\"|[^\s,;='\"()\[\]]+")
_WORD = re.compile(r"[^\s,;='\"()\[\]]+")
_NUMBER = re.compile(r"[-+.0-9][-+.0-9deDE]*")
#: Words of messages; they stand there without quotes.
_PLAIN = re.compile(r"[a-z]+|\*?[A-Za-z]?")
#: Characters that are enough to know a word by, of which messages show the beginning.
KNOWN = 6


@dataclass
class Included:
    """The files that are open, and how many have been taken in."""

    open: list[Path] = field(default_factory=list)
    count: int = 0

    def enter(self, file: Path) -> None:
        """Begin a file; `open.pop()` ends it.

        Raises
        ------
        InputError : it takes in itself, or there are too many.
        """
        name = file.resolve()
        if name in self.open:
            raise InputError(
                "includes itself", source=file, expected="files that come to an end"
            )
        self.open.append(name)
        self.count += 1
        if self.count > MOST:
            raise InputError(
                f"takes in more than {MOST} files",
                source=file,
                expected="a deck with fewer lines of INCLUDE",
            )


def located_line(number: int, file: str) -> str:
    """The place of a line, with the file if it is one that the deck takes in."""
    return f"{file}, line {number}" if file else f"line {number}"


@contextmanager
def foreign_text_hidden(path: Path) -> Iterator[None]:
    """Let errors of a deck quote no text of the files that it takes in."""
    try:
        yield
    except InputError as error:
        files = _files_of(path)
        if not files[1:]:
            raise
        hidden = _Hidden(files)
        raise InputError(
            hidden.shown(error.problem),
            source=error.source,
            place=error.place,
            expected=error.expected and hidden.shown(error.expected),
            also=[hidden.shown(text) for text in error.also],
        ) from None


def _files_of(path: Path) -> list[Path]:
    """A deck and all files that it takes in, as far as they can be read."""
    found, waiting = [path], [path]
    while waiting and len(found) < MOST:
        file = waiting.pop()
        for line in _lines_of(file):
            if match := _TAKES_IN.match(line.split("$")[0]):
                name = (match["inp"] or match["bdf"]).strip().strip("'\"")
                other = file.parent / name
                if other not in found:
                    found.append(other)
                    waiting.append(other)
    return found


def _lines_of(file: Path) -> list[str]:
    try:
        return read_lines(file)
    except (InputError, ValueError):
        return []


class _Hidden:
    """Words that stand in the files that a deck takes in, and not in the deck."""

    def __init__(self, files: list[Path]) -> None:
        own = {w.upper() for line in _lines_of(files[0]) for w in _WORD.findall(line)}
        own |= {part.upper() for file in files for part in (file.name, str(file))}
        words: set[str] = set()
        formed = _KEYWORD if files[0].suffix.lower() == ".inp" else _CARD
        for file in files[1:]:
            for line in _lines_of(file):
                found = formed.match(line)
                if found:
                    own |= {w.upper() for w in _WORD.findall(found[0].strip(" *"))}
                    line = line[found.end() :]
                words |= {w.upper() for w in _WORD.findall(line)}
        self._own = own
        self._words = sorted(w for w in words - own if not _NUMBER.fullmatch(w))

    def shown(self, text: str) -> str:
        """A text without these words."""
        return _QUOTED_OR_WORD.sub(self._replace, text)

    def _replace(self, found: re.Match[str]) -> str:
        text = found[0]
        quoted = text[0] in "'\""
        if not quoted and _PLAIN.fullmatch(text):
            return text
        words = _WORD.findall(text.strip("'\""))
        hidden = "(text of an included file)"
        return hidden if any(map(self._is_hidden, words)) else text

    def _is_hidden(self, word: str) -> bool:
        word = word.upper().rstrip(".:")
        if word in self._own:
            return False
        k = bisect_left(self._words, word)
        there = self._words[k] if k < len(self._words) else ""
        return there == word or (len(word) >= KNOWN and there.startswith(word))
