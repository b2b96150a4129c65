"""Result of a sweep: measures of outputs in a table, as text, CSV and picture."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.integrate import trapezoid

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.html import html_table
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, each_once
from sidtool.formats.file_names import check_ending, kind_by_ending
from sidtool.formats.scene import has_wildcard, parse_output
from sidtool.formats.storage.atomic import atomic_path

if TYPE_CHECKING:
    import os

    import pandas


#: Name for the output times; no output has this name.
TIME = "t"

#: The last column: why a run failed, or its warnings.
MESSAGE_COLUMN = "message"


def mean(times: Array, values: Array) -> float:
    """Return the mean over time by the trapezoidal rule."""
    if times[-1] <= times[0]:
        return float(values[-1])
    return float(trapezoid(values, times) / (times[-1] - times[0]))


def root_mean_square(times: Array, values: Array) -> float:
    """Return the root mean square over time by the trapezoidal rule."""
    return float(np.sqrt(mean(times, values**2)))


MEASURES: dict[str, Callable[[Array, Array], float]] = {
    "max": lambda _, values: float(values.max()),
    "min": lambda _, values: float(values.min()),
    "end": lambda _, values: float(values[-1]),
    "mean": mean,
    "rms": root_mean_square,
    "amplitude": lambda _, values: float(values.max() - values.min()) / 2.0,
}


class Measure(NamedTuple):
    """A measure of an output, such as `tip.y.max`; `output` may have wildcards."""

    output: str
    name: str

    def __str__(self) -> str:
        return f"{self.output}.{self.name}"


def parse_measures(texts: str | Iterable[str]) -> list[Measure]:
    """Parse measures of the option `--of`; one text may hold several, with commas.

    Raises
    ------
    InputError : a text does not end in a measure, or names no output.
    """
    given = [texts] if isinstance(texts, str) else texts
    listed = [part.strip() for text in given for part in text.split(",")]
    if not any(listed):
        raise InputError(
            "nothing is measured", place="--of", expected="such as piston.x.max"
        )
    return [_parse_measure(text) for text in dict.fromkeys(listed) if text]


def _parse_measure(text: str) -> Measure:
    output, _, name = text.rpartition(".")
    if name not in MEASURES or not output:
        known = ", ".join(MEASURES)
        raise InputError(
            f"found {text!r}",
            place="--of",
            expected=f"an output and one of {known}, such as {text.strip('.')}.max",
        )
    if output != TIME and not has_wildcard(output):
        try:
            parse_output(output)
        except InputError as error:
            raise InputError(
                error.problem, place=f"--of {text}", expected=error.expected
            ) from None
    return Measure(output, name)


@dataclass(frozen=True)
class SweepPoint:
    """One point of a sweep.

    Attributes
    ----------
    values : by keys of the scene
    measures : values by name, such as `tip.y.max`; empty if the run failed
    message : why the run failed; else empty
    diagnostics : of the run
    """

    values: Mapping[str, Any]
    measures: Mapping[str, float] = field(default_factory=dict)
    message: str = ""
    diagnostics: tuple[Diagnostic, ...] = ()


@dataclass(frozen=True, kw_only=True, eq=False)
class Sweep(Mapping[str, np.ndarray]):
    """All points of a sweep; a mapping from names of columns to arrays.

        found["parameters.h"], found["tip.y.max"], found["message"]

    Attributes
    ----------
    points : one for each combination of values, in the requested order
    axes : keys that are varied
    measures : what was measured, wildcards expanded
    units : units of axes and measures, "" if there is none or it is not known
    title : of pictures
    """

    points: tuple[SweepPoint, ...]
    axes: tuple[str, ...]
    measures: tuple[str, ...]
    units: Mapping[str, str] = field(default_factory=dict)
    title: str = ""

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a column (n,) of numbers, or of texts.

        Raises
        ------
        KeyError : there is no such column.
        """
        if name in self.axes:
            return _as_array([p.values[name] for p in self.points])
        if name in self.measures:
            return np.array([p.measures.get(name, np.nan) for p in self.points])
        if name == MESSAGE_COLUMN:
            return np.array([_message_of(p) for p in self.points], dtype=object)
        raise KeyError(f"{name}; there are {', '.join(self)}")

    def __iter__(self) -> Iterator[str]:
        return iter((*self.axes, *self.measures, MESSAGE_COLUMN))

    def __len__(self) -> int:
        return len(self.axes) + len(self.measures) + 1

    @property
    def failed(self) -> tuple[SweepPoint, ...]:
        """Return the points whose runs failed."""
        return tuple(p for p in self.points if p.message)

    @property
    def header(self) -> list[str]:
        """Return the names of the columns with their units."""
        from ..report.tables import name_with_unit

        return [name_with_unit(name, self.units.get(name, "")) for name in self]

    def to_dataframe(self) -> pandas.DataFrame:
        """Return a pandas table: a row per point; units in `attrs`.

        Raises
        ------
        InputError : pandas is not installed.
        """
        from ..report.tables import import_optional

        table = import_optional("pandas").DataFrame(dict(self))
        table.attrs["units"] = dict(self.units)
        return table

    def report(self, most: int | None = None) -> str:
        """Return the table as text, as `sidtool sweep` prints it.

        most : largest number of rows, if it is limited
        """
        from ..report.diagnostics import table_of_codes
        from ..report.tables import text_table

        table: str = text_table(self._shown(), self._rows(), most)
        codes = table_of_codes(self.runs)
        return f"{table}\n\n{codes}" if codes else table

    @property
    def runs(self) -> list[tuple[str, tuple[Diagnostic, ...]]]:
        """Return the diagnostics of all runs under their values."""
        return [
            (", ".join(map(_short_text, p.values.values())), p.diagnostics)
            for p in self.points
        ]

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """Return the diagnostics of all runs, each once."""
        return each_once(each for p in self.points for each in p.diagnostics)

    def _shown(self) -> list[str]:
        return self.header if any(map(_message_of, self.points)) else self.header[:-1]

    def _rows(self) -> list[list[str]]:
        """Return rows of texts; numbers have six digits."""
        columns = [[_short_text(value) for value in self[name]] for name in self]
        columns = columns[: len(self._shown())]
        return [list(row) for row in zip(*columns, strict=True)]

    def data(self) -> dict[str, Any]:
        """Return the data that `--json` prints."""
        from ..report.diagnostics import runs_by_code

        return {
            "title": self.title,
            "units": dict(self.units),
            "codes": {
                code: len(names) for code, names in runs_by_code(self.runs).items()
            },
            "points": [
                {
                    "values": dict(p.values),
                    "measures": dict(p.measures),
                    "message": p.message,
                    "diagnostics": [each.as_data() for each in p.diagnostics],
                }
                for p in self.points
            ],
        }

    def plot(self, path: str | os.PathLike[str] | None = None) -> Any:
        """Return a matplotlib figure: a panel per measure over the first key, with a
        line for each combination of the other keys.

        path : file to which the figure is written as well (.png, .svg, .pdf)

        Raises
        ------
        InputError : no run has a number.
        """
        from ..plot.studies import plot_sweep

        return plot_sweep(
            None if path is None else Path(path),
            self,
            self.axes,
            self.measures,
            dict(zip(self, self.header, strict=True)),
            [not point.message for point in self.points],
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the table (.csv), or the picture (.png, .svg, .pdf).

        Raises
        ------
        InputError, OSError : the file cannot be written.
        """
        if kind_by_ending(path, "sweep", "picture") == "picture":
            self.plot(path)
            return
        check_ending(path, "sweep")
        with (
            atomic_path(Path(path)) as temporary,
            temporary.open("w", newline="", encoding="utf-8") as stream,
        ):
            writer = csv.writer(stream)
            writer.writerow(self.header)
            columns = [[_full_text(value) for value in self[name]] for name in self]
            writer.writerows(zip(*columns, strict=True))

    def __repr__(self) -> str:
        name = f" {self.title!r}" if self.title else ""
        failed = f", {len(self.failed)} failed" if self.failed else ""
        return f"<Sweep{name}: {len(self.points)} points{failed}>"

    def _repr_html_(self) -> str:
        return html_table(self._rows(), self._shown(), self.title)


def _as_array(values: list[Any]) -> np.ndarray:
    if all(isinstance(v, int | float) and not isinstance(v, bool) for v in values):
        return np.array(values, float)
    array = np.empty(len(values), object)
    array[:] = values
    return array


def _message_of(point: SweepPoint) -> str:
    """Return why a point failed, or else the codes of its warnings."""
    codes = dict.fromkeys(d.code for d in point.diagnostics if d.is_warning)
    return point.message or ("warnings: " + ", ".join(codes) if codes else "")


def _short_text(value: Any) -> str:
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value:.6g}"
    return str(value)


def _full_text(value: Any) -> str:
    if isinstance(value, float):
        return "" if np.isnan(value) else repr(float(value))
    return str(value)
