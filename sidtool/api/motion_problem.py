"""A scene with variables and functionals, run at values of the variables and beside.

`sidtool.sensitivity`, `sidtool.gradient`, `sidtool.optimise` and `sidtool.identify` are
made of it.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import itemgetter
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.scene import SceneFile
from sidtool.formats.storage.operating_system import processors
from sidtool.formats.toml.files import locate_errors
from sidtool.solver.initial_state.integrator_start import run_settings
from sidtool.solver.simulation.frozen_run import (
    Grid,
    StructureChange,
    record_grid,
    record_motion,
    run_on_grid,
)
from sidtool.solver.simulation.linearised_run import NotLinearisable
from sidtool.solver.system.errors import SimulationError
from sidtool.solver.system.system import System

from ..sensitivity.differences import (
    CENTRAL,
    GOOD_ERROR,
    Difference,
    differentiate,
    rounding_of,
)
from ..sensitivity.functionals import Functional, Term, recorded_outputs
from ..sensitivity.history import History
from ..sensitivity.sensitivity_result import Sensitivities
from ..sensitivity.variables import (
    Variable,
    model_changes,
    model_offsets,
    scene_changes,
)
from .compiled_scene import CompiledScene, Sids, map_in_threads
from .linearised_point import (
    AUTO,
    DIFFERENCES,
    METHODS,
    Failure,
    LinearisedPoint,
    SidDerivative,
    combined,
)
from .varied_bodies import VariedBody, varied_models

Programs = Mapping[str, Any]

#: Estimated error of a derivative, relative to its size, above which it is reported.
LARGE_ERROR = 1e-3
#: Changes of a functional that matter not, relative to its size, for a change of a
#: variable of its own size.
NEGLIGIBLE = 1e-3
#: Tolerance of runs of optimisations and fits: values must not jump with the steps by
#: more than these resolve.
RTOL = 1e-8
#: Derivatives of two peaks differ by more than this part of them.
DIFFERENT = 0.01


@dataclass(frozen=True)
class RunOptions:
    """How runs are made, as of `sidtool.simulate`.

    Attributes
    ----------
    sids : SIDs that replace those of the scene, by body
    integrator, rtol, step : replace those of the scene
    jobs : number of threads, default the processors of this process
    programs : callables for drives and for forces, by name
    method : of derivatives, one of `linearised_point.METHODS`
    """

    sids: Sids | None = None
    integrator: str | None = None
    rtol: float | None = None
    step: float | None = None
    jobs: int | None = None
    programs: tuple[Programs | None, Programs | None] = (None, None)
    method: str = AUTO


class Problem:
    """A scene with variables and functionals, compiled once.

    Attributes
    ----------
    scene : with the outputs that the functionals need
    variables, functionals : parsed
    x0 : (n,) values of the variables in the scene
    steps : steps of differences that were found, by variable
    noise : rounding of all terms of a point, None where it is not known yet
    """

    def __init__(
        self,
        scene: SceneFile,
        variables: Sequence[Variable],
        functionals: Sequence[Functional],
        settings: RunOptions,
    ) -> None:
        self.settings = settings
        self.functionals, self.variables = [*functionals], [*variables]
        sids, programs, jobs = settings.sids, settings.programs, settings.jobs
        with locate_errors(scene):
            given_sids = dict(sids or {})
            self.models = varied_models(scene, self.variables, given_sids)
            record = recorded_outputs(self.functionals)
            self.scene = _with_outputs(scene, record)
            self._bodies = self.bodies(np.array([v.value for v in self.variables]))
            given_sids |= {name: body.sid for name, body in self._bodies.items()}
            self.compiled = CompiledScene(
                self.scene, sids=given_sids, drives=programs[0], forces=programs[1]
            )
        if settings.method not in METHODS:
            expected = f"one of {', '.join(METHODS)}"
            raise InputError(f"method is {settings.method!r}", expected=expected)
        if jobs is not None and jobs < 1:
            raise InputError(f"jobs is {jobs}", expected="a positive number")
        sequential = bool(self.compiled.system_with({}).natives)
        self.jobs = 1 if sequential else jobs or processors()
        self.x0 = np.array([v.value for v in self.variables])
        self.steps: dict[str, float] = {}
        self.noise: Array | None = None

    @property
    def needs_motion(self) -> bool:
        return any(f.needs_motion for f in self.functionals)

    @cached_property
    def unit_sizes(self) -> dict[str, float]:
        """Sizes of numbers that are 0, by unit; 1 for others."""
        length, span = self.compiled.system_with({}).length, self.scene.time
        duration = span.end - span.start
        per_second = {"m/s": length / duration, "rad/s": 1.0 / duration}
        return {"m": length, "s": duration} | per_second

    def bodies(self, x: Array) -> dict[str, VariedBody]:
        """Bodies with variables of their models, by name.

        Raises
        ------
        InputError : a value does not fit, or a model cannot be converted.
        """
        found = {}
        for name, model in self.models.items():
            changes = model_changes(self.variables, x, name)
            found[name] = VariedBody(model.with_(changes), [*changes])
        return found

    def system(self, x: Array, sids: Mapping[str, SID]) -> System:
        """The compiled scene with values of the variables.

        Parameters
        ----------
        sids : of the bodies with variables of their models

        Raises
        ------
        InputError : a value does not fit.
        """
        pairs = [*zip(self.variables, x.tolist(), strict=True)]
        moved = [(one, value) for one, value in pairs if value != one.value]
        changes = scene_changes([v for v, _ in moved], np.array([y for _, y in moved]))
        return self.compiled.system_with(changes, sids)

    def at(self, x: Array) -> Point:
        """Run the scene with values of the variables.

        Raises
        ------
        InputError, SimulationError : as `simulate`.
        """
        with locate_errors(self.scene):
            bodies = self._bodies
            if not np.array_equal(x, self.x0):
                bodies = self.bodies(x)
            system = self.system(x, {n: body.sid for n, body in bodies.items()})
            grid, history, runs = None, None, 0
            if self.needs_motion:
                given = self.settings
                chosen = run_settings(
                    system, given.integrator, given.rtol, given.step, None
                )
                if given.method == DIFFERENCES:
                    grid = record_grid(system, chosen)
                    motion, runs = run_on_grid(system, grid), 2
                else:
                    grid, motion, runs = record_motion(system, chosen)
                history = History(motion)
            terms = _terms(self.functionals, history)
            values = [term.value(system, history) for term in terms]
            pairs = zip(terms, values, strict=True)
            scales = [t.functional.scale(history, v) for t, v in pairs]
        sizes = tuple(map(len, values))
        joined = np.concatenate(values), np.concatenate(scales), sizes
        x = np.asarray(x, float)
        return Point(self, x, bodies, grid, history, terms, *joined, runs)


def _with_outputs(scene: SceneFile, record: Sequence[str]) -> SceneFile:
    """The scene with other outputs.

    Raises
    ------
    InputError : there is no such output.
    """
    try:
        return scene.with_({"outputs.record": list(record)})
    except InputError as error:
        if not (error.place or "").startswith("outputs."):
            raise
        # Requested by a functional: not a mistake of the scene.
        raise InputError(
            error.problem, place="functionals", expected=error.expected
        ) from None


def _terms(functionals: Sequence[Functional], history: History | None) -> list[Term]:
    """A term for each functional, then their other peaks."""
    peaks = [[] if history is None else f.peaks(history) for f in functionals]
    terms = [
        Term(f, found[0] if found else None)
        for f, found in zip(functionals, peaks, strict=True)
    ]
    for k, found in enumerate(peaks):
        terms += [Term(functionals[k], rival, k) for rival in found[1:]]
    return terms


@dataclass(eq=False)
class Point:
    """Values of the functionals at values of the variables, and their neighbours.

    Attributes
    ----------
    x : (n_variables,) values of the variables
    bodies : bodies with variables of their models, by name
    grid, history : of the run
    terms : functionals, then their other peaks
    all_values, scales : (n,) values of all terms, and their sizes
    sizes : number of values of each term
    runs : made for the values and for their rounding; a single one was not made as
        those of neighbours
    """

    problem: Problem
    x: Array
    bodies: Mapping[str, VariedBody]
    grid: Grid | None
    history: History | None
    terms: Sequence[Term]
    all_values: Array
    scales: Array
    sizes: tuple[int, ...]
    runs: int

    @property
    def n_values(self) -> int:
        """Number of values of the functionals."""
        return sum(self.sizes[: len(self.problem.functionals)])

    @property
    def rtol(self) -> float:
        """Tolerance of the run, NaN without one or with fixed steps."""
        settings = None if self.grid is None else self.grid.settings
        if settings is None or settings.step is not None:
            return np.nan
        return settings.rtol

    @property
    def values(self) -> Array:
        """Values of the functionals, (n_values,)."""
        return self.all_values[: self.n_values]

    def neighbour(self, x: Array) -> Array:
        """Values of the terms at neighbouring values of the variables.

        Raises
        ------
        StructureChange : the run has other events.
        InputError, SimulationError : as `simulate`.
        """
        system, history = self._system(x), None
        if self.grid is not None:
            history = History(run_on_grid(system, self.grid))
        return np.concatenate([term.value(system, history) for term in self.terms])

    def _system(self, x: Array) -> System:
        """The scene at neighbouring values of the variables."""
        variables, changes = self.problem.variables, x - self.x
        sids = {
            name: body.neighbour(model_offsets(variables, changes, name))
            for name, body in self.bodies.items()
        }
        return self.problem.system(x, sids)

    def neighbour_along(self, direction: Array, step: float) -> System:
        """The scene with the variables changed by a step along a direction.

        Raises
        ------
        InputError : they do not fit.
        """
        with locate_errors(self.problem.scene):
            return self._system(self.x + step * direction)

    def model_derivatives(self, k: int) -> list[SidDerivative]:
        """Derivatives of SIDs by a variable; none of one that changes the scene."""
        entries = self.problem.variables[k].entries
        if any(not entry.body for entry in entries):
            return []
        bodies = self.bodies
        return [
            SidDerivative(e.body, bodies[e.body].derivative(e.model_key), e.factor)
            for e in entries
        ]

    def by_entries(self) -> tuple[Point, Array]:
        """The point with each number that the variables change as a variable, and the
        derivatives of these numbers by the variables, (n_variables, numbers).
        """
        variables = self.problem.variables
        entries = {entry.key: entry for v in variables for entry in v.entries}
        columns = {key: k for k, key in enumerate(entries)}
        factors = np.zeros((len(variables), len(entries)))
        rows = [k for k, variable in enumerate(variables) for _ in variable.entries]
        listed = [entry for variable in variables for entry in variable.entries]
        places = rows, [columns[entry.key] for entry in listed]
        np.add.at(factors, places, [entry.factor for entry in listed])
        changes = self.x - [variable.value for variable in variables]
        values = [entry.value for entry in entries.values()] + changes @ factors
        units = {entry.key: v.unit for v in variables for entry in v.entries}
        numbers = [
            Variable(key, entry.value, units[key], (entry._replace(factor=1.0),))
            for key, entry in entries.items()
        ]
        problem = copy.copy(self.problem)
        problem.variables, problem.x0, problem.steps = numbers, values, {}
        return replace(self, problem=problem, x=values), factors

    def without_motion(self) -> Point:
        """The point with the terms alone that need no motion."""
        kept = [not term.functional.needs_motion for term in self.terms]
        values = np.repeat(kept, self.sizes)
        pairs = zip(self.terms, self.sizes, kept, strict=True)
        rows = [(term, n) for term, n, is_kept in pairs if is_kept]
        return replace(
            self,
            grid=None,
            history=None,
            terms=[term for term, _ in rows],
            all_values=self.all_values[values],
            scales=self.scales[values],
            sizes=tuple(n for _, n in rows),
        )

    def differences(
        self,
        good: float = GOOD_ERROR,
        progress: Callable[[str, int, int], None] | None = None,
    ) -> tuple[list[Difference | Failure], str]:
        """Derivatives of all terms by each variable, or why there is none, and why
        derivatives are not those of the linearised run, or empty.

        Parameters
        ----------
        good : error of a derivative by differences, relative to its size, that is small
            enough
        progress : called with a variable, its number and the number of all

        Raises
        ------
        InputError : the method that was requested is not available.
        """
        numbers, method = range(len(self.x)), self.problem.settings.method
        found: list[Difference | Failure] = [StructureChange("")] * len(numbers)
        reason = "as requested" if method == DIFFERENCES else ""
        if self.history is not None and method != DIFFERENCES:
            try:
                found = self._linearised_differences(method)
            except NotLinearisable as why:
                reason = why.reason
                if method != AUTO:
                    raise InputError(
                        f"cannot linearise {reason}", place="method", expected=AUTO
                    ) from None
        for k, one in enumerate(found):
            if isinstance(one, Difference):
                continue
            if progress is not None:
                progress(self.problem.variables[k].name, k, len(self.x))
            reason = reason or str(one)
            try:
                found[k] = self.difference(k, good)
            except (StructureChange, InputError, SimulationError) as why:
                found[k] = why
        return found, reason

    def _linearised_differences(self, method: str) -> list[Difference | Failure]:
        """Derivatives about the linearised run, by variables or by the numbers that
        they change, whichever are fewer.

        Raises
        ------
        NotLinearisable : the run has something that is not linearised.
        """
        numbers, factors = self.by_entries()
        if len(numbers.x) >= len(self.x):
            return LinearisedPoint(self, method).differences(range(len(self.x)))
        found = LinearisedPoint(numbers, method).differences(range(len(numbers.x)))
        return combined(found, factors)

    def difference(self, k: int, good: float = GOOD_ERROR) -> Difference:
        """Derivatives of all terms by one variable.

        Parameters
        ----------
        good : error of a derivative, relative to its size, that is small enough

        Raises
        ------
        StructureChange, InputError, SimulationError : there are none.
        """
        problem, variable = self.problem, self.problem.variables[k]
        size = self.size(k)
        found = differentiate(
            self._along(k),
            self.x[k],
            size,
            self._frozen_values,
            NEGLIGIBLE * self.scales / size,
            self._noise(k),
            problem.steps.get(variable.name, 0.0),
            good,
        )
        problem.steps[variable.name] = found.step
        return found

    def sensitivities(
        self, progress: Callable[[str, int, int], None] | None = None
    ) -> Sensitivities:
        """Derivatives by all variables."""
        problem, started = self.problem, time.perf_counter()
        all_found, reason = self.differences(progress=progress)
        diagnostics = list[Diagnostic]()
        if self.grid is not None and not np.isnan(self.grid.singular_time):
            diagnostics.append(diagnose("N738", t=self.grid.singular_time))
        runs, methods = self.runs, dict[str, str]()
        none = np.full(len(self.all_values), np.nan)
        derivatives, errors = [none] * len(all_found), [none] * len(all_found)
        pairs = zip(problem.variables, all_found, strict=True)
        for k, (variable, found) in enumerate(pairs):
            if not isinstance(found, Difference):
                diagnostics.append(diagnose("N735", variable.name, reason=str(found)))
                continue
            methods[variable.name] = found.method
            runs += found.runs
            derivatives[k], errors[k] = found.derivatives, found.errors
        table, error_table = np.array(derivatives).T, np.array(errors).T
        diagnostics += self.warnings(table, error_table)
        count = len(self.values)
        scene = problem.scene
        units = {f.text: f.unit(scene) for f in problem.functionals}
        return Sensitivities(
            functionals=tuple(f.text for f in problem.functionals),
            variables=tuple(v.name for v in problem.variables),
            values=self.values,
            point=self.x,
            derivatives=table[:count],
            errors=error_table[:count],
            units=units | {v.name: v.unit for v in problem.variables},
            runs=runs,
            seconds=time.perf_counter() - started,
            rtol=self.rtol,
            methods=methods,
            reason=reason,
            diagnostics=tuple(diagnostics),
            title=scene.title,
        )

    @cached_property
    def _frozen_values(self) -> Array:
        """Values of the terms of a run that is made as those of neighbours."""
        if self.grid is None or self.runs > 1:
            return self.all_values
        self.runs += 1
        return self.neighbour(self.x)

    def _noise(self, k: int) -> Array:
        """Rounding of all terms, measured once along a variable."""
        noise = self.problem.noise
        if noise is None or noise.shape != self.all_values.shape:
            size = self.size(k)
            try:
                values = self._frozen_values
                noise = rounding_of(self._along(k), self.x[k], size, values)
            except (StructureChange, InputError, SimulationError):
                return np.zeros_like(self.all_values)
            self.problem.noise = noise
            self.runs += len(CENTRAL)
        return noise

    def _along(self, k: int) -> Callable[[Sequence[float]], list[Array]]:
        """Values of the terms where one variable is varied."""

        def evaluate(values: Sequence[float]) -> list[Array]:
            points = []
            for value in values:
                point = self.x.copy()
                point[k] = value
                points.append(point)
            jobs = self.problem.jobs
            return [*map_in_threads(lambda x, _: self.neighbour(x), points, jobs)]

        with locate_errors(self.problem.scene):
            return evaluate

    def size(self, k: int) -> float:
        """Size of a variable: its value, or where that is 0 one by its unit."""
        variable, value = self.problem.variables[k], float(self.x[k])
        if value != 0.0:
            return abs(value)
        return self.problem.unit_sizes.get(variable.unit, 1.0)

    def warnings(self, derivatives: Array, errors: Array) -> list[Diagnostic]:
        """What is doubtful of the derivatives by all variables (N736, N737).

        Parameters
        ----------
        derivatives, errors : (terms, n_variables), NaN where there are none
        """
        if self.n_values > len(self.problem.functionals):
            return []  # single values of a history
        variables = self.problem.variables
        sizes = np.array([self.size(k) for k in range(len(variables))])
        least = NEGLIGIBLE * self.scales[:, None] / sizes
        size = np.maximum(np.abs(derivatives), least)
        found = list[tuple[int, Diagnostic]]()
        relative = (errors / size)[: self.n_values]
        for i, k in np.argwhere(relative > LARGE_ERROR).tolist():
            of, error = self.problem.functionals[i].text, float(relative[i, k])
            text = diagnose("N737", variables[k].name, of=of, error=error)
            found.append((k, text))
        for i, term in enumerate(self.terms):  # other peaks with other derivatives
            own = term.rival_of
            if own < 0:
                continue
            difference = np.abs(derivatives[i] - derivatives[own])
            difference /= np.maximum(size[i], size[own])
            for k in np.flatnonzero(difference > DIFFERENT).tolist():
                of, away = term.functional.text, float(difference[k])
                text = diagnose("N736", variables[k].name, of=of, difference=away)
                found.append((k, text))
        return [each for _, each in sorted(found, key=itemgetter(0))]
