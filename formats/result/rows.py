"""Rows of a result in transfer: into memory, or into files while a run continues."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .data import TABLES, Result

Array = NDArray[np.float64]
#: Names of columns by table, see `TABLES`.
Columns = Mapping[str, tuple[str, ...]]
#: Rows that are written together.
ROWS_PER_BLOCK = 4096


@dataclass(frozen=True, eq=False)
class Rows:
    """Some output times (nt,) [s] and the rows of each of `TABLES` there, (nt, n)."""

    t: Array
    tables: Mapping[str, Array]


class Sink(Protocol):
    """Protocol: takes the rows of one run, in the order of time."""

    def begin(self, columns: Columns, most: int) -> None:
        """Take the names of all columns, and the largest number of rows."""

    def add(self, rows: Rows) -> None:
        """Takes more rows; their arrays are used again."""

    def finish(self, result: Result) -> None:
        """Take everything else; the tables of this result are empty."""


class InMemory:
    """Stores the rows of a run as arrays."""

    def begin(self, columns: Columns, most: int) -> None:
        self._count, self._t = 0, np.empty(most)
        self._tables = {k: np.empty((most, len(names))) for k, names in columns.items()}

    def add(self, rows: Rows) -> None:
        part = slice(self._count, self._count + len(rows.t))
        self._t[part] = rows.t
        for name, table in rows.tables.items():
            self._tables[name][part] = table
        self._count += len(rows.t)

    def finish(self, result: Result) -> None:
        """Do nothing: the arrays hold everything."""

    def arrays(self) -> dict[str, Any]:
        """t and the tables."""
        arrays = {"t": self._t, **self._tables}
        if self._count == len(self._t):
            return arrays
        return {name: array[: self._count].copy() for name, array in arrays.items()}


def column_names(result: Result) -> Columns:
    return {table: getattr(result, names) for table, names in TABLES.items()}


def iterate_rows(result: Result) -> Iterator[Rows]:
    """The rows of a result, block by block."""
    for first in range(0, len(result.t), ROWS_PER_BLOCK):
        part = slice(first, first + ROWS_PER_BLOCK)
        tables = {name: getattr(result, name)[part] for name in TABLES}
        yield Rows(result.t[part], tables)


def write_rows(result: Result, sink: Sink) -> None:
    """Gives a whole result to a sink."""
    sink.begin(column_names(result), len(result.t))
    for rows in iterate_rows(result):
        sink.add(rows)
    sink.finish(result)
