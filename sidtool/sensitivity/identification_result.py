"""Result of an identification: numbers with intervals, as table, data and picture."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.base.html import html_table
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.file_names import kind_by_ending

from .identification import Fit
from .measurements import Measurement


@dataclass(frozen=True, kw_only=True, eq=False)
class Identification:
    """Numbers of a scene that fit a measurement best.

        found = sidtool.identify("scene.toml", ["spring.stiffness"], "measured.csv")
        found.x["spring.stiffness"], found.intervals["spring.stiffness"]

    Attributes
    ----------
    variables : their names
    start : (n,) first values
    fit : values, deviations, correlations and noises
    measured : measurements by output
    targets : measured values and deviations, by functional
    changes : of the scene, by keys as in `Scene.with_`
    model_changes : of models by body, by keys as in `Model.with_`
    units : of variables, outputs and functionals
    runs, seconds : that it took
    diagnostics : what makes intervals doubtful
    title : of the scene
    """

    variables: tuple[str, ...]
    start: Array
    fit: Fit
    measured: Mapping[str, Measurement]
    targets: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    changes: Mapping[str, float] = field(default_factory=dict)
    model_changes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    runs: int = 0
    seconds: float = 0.0
    diagnostics: tuple[Diagnostic, ...] = ()
    title: str = ""

    @property
    def x(self) -> dict[str, float]:
        """Values of the variables by their names."""
        return dict(zip(self.variables, map(float, self.fit.x), strict=True))

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Least and largest value of the 95 % interval of each variable."""
        low, high = self.fit.x - self.fit.half_widths, self.fit.x + self.fit.half_widths
        pairs = zip(map(float, low), map(float, high), strict=True)
        return dict(zip(self.variables, pairs, strict=True))

    @property
    def noises(self) -> dict[str, float]:
        """Standard deviation of each measured output about the fit."""
        return dict(zip(self.measured, map(float, self.fit.noises), strict=True))

    def report(self) -> str:
        """Return the result as text, as `sidtool identify` prints it."""
        from ..report.tables import text_table

        parts = [text_table(self._VARIABLES, self._variable_rows()), ""]
        parts += [text_table(self._OUTPUTS, self._output_rows()), ""]
        end = (
            "Converged" if self.fit.converged else f"Not converged: {self.fit.message}"
        )
        parts += [f"{end}. {self.runs} runs, {self.seconds:.2g} s.", ""]
        for where, changes in (("Scene", self.changes), *self.model_changes.items()):
            options = [f"--set {key}={value!r}" for key, value in changes.items()]
            if options:
                name = where if where == "Scene" else f"Model of {where}"
                parts.append(f"{name}: {' '.join(options)}")
        return "\n".join(parts)

    _VARIABLES = ("variable", "start", "value", "unit", "95 % interval", "+- %")
    _OUTPUTS = ("measured", "values", "noise or distance", "unit")

    def _variable_rows(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = []
        for k, name in enumerate(self.variables):
            value, half = self.fit.x[k], self.fit.half_widths[k]
            low, high = self.intervals[name]
            share = f"{100 * half / abs(value):.2g}" if value else ""
            span = f"{low:.6g} to {high:.6g}"
            unit = self.units.get(name, "")
            rows.append(
                (name, f"{self.start[k]:.6g}", f"{value:.8g}", unit, span, share)
            )
        return rows

    def _output_rows(self) -> list[tuple[str, ...]]:
        rows: list[tuple[str, ...]] = [
            (
                name,
                str(len(values.times)),
                f"{self.noises[name]:.3g}",
                self.units.get(name, ""),
            )
            for name, values in self.measured.items()
        ]
        first = len(self.fit.values) - len(self.targets)
        for k, (name, (value, _)) in enumerate(self.targets.items()):
            distance = self.fit.values[first + k] - value
            rows.append((name, "1", f"{distance:.3g}", self.units.get(name, "")))
        return rows

    def data(self) -> dict[str, Any]:
        """Return the data that `--json` prints, and that `save` writes."""
        return {
            "title": self.title,
            "converged": self.fit.converged,
            "message": self.fit.message,
            "variables": {
                name: {
                    "start": float(self.start[k]),
                    "value": float(self.fit.x[k]),
                    "deviation": _finite(self.fit.deviations[k]),
                    "interval": [_finite(end) for end in self.intervals[name]],
                    "unit": self.units.get(name, ""),
                }
                for k, name in enumerate(self.variables)
            },
            "correlation": self.fit.correlation.tolist(),
            "noises": self.noises,
            "changes": dict(self.changes),
            "model_changes": {k: dict(v) for k, v in self.model_changes.items()},
            "runs": self.runs,
            "seconds": self.seconds,
            "diagnostics": [each.as_data() for each in self.diagnostics],
        }

    def plot(self, path: str | os.PathLike[str] | None = None) -> Any:
        """Return a matplotlib figure: measured and fitted outputs over time.

        path : file to which the figure is written as well (.png, .svg, .pdf)
        """
        from ..plot.designs import plot_fit
        from ..report.tables import name_with_unit

        ends = np.cumsum([len(m.times) for m in self.measured.values()])
        fitted = np.split(self.fit.values, ends)[: len(ends)]
        panels = [
            (
                name_with_unit(name, self.units.get(name, "")),
                values.times,
                values.values,
                curve,
            )
            for (name, values), curve in zip(self.measured.items(), fitted, strict=True)
        ]
        return plot_fit(None if path is None else Path(path), panels)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the data (.json), or the picture (.png, .svg, .pdf).

        Raises
        ------
        InputError, OSError : the file cannot be written.
        """
        if kind_by_ending(path, "optimisation", "picture") == "picture":
            self.plot(path)
            return
        from ..report.json_data import write_json

        write_json(Path(path), self.data())

    def __repr__(self) -> str:
        return f"<Identification {self.title!r}: {self.x}>"

    def _repr_html_(self) -> str:
        outputs = html_table(self._output_rows(), self._OUTPUTS)
        return html_table(self._variable_rows(), self._VARIABLES) + outputs


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def strongest_correlation(
    fit: Fit, variables: Sequence[str]
) -> tuple[str, str, float] | None:
    """The two variables that are most correlated, None for one variable."""
    if len(variables) < 2:
        return None
    magnitude = np.abs(np.triu(fit.correlation, 1))
    i, j = np.unravel_index(int(np.argmax(magnitude)), magnitude.shape)
    return variables[int(i)], variables[int(j)], float(fit.correlation[i, j])
