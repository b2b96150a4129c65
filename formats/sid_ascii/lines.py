"""Lines of a SID file, the numbers on them, and diagnostics of the reader.

Detection of the index order and column layout of a file from its numbers.

Raw contents of a SID file: headers and entries before their interpretation.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.sid import Array, Taylor, by_mode, symmetric_3x3
from ..diagnostics import Diagnostic, diagnose
from .codes import IndexCodes, entry_code
from .title import Layout

CERTAIN_ERROR = 1e-3
WORSE_RATIO = 10.0

HEADER_ITEMS = ("order", "nrow", "ncol", "nq", "nqn", "structure")
#: Entries that may stand as Python objects, at ten times the memory of packed ones.
BATCH = 8192
CHUNK = 1 << 18
MAX_TITLE_LENGTH = 100_000
MAX_LINE_LENGTH = 4_096
#: Texts of `ahead` that are not skipped before the file is read line by line.
_MAX_UNUSED_READS = 100
_NOT_TEXT = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
_BYTE_ORDER_MARK = "\xef\xbb\xbf"
_NUMBER = re.compile(
    r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[eEdD]([+-]?\d+)|([+-]\d+))?", re.ASCII
)
_INTEGER = re.compile(r"[+-]?\d{1,9}", re.ASCII)
REAL_EXPECTED = "a finite number such as 1.5, -7.065D+02 or 1.0-100"


def detect_m1_index(
    expansions: Iterable[tuple[RawTaylor, int]], nq: int, hint: Layout | None
) -> str:
    """The index order of m1, "rlc" or "rcl".

    Parameters
    ----------
    expansions : each with its number of columns
    nq : number of elastic coordinates
    hint : the layout of the writer that the title names
    """
    misfits = {"rlc": 0, "rcl": 0}
    for raw, columns in expansions:
        j, k = raw.codes.largest
        misfits["rlc"] += j > nq or k > columns
        misfits["rcl"] += j > columns or k > nq
    if misfits["rlc"] != misfits["rcl"]:
        return min(misfits, key=lambda order: misfits[order])
    return "rlc" if hint is None else hint.m1_index


def rearrange(block: Taylor, change: Callable[[Array], Array]) -> Taylor:
    """The expansion with m0, m1 and mn rearranged alike."""
    m1 = None if block.m1 is None else change(block.m1)
    mn = None if block.mn is None else change(block.mn)
    return Taylor(change(block.m0), m1, mn, block.order)


def by_mode_in(columns: Array, nq: int, layout: str) -> Array:
    """Columns (n, 3 nq) in either layout as one matrix a mode, (nq, n, 3)."""
    if layout == "axis":
        return by_mode(columns, nq)
    return np.moveaxis(columns.reshape(-1, nq, 3), 1, 0)


def mode_major(columns: Array, nq: int) -> Array:
    """Axis-major columns (..., 3 nq) in mode-major order."""
    parts = columns.reshape(*columns.shape[:-1], 3, nq)
    return np.swapaxes(parts, -1, -2).reshape(columns.shape)


def axis_from_mode_major(columns: Array, nq: int) -> Array:
    """Mode-major columns (..., 3 nq) in axis-major order."""
    parts = columns.reshape(*columns.shape[:-1], nq, 3)
    return np.swapaxes(parts, -1, -2).reshape(columns.shape)


def gr_errors(gr: Array, j1: Array) -> dict[str, float] | None:
    """Return the deviations of Gr (3, 3 nq) from the identity with J1, in each layout.

    None if they cannot be determined: one mode, or a block without entries.
    """
    nq = len(j1)
    if nq < 2 or not gr.any() or not j1.any():
        return None
    doubled = 2 * symmetric_3x3(j1[:, :, 0])
    parts = {name: by_mode_in(gr, nq, name) for name in ("axis", "mode")}
    return {
        name: _relative_error(part + np.swapaxes(part, 1, 2) - doubled, gr)
        for name, part in parts.items()
    }


def ge_errors(ge: Array, cr1: Array) -> dict[str, float] | None:
    """How far Ge (nq, 3 nq) is from its identity with Cr1 (nq, nq, 3), by layout."""
    nq = len(cr1)
    if nq < 2 or not ge.any() or not cr1.any():
        return None
    candidates = (2 * cr1, cr1 - np.swapaxes(cr1, 0, 1))
    parts = {name: by_mode_in(ge, nq, name) for name in ("axis", "mode")}
    return {
        name: min(_relative_error(part - candidate, ge) for candidate in candidates)
        for name, part in parts.items()
    }


def certain_layout(errors: dict[str, float] | None) -> str | None:
    """The layout that the identity proves, None if it proves neither."""
    if errors is None:
        return None
    best, other = sorted(errors, key=lambda name: errors[name])
    is_clear = (
        errors[best] < CERTAIN_ERROR and errors[other] > WORSE_RATIO * errors[best]
    )
    return best if is_clear else None


def choose_layout(
    errors: dict[str, float] | None, hint: str | None
) -> tuple[str, bool]:
    """The layout to read, and whether it is certain.

    The identity decides; then the title; then the smaller deviation; then axis-major,
    which is what most writers use.
    """
    certain = certain_layout(errors)
    if certain:
        return certain, True
    if hint or errors is None:
        return hint or "axis", hint is not None
    return min(errors, key=lambda name: errors[name]), False


def _relative_error(deviation: Array, reference: Array) -> float:
    return float(np.abs(deviation).max() / np.abs(reference).max())


@dataclass(frozen=True)
class RawTaylor:
    """One Taylor expansion: header items and entries, with their line numbers.

    Attributes
    ----------
    name : as written
    line : where the expansion starts
    header : item -> (value, line number)
    codes : indices of the n entries
    values : (n,)
    lines : (n,) line numbers
    letter : exponent letter of the entries, "D", "E" or "" for none
    """

    name: str
    line: int
    header: dict[str, tuple[int, int]]
    codes: IndexCodes
    values: Array
    lines: NDArray[np.int64]
    letter: str


@dataclass(frozen=True)
class RawNode:
    """One node; `entries` by canonical name."""

    id: str
    line: int
    rframe: str
    entries: dict[str, RawTaylor]


@dataclass(frozen=True)
class RawReference:
    """The section ``refmod``."""

    mass: float
    nq: int
    labels: tuple[str, ...]
    missing_labels: int
    nq_line: int = 0


@dataclass(frozen=True)
class RawFile:
    """A whole file.

    `blocks` has canonical names where the name is known. `counts` are the numbers of
    nodes and modes in the title, None without a title.
    """

    title: str
    counts: tuple[int, int] | None
    name: str
    reference: RawReference
    nodes: tuple[RawNode, ...]
    blocks: dict[str, RawTaylor] = field(default_factory=dict)
    last_line: int = 0

    def expansions(self) -> Iterator[tuple[str, RawTaylor]]:
        """Every Taylor expansion of the file with its canonical name."""
        for node in self.nodes:
            yield from node.entries.items()
        yield from self.blocks.items()


_PLAIN = str.maketrans("dD", "ee")


class ExpansionEntries:
    """Takes lines one by one or many at once; `finish` gives the expansion."""

    def __init__(self, name: str, lines: LineReader) -> None:
        self._name = name
        self._lines = lines
        self._start = lines.number
        self._header: dict[str, tuple[int, int]] = {}
        self._letter: str | None = None
        self._codes: list[int] = []
        self._texts: list[str] = []
        self._numbers: list[int] = []
        self._packed: list[tuple[IndexCodes, Array, NDArray[np.int64]]] = []

    def add(self, key: str, value: str) -> None:
        """The current line, in any spelling.

        Raises
        ------
        InputError : the key is unknown or given twice, or a value so far is no number.
        """
        code = entry_code(key)
        if not code:
            self._add_header_item(key.strip().lower(), value.strip())
            return
        self._note_letter(value)
        self._codes.append(code)
        self._texts.append(value)
        self._numbers.append(self._lines.number)
        if len(self._codes) == BATCH:
            self._pack()

    def add_ahead(self) -> None:
        """All lines up to the end at once, where none is odd: most of a file.

        Split at its ends and at "=", a text of entries has keys and numbers by turns,
        and no other text has: what is no number is no key either.
        """
        text = self._lines.complete_lines_ahead()
        parts = text.replace("\n", "=").split("=")
        known = _known_keys("=".join(parts[:-1:2])) if text else None
        if known is None or "_" in text:
            return
        items, codes = known
        keys, texts = parts[1 : 2 * len(items) : 2], parts[2 * len(items) + 1 :: 2]
        try:
            header = [int(value) for value in keys]
            plain = "=".join(texts).translate(_PLAIN).split("=") if texts else []
            values = np.fromiter(map(float, plain), np.float64, len(codes))
        except ValueError:
            return
        usual = np.isfinite(values).all() and min(header, default=0) >= 0
        if not usual or any(item in self._header for item in items):
            return
        self._pack()
        if texts:
            self._note_letter(text[text.rindex("=") :])
        first = self._lines.number + 1
        self._lines.skip(text)
        for number, item in enumerate(items):
            self._header[item] = header[number], first + number
        numbers = np.arange(len(items), len(items) + len(codes)) + first
        self._packed.append((codes, values, numbers))

    def finish(self) -> RawTaylor:
        """The whole expansion."""
        self._pack()
        codes, values, numbers = _concatenate(self._packed)
        return RawTaylor(
            name=self._name,
            line=self._start,
            header=self._header,
            codes=codes,
            values=values,
            lines=numbers,
            letter=self._letter or "",
        )

    def _add_header_item(self, key: str, value: str) -> None:
        if key not in HEADER_ITEMS or key in self._header:
            raise self._lines.error(
                f"'{shorten(key)}' is unknown or given twice in {self._name}",
                f"{', '.join(HEADER_ITEMS)}, m0(row, column), m1(row, mode, column) "
                f"or 'end {self._name}'",
            )
        self._header[key] = (parse_integer(value, key, self._lines), self._lines.number)

    def _note_letter(self, text: str) -> None:
        if self._letter is None:
            self._letter = next((char for char in "DE" if char in text.upper()), "")

    def _pack(self) -> None:
        """Convert the collected Python objects into arrays."""
        if not self._codes:
            return
        values = parse_reals(self._texts, self._numbers, self._lines)
        codes = IndexCodes(np.array(self._codes, dtype=np.int64))
        self._packed.append((codes, values, np.array(self._numbers, dtype=np.int64)))
        for collected in (self._codes, self._texts, self._numbers):
            collected.clear()


@lru_cache(maxsize=16)
def _known_keys(keys: str) -> tuple[tuple[str, ...], IndexCodes] | None:
    """Header items and indices of entries behind them; None if another key is there.

    Nodes repeat the keys of the one before.
    """
    names = [key.strip().lower() for key in keys.split("=")]
    items = tuple(name for name in names if name in HEADER_ITEMS)
    codes = [entry_code(name) for name in names[len(items) :]]
    if len(set(items)) < len(items) or not all(codes):
        return None
    return items, IndexCodes(np.array(codes, dtype=np.int64))


def _concatenate(
    packed: list[tuple[IndexCodes, Array, NDArray[np.int64]]],
) -> tuple[IndexCodes, Array, NDArray[np.int64]]:
    if len(packed) == 1:
        return packed[0]
    if not packed:
        none = np.zeros(0, dtype=np.int64)
        return IndexCodes(none), np.zeros(0), none
    codes, values, numbers = zip(*packed, strict=True)
    together = IndexCodes(np.concatenate([part.packed for part in codes]))
    return together, np.concatenate(values), np.concatenate(numbers)


_NOT_TEXT_BYTES = bytes([*range(9), *range(14, 32), 127])


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
