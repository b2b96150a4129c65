"""Optimisation of a design: scaled variables, objective and limits for SciPy.

Variables are scaled by their ranges, the objective by its value at the start, each
limit by its size, so that tolerances are relative.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from scipy.optimize import BFGS, NonlinearConstraint, minimize

from sidtool.formats.base.sid import Array
from sidtool.formats.design import DesignFile, VariableRange
from sidtool.solver.system.errors import SimulationError

#: A limit is kept, or reached, within this part of its size, or the tolerance of the
#: method, whose constraints are as exact.
LIMIT_TOLERANCE = 1e-4
#: Value of the scaled objective, and of scaled limits, where a run fails.
FAILED = 1e3
#: Message of SLSQP where the objective does not fall along its gradient.
_NO_DESCENT = 8


class Evaluation(Protocol):
    """Values of functionals and their derivatives at values of the variables."""

    def value(self, x: Array) -> Array:
        """Values of all functionals, (m,)."""

    def derivative(self, x: Array) -> Array:
        """Their derivatives, (m, n)."""


@dataclass(frozen=True)
class Iteration:
    """One point of the way to an optimum.

    Attributes
    ----------
    x : values of the variables
    values : values of the functionals
    """

    x: tuple[float, ...]
    values: tuple[float, ...]


@dataclass
class Search:
    """A search for the optimum of a design.

    Attributes
    ----------
    functionals : objective first, then those of limits
    history : points that were reached
    message : why it ended
    converged : True if the tolerance was reached
    """

    design: DesignFile
    functionals: Sequence[str]
    evaluation: Evaluation
    start: Array
    report: Callable[[Iteration], None]
    history: list[Iteration] = field(default_factory=list)
    message: str = ""
    converged: bool = False

    def __post_init__(self) -> None:
        ranges = [*self.design.variables.values()]
        self.low, self.high = bounds(ranges)
        self.size = np.array(
            [_size(r, x) for r, x in zip(ranges, self.start, strict=True)]
        )
        objective = self.design.objective
        self.sign = 1.0 if objective.minimise is not None else -1.0
        self.limits = [
            (self.functionals.index(limit.of), sign, value)
            for limit in self.design.limits
            for sign, value in ((1.0, limit.min), (-1.0, limit.max))
            if value is not None
        ]

    # Scaled functions

    def _unscaled(self, u: Array) -> Array:
        return np.clip(self.start + u * self.size, self.low, self.high)

    def _values(self, u: Array) -> Array | None:
        """Values of the functionals; None if the run fails."""
        try:
            return self.evaluation.value(self._unscaled(u))
        except SimulationError:
            if not self.history:
                raise
            return None

    def _objective(self, u: Array) -> float:
        values = self._values(u)
        return FAILED if values is None else float(self.scale * values[0])

    def _slope(self, u: Array) -> Array:
        derivatives = self.evaluation.derivative(self._unscaled(u))
        return np.asarray(self.scale * derivatives[0] * self.size)

    def _margins(self, u: Array) -> Array:
        """How far limits are kept, relative to their sizes; negative beyond."""
        values = self._values(u)
        if values is None:
            return np.full(len(self.limits), -FAILED)
        return self.margins(values)

    def margins(self, values: Array) -> Array:
        """How far limits are kept by values, relative to their sizes."""
        found = [
            sign * (values[k] - limit) / self._limit_size(k, limit)
            for k, sign, limit in self.limits
        ]
        return np.array(found)

    def _limit_size(self, k: int, limit: float) -> float:
        return abs(limit) or abs(self.first[k]) or 1.0

    def _margin_slopes(self, u: Array) -> Array:
        derivatives = self.evaluation.derivative(self._unscaled(u))
        rows = [
            sign * derivatives[k] * self.size / self._limit_size(k, limit)
            for k, sign, limit in self.limits
        ]
        return np.array(rows).reshape(len(self.limits), len(self.size))

    # Search

    def run(self) -> None:
        """Search from the start.

        Raises
        ------
        InputError, SimulationError : the start cannot be run, or a derivative does not
            exist.
        """
        self.first = self.evaluation.value(self.start)
        self.scale = self.sign / (abs(self.first[0]) or 1.0)
        self._add(np.zeros(len(self.start)))
        method = self.design.method
        low, high = (
            (self.low - self.start) / self.size,
            (self.high - self.start) / self.size,
        )
        common: dict[str, Any] = {
            "x0": np.zeros(len(self.start)),
            "jac": self._slope,
            "bounds": np.column_stack([low, high]),
        }
        if method.name == "slsqp":
            self._slsqp(common, method.tolerance, method.iterations)
        else:
            self._trust_region(common, method.tolerance, method.iterations)

    def _slsqp(
        self, common: Mapping[str, Any], tolerance: float, iterations: int
    ) -> None:
        constraint = {
            "type": "ineq",
            "fun": self._margins,
            "jac": self._margin_slopes,
        }
        found = minimize(
            self._objective,
            method="SLSQP",
            constraints=[constraint] if self.limits else [],
            callback=self._add,
            options={"ftol": tolerance, "maxiter": iterations},
            **common,
        )
        self.message = str(found.message)
        self.converged = bool(found.success) or (
            found.status == _NO_DESCENT and self._is_settled(math.sqrt(tolerance))
        )
        self._add(found.x)

    def _trust_region(
        self, common: Mapping[str, Any], tolerance: float, iterations: int
    ) -> None:
        constraint = NonlinearConstraint(
            self._margins, 0.0, np.inf, jac=self._margin_slopes, hess=BFGS()
        )
        options = {
            "gtol": tolerance,
            "xtol": tolerance,
            "maxiter": iterations,
            "initial_barrier_parameter": tolerance,
            "initial_barrier_tolerance": tolerance,
        }
        with warnings.catch_warnings():
            # SciPy warns that functions look linear.
            warnings.filterwarnings("ignore", "delta_grad == 0.0", UserWarning)
            found = minimize(
                self._objective,
                method="trust-constr",
                constraints=[constraint] if self.limits else [],
                callback=lambda u, _: self._add(u),
                options=options,
                **common,
            )
        self.message, self.converged = str(found.message), found.status in (1, 2)
        self._add(found.x)

    def _is_settled(self, tolerance: float) -> bool:
        """True if the objective hardly changed in the last iteration."""
        if len(self.history) < 2:
            return False
        last, before = (point.values[0] for point in self.history[-1:-3:-1])
        return bool(abs(last - before) * abs(self.scale) < tolerance)

    def _add(self, u: Array) -> None:
        x = self._unscaled(np.asarray(u))
        if self.history and np.array_equal(x, self.history[-1].x):
            return
        values = self.evaluation.value(x)
        point = Iteration(tuple(map(float, x)), tuple(map(float, values)))
        self.history.append(point)
        self.report(point)

    @property
    def best(self) -> Iteration:
        """The best point that keeps all limits, or that keeps them best."""

        def rank(point: Iteration) -> tuple[float, float]:
            margins = self.margins(np.array(point.values))
            room = limit_tolerance(self.design)
            excess = max(0.0, -float(margins.min(initial=0.0)) - room)
            return excess, self.sign * point.values[0]

        return min(self.history, key=rank)


def limit_tolerance(design: DesignFile) -> float:
    """Part of the size of a limit by which it may be exceeded."""
    return max(LIMIT_TOLERANCE, design.method.tolerance)


def bounds(ranges: Sequence[VariableRange]) -> tuple[Array, Array]:
    """Least and largest values of variables, infinite without a limit."""
    low = [-np.inf if r.min is None else r.min for r in ranges]
    high = [np.inf if r.max is None else r.max for r in ranges]
    return np.array(low), np.array(high)


def _size(given: VariableRange, x: float) -> float:
    if given.min is not None and given.max is not None:
        return float(given.max - given.min)
    return abs(float(x)) or 1.0
