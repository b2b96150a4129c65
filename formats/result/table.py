"""The outputs of a result as a table of text (CSV)."""

from __future__ import annotations

import csv
from pathlib import Path

from ..atomic import atomic_path
from .data import Result


def write_csv(path: str | Path, result: Result) -> None:
    """Write outputs as text: a header ``t,NAME,...`` and one row per output time.

    Numbers are written so that reading them gives the same double back.

    Raises
    ------
    InputError : the file cannot be written.
    """
    with (
        atomic_path(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as stream,
    ):
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["t", *result.names])
        for time, row in zip(result.t.tolist(), result.values.tolist(), strict=True):
            writer.writerow([repr(time), *map(repr, row)])
