"""The files that a run fills while it goes on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import click

from sidtool.formats.result import ResultFile, TableFile
from sidtool.formats.storage.atomic import KeptBeside
from sidtool.formats.storage.unreadable import reason_of

if TYPE_CHECKING:
    from sidtool.formats.result import Result
    from sidtool.formats.result.rows import Columns, Rows

File = ResultFile | TableFile


class Outputs:
    """A result, a table, both or nothing; what cannot be written ends that file only.
    A whole file that cannot replace another one is kept beside it.

    A block: files that are not whole at its end leave no trace.

    Attributes
    ----------
    span : first and last output time [s] and how many there were
    failed : a file is not where it was wanted, or not at all
    """

    def __init__(self, result: Path | None, table: Path | None) -> None:
        self._open: dict[Path, File] = {}
        if table is not None:
            self._open[table] = TableFile(table, elsewhere=True)
        if result is not None:
            self._open[result] = ResultFile(result, elsewhere=True)
        self._told: list[str] = []
        self.span: tuple[float, float, int] = (0.0, 0.0, 0)
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

    def begin(self, columns: Columns, most: int) -> None:
        self._each(lambda file: file.begin(columns, most))

    def add(self, rows: Rows) -> None:
        if len(rows.t):
            first, _, count = self.span
            first = first if count else float(rows.t[0])
            self.span = first, float(rows.t[-1]), count + len(rows.t)
        self._each(lambda file: file.add(rows))

    def finish(self, result: Result) -> None:
        self._each(lambda file: file.finish(result))
        for path, file in self._open.items():
            assert file.file is not None
            moved = file.file.moved
            if moved is None:
                self._told.append(f"{path} written")
                continue
            self._fail(path, moved)
            self._told.append(f"sidtool: {file.file.target} written instead")
        self._open = {}

    def tell(self, err: bool) -> None:
        """Says what became of the files."""
        for text in self._told:
            click.echo(text, err=err or text.startswith("sidtool:"))

    def _each(self, act: Callable[[File], None]) -> None:
        """Raises what ends the last file."""
        for path, file in list(self._open.items()):
            try:
                act(file)
            except OSError as error:
                file.discard()
                del self._open[path]
                self._fail(path, error)
                if not self._open and not isinstance(error, KeptBeside):
                    self._told.append(
                        "sidtool: nothing was kept: run again with another -o"
                    )
                    raise

    def _fail(self, path: Path, error: OSError) -> None:
        self.failed = True
        self._told.append(f"sidtool: {path}: {reason_of(error)}")
