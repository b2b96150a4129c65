"""Identification of numbers of a scene from measured motions: least squares.

The noise of each output is not known: it is estimated from its residuals, and the
squares are weighted by it. With J the derivatives of the weighted residuals the
covariance of the numbers is (J^T J)^-1; intervals follow from Student's distribution.

Reference
---------
G. A. F. Seber, C. J. Wild: Nonlinear Regression. Wiley (1989), sections 2.1 and 5.1.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import SceneFile

from .functionals import Functional, History, Peak, parse_functionals
from .measurements import Measurement
from .optimisation import Evaluation

#: Share of intervals that contain the true value.
CONFIDENCE = 0.95
#: Weights are estimated anew until noises change by less than this part, so often at
#: most.
WEIGHT_TOLERANCE, MAX_PASSES = 1e-3, 5
#: Residuals of one output below this part of its range are rounding.
LEAST_NOISE = 1e-9


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
        numbers = float(value), float(deviation)
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
