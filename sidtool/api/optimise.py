"""Optimisation of a design by gradients of its motion."""

import os
import time
from collections.abc import Callable, Mapping

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.design import DesignFile, read_design
from sidtool.formats.diagnostics.record import warn_of_each
from sidtool.formats.file_names import path_of
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.formats.toml.files import locate_errors

from ..sensitivity.functionals import parse_functionals
from ..sensitivity.optimisation import Iteration, Optimum, Search, bounds
from ..sensitivity.variables import (
    Numbers,
    Variable,
    model_changes,
    scene_changes,
)
from ..sweep.design import Designs
from .cached_problem import CachedProblem
from .compiled_scene import Sids
from .motion_problem import RTOL, Problem, RunOptions

Path_ = str | os.PathLike[str]


def optimise(
    design: DesignFile | Path_,
    *,
    scene: SceneFile | None = None,
    start: Mapping[str, float] | None = None,
    sids: Sids | None = None,
    jobs: int | None = None,
    method: str = "auto",
    progress: Callable[[Iteration, int], None] | None = None,
) -> Optimum:
    """Find the best design within limits, as `sidtool optimise` does.

        found = sidtool.optimise("design.toml")
        print(found.report())

    Parameters
    ----------
    design : a design file, or its content
    scene : in place of that which the design names
    start : first values of variables by their names, default those of the design
    sids : SIDs, or SID files, that replace those of the scene, by body
    jobs : number of threads, default the processors of this process
    method : of the derivatives, as of `sidtool.sensitivity`
    progress : called with each point and its number

    Raises
    ------
    InputError : the design is wrong, or a derivative does not exist.
    sidtool.SimulationError : the start cannot be run.
    """
    content = (
        design
        if isinstance(design, DesignFile)
        else read_design(path_of(design, "design"))
    )
    began = time.perf_counter()
    with locate_errors(content):
        base = scene or read_scene(content.folder / content.scene)
        base = base.with_(content.changes)
        variables = _variables(content, base)
        texts = dict.fromkeys([content.objective.of, *(v.of for v in content.limits)])
        functionals = parse_functionals(texts, base.folder)
        if len(functionals) != len(texts):
            raise InputError("holds several functionals", place="objective")
        rtol = min(base.accuracy.rtol, RTOL)
        options = RunOptions(sids=sids, rtol=rtol, jobs=jobs, method=method)
        problem = Problem(base, variables, functionals, options)
        evaluation = CachedProblem(problem)
        count = 0

        def report(point: Iteration) -> None:
            nonlocal count
            if progress is not None:
                progress(point, count)
            count += 1

        search = Search(
            content, [f.text for f in functionals], evaluation, problem.x0, report
        )
        search.start = _start(content, problem, start or {})
        search.run()
    best = search.best
    x, units = np.array(best.x), {f.text: f.unit(problem.scene) for f in functionals}
    found = Optimum(
        design=content,
        best=best,
        history=tuple(search.history),
        functionals=tuple(search.functionals),
        changes=scene_changes(variables, x),
        model_changes={n: model_changes(variables, x, n) for n in problem.models},
        converged=search.converged,
        message=search.message,
        units=units | {v.name: v.unit for v in variables},
        runs=evaluation.runs,
        seconds=time.perf_counter() - began,
        diagnostics=evaluation.diagnostics,
    )
    warn_of_each(found.diagnostics)
    return found


def _variables(design: DesignFile, scene: SceneFile) -> list[Variable]:
    numbers = Numbers(Designs(scene, {}, []))
    return [
        numbers.group(name, given.keys or {})
        if given.key is None
        else numbers.single(given.key, name)
        for name, given in design.variables.items()
    ]


def _start(design: DesignFile, problem: Problem, given: Mapping[str, float]) -> Array:
    """First values of the variables.

    Raises
    ------
    InputError : there is no such variable, or a value lies outside of its range.
    """
    unknown = [name for name in given if name not in design.variables]
    if unknown:
        known = ", ".join(design.variables)
        raise InputError(f"there is no {unknown[0]!r}", place="start", expected=known)
    x = [
        given.get(name, value if limits.start is None else limits.start)
        for (name, limits), value in zip(
            design.variables.items(), problem.x0, strict=True
        )
    ]
    low, high = bounds([*design.variables.values()])
    for name, value, least, most in zip(design.variables, x, low, high, strict=True):
        if not least <= value <= most:
            raise InputError(
                f"starts at {value:g}",
                place=f"variables.{name}",
                expected=f"{least:g} to {most:g}",
            )
    return np.array(x, float)
