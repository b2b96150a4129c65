"""Values and derivatives of a problem for searches, with the last points kept."""

from collections.abc import Callable

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose

from ..sensitivity.differences import GOOD_ERROR, Difference
from .motion_problem import Point, Problem

#: Points of which runs are kept.
KEPT_POINTS = 20


class CachedProblem:
    """Values and derivatives of a problem; the last points are kept.

    Attributes
    ----------
    runs : runs made so far
    """

    def __init__(
        self,
        problem: Problem,
        good: float = GOOD_ERROR,
        progress: Callable[[Array, Array], None] | None = None,
    ) -> None:
        """Parameters
        ----------
        good : error of a derivative, relative to its size, that is small enough
        progress : called with variables and values of each new point
        """
        self._problem, self._good, self._progress = problem, good, progress
        self._points: dict[bytes, Point] = {}
        self._derivatives: dict[bytes, Array] = {}
        self.runs = 0
        self._warnings: dict[tuple[str, str], Diagnostic] = {}

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """The last one of each code for each variable."""
        return tuple(self._warnings.values())

    def _point(self, x: Array) -> Point:
        key = x.tobytes()
        if key not in self._points:
            if len(self._points) >= KEPT_POINTS:
                self._points.pop(next(iter(self._points)))
            point = self._points[key] = self._problem.at(x)
            self.runs += point.runs
            if self._progress is not None:
                self._progress(x, point.values)
        return self._points[key]

    def value(self, x: Array) -> Array:
        """Values of the functionals, (m,)."""
        return self._point(x).values

    def derivative(self, x: Array) -> Array:
        """Derivatives of the functionals by the variables, (m, n).

        Raises
        ------
        InputError : a derivative does not exist.
        """
        key = x.tobytes()
        if key not in self._derivatives:
            point, columns, errors = self._point(x), [], []
            for k, found in enumerate(point.differences(self._good)[0]):
                if isinstance(found, InputError):
                    raise found
                if not isinstance(found, Difference):
                    name = self._problem.variables[k].name
                    problem = diagnose("N735", name, reason=str(found))
                    raise InputError(problem.message, place=name)
                self.runs += found.runs
                columns.append(found.derivatives)
                errors.append(found.errors)
            table = np.column_stack(columns)
            for each in point.warnings(table, np.column_stack(errors)):
                self._warnings[each.code, each.subject] = each
            self._derivatives = {key: table[: point.n_values]}
        return self._derivatives[key]
