"""A SID file as it stands, before indices and layouts are understood."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..sid import Array
from .codes import Codes


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
    codes: Codes
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
