"""Optimisation of a design: scaled variables, objective and limits for SciPy.

Variables are scaled by their ranges, the objective by its value at the start, each
limit by its size, so that tolerances are relative.

Result of an optimisation: the best design, and the way to it.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from scipy.optimize import BFGS, NonlinearConstraint, minimize

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.html import html_table
from sidtool.formats.base.sid import Array
from sidtool.formats.design import DesignFile, VariableRange
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.text import counted_noun
from sidtool.solver.system.errors import SimulationError

from .search_result import SearchResult

#: `format` of files of histories.
HISTORY_FORMAT = "sidtool optimisation"

#: A limit is kept, or reached, within this part of its size, or the tolerance of the
#: method, whose constraints are as exact.
LIMIT_TOLERANCE = 1e-4
#: Value of the scaled objective, and of scaled limits, where a run fails.
FAILED = 1e3
#: Message of SLSQP where the objective does not fall along its gradient.
_NO_DESCENT = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class Optimum(SearchResult):
    """The best design that was found.

        found = sidtool.optimise("design.toml")
        found.x["thickness"], found.values["mass(rod)"], found.changes

    Attributes
    ----------
    design : the design file
    best : values of variables and functionals
    history : points on the way, the start first
    functionals : objective first, then those of limits
    changes : of the scene, by keys as in `Scene.with_`
    model_changes : of models by body, by keys as in `Model.with_`
    converged : True if the tolerance was reached
    message : why it ended
    units : of variables and functionals
    runs, seconds : that it took
    diagnostics : of the derivatives
    """

    design: DesignFile
    best: Iteration
    history: tuple[Iteration, ...]
    functionals: tuple[str, ...]
    changes: Mapping[str, float] = field(default_factory=dict)
    model_changes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    converged: bool
    message: str
    units: Mapping[str, str] = field(default_factory=dict)
    runs: int = 0
    seconds: float = 0.0
    diagnostics: tuple[Diagnostic, ...] = ()

    @property
    def x(self) -> dict[str, float]:
        """Values of the variables by their names."""
        return dict(zip(self.design.variables, self.best.x, strict=True))

    @property
    def values(self) -> dict[str, float]:
        """Values of the functionals."""
        return dict(zip(self.functionals, self.best.values, strict=True))

    @property
    def is_feasible(self) -> bool:
        """True if the best design keeps all limits."""
        return all(margin >= -room for *_, margin, room in self._limit_margins())

    def report(self) -> str:
        """Return the result as text, as `sidtool optimise` prints it."""
        from ..report.tables import set_options, text_table

        parts = [
            text_table(self._VARIABLES, self._variable_rows()),
            "",
            text_table(self._FUNCTIONALS, self._functional_rows()),
            "",
            self._end_line(),
            "",
            *set_options(self.changes, self.model_changes),
        ]
        return "\n".join(parts)

    def _end_line(self) -> str:
        end = "Converged" if self.converged else f"Not converged: {self.message}"
        cost = f"{counted_noun(len(self.history) - 1, 'iteration')}, {self.runs} runs"
        return f"{end}. {cost}, {self.seconds:.2g} s."

    _VARIABLES = ("variable", "start", "best", "unit", "range", "")
    _FUNCTIONALS = ("functional", "start", "best", "unit", "limit", "")

    def _variable_rows(self) -> list[tuple[str, ...]]:
        low, high = bounds([*self.design.variables.values()])
        rows: list[tuple[str, ...]] = []
        for k, (name, first) in enumerate(
            zip(self.design.variables, self.history[0].x, strict=True)
        ):
            best, span = self.best.x[k], f"{low[k]:g} to {high[k]:g}"
            room = LIMIT_TOLERANCE * (high[k] - low[k])
            state = "at its bound" if _is_at(best, low[k], high[k], room) else ""
            unit = self.units.get(name, "")
            rows.append((name, f"{first:.6g}", f"{best:.6g}", unit, span, state))
        return rows

    def _functional_rows(self) -> list[tuple[str, ...]]:
        objective = self.design.objective
        role = "minimised" if objective.minimise is not None else "maximised"
        rows = [self._functional_row(0, role, "")]
        for k, word, value, margin, room in self._limit_margins():
            near = max(room, 0.01 * (abs(value) or 1.0))
            state = "reached" if abs(margin) <= near else ""
            state = "exceeded" if margin < -room else state
            rows.append(self._functional_row(k, f"{word} {value:g}", state))
        return rows

    def _limit_margins(self) -> Iterator[tuple[int, str, float, float, float]]:
        """Yield for each limit the number of its functional, "at least" or "at most",
        its value, the distance of the best design from it, negative beyond, and by how
        much it may be exceeded.
        """
        for limit in self.design.limits:
            k = self.functionals.index(limit.of)
            for word, sign, value in (
                ("at least", 1.0, limit.min),
                ("at most", -1.0, limit.max),
            ):
                if value is not None:
                    margin = sign * (self.best.values[k] - value)
                    room = limit_tolerance(self.design) * (abs(value) or 1.0)
                    yield k, word, value, margin, room

    def _functional_row(self, k: int, limit: str, state: str) -> tuple[str, ...]:
        name = self.functionals[k]
        first, best = self.history[0].values[k], self.best.values[k]
        unit = self.units.get(name, "")
        return name, f"{first:.6g}", f"{best:.6g}", unit, limit, state

    def data(self) -> dict[str, Any]:
        """Return the data that `--json` prints, and that `save` writes."""
        names = [*self.design.variables]
        return {
            "format": HISTORY_FORMAT,
            "version": 1,
            "title": self.design.title,
            "converged": self.converged,
            "message": self.message,
            "is_feasible": self.is_feasible,
            "variables": names,
            "functionals": list(self.functionals),
            "units": dict(self.units),
            "best": {"x": self.x, "values": self.values},
            "changes": dict(self.changes),
            "model_changes": {k: dict(v) for k, v in self.model_changes.items()},
            "history": [
                {"x": [*point.x], "values": [*point.values]} for point in self.history
            ],
            "runs": self.runs,
            "seconds": self.seconds,
            "diagnostics": [each.as_data() for each in self.diagnostics],
        }

    def plot(self, path: str | os.PathLike[str] | None = None) -> Any:
        """Return a matplotlib figure: functionals and variables over the iterations.

        path : file to which the figure is written as well (.png, .svg, .pdf)
        """
        from ..plot.studies import plot_history
        from ..report.tables import name_with_unit

        low, high = bounds([*self.design.variables.values()])
        x = np.array([point.x for point in self.history])
        values = np.array([point.values for point in self.history])
        limits = [
            [
                value
                for limit in self.design.limits
                for value in (limit.min, limit.max)
                if limit.of == name and value is not None
            ]
            for name in self.functionals
        ]
        panels = [
            (name_with_unit(name, self.units.get(name, "")), values[:, k], limits[k])
            for k, name in enumerate(self.functionals)
        ]
        for k, name in enumerate(self.design.variables):
            ends = [end for end in (low[k], high[k]) if np.isfinite(end)]
            panels.append(
                (name_with_unit(name, self.units.get(name, "")), x[:, k], ends)
            )
        return plot_history(None if path is None else Path(path), panels)

    def _heading(self) -> str:
        return self.design.title or "Optimisation"

    def _outcome(self) -> tuple[str, bool]:
        exceeded = "" if self.is_feasible else "A limit is exceeded. "
        return exceeded + self._end_line(), self.converged and self.is_feasible

    def _sections(self) -> Iterator[tuple[str, str]]:
        design = self.design
        method = f"{design.method.name}, tolerance {design.method.tolerance:g}"
        rows = [("scene", design.scene), ("method", method)]
        rows += [(key, str(value)) for key, value in design.changes.items()]
        yield "Design", html_table(rows)
        yield "Variables", html_table(self._variable_rows(), self._VARIABLES)
        yield (
            "Objective and limits",
            html_table(self._functional_rows(), self._FUNCTIONALS),
        )
        yield (
            "Iterations",
            html_table(
                (
                    (k, *(f"{x:.6g}" for x in (*point.values, *point.x)))
                    for k, point in enumerate(self.history)
                ),
                ("", *self.functionals, *design.variables),
            ),
        )

    def __repr__(self) -> str:
        state = "converged" if self.converged else "not converged"
        return f"<Optimum {self.design.title!r}: {self.x}, {state}>"

    def _repr_html_(self) -> str:
        return html_table(self._variable_rows(), self._VARIABLES) + html_table(
            self._functional_rows(), self._FUNCTIONALS
        )


def _is_at(value: float, low: float, high: float, room: float) -> bool:
    room = room if np.isfinite(room) else 0.0
    return bool(value <= low + room or value >= high - room)


def write_history(
    path: Path, names: Sequence[str], points: Sequence[Iteration]
) -> None:
    """Write the points so far, from which `--continue` goes on.

    Raises
    ------
    OSError : the file cannot be written.
    """
    from ..report.json_data import write_json

    history = [{"x": [*point.x], "values": [*point.values]} for point in points]
    data = {"format": HISTORY_FORMAT, "version": 1, "variables": [*names]}
    write_json(path, data | {"history": history})


def read_history(path: Path, names: Sequence[str]) -> Array:
    """Return the last point of a history, (n,).

    Raises
    ------
    InputError : the file holds no history of these variables.
    """
    from sidtool.formats.toml.reading import read_data

    data = read_data(path)
    if data.get("format") != HISTORY_FORMAT or data.get("variables") != [*names]:
        raise InputError(
            "is no history of this design",
            source=path,
            expected=f"variables {', '.join(names)}",
        )
    return np.array(data["history"][-1]["x"], float)


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
