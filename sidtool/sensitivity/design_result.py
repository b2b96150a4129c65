"""Result of an optimisation: the best design, and the way to it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.html import html_table
from sidtool.formats.base.sid import Array
from sidtool.formats.design import DesignFile
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.file_names import kind_by_ending

from .optimisation import LIMIT_TOLERANCE, Iteration, bounds, limit_tolerance

#: `format` of files of histories.
HISTORY_FORMAT = "sidtool optimisation"


@dataclass(frozen=True, kw_only=True, eq=False)
class Optimum:
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
        from sidtool.formats.text import counted_noun

        from ..report.tables import text_table

        end = "Converged" if self.converged else f"Not converged: {self.message}"
        cost = f"{counted_noun(len(self.history) - 1, 'iteration')}, {self.runs} runs"
        parts = [
            text_table(self._VARIABLES, self._variable_rows()),
            "",
            text_table(self._FUNCTIONALS, self._functional_rows()),
            "",
            f"{end}. {cost}, {self.seconds:.2g} s.",
            "",
            *self._settings(),
        ]
        return "\n".join(parts)

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

    def _settings(self) -> list[str]:
        """Options of the command line that make the best design."""
        lines = []
        if self.changes:
            options = [f"--set {key}={value!r}" for key, value in self.changes.items()]
            lines.append(f"Scene: {' '.join(options)}")
        for body, changes in self.model_changes.items():
            options = [f"--set {key}={value!r}" for key, value in changes.items()]
            lines.append(f"Model of {body}: {' '.join(options)}")
        return lines

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
        from ..plot.designs import plot_history
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

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the history (.json), or its picture (.png, .svg, .pdf).

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
