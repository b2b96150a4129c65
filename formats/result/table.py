"""The outputs of a result as a table of text (CSV)."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..endings import check_ending
from ..storage.growing import GrowingFile
from .data import Result
from .rows import Columns, Rows, pass_on


class TableFile:
    """A header ``t,NAME,...`` and one row per output time, while a run goes on.

    Numbers are written so that reading them gives the same double back. The file is
    there after `finish`, and not at all after `discard`.

    Raises
    ------
    InputError, OSError : the file cannot be written.
    """

    def __init__(self, path: str | Path, elsewhere: bool = False) -> None:
        check_ending(path, "table")
        self.file: GrowingFile | None = None
        self._path, self._elsewhere = path, elsewhere

    def begin(self, columns: Columns, most: int) -> None:
        self.file = GrowingFile(self._path, self._elsewhere)
        self._write([["t", *columns["values"]]])

    def add(self, rows: Rows) -> None:
        values = rows.tables["values"].tolist()
        self._write(
            [repr(time), *map(repr, row)]
            for time, row in zip(rows.t.tolist(), values, strict=True)
        )

    def finish(self, result: Result) -> None:
        assert self.file is not None
        self.file.close()

    def discard(self) -> None:
        if self.file is not None:
            self.file.discard()

    def _write(self, lines: Iterable[list[Any]]) -> None:
        assert self.file is not None
        text = io.StringIO(newline="")
        csv.writer(text, lineterminator="\n").writerows(lines)
        self.file.write(text.getvalue().encode())
        self.file.check()


def write_csv(path: str | Path, result: Result) -> None:
    """Write outputs as text, see `TableFile`.

    Raises
    ------
    InputError, OSError : the file cannot be written.
    """
    table = TableFile(path)
    try:
        pass_on(result, table)
    except BaseException:
        table.discard()
        raise
