"""Tables of values over one or two variables, which formulas look up."""

from typing import Any, Literal

import numpy as np
from pydantic import model_validator

from ..base.errors import InputError
from ..diagnostics import diagnose
from ..diagnostics.python_warnings import warn_of
from ..toml.tables import Field
from .base import Table
from .signal_files import SCALE, Values, with_signal

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
