"""Lines and numbers of mesh files, and the files that a deck includes.

Circular and long chains of included files are refused. A deck from others may include
any file of its reader, so messages do not quote the text of included files, only
keywords and numbers.
"""

import json
import re
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import chain
from math import isfinite
from pathlib import Path

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.numbers import is_plain, real_of_text
from sidtool.formats.base.sid import Array
from sidtool.formats.storage.unreadable import unreadable_error
from sidtool.formats.toml.reading import LARGEST_NUMBER

#: Labels are held in 64 bits.
MAX_LABEL = 2**63 - 1

#: Largest number of INCLUDE lines of a deck: ten files that include each other ten
#: times would give 10^10.
MAX_INCLUDES = 1000
#: Largest number of further lines of the name of a file.
NAME_LINES = 10
#: Pattern of a line that includes a file, in `.inp` and `.bdf`.
_TAKES_IN = re.compile(
    r"\s*\*.*\bINPUT\s*=\s*(?P<inp>[^,]+)|\s*INCLUDE\s+(?P<bdf>\S.*)", re.IGNORECASE
)
#: Patterns of lines of a deck that begin with a keyword.
_KEYWORD = re.compile(r"\s*\*[A-Z][A-Z -]*(?=,|$)", re.IGNORECASE)
_CARD = re.compile(r"[A-Z][A-Z0-9]{0,7}\*?(?=(?: *,| ) *[-+.0-9])", re.IGNORECASE)
_QUOTED_OR_WORD = re.compile(r"'[^'\n]*'|\"[^\"\n]*\"|[^\s,;='\"()\[\]]+")
_WORD = re.compile(r"[^\s,;='\"()\[\]]+")
_NUMBER = re.compile(r"[-+.0-9][-+.0-9deDE]*")
#: Pattern of words of messages that are never hidden.
_PLAIN = re.compile(r"[a-z]+|\*?[A-Za-z]?")
#: Minimum length of a word that identifies included text.
MIN_WORD_LENGTH = 6
#: Numbers are removed to compare refusals.
_NUMBERS = re.compile(r"[-+]?\d[\d.+-]*")
#: Texts of refusals that may follow from another one, as of an element set.
_CONSEQUENCE_TEXTS = ("not defined", "there is no ", "is empty", "stands alone")
#: Largest number of different refusals in a report.
_MAX_REFUSALS = 40


def read_lines(path: str | Path) -> list[str]:
    """The lines of a text file.

    Raises
    ------
    InputError : it cannot be read, is empty, or is no text.
    """
    _check_regular(Path(path))
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise unreadable_error(path, "a file", error) from None
    if not data.strip():
        raise InputError("is empty", source=path, expected="a mesh or a matrix")
    try:
        return _split_lines(data.decode("utf-8-sig"))
    except UnicodeDecodeError:
        pass
    if b"\0" in data:
        raise InputError("holds binary data", source=path, expected="the text format")
    return _split_lines(data.decode("latin-1"))


def _split_lines(text: str) -> list[str]:
    """Lines as other programs end them.

    `str.splitlines` also ends them at characters of comments, such as the ellipsis of
    Windows (0x85). Form feeds of listings are no part of a line.
    """
    plain = text.replace("\r\n", "\n").replace("\r", "\n").replace("\f", "")
    return plain.removesuffix("\n").split("\n")


def _check_regular(path: Path) -> None:
    """Refuse pipes and devices, which may never end."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise InputError(
            "is a pipe or a device", source=path, expected="a regular file"
        )


def parse_numbers(
    words: Sequence[str], place: str, what: str = "numbers"
) -> list[float]:
    """Numbers of at most `LARGEST_NUMBER` in size from words.

    Raises
    ------
    InputError : one is not.
    """
    try:
        result = list(map(float, words))
        if (
            is_plain("".join(words))
            and all(map(isfinite, result))
            and max(map(abs, result), default=0.0) <= LARGEST_NUMBER
        ):
            return result
    except ValueError:
        pass
    result = []
    for word in words:
        try:
            value = real_of_text(word.replace("D", "E").replace("d", "e"))
        except ValueError:
            raise InputError(
                f"found {word.strip()[:60]!r}", place=place, expected=what
            ) from None
        if not abs(value) <= LARGEST_NUMBER:
            raise InputError(
                f"found {word.strip()!r}",
                place=place,
                expected=f"{what} of at most {LARGEST_NUMBER:g} in size, in "
                "consistent units",
            )
        result.append(value)
    return result


def parse_integers(
    words: Sequence[str], place: str, what: str = "integers"
) -> list[int]:
    """Integers from words.

    Raises
    ------
    InputError : one is not.
    """
    try:
        numbers = list(map(int, words)) if is_plain("".join(words)) else []
    except ValueError:
        numbers = []
    largest = max(map(abs, numbers), default=0)
    if len(numbers) < len(words) or largest > MAX_LABEL:
        text = " ".join(words)[:60]
        raise InputError(f"found {text!r}", place=place, expected=what)
    return numbers


def parse_label(word: str, place: str, what: str) -> int:
    """The number of a node or an element from a word.

    Raises
    ------
    InputError : it is no integer above zero.
    """
    (label,) = parse_integers([word], place, f"{what} number above 0")
    check_label(label, place, what)
    return label


def check_label(label: int, place: str, what: str) -> None:
    """Refuse zero and negative numbers of nodes and elements.

    Raises
    ------
    InputError : the number is one.
    """
    if label < 1:
        expected = f"{what} number above 0"
        raise InputError(f"found {label}", place=place, expected=expected)


def number_table(rows: Sequence[tuple[str, Sequence[str]]], width: int) -> Array:
    """(rows, width) finite numbers from rows of a place and words.

    Raises
    ------
    InputError : a row has another number of words, or one is no number.
    """
    for place, words in rows:
        if len(words) != width:
            raise InputError(
                f"has {len(words)} entries",
                place=place,
                expected=f"{width} (is the file cut off?)",
            )
    try:
        texts = chain.from_iterable(words for _, words in rows)
        table = np.fromiter(map(float, texts), np.float64, width * len(rows))
        if np.isfinite(table).all() and all(is_plain("".join(w)) for _, w in rows):
            return table.reshape(-1, width)
    except ValueError:
        pass
    read = [parse_numbers(words, place) for place, words in rows]
    return np.array(read).reshape(-1, width)


@dataclass
class IncludedFiles:
    """The stack of open files, and the number of included files."""

    open: list[Path] = field(default_factory=list)
    count: int = 0

    def enter(self, file: Path) -> None:
        """Begin a file; `open.pop()` ends it.

        Raises
        ------
        InputError : the file includes itself, or there are too many files.
        """
        name = file.resolve()
        if name in self.open:
            raise InputError(
                "includes itself", source=file, expected="files that come to an end"
            )
        self.open.append(name)
        self.count += 1
        if self.count > MAX_INCLUDES:
            raise InputError(
                f"takes in more than {MAX_INCLUDES} files",
                source=file,
                expected="a deck with fewer lines of INCLUDE",
            )


def named_file(deck: Path, name: str) -> Path:
    r"""Return the file that a deck names, also in the spelling of Windows, ..\FILE.

    Raises
    ------
    InputError : the name has a zero byte.
    """
    if "\0" in name:
        raise InputError(f"names the file {name!r}", expected="a name without \\x00")
    path = deck.parent / name
    if "\\" in name and not path.exists():
        return deck.parent / name.replace("\\", "/")
    return path


def joined_name(text: str, following: Sequence[str]) -> tuple[str, int]:
    """Return the name of a file without its quotes, and how many lines continue it.

    In quotes it may extend over lines (Nastran).
    """
    name = text.strip()
    quote = name[:1]
    if quote and quote in "'\"" and quote not in name[1:]:
        for count, line in enumerate(following, start=1):
            if line.lstrip()[:7].upper() == "INCLUDE":
                break
            name += line.strip()
            if quote in line:
                return name.split(quote)[1], count
        name = text.strip()
    return name.strip("'\""), 0


def located_line(number: int, file: str) -> str:
    """Return the location of a line, with the name of an included file."""
    return f"{file}, line {number}" if file else f"line {number}"


@contextmanager
def hide_included_text(path: Path) -> Iterator[None]:
    """Remove text of included files from errors that are raised inside the context."""
    try:
        yield
    except InputError as error:
        files = deck_files(path)
        if not files[1:]:
            raise
        hidden = _IncludedWords(files)
        raise InputError(
            hidden.hide_words(error.problem),
            source=error.source,
            place=error.place,
            expected=error.expected and hidden.hide_words(error.expected),
            also=[hidden.hide_words(text) for text in error.also],
        ) from None


def deck_files(path: Path) -> list[Path]:
    """Return a deck and all files that it includes, readable or not."""
    files, waiting = [path], [path]
    while waiting and len(files) < MAX_INCLUDES:
        file = waiting.pop()
        lines = _lines_of_file(file)
        for i, line in enumerate(lines):
            if match := _TAKES_IN.match(line.split("$")[0]):
                name = match["inp"] or match["bdf"]
                name, _ = joined_name(name, lines[i + 1 : i + 1 + NAME_LINES])
                other = named_file(file, name)
                if other not in files:
                    files.append(other)
                    waiting.append(other)
    return files


def _lines_of_file(file: Path) -> list[str]:
    try:
        return read_lines(file)
    except (InputError, ValueError):
        return []


class _IncludedWords:
    """Words of the included files that do not occur in the deck itself."""

    def __init__(self, files: list[Path]) -> None:
        own = {
            w.upper() for line in _lines_of_file(files[0]) for w in _WORD.findall(line)
        }
        own |= {part.upper() for file in files for part in (file.name, str(file))}
        words: set[str] = set()
        formed = _KEYWORD if files[0].suffix.lower() == ".inp" else _CARD
        for file in files[1:]:
            for line in _lines_of_file(file):
                match = formed.match(line)
                if match:
                    own |= {w.upper() for w in _WORD.findall(match[0].strip(" *"))}
                    line = line[match.end() :]
                words |= {w.upper() for w in _WORD.findall(line)}
        self._own = own
        self._words = sorted(w for w in words - own if not _NUMBER.fullmatch(w))

    def hide_words(self, text: str) -> str:
        """A text without these words."""
        return _QUOTED_OR_WORD.sub(self._replace, text)

    def _replace(self, match: re.Match[str]) -> str:
        text = match[0]
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
        return there == word or (
            len(word) >= MIN_WORD_LENGTH and there.startswith(word)
        )


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
