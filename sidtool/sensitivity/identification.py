"""Identification of numbers of a scene from measured motions: least squares.

The noise of each output is not known: it is estimated from its residuals, and the
squares are weighted by it. With J the derivatives of the weighted residuals the
covariance of the numbers is (J^T J)^-1; intervals follow from Student's distribution.

Reference
---------
G. A. F. Seber, C. J. Wild: Nonlinear Regression. Wiley (1989), sections 2.1 and 5.1.

Result of an identification: numbers with intervals, as table, data and picture.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.html import html_table
from sidtool.formats.base.numbers import real_of_text
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.scene import SceneFile

from .functionals import Functional, parse_functionals
from .history import History, Peak
from .measurements import Measurement
from .optimisation import Evaluation
from .search_result import SearchResult

#: Share of intervals that contain the true value.
CONFIDENCE = 0.95
#: Weights are estimated anew until noises change by less than this part, so often at
#: most.
WEIGHT_TOLERANCE, MAX_PASSES = 1e-3, 5
#: Residuals of one output below this part of its range are rounding.
LEAST_NOISE = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class Identification(SearchResult):
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
        from ..report.tables import set_options, text_table

        parts = [text_table(self._VARIABLES, self._variable_rows()), ""]
        parts += [text_table(self._OUTPUTS, self._output_rows()), ""]
        parts += [self._end_line(), ""]
        return "\n".join([*parts, *set_options(self.changes, self.model_changes)])

    def _end_line(self) -> str:
        fit = self.fit
        end = "Converged" if fit.converged else f"Not converged: {fit.message}"
        return f"{end}. {self.runs} runs, {self.seconds:.2g} s."

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
        from ..plot.studies import plot_fit
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

    def _heading(self) -> str:
        return self.title or "Identification"

    def _outcome(self) -> tuple[str, bool]:
        return self._end_line(), self.fit.converged

    def _sections(self) -> Iterator[tuple[str, str]]:
        yield "Variables", html_table(self._variable_rows(), self._VARIABLES)
        yield "Measured", html_table(self._output_rows(), self._OUTPUTS)
        yield (
            "Correlation of the errors",
            html_table(
                (
                    (name, *(f"{x:.3f}" for x in row))
                    for name, row in zip(
                        self.variables, self.fit.correlation, strict=True
                    )
                ),
                ("", *self.variables),
            ),
        )

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


@dataclass(frozen=True)
class MeasuredOutput(Functional):
    """An output at the times of a measurement; its value is an array."""

    is_scalar: ClassVar[bool] = False

    def of_motion(self, history: History, peak: Peak | None) -> Array:  # type: ignore[override]
        assert self.measurement is not None
        return self._values_at(history, self.measurement.times)


@dataclass(frozen=True)
class Target:
    """A measured value of a functional, with its standard deviation."""

    functional: Functional
    value: float
    deviation: float


def measured_outputs(measured: Mapping[str, Measurement]) -> list[MeasuredOutput]:
    """The functionals of measured outputs."""
    return [
        MeasuredOutput(name, "value", name, measurement=values)
        for name, values in measured.items()
    ]


@dataclass(frozen=True, eq=False)
class Fit:
    """Numbers that fit measurements best.

    Attributes
    ----------
    x : (n,) values of the variables
    deviations : (n,) standard deviations
    half_widths : (n,) of the 95 % intervals
    correlation : (n, n)
    noises : standard deviation of each measured output about the fit
    autocorrelations : of the residuals of each output, of neighbours in time
    values : (m,) fitted values of outputs and targets
    freedoms : measured values less variables
    converged : True if the tolerance was reached
    message : why the fit ended
    """

    x: Array
    deviations: Array
    half_widths: Array
    correlation: Array
    noises: Array
    autocorrelations: Array
    values: Array
    freedoms: int
    converged: bool
    message: str


def fit(
    evaluation: Evaluation,
    outputs: Sequence[MeasuredOutput],
    targets: Sequence[Target],
    start: Array,
    bounds: tuple[Array, Array],
    tolerance: float = 1e-8,
) -> Fit:
    """Fit variables to measured outputs and targets.

    Parameters
    ----------
    evaluation : values of all outputs at their times, then of all targets
    start : (n,) first values of the variables
    bounds : least and largest values, (n,) each
    tolerance : relative change at which the fit ends

    Raises
    ------
    InputError : there are fewer measured values than variables.
    """
    data = [o.measurement.values for o in outputs if o.measurement is not None]
    counts = [len(values) for values in data]
    edges = np.cumsum([0, *counts])
    parts = [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    measured = np.concatenate([*data, [target.value for target in targets]])
    freedoms = len(measured) - len(start)
    if freedoms < 0 or (freedoms == 0 and outputs):
        raise InputError(
            f"{len(measured)} measured values", expected=f"more than {len(start)}"
        )
    least = np.array([LEAST_NOISE * (np.ptp(v) or abs(v).max() or 1.0) for v in data])
    noises = np.array([np.ptp(v) or abs(v).max() or 1.0 for v in data])
    deviations = [target.deviation for target in targets]
    x = np.asarray(start, float)
    for _ in range(MAX_PASSES):
        weights = 1.0 / np.concatenate([np.repeat(noises, counts), deviations])
        found = least_squares(
            lambda x, w=weights: w * (evaluation.value(x) - measured),
            x,
            jac=lambda x, w=weights: w[:, None] * evaluation.derivative(x),
            bounds=bounds,
            x_scale="jac",
            xtol=tolerance,
            ftol=tolerance,
            gtol=tolerance,
        )
        x = found.x
        residuals = evaluation.value(x) - measured
        share = freedoms / max(1, len(measured))
        new = [np.sqrt(np.mean(residuals[p] ** 2) / share) for p in parts]
        before, noises = noises, np.maximum(new, least)
        if len(noises) < 2 or (abs(noises - before) < WEIGHT_TOLERANCE * noises).all():
            break
    weights = 1.0 / np.concatenate([np.repeat(noises, counts), deviations])
    J = weights[:, None] * evaluation.derivative(x)
    covariance, correlation = _covariance(J)
    standard = np.sqrt(covariance)
    quantile = student.ppf(0.5 + 0.5 * CONFIDENCE, freedoms) if outputs else 1.96
    return Fit(
        x=x,
        deviations=standard,
        half_widths=quantile * standard,
        correlation=correlation,
        noises=noises,
        autocorrelations=np.array([_autocorrelation(residuals[p]) for p in parts]),
        values=residuals + measured,
        freedoms=freedoms,
        converged=bool(found.success),
        message=str(found.message),
    )


def _covariance(J: Array) -> tuple[Array, Array]:
    """Variances and correlations of the variables; infinite without influence."""
    size = np.linalg.norm(J, axis=0)
    scaled = J / np.where(size > 0.0, size, 1.0)
    _, s, Vt = np.linalg.svd(scaled, full_matrices=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        weights = np.where(s > 1e-12 * s[0], 1.0 / s**2, np.inf)
        inverse = (Vt.T * np.minimum(weights, 1e300)) @ Vt
        variances = np.where(size > 0.0, np.diag(inverse) / size**2, np.inf)
        spread = np.sqrt(np.diag(inverse))
        correlation = inverse / np.outer(spread, spread)
    return variances, correlation


def _autocorrelation(residuals: Array) -> float:
    """Correlation of residuals with their neighbours in time."""
    total = float(residuals @ residuals)
    return float(residuals[1:] @ residuals[:-1]) / total if total > 0.0 else 0.0


def parse_target(text: str, scene: SceneFile) -> Target:
    """Parse a text FUNCTIONAL=VALUE+-DEVIATION.

    Raises
    ------
    InputError : it has another form.
    """
    of, _, rest = text.rpartition("=")
    value, _, deviation = rest.partition("+-")
    try:
        numbers = real_of_text(value), real_of_text(deviation)
    except ValueError:
        numbers = np.nan, np.nan
    if not (of and np.isfinite(numbers).all() and numbers[1] > 0.0):
        raise InputError(
            f"found {text!r}",
            place="--target",
            expected="FUNCTIONAL=VALUE+-DEVIATION, such as frequency(1)=12.3+-0.1",
        )
    functionals = parse_functionals([of], scene.folder)
    return Target(functionals[0], *numbers)
