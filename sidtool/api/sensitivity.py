"""Derivatives of functionals of a motion by numbers of a scene."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.diagnostics.python_warnings import warn_of_each
from sidtool.formats.file_names import scene_given
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.formats.storage.operating_system import processors
from sidtool.formats.toml.files import locate_errors
from sidtool.solver.initial_state.integrator_start import run_settings
from sidtool.solver.simulation.frozen_run import (
    Grid,
    StructureChange,
    record_grid,
    run_on_grid,
)
from sidtool.solver.system.errors import SimulationError
from sidtool.solver.system.system import System

from ..model_derivatives.sid_derivatives import SidDerivatives, sid_derivatives
from ..sensitivity.differences import differentiate
from ..sensitivity.functionals import (
    Functional,
    History,
    Peak,
    parse_functionals,
    recorded_outputs,
)
from ..sensitivity.sensitivity_result import Sensitivities
from ..sensitivity.variables import (
    Variable,
    find_variables,
    model_changes,
    scene_changes,
)
from ..sweep.design import Designs
from .compiled_scene import CompiledScene
from .parallel_runs import map_in_threads

Path_ = str | os.PathLike[str]
Sids = Mapping[str, SID | Path_]
Programs = Mapping[str, Any]

#: Estimated error of a derivative, relative to its size, above which it is reported.
LARGE_ERROR = 1e-3
#: Changes of a functional that matter not, relative to its size, for a change of a
#: variable of its own size.
NEGLIGIBLE = 1e-3
#: Derivatives of two peaks differ by more than this part of them.
DIFFERENT = 0.01


def sensitivity(
    scene: SceneFile | Path_,
    variables: str | Iterable[str],
    functionals: str | Iterable[str],
    *,
    sids: Sids | None = None,
    integrator: str | None = None,
    rtol: float | None = None,
    step: float | None = None,
    jobs: int | None = None,
    drives: Programs | None = None,
    forces: Programs | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Sensitivities:
    """Return derivatives of functionals of a motion by numbers of a scene.

        found = sidtool.sensitivity(
            "slider_crank.toml", ["piston.mass"], ["max_abs(rod.q1)"]
        )
        print(found.report())
        found["max_abs(rod.q1)", "piston.mass"]

    Neighbouring scenes are run with the steps of this one, and differences of fourth
    order are taken. `errors` estimates the error of each derivative.

    Parameters
    ----------
    scene : a scene file, or its content
    variables : keys of numbers, as in `Scene.with_`; `*` stands for any letters
    functionals : such as "max_abs(rod.q1)" or "mean(piston.x)"; see
        `sidtool sensitivity --help` for all
    sids : SIDs, or SID files, that replace those of the scene, by body
    integrator, rtol, step : as of `sidtool.simulate`
    jobs : number of threads, default the processors of this process
    drives, forces : callables by name, as of `sidtool.simulate`; they run one after the
        other
    progress : called with a variable, its number and the number of all

    Raises
    ------
    InputError : there is no such key, functional or output, or as `simulate`.
    sidtool.SimulationError : the run of the scene itself stops. A derivative that does
        not exist is NaN, and `diagnostics` says why.
    """
    settings = {"integrator": integrator, "rtol": rtol, "step": step}
    problem = Problem(
        scene, variables, functionals, sids, settings, jobs, (drives, forces)
    )
    found = problem.at(problem.x0).sensitivities(progress)
    warn_of_each(found.diagnostics)
    return found


class Problem:
    """A scene with variables and functionals, compiled once.

    Attributes
    ----------
    scene : with the outputs that the functionals need
    variables, functionals : parsed
    x0 : (n,) values of the variables in the scene
    steps : steps of differences that were found, by variable
    """

    def __init__(
        self,
        scene: SceneFile | Path_,
        variables: str | Iterable[str],
        functionals: str | Iterable[str],
        sids: Sids | None,
        settings: Mapping[str, Any],
        jobs: int | None,
        programs: tuple[Programs | None, Programs | None],
    ) -> None:
        given = scene_given(scene)
        self.settings = settings
        with locate_errors(given):
            self.functionals = parse_functionals(functionals, given.folder)
            self.variables = find_variables(variables, given)
            given_sids = dict(sids or {})
            self.models = _models(given, self.variables, given_sids)
            record = recorded_outputs(self.functionals)
            self.scene = given.with_({"outputs.record": record})
            self._bodies = self.bodies(np.array([v.value for v in self.variables]))
            given_sids |= {name: body.sid for name, body in self._bodies.items()}
            self.compiled = CompiledScene(
                self.scene, sids=given_sids, drives=programs[0], forces=programs[1]
            )
        if jobs is not None and jobs < 1:
            raise InputError(f"jobs is {jobs}", expected="a positive number")
        sequential = bool(self.compiled.system_with({}).natives)
        self.jobs = 1 if sequential else jobs or processors()
        self.x0 = np.array([v.value for v in self.variables])
        self.steps: dict[str, float] = {}

    @property
    def needs_motion(self) -> bool:
        return any(f.needs_motion for f in self.functionals)

    def bodies(self, x: Array) -> dict[str, SidDerivatives]:
        """SIDs of the bodies with variables of their models, and their derivatives.

        Raises
        ------
        InputError : a value does not fit, or a model cannot be converted.
        """
        found = {}
        for name, model in self.models.items():
            changes = model_changes(self.variables, x, name)
            changed = model.with_(changes)
            found[name] = sid_derivatives(changed, [*changes])
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
        return self.compiled.system_with(scene_changes(self.variables, x), sids)

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
            grid, history = None, None
            if self.needs_motion:
                chosen = run_settings(
                    system,
                    self.settings["integrator"],
                    self.settings["rtol"],
                    self.settings["step"],
                    None,
                )
                grid = record_grid(system, chosen)
                history = History(run_on_grid(system, grid))
            terms = _terms(self.functionals, history)
            values = np.array([term.value(system, history) for term in terms])
            pairs = zip(terms, values, strict=True)
            scales = np.array([t.functional.scale(history, v) for t, v in pairs])
        return Point(self, np.asarray(x, float), bodies, grid, terms, values, scales)


def _models(
    scene: SceneFile, variables: Sequence[Variable], sids: Mapping[str, Any]
) -> dict[str, ModelFile]:
    """Models of the bodies of which the models have variables.

    Raises
    ------
    InputError : a SID replaces that of such a body.
    """
    names = dict.fromkeys(v.body for v in variables if v.body)
    for name in names:
        if name in sids:
            raise InputError(
                "replaces a body whose model is varied",
                place=f"sids[{name!r}]",
                expected="variables of other bodies",
            )
    designs = Designs(scene, {}, [])
    return {name: designs.model(name) for name in names}


class Term(NamedTuple):
    """A functional, at one of its peaks if it is an extremum.

    Attributes
    ----------
    functional : the functional
    peak : where it lies in the nominal motion
    rival_of : number of the functional of which this is another peak, or -1
    """

    functional: Functional
    peak: Peak | None = None
    rival_of: int = -1

    def value(self, system: System, history: History | None) -> float:
        """The value of a scene and its motion."""
        if self.functional.needs_motion and history is not None:
            return self.functional.of_motion(history, self.peak)
        return self.functional.of_system(system)


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
    bodies : SIDs of models with variables, and their derivatives, by body
    grid : of the run
    terms, all_values : (n_terms,) functionals, then their other peaks
    scales : (n_terms,) sizes of the values
    """

    problem: Problem
    x: Array
    bodies: Mapping[str, SidDerivatives]
    grid: Grid | None
    terms: Sequence[Term]
    all_values: Array
    scales: Array

    @property
    def values(self) -> Array:
        """Values of the functionals, (n_functionals,)."""
        return self.all_values[: len(self.problem.functionals)]

    def neighbour(self, x: Array) -> Array:
        """Values of the terms at neighbouring values of the variables.

        Raises
        ------
        StructureChange : the run has other events.
        InputError, SimulationError : as `simulate`.
        """
        variables, changes = self.problem.variables, x - self.x
        sids = {
            name: body.neighbour(model_changes(variables, changes, name))
            for name, body in self.bodies.items()
        }
        system, history = self.problem.system(x, sids), None
        if self.grid is not None:
            history = History(run_on_grid(system, self.grid))
        return np.array([term.value(system, history) for term in self.terms])

    def sensitivities(
        self, progress: Callable[[str, int, int], None] | None = None
    ) -> Sensitivities:
        """Derivatives by all variables."""
        problem, started = self.problem, time.perf_counter()
        shape = len(self.values), len(problem.variables)
        derivatives, errors = np.full(shape, np.nan), np.full(shape, np.nan)
        diagnostics, runs = list[Diagnostic](), 2
        if self.grid is not None and not np.isnan(self.grid.singular_time):
            diagnostics.append(diagnose("N738", t=self.grid.singular_time))
        for k, variable in enumerate(problem.variables):
            if progress is not None:
                progress(variable.key, k, len(problem.variables))
            try:
                size = self._size(variable, self.x[k])
                least = NEGLIGIBLE * self.scales / size
                found = differentiate(
                    self._along(k),
                    self.x[k],
                    size,
                    self.all_values,
                    least,
                    problem.steps.get(variable.key, 0.0),
                )
            except (StructureChange, InputError, SimulationError) as why:
                diagnostics.append(diagnose("N735", variable.key, reason=str(why)))
                continue
            runs += found.runs
            problem.steps[variable.key] = found.step
            count = len(self.values)
            derivatives[:, k] = found.derivatives[:count]
            errors[:, k] = found.errors[:count]
            sizes = np.maximum(np.abs(found.derivatives), least)
            diagnostics += self._large_errors(variable, found.errors / sizes)
            diagnostics += self._rivals(variable, found.derivatives, sizes)
        scene = problem.scene
        units = {f.text: f.unit(scene) for f in problem.functionals}
        return Sensitivities(
            functionals=tuple(f.text for f in problem.functionals),
            variables=tuple(v.key for v in problem.variables),
            values=self.values,
            point=self.x,
            derivatives=derivatives,
            errors=errors,
            units=units | {v.key: v.unit for v in problem.variables},
            runs=runs,
            seconds=time.perf_counter() - started,
            diagnostics=tuple(diagnostics),
            title=scene.title,
        )

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

    def _size(self, variable: Variable, value: float) -> float:
        """Size of a variable: its value, or where that is 0 one by its unit."""
        if value != 0.0:
            return abs(float(value))
        scene, system = self.problem.scene, self.problem.compiled.system_with({})
        time_ = scene.time
        sizes = {"m": system.length, "s": time_.end - time_.start}
        sizes["m/s"] = sizes["m"] / sizes["s"]
        sizes["rad/s"] = 1.0 / sizes["s"]
        return float(sizes.get(variable.unit, 1.0))

    def _rivals(
        self, variable: Variable, derivatives: Array, sizes: Array
    ) -> list[Diagnostic]:
        """Extrema with another peak that has another derivative (N736)."""
        found = []
        for k, term in enumerate(self.terms):
            own = term.rival_of
            if own < 0:
                continue
            size = max(sizes[k], sizes[own])
            difference = float(abs(derivatives[k] - derivatives[own]) / size)
            if difference > DIFFERENT:
                of = term.functional.text
                found.append(
                    diagnose("N736", variable.key, of=of, difference=difference)
                )
        return found

    def _large_errors(self, variable: Variable, errors: Array) -> list[Diagnostic]:
        """Derivatives by a variable whose relative errors are large (N737)."""
        functionals = self.problem.functionals
        rows = zip(functionals, errors[: len(functionals)], strict=True)
        return [
            diagnose("N737", variable.key, of=f.text, error=float(error))
            for f, error in rows
            if error > LARGE_ERROR
        ]


class Gradient:
    """Values of functionals and their derivatives, as functions of the variables.

        objective = sidtool.gradient("arm.toml", ["parameters.h"], "rms(arm.tip.y)")
        found = scipy.optimize.minimize(objective, objective.x0, jac=True)

    Called with values of the variables it returns the value and the gradient (n,), or
    for a list of functionals the values (m,) and the derivatives (m, n).

    Attributes
    ----------
    x0 : (n,) values of the variables in the scene
    variables, functionals : their names
    runs : runs made so far
    """

    def __init__(self, problem: Problem, is_scalar: bool) -> None:
        self._problem, self._is_scalar = problem, is_scalar
        self.x0 = problem.x0.copy()
        self.variables = tuple(v.key for v in problem.variables)
        self.functionals = tuple(f.text for f in problem.functionals)
        self.runs = 0
        self._point: Point | None = None
        self._found: Sensitivities | None = None

    def __call__(self, x: Any) -> tuple[Any, Array]:
        return self.value(x), self.derivative(x)

    def value(self, x: Any) -> Any:
        """The value of the functional, or the values (m,).

        Raises
        ------
        InputError, SimulationError : as `simulate`.
        """
        values = self._at(x).values
        return float(values[0]) if self._is_scalar else values.copy()

    def derivative(self, x: Any) -> Array:
        """The gradient (n,), or the derivatives (m, n).

        Raises
        ------
        InputError, SimulationError : as `simulate`, or a derivative does not exist.
        """
        derivatives = self.sensitivities(x).derivatives
        return derivatives[0].copy() if self._is_scalar else derivatives.copy()

    def sensitivities(self, x: Any) -> Sensitivities:
        """Values, derivatives and their errors, as of `sidtool.sensitivity`.

        Raises
        ------
        InputError, SimulationError : as `simulate`, or a derivative does not exist.
        """
        point = self._at(x)
        if self._found is None:
            self._found = point.sensitivities()
            self.runs += self._found.runs
            missing = [d for d in self._found.diagnostics if d.code == "N735"]
            if missing:
                raise InputError(missing[0].message, place=missing[0].subject)
        return self._found

    def _at(self, x: Any) -> Point:
        array = np.array(x, float).reshape(-1)
        if array.shape != self.x0.shape:
            raise InputError(
                f"found {len(array)} values", place="x", expected=f"{len(self.x0)}"
            )
        if self._point is None or not np.array_equal(array, self._point.x):
            self._point, self._found = self._problem.at(array), None
        return self._point


def gradient(
    scene: SceneFile | Path_,
    variables: str | Iterable[str],
    functionals: str | Iterable[str],
    *,
    sids: Sids | None = None,
    integrator: str | None = None,
    rtol: float | None = None,
    step: float | None = None,
    jobs: int | None = None,
    drives: Programs | None = None,
    forces: Programs | None = None,
) -> Gradient:
    """Return a function of the variables with values and derivatives of functionals.

        objective = sidtool.gradient("arm.toml", ["parameters.h"], "rms(arm.tip.y)")
        value, slope = objective(objective.x0)
        found = scipy.optimize.minimize(objective, objective.x0, jac=True)

    The scene is compiled once. The first call finds the steps of the differences, later
    ones use them and take four runs per variable.

    Parameters
    ----------
    functionals : a text for a value and its gradient, a list for values and a matrix of
        derivatives
    scene, variables, sids, integrator, rtol, step, jobs, drives, forces : as of
        `sidtool.sensitivity`

    Raises
    ------
    InputError : as `sidtool.sensitivity`.
    """
    settings = {"integrator": integrator, "rtol": rtol, "step": step}
    problem = Problem(
        scene, variables, functionals, sids, settings, jobs, (drives, forces)
    )
    is_scalar = isinstance(functionals, str) and len(problem.functionals) == 1
    return Gradient(problem, is_scalar)
