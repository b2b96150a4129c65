"""Derivatives of functionals of a motion by numbers of a scene."""

import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics.record import warn_of_each
from sidtool.formats.file_names import path_of, scene_given
from sidtool.formats.model import ModelFile, read_model
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.files import locate_errors

from ..pipeline.files import kind_of
from ..sensitivity.functionals import parse_functionals
from ..sensitivity.model_sensitivity import model_sensitivities
from ..sensitivity.sensitivity_result import Sensitivities
from ..sensitivity.variables import find_variables
from .compiled_scene import Sids
from .motion_problem import Point, Problem, RunOptions

Path_ = str | os.PathLike[str]
Programs = Mapping[str, Any]


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
    method: str = "auto",
    drives: Programs | None = None,
    forces: Programs | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Sensitivities:
    """Return derivatives of functionals of a motion by numbers of a scene.

        found = sidtool.sensitivity("scene.toml", ["piston.mass"], ["max_abs(rod.q1)"])
        print(found.report())
        found["max_abs(rod.q1)", "piston.mass"]

    The run is linearised about itself; where that is not possible, neighbouring scenes
    are run with its steps, and differences of fourth order are taken. `methods` says
    which was used for each variable, `errors` estimates the error of each derivative.

    Of a model, quantities of the body are differentiated by its numbers, such as
    "frequency(1)" by "material.youngs_modulus", see `sidtool.sid_derivatives`; no
    further argument applies.

    Parameters
    ----------
    scene : a scene or a model file, or its content
    variables : keys of numbers, as in `Scene.with_`; `*` stands for any letters
    functionals : such as "max_abs(rod.q1)" or "mean(piston.x)"; see
        `sidtool sensitivity --help` for all
    sids : SIDs, or SID files, that replace those of the scene, by body
    integrator, rtol, step : as of `sidtool.simulate`
    jobs : number of threads, default the processors of this process
    method : "adjoint" or "direct" about the linearised run, "differences" of runs, or
        "auto"
    drives, forces : callables by name, as of `sidtool.simulate`; they run one after the
        other
    progress : called with a variable, its number and the number of all

    Raises
    ------
    InputError : there is no such key, functional or output, the method is not available
        for the scene, or as `simulate`.
    sidtool.SimulationError : the run of the scene itself stops. A derivative that does
        not exist is NaN, and `diagnostics` says why.
    """
    model = _model_given(scene)
    if model is not None:
        return model_sensitivities(model, variables, functionals)[0]
    options = RunOptions(sids, integrator, rtol, step, jobs, (drives, forces), method)
    problem = parse_problem(scene, variables, functionals, options)
    found = problem.at(problem.x0).sensitivities(progress)
    warn_of_each(found.diagnostics)
    return found


def _model_given(value: Any) -> ModelFile | None:
    """The model that an argument is, or that its file holds; None for others."""
    if isinstance(value, ModelFile):
        return value
    if isinstance(value, SceneFile):
        return None
    path = path_of(value, "scene", "a sidtool.Scene or a sidtool.Model")
    return read_model(path) if kind_of(path) == "model" else None


def parse_problem(
    scene: SceneFile | Path_,
    variables: str | Iterable[str],
    functionals: str | Iterable[str],
    options: RunOptions,
) -> Problem:
    """Compile a scene with variables and functionals given as texts.

    Raises
    ------
    InputError : there is no such key, functional or output, or the scene is wrong.
    """
    content = scene_given(scene)
    with locate_errors(content):
        found = parse_functionals(functionals, content.folder)
        return Problem(content, find_variables(variables, content), found, options)


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
        self.variables = tuple(v.name for v in problem.variables)
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
    method: str = "auto",
    drives: Programs | None = None,
    forces: Programs | None = None,
) -> Gradient:
    """Return a function of the variables with values and derivatives of functionals.

        objective = sidtool.gradient("arm.toml", ["parameters.h"], "rms(arm.tip.y)")
        value, slope = objective(objective.x0)
        found = scipy.optimize.minimize(objective, objective.x0, jac=True)

    The scene is compiled once. Where derivatives are differences of runs, the first
    call finds their steps, and later ones use them and take four runs per variable.

    Parameters
    ----------
    functionals : a text for a value and its gradient, a list for values and a matrix of
        derivatives
    scene, variables, sids, integrator, rtol, step, jobs, method, drives, forces : as of
        `sidtool.sensitivity`

    Raises
    ------
    InputError : as `sidtool.sensitivity`.
    """
    options = RunOptions(sids, integrator, rtol, step, jobs, (drives, forces), method)
    problem = parse_problem(scene, variables, functionals, options)
    is_scalar = isinstance(functionals, str) and len(problem.functionals) == 1
    return Gradient(problem, is_scalar)
