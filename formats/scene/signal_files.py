"""Columns of numbers from CSV and HDF5 files, for signals and tables of a scene.

Tables of a scene whose values over time may come from a file.

Tables of values over one or two variables, which formulas look up.
"""

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import ModelWrapValidatorHandler, PrivateAttr, model_validator

from ..base.errors import InputError
from ..base.numbers import real_of_text
from ..base.units import column_factor, is_known_unit, split_unit
from ..diagnostics import diagnose
from ..diagnostics.record import warn_of
from ..storage.unreadable import read_text
from ..toml.messages import nearest_key
from ..toml.tables import Field
from .base import Table, as_tuples

#: Columns of a signal: key of the column -> key of its numbers.
SIGNAL_KEYS = {"time": "times", "value": "values"}
#: A column by its name in the header or by its number from 1; None: the default one.
Column = str | int | None
Values = tuple[float, ...]
#: A cell between spaces; that of a header with its unit in brackets.
_SPACED = re.compile(r"[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?|\S+")
_HDF5 = (".h5", ".hdf5")
#: Attributes of a dataset that name its unit.
_UNIT_KEYS = ("units", "unit")
SCALE = (
    "factor of the values of a file, instead of that of the unit in its header to SI"
)
#: Tables of a scene whose entries may name files of signals.
SIGNAL_TABLES = ("drives", "forces", "inputs", "tables")


class SignalTable(Table):
    """A table with the keys `times` and `values`, or `file` and its columns."""

    #: what the file states of its values
    _unit_of_file: str = PrivateAttr(default="")

    @model_validator(mode="wrap")
    @classmethod
    def _read_file(cls, data: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Return the table's data with the columns of its file."""
        data, unit = signal_and_unit(data, SIGNAL_KEYS)
        table = handler(data)
        if unit:
            table._unit_of_file = unit
        return table

    def __eq__(self, other: object) -> bool:
        """Whether numbers are equal, whether they came from a file or not."""
        return type(self) is type(other) and vars(self) == vars(other)

    @property
    def unit_of_file(self) -> str:
        """The unit that its file states, or ""."""
        return self._unit_of_file


class SignalColumn(NamedTuple):
    """The numbers of a column, and the unit that its file states, or ""."""

    values: Values
    unit: str = ""


def read_columns(path: str | Path, columns: Sequence[Column]) -> list[SignalColumn]:
    """Read columns of a table: CSV, or HDF5 by its ending.

    Of a CSV file the separator is a comma, a semicolon, a tab or spaces. A header is
    optional, lines with # are comments. Of an HDF5 file columns are datasets, of a
    result of sidtool times `t` and outputs.

    Parameters
    ----------
    columns : by name, with or without the unit behind it, or by number from 1; None is
        the column at the same place of the file

    Raises
    ------
    InputError : the file cannot be read, lacks a column, or holds other rows.
    """
    path = Path(path)
    try:
        if path.suffix.lower() in _HDF5:
            return _read_hdf5(path, columns)
        return _read_text(path, columns)
    except InputError as error:
        raise error.located(path) from None


def with_signal(data: Any, keys: Mapping[str, str], required: tuple[str, ...]) -> Any:
    """Return the first of `signal_and_unit`."""
    return signal_and_unit(data, keys, required)[0]


def signal_and_unit(
    data: Any, keys: Mapping[str, str], required: tuple[str, ...] = ()
) -> tuple[Any, str]:
    """Return data of a table with the columns of its `file` in place of their names,
    and the unit that the file states for the values, or "".

    Numbers become those of SI units, or of the `unit` of an input, by the unit in the
    header. Where data have a `scale`, values have this factor instead. Lists become
    tuples, which validation expects behind a validator.

    Parameters
    ----------
    keys : key that names a column -> key that takes its numbers
    required : keys without which there is no column; others take the default column

    Raises
    ------
    InputError : see `read_columns`; numbers are given as well; or a unit does not fit.
    """
    if not isinstance(data, Mapping):
        return data, ""
    content = {key: as_tuples(value) for key, value in data.items()}
    if content.get("file") is None:
        return content, ""
    path, scale = Path(str(content.pop("file"))), content.pop("scale", None)
    named = [key for key in keys if key in content or key not in required]
    for key, target in keys.items():
        if target != key and target in content:
            raise InputError(
                f"gives {target} beside a file", source=path, expected="one of them"
            )
    requested = [content.pop(key, None) for key in named]
    columns = read_columns(path, requested)
    unit_of_values = ""
    for key, title, column in zip(named, requested, columns, strict=True):
        target = keys[key]
        unit = {"times": "s", "values": content.get("unit") or ""}.get(target, "")
        is_scaled = target == "values" and scale is not None
        if not (is_scaled or column.unit == unit or is_known_unit(column.unit)):
            warn_of(diagnose("N245", f"{path.name}, {title or key}", unit=column.unit))
        if target == "values" and not is_scaled:
            unit_of_values = column.unit
        try:
            factor = scale if is_scaled else column_factor(column.unit, unit)
        except InputError as error:
            error.place = f"the column of {target}"
            raise error.located(path) from None
        content[target] = tuple(factor * value for value in column.values)
    return content, unit_of_values


def relocate_signal_files(data: Mapping[str, Any], folder: Path) -> None:
    """Make paths of signals in data of a scene relative to the working folder."""
    waiting = [data.get(table) for table in SIGNAL_TABLES]
    while waiting:
        part = waiting.pop()
        if isinstance(part, dict):
            waiting += part.values()
            if isinstance(part.get("file"), str):
                part["file"] = str(folder / part["file"])
        elif isinstance(part, list):
            waiting += [each for each in part if isinstance(each, dict)]


def _read_text(path: Path, columns: Sequence[Column]) -> list[SignalColumn]:
    lines = read_text(path, "a table (CSV)").splitlines()
    numbered = [(k, line) for k, line in enumerate(lines, 1) if line.strip()]
    numbered = [(k, line) for k, line in numbered if not line.lstrip().startswith("#")]
    if not numbered:
        raise InputError("holds no values", expected="columns of numbers")
    separator = next((c for c in ";\t," if c in numbered[0][1]), None)
    rows = [(k, _cells(line, separator)) for k, line in numbered]
    header: list[str] = []
    if not is_finite_number(rows[0][1][0]):
        header = rows[0][1]
        rows = rows[1:]
    width = len(header or rows[0][1])
    indices = [_index(c, k, header, width) for k, c in enumerate(columns)]
    result: list[list[float]] = [[] for _ in indices]
    for line, row in rows:
        if any(row[width:]):
            raise InputError(
                f"found {len(row)} cells",
                place=f"line {line}",
                expected=f"{width}, and decimal points",
            )
        for values, index in zip(result, indices, strict=True):
            if index >= len(row) or not is_finite_number(row[index]):
                raise InputError(
                    f"found {' '.join(row)[:40]!r}",
                    place=f"line {line}",
                    expected=f"a number in column {index + 1}",
                )
            values.append(float(row[index]))
    units = [split_unit(header[k])[1] if header else "" for k in indices]
    return [
        SignalColumn(tuple(values), unit)
        for values, unit in zip(result, units, strict=True)
    ]


def _cells(line: str, separator: str | None) -> list[str]:
    if separator is None:
        return _SPACED.findall(line)
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]


def _index(column: Column, default: int, header: list[str], width: int) -> int:
    if column is None and default < width:
        return default
    if isinstance(column, int) and 1 <= column <= width:
        return column - 1
    if isinstance(column, str):
        names = [split_unit(name)[0] for name in header]
        for known in (header, names):
            if known.count(column) > 1:
                raise InputError(
                    f"has {known.count(column)} columns {column!r}",
                    expected="one, or the number of the column",
                )
            if column in known:
                return known.index(column)
    asked = "a further column" if column is None else f"column {column!r}"
    known_names = header or [f"1 to {width}"]
    expected = nearest_key(str(column), known_names) if header else known_names[0]
    raise InputError(f"has not {asked}", expected=expected)


def is_finite_number(text: str) -> bool:
    """Return whether a cell of a table holds a finite number."""
    try:
        real_of_text(text)
    except ValueError:
        return False
    return True


def _read_hdf5(path: Path, columns: Sequence[Column]) -> list[SignalColumn]:
    import h5py
    import numpy as np

    try:
        with h5py.File(path, "r") as file:
            is_result = file.attrs.get("format") == "sidtool result"
            found = []
            for name in columns:
                unit: object = ""
                if is_result:
                    content, unit = _result_column(file, name)
                elif isinstance(name, str) and name in file:
                    content = file[name][()]
                    attributes = file[name].attrs
                    unit = next(
                        (attributes[k] for k in _UNIT_KEYS if k in attributes), ""
                    )
                else:
                    raise InputError(
                        f"has no dataset {name!r}",
                        expected=", ".join(list(file)[:8]) or "a dataset",
                    )
                values = np.asarray(content, float)
                if values.ndim != 1 or not np.isfinite(values).all():
                    raise InputError(
                        f"has the shape {values.shape}",
                        place=str(name),
                        expected="a row of finite numbers",
                    )
                text = unit.decode() if isinstance(unit, bytes) else str(unit)
                found.append(SignalColumn(tuple(values.tolist()), text.strip()))
            return found
    except (OSError, TypeError, ValueError) as error:
        raise InputError(
            f"cannot be read ({error})", expected="an HDF5 file with datasets"
        ) from None


def _result_column(file: Any, name: Column) -> tuple[Any, str]:
    """Times or an output of a result of sidtool, (nt,), and its unit.

    Results of version 0.1 and of early files of 1.0 hold no units: "".
    """
    if name in (None, "t"):
        return file["t"][()], "s"
    names = [str(text) for text in file["names/values"].asstr()[:]]
    if name not in names:
        raise InputError(
            f"records no output {name!r}", expected=nearest_key(str(name), names)
        )
    at = names.index(str(name))
    unit = file["units/values"].asstr()[at] if "units/values" in file else ""
    return file["values"][:, at], unit


#: Points beyond a table by this part of its largest one are at its end.
ROUNDING = 1e-12
_KEYS = {"x": "x", "y": "y", "values": "values"}


class LookupTable(Table):
    """Values over one or two variables, for formulas: `lookup(NAME, x)` or
    `lookup(NAME, x, y)`.

    Over one variable the values are held, joined by straight lines, or by a cubic
    spline; over two they are bilinear. Beyond its ends the last value holds; a smooth
    curve goes on in a straight line.
    """

    file: str | None = Field(
        default=None,
        description="CSV or HDF5 file with the columns that x, y and values name; of "
        "two variables one row for each point of the grid",
    )
    x: Values | str = Field(description="first variable, growing; or its column")
    y: Values | str | None = Field(
        default=None, description="second variable, growing; or its column"
    )
    values: Values | tuple[Values, ...] | str = Field(
        description="one for each x, or a row over y for each x; or their column"
    )
    scale: float | None = Field(default=None, description=SCALE)
    interpolation: Literal["hold", "linear", "smooth"] = Field(
        default="linear", description="between the points of one variable"
    )

    @model_validator(mode="before")
    @classmethod
    def _read_file(cls, data: Any) -> Any:
        data = with_signal(data, _KEYS, ("y",))
        if isinstance(data, dict) and isinstance(data.get("y"), tuple):
            x, y, values = (np.array(data[key], float) for key in ("x", "y", "values"))
            if values.ndim == 1 and len(x) == len(y) == len(values):
                data = data | _grid(x, y, values)
        return data

    def number(self, name: str, *point: float) -> float:
        """The value for a formula of a number, of a table that is not checked yet and
        has a name.

        Raises
        ------
        InputError : the table has another number of variables, is smooth (formulas of
            numbers do not read these), or is no table.
        """
        check_table(self, "tables")
        if len(point) != self.variables or self.interpolation == "smooth":
            kind = "a smooth table" if len(point) == self.variables else "this table"
            raise InputError(
                f"looks {kind} up over {len(point)} of {self.variables} variables",
                expected="a linear or held one over as many",
            )
        for key, a in zip("xy", point, strict=False):
            first, last = getattr(self, key)[0], getattr(self, key)[-1]
            rounding = ROUNDING * max(abs(first), abs(last))
            if not first - rounding <= a <= last + rounding:
                subject = f"tables.{name}, {key}"
                warn_of(diagnose("N246", subject, first=first, last=last))
        return self.value(*point)

    def value(self, *point: float) -> float:
        """The value of a linear or held table at a point; that of the end beyond it."""
        x, y, values = self.points
        a = float(np.clip(point[0], x[0], x[-1]))
        i = min(max(int(np.searchsorted(x, a, side="right")) - 1, 0), len(x) - 2)
        p = (a - x[i]) / (x[i + 1] - x[i])
        if self.interpolation == "hold":
            p = np.floor(p)
        rows = values[i : i + 2]
        if y is not None:
            b = float(np.clip(point[1], y[0], y[-1]))
            j = min(max(int(np.searchsorted(y, b, side="right")) - 1, 0), len(y) - 2)
            q = (b - y[j]) / (y[j + 1] - y[j])
            rows = (1 - q) * rows[:, j] + q * rows[:, j + 1]
        return float((1 - p) * rows[0] + p * rows[1])

    @property
    def points(self) -> tuple[Any, Any, Any]:
        """x, y (None of one variable) and values as arrays."""
        y = None if self.y is None else np.array(self.y, float)
        return np.array(self.x, float), y, np.array(self.values, float)

    @property
    def variables(self) -> int:
        """1 or 2."""
        return 1 if self.y is None else 2


def check_table(table: LookupTable, place: str) -> None:
    """Raise what does not fit in a table, with its key.

    Raises
    ------
    InputError : columns without a file, or points that make no table.
    """
    for key in ("x", "y", "values"):
        if isinstance(getattr(table, key), str):
            raise InputError(
                "names a column without a file",
                place=f"{place}.{key}",
                expected="numbers",
            )
    rows = [len(row) for row in table.values if isinstance(row, tuple)]
    if len(set(rows)) > 1:
        raise InputError(
            "has rows of different lengths",
            place=f"{place}.values",
            expected="equal ones",
        )
    x, y, values = table.points
    for key, points in (("x", x), ("y", y)):
        if points is not None and (len(points) < 2 or (np.diff(points) <= 0).any()):
            raise InputError(
                "does not grow",
                place=f"{place}.{key}",
                expected="two or more growing numbers",
            )
    shape = (len(x),) if y is None else (len(x), len(y))
    if values.shape != shape:
        raise InputError(
            f"has {' x '.join(map(str, values.shape))} numbers",
            place=f"{place}.values",
            expected=" x ".join(map(str, shape)),
        )
    if y is not None and table.interpolation != "linear":
        raise InputError(
            f"is {table.interpolation} in two variables",
            place=f"{place}.interpolation",
            expected="linear",
        )


def _grid(x: Any, y: Any, values: Any) -> dict[str, Any]:
    """Rows of a file as a grid.

    Raises
    ------
    InputError : points of the grid are missing, or are there twice.
    """
    xs, ys = np.unique(x), np.unique(y)
    table = np.full((len(xs), len(ys)), np.nan)
    table[np.searchsorted(xs, x), np.searchsorted(ys, y)] = values
    if len(values) != table.size or np.isnan(table).any():
        raise InputError(
            f"has {len(values)} rows for a grid of {len(xs)} x {len(ys)} points",
            place="values",
            expected="one row for each point",
        )
    rows = tuple(tuple(row) for row in table.tolist())
    return {"x": tuple(xs.tolist()), "y": tuple(ys.tolist()), "values": rows}
