"""Output files that are written during a run: a result, a table, or both."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import click
import numpy as np

from sidtool.formats.result import ResultFile, TableFile
from sidtool.formats.storage.atomic import StoredUnderOtherName
from sidtool.formats.storage.unreadable import failure_reason

from .common import name_with_size

if TYPE_CHECKING:
    from sidtool.formats.result import Result
    from sidtool.formats.result.data import Columns, Rows

File = ResultFile | TableFile


class OutputFiles:
    """Sink for a result, a table, both or nothing.

    If one file cannot be written, the other one continues. A complete file that cannot
    replace an existing one is stored under another name next to it. As a context
    manager it removes files that are incomplete at its end.

    Attributes
    ----------
    span : first and last output time [s] and number of output times
    ranges : first, least, greatest and last value of each output
    failed : True if a file is missing or has another name than requested
    written : complete files with their sizes
    """

    def __init__(self, result: Path | None, table: Path | None) -> None:
        self._open: dict[Path, File] = {}
        if table is not None:
            self._open[table] = TableFile(table, use_fallback_folder=True)
        if result is not None:
            self._open[result] = ResultFile(result, use_fallback_folder=True)
        self._messages: list[str] = []
        self.written: list[str] = []
        self.span: tuple[float, float, int] = (0.0, 0.0, 0)
        self._names: tuple[str, ...] = ()
        self._ranges = np.zeros((4, 0))
        self.failed = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for file in self._open.values():
            file.discard()

    @property
    def ranges(self) -> dict[str, tuple[float, ...]]:
        """The range of each output, empty without output times."""
        if not self.span[2]:
            return {}
        return dict(zip(self._names, map(tuple, self._ranges.T.tolist()), strict=True))

    def begin(self, columns: Columns, most: int) -> None:
        self._names = tuple(columns["values"])
        self._each(lambda file: file.begin(columns, most))

    def add(self, rows: Rows) -> None:
        if len(rows.t):
            first, _, count = self.span
            first = first if count else float(rows.t[0])
            values = rows.tables["values"]
            least, greatest = values.min(axis=0), values.max(axis=0)
            if count:
                least = np.minimum(least, self._ranges[1])
                greatest = np.maximum(greatest, self._ranges[2])
            start = self._ranges[0] if count else values[0]
            self._ranges = np.array([start, least, greatest, values[-1]])
            self.span = first, float(rows.t[-1]), count + len(rows.t)
        self._each(lambda file: file.add(rows))

    def finish(self, result: Result) -> None:
        self._each(lambda file: file.finish(result))
        for path, file in self._open.items():
            assert file.file is not None
            moved = file.file.moved
            if moved is None:
                self.written.append(name_with_size(path))
                continue
            self._fail(path, moved)
            self._messages.append(f"sidtool: {file.file.target} written instead")
        self._open = {}

    def print_messages(self, stderr: bool) -> None:
        """Print the paths of the files, or why they are missing."""
        for text in self._messages:
            click.echo(text, err=stderr or text.startswith("sidtool:"))

    def _each(self, act: Callable[[File], None]) -> None:
        """Apply a function to all open files; re-raise the error that closes the last
        one.
        """
        for path, file in list(self._open.items()):
            try:
                act(file)
            except OSError as error:
                file.discard()
                del self._open[path]
                self._fail(path, error)
                if not self._open and not isinstance(error, StoredUnderOtherName):
                    self._messages.append(
                        "sidtool: nothing was kept: run again with another -o"
                    )
                    raise

    def _fail(self, path: Path, error: OSError) -> None:
        self.failed = True
        self._messages.append(f"sidtool: {path}: {failure_reason(error)}")
