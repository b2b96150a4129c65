"""Reference numbers as CSV; `sidtool.formats.reference` says what the columns mean."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..storage.unreadable import unreadable

_COLUMNS = (
    "quantity",
    "value",
    "mode",
    "row",
    "column",
    "node",
    "tolerance",
    "name",
    "source",
)
_NUMBER, _WHOLE = (float, "a number"), (int, "a whole number")
_KINDS: dict[str, tuple[type, str]] = {
    "value": _NUMBER,
    "tolerance": _NUMBER,
    "mode": _WHOLE,
    "row": _WHOLE,
    "column": _WHOLE,
}


def read_rows(path: Path) -> list[tuple[int, dict[str, Any]]]:
    """Line number and filled cells of each row; numbers are converted.

    Empty lines and lines that start with # are skipped.

    Raises
    ------
    InputError : no such file, no text, an unknown column, or a cell that does not fit.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise unreadable(path, "a CSV table", error) from None
    except ValueError as error:
        raise InputError(
            f"cannot be read ({error})", source=path, expected="a CSV table"
        ) from None
    kept = [
        (number, line)
        for number, line in enumerate(lines, 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not kept:
        raise InputError("is empty", source=path, expected="a CSV table with a header")
    header = [name.strip() for name in next(csv.reader([kept[0][1]]))]
    _check_header(header, path, kept[0][0])
    return [
        (number, _entry(_columns(line, header, path, number), path, number))
        for number, line in kept[1:]
    ]


def _check_header(header: list[str], path: Path, line: int) -> None:
    unknown = [name for name in header if name not in _COLUMNS]
    missing = [name for name in ("quantity", "value") if name not in header]
    if unknown or missing or len(set(header)) < len(header):
        problem = f"the header is {', '.join(header)}"
        raise InputError(
            problem,
            source=path,
            place=f"line {line}",
            expected=f"quantity, value and any of {', '.join(_COLUMNS[2:])}, each once",
        )


def _columns(line: str, header: list[str], path: Path, number: int) -> dict[str, str]:
    cells = [cell.strip() for cell in next(csv.reader([line]))]
    if len(cells) != len(header):
        raise InputError(
            f"found {len(cells)} cells",
            source=path,
            place=f"line {number}",
            expected=f"{len(header)}, as in the header",
        )
    return {name: cell for name, cell in zip(header, cells, strict=True) if cell}


def _entry(row: dict[str, str], path: Path, line: int) -> dict[str, Any]:
    missing = [name for name in ("quantity", "value") if name not in row]
    if missing:
        raise InputError(f"{missing[0]} is missing", source=path, place=f"line {line}")
    return {name: _value(cell, name, path, line) for name, cell in row.items()}


def _value(cell: str, name: str, path: Path, line: int) -> Any:
    kind, expected = _KINDS.get(name, (str, "a text"))
    try:
        return kind(cell)
    except ValueError:
        raise InputError(
            f"found {cell!r}",
            source=path,
            place=f"line {line}, column {name}",
            expected=expected,
        ) from None
