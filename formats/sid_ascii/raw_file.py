"""Raw contents of a SID file: headers and entries before their interpretation."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..base.sid import Array
from .codes import IndexCodes, entry_code
from .lines import LineReader, parse_integer, parse_reals, shorten


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


HEADER_ITEMS = ("order", "nrow", "ncol", "nq", "nqn", "structure")
#: Entries that may stand as Python objects, at ten times the memory of packed ones.
BATCH = 8192

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
