"""Outputs of a result as a table of text (CSV), with their units."""

import csv
import io
import json
from collections.abc import Callable, Iterable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from ..base.errors import InputError
from ..file_names import check_ending
from ..scene import SceneFile, unit_of
from ..storage.growing import GrowingFile
from ..toml.reading import validate_data
from .data import Result
from .rows import Columns, Rows, write_rows


class TableFile:
    """A header ``t,NAME,...`` and one row per output time, written during a run.

    Numbers are written so that reading them gives the same double back. The file
    exists after `finish`, and not after `discard`.

    Raises
    ------
    InputError, OSError : the file cannot be written.
    """

    def __init__(self, path: str | Path, use_fallback_folder: bool = False) -> None:
        check_ending(path, "table")
        self.file: GrowingFile | None = None
        self._path, self._use_fallback_folder = path, use_fallback_folder

    def begin(self, columns: Columns, most: int) -> None:
        self.file = GrowingFile(self._path, self._use_fallback_folder)
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
        write_rows(result, table)
    except BaseException:
        table.discard()
        raise


def units_in(result: Result) -> Callable[[str], str]:
    """The unit of an output of this result by its name, see `unit_of`."""
    return _units_of_scene(result.scene)


@lru_cache(maxsize=8)
def _units_of_scene(text: str) -> Callable[[str], str]:
    try:
        return partial(unit_of, scene=validate_data(json.loads(text), SceneFile))
    except (ValueError, InputError):
        return unit_of
