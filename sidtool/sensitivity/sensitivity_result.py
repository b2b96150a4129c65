"""Derivatives of functionals by variables: as table, data and file."""

from __future__ import annotations

import csv
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.base.html import html_table
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.file_names import check_ending
from sidtool.formats.storage.atomic import atomic_path

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, kw_only=True, eq=False)
class Sensitivities:
    """Values of functionals and their derivatives by variables.

        found.derivatives[0, 1]  # of the first functional by the second variable
        found["max_abs(rod.q1)", "piston.mass"]

    Attributes
    ----------
    functionals, variables : their names
    values : (n_functionals,) values of the functionals
    point : (n_variables,) values of the variables
    derivatives, errors : (n_functionals, n_variables)
        NaN where a derivative does not exist; estimates of their errors, NaN where
        derivatives are exact to rounding
    relative : (n_functionals, n_variables)
        per cent of a functional for one per cent of a variable
    units : of functionals and variables, "" if there is none or it is not known
    runs : runs that were made
    seconds : that the derivatives took
    rtol : tolerance of the runs, NaN without runs or with fixed steps
    methods : adjoint, direct or differences, by variable
    reason : why derivatives of a motion are differences of runs, or empty
    diagnostics : of all derivatives
    title : of the scene
    """

    functionals: tuple[str, ...]
    variables: tuple[str, ...]
    values: Array
    point: Array
    derivatives: Array
    errors: Array
    units: Mapping[str, str] = field(default_factory=dict)
    runs: int = 0
    seconds: float = 0.0
    rtol: float = np.nan
    methods: Mapping[str, str] = field(default_factory=dict)
    reason: str = ""
    diagnostics: tuple[Diagnostic, ...] = ()
    title: str = ""

    @property
    def relative(self) -> Array:
        with np.errstate(divide="ignore", invalid="ignore"):
            found = self.derivatives * self.point / self.values[:, None]
        return np.where(np.isfinite(found), found + 0.0, np.nan)

    @property
    def method(self) -> str:
        """The methods of all variables, each once."""
        return ", ".join(dict.fromkeys(self.methods.values()))

    @property
    def runs_per_variable(self) -> float:
        return self.runs / max(1, len(self.variables))

    def __getitem__(self, names: tuple[str, str]) -> float:
        """Return the derivative of a functional by a variable.

        Raises
        ------
        KeyError : there is no such functional or variable.
        """
        of, by = names
        if of not in self.functionals or by not in self.variables:
            known = ", ".join((*self.functionals, *self.variables))
            raise KeyError(f"{of}, {by}; there are {known}")
        row, column = self.functionals.index(of), self.variables.index(by)
        return float(self.derivatives[row, column])

    def ranked(self, functional: int) -> list[int]:
        """Return the variables by their influence on a functional, the largest first.

        Variables of the value 0 have no relative influence; they come last.
        """
        relative = np.nan_to_num(np.abs(self.relative[functional]), nan=-1.0)
        return np.argsort(-relative, kind="stable").tolist()  # type: ignore[no-any-return]

    _COLUMNS = ("functional", "value", "variable", "at", "derivative", "error")

    def rows(self) -> list[dict[str, Any]]:
        """Return a row per functional and variable, ranked for each functional."""
        relative = self.relative
        return [
            {
                "functional": of,
                "value": float(self.values[i]),
                "variable": self.variables[j],
                "at": float(self.point[j]),
                "derivative": float(self.derivatives[i, j]),
                "error": float(self.errors[i, j]),
                "unit": self._unit(i, j),
                "relative": float(relative[i, j]),
            }
            for i, of in enumerate(self.functionals)
            for j in self.ranked(i)
        ]

    def _unit(self, i: int, j: int) -> str:
        above = self.units.get(self.functionals[i], "")
        below = self.units.get(self.variables[j], "")
        if above == below:
            return ""
        return (
            f"{above or '1'}/({below})"
            if " " in below or "/" in below
            else (f"{above or '1'}/{below}" if below else above)
        )

    def report(self, most: int | None = None) -> str:
        """Return the table as text, as `sidtool sensitivity` prints it.

        most : largest number of variables of each functional, if it is limited
        """
        from ..report.tables import text_table

        parts = []
        for i, of in enumerate(self.functionals):
            unit = self.units.get(of, "")
            parts.append(f"{of} = {self.values[i]:.9g} {unit}".rstrip())
            parts.append(text_table(self._header, self._lines(i), most))
            parts.append("")
        cost = ""
        if self.runs:
            runs = "1 run" if self.runs == 1 else f"{self.runs} runs"
            cost = f"{runs}, {self.runs_per_variable:.1f} per variable, "
        if self.methods:
            reason = f" ({self.reason})" if self.reason else ""
            cost = f"{self.method}{reason}, {cost}"
        parts.append(f"{cost}{self.seconds:.2g} s")
        if not np.isnan(self.rtol):
            error = "Errors are those of the derivatives of the motion at"
            parts.append(f"{error} rtol = {self.rtol:g}.")
        return "\n".join(parts)

    @property
    def _header(self) -> tuple[str, ...]:
        return ("variable", "value", "derivative", "unit", "error", "% per %")

    def _lines(self, i: int) -> list[tuple[str, ...]]:
        relative = self.relative
        return [
            (
                self.variables[j],
                f"{self.point[j]:.6g}",
                _text(self.derivatives[i, j], ".9g"),
                self._unit(i, j),
                _text(self.errors[i, j], ".1e"),
                _text(relative[i, j], ".4g"),
            )
            for j in self.ranked(i)
        ]

    def data(self) -> dict[str, Any]:
        """Return the data that `--json` prints."""
        rows = [
            {k: None if v != v else v for k, v in row.items()} for row in self.rows()
        ]
        return {
            "title": self.title,
            "sensitivities": rows,
            "units": dict(self.units),
            "runs": self.runs,
            "runs_per_variable": self.runs_per_variable,
            "seconds": self.seconds,
            "methods": dict(self.methods),
            "reason": self.reason or None,
            "rtol": None if np.isnan(self.rtol) else self.rtol,
            "diagnostics": [each.as_data() for each in self.diagnostics],
        }

    def to_dataframe(self) -> pandas.DataFrame:
        """Return a pandas table: a row per functional and variable.

        Raises
        ------
        InputError : pandas is not installed.
        """
        from ..report.tables import import_optional

        return import_optional("pandas").DataFrame(self.rows())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the table (.csv).

        Raises
        ------
        InputError, OSError : the file cannot be written.
        """
        check_ending(path, "table")
        with (
            atomic_path(Path(path)) as temporary,
            temporary.open("w", newline="", encoding="utf-8") as stream,
        ):
            rows = self.rows()
            writer = csv.DictWriter(stream, list(rows[0]))
            writer.writeheader()
            writer.writerows(
                {k: "" if v != v else v for k, v in row.items()} for row in rows
            )

    def __repr__(self) -> str:
        name = f" {self.title!r}" if self.title else ""
        size = f"{len(self.functionals)} functionals, {len(self.variables)} variables"
        return f"<Sensitivities{name}: {size}>"

    def _repr_html_(self) -> str:
        return "".join(
            html_table(self._lines(i), self._header, f"{of} = {self.values[i]:.9g}")
            for i, of in enumerate(self.functionals)
        )


def _text(value: float, form: str) -> str:
    return "" if np.isnan(value) else format(value, form)
