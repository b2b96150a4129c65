"""Reference files: published or computed numbers that a SID is compared with.

TOML or JSON::

    format = "sidtool reference"
    version = 1
    title = "Piston rod"

    [[frequencies]]
    name = "paper, ANSYS 150x10"
    source = "Held & Hildebrandt"
    hertz = [31.8, 200.6, 560.6, 1082.3, 1254.9]
    tolerance = 1e-2          # relative; without it the differences are only shown

    [[blocks]]
    block = "J"               # mass, a body block, or an entry of a node
    row = 3                   # indices count from 1, as in the SID file
    value = 5.5
    tolerance = 1e-9

or a CSV table with one row per number, its columns in any order: `quantity`
("frequency" or the name of a block) and `value` are needed, `mode`, `row`, `column`,
`node`, `tolerance`, `name` and `source` may be there. Rows of frequencies with the same
name belong together; their `mode` is the number of the frequency, counted from 1.
"""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from ..base.errors import InputError
from ..base.numbers import integer_of_text, real_of_text
from ..base.sid import BLOCK_SHAPES, NODE_SHAPES
from ..storage.unreadable import unreadable_error
from ..toml.reading import load, validate_data

_SHARED = ("source", "tolerance")

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
_NUMBER, _WHOLE = (real_of_text, "a finite number"), (integer_of_text, "an integer")
_KINDS: dict[str, tuple[Callable[[str], object], str]] = {
    "value": _NUMBER,
    "tolerance": _NUMBER,
    "mode": _WHOLE,
    "row": _WHOLE,
    "column": _WHOLE,
}


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Frequencies(_Table):
    """One row of natural frequencies from one source."""

    name: str = Field(description="a text that names this row in tables")
    source: str = Field(default="", description="where the numbers come from")
    hertz: tuple[float, ...] = Field(
        min_length=1, description="natural frequencies [Hz], ascending"
    )
    modes: tuple[int, ...] | None = Field(
        default=None,
        description="numbers of these frequencies, counted from 1; 1, 2, ... if left "
        "out",
    )
    body: Literal["held", "free"] = Field(
        default="held",
        description="held: the body frame is fixed, (Ke, Me); free: the body floats",
    )
    tolerance: float | None = Field(
        default=None, gt=0.0, description="relative deviation that is accepted"
    )

    @model_validator(mode="after")
    def _numbered(self) -> Frequencies:
        if self.modes is None:
            return self
        if len(self.modes) != len(self.hertz) or min(self.modes) < 1:
            raise ValueError("as many mode numbers, from 1 on, as frequencies")
        return self

    @property
    def numbers(self) -> tuple[int, ...]:
        """The number of each frequency, counted from 1."""
        return self.modes or tuple(range(1, len(self.hertz) + 1))


class BlockValue(_Table):
    """One number of a SID, named as in the file; indices count from 1."""

    block: str = Field(description="mass, a body block, or an entry of a node")
    row: int = Field(default=1, ge=1, description="row, from 1")
    column: int = Field(default=1, ge=1, description="column, from 1")
    mode: int | None = Field(
        default=None, ge=1, description="elastic coordinate of a first-order term"
    )
    node: str | None = Field(default=None, description="id of the node of the entry")
    value: float = Field(description="a number in the units of the SID")
    tolerance: float | None = Field(
        default=None, gt=0.0, description="relative deviation that is accepted"
    )
    name: str = Field(default="", description="a text that names this number")
    source: str = Field(default="", description="where the number comes from")

    @field_validator("block")
    @classmethod
    def _known(cls, block: str) -> str:
        known = ("mass", *BLOCK_SHAPES, *NODE_SHAPES)
        if block not in known:
            raise ValueError(f"one of {', '.join(known)}")
        return block

    @model_validator(mode="after")
    def _belongs(self) -> BlockValue:
        if (self.block in NODE_SHAPES) != (self.node is not None):
            raise ValueError(
                f"`node` with {', '.join(NODE_SHAPES)}, and with these only"
            )
        return self


class ReferenceFile(_Table):
    """What a SID is compared with: frequencies and values of blocks."""

    format: Literal["sidtool reference"]
    version: Literal[1]
    title: str = Field(default="", description="a text")
    frequencies: tuple[Frequencies, ...] = Field(
        default=(), description="rows of natural frequencies"
    )
    blocks: tuple[BlockValue, ...] = Field(
        default=(), description="single numbers of a SID"
    )

    @model_validator(mode="after")
    def _not_empty(self) -> ReferenceFile:
        if not self.frequencies and not self.blocks:
            raise ValueError("at least one table [[frequencies]] or [[blocks]]")
        return self


def read_reference(path: str | Path) -> ReferenceFile:
    """Read a reference file: CSV if its name ends in ``.csv``, else TOML or JSON.

    Raises
    ------
    InputError : the file cannot be read, or a key, column or value does not fit.
    """
    path = Path(path)
    return (
        _read_csv(path) if path.suffix.lower() == ".csv" else load(path, ReferenceFile)
    )


def _read_csv(path: Path) -> ReferenceFile:
    blocks: list[dict[str, Any]] = []
    frequencies: dict[str, dict[str, Any]] = {}
    for line, entry in read_rows(path):
        try:
            _add_entry(entry, blocks, frequencies)
        except InputError as error:
            raise _with_line(error, line).located(path) from None
    data = {
        "format": "sidtool reference",
        "version": 1,
        "title": path.stem,
        "frequencies": list(frequencies.values()),
        "blocks": blocks,
    }
    return validate_data(data, ReferenceFile, source=path)


def _add_entry(
    entry: dict[str, Any],
    blocks: list[dict[str, Any]],
    frequencies: dict[str, dict[str, Any]],
) -> None:
    quantity = entry.pop("quantity")
    if quantity != "frequency":
        data = {"block": quantity, **entry}
        validate_data(data, BlockValue)
        blocks.append(data)
        return
    if "mode" not in entry:
        raise InputError("is missing", place="column mode", expected="a mode's number")
    name = entry.get("name", "frequency")
    shared: dict[str, Any] = {k: entry[k] for k in _SHARED if k in entry}
    row = frequencies.setdefault(name, {"name": name, "hertz": [], "modes": []})
    row.update(shared)
    row["hertz"].append(entry["value"])
    row["modes"].append(entry["mode"])


def _with_line(error: InputError, line: int) -> InputError:
    place = f"line {line}" + (f", {error.place}" if error.place else "")
    return InputError(error.problem, place=place, expected=error.expected)


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
        raise unreadable_error(path, "a CSV table", error) from None
    except ValueError as error:
        raise InputError(
            f"cannot be read ({error})", source=path, expected="a CSV table"
        ) from None
    rows = [
        (number, line)
        for number, line in enumerate(lines, 1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not rows:
        raise InputError("is empty", source=path, expected="a CSV table with a header")
    header = [name.strip() for name in next(csv.reader([rows[0][1]]))]
    _check_header(header, path, rows[0][0])
    return [
        (number, _read_entry(_column_names(line, header, path, number), path, number))
        for number, line in rows[1:]
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


def _column_names(
    line: str, header: list[str], path: Path, number: int
) -> dict[str, str]:
    cells = [cell.strip() for cell in next(csv.reader([line]))]
    if len(cells) != len(header):
        raise InputError(
            f"found {len(cells)} cells",
            source=path,
            place=f"line {number}",
            expected=f"{len(header)}, as in the header",
        )
    return {name: cell for name, cell in zip(header, cells, strict=True) if cell}


def _read_entry(row: dict[str, str], path: Path, line: int) -> dict[str, Any]:
    missing = [name for name in ("quantity", "value") if name not in row]
    if missing:
        raise InputError(f"{missing[0]} is missing", source=path, place=f"line {line}")
    return {name: _parse_value(cell, name, path, line) for name, cell in row.items()}


def _parse_value(cell: str, name: str, path: Path, line: int) -> Any:
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
