"""Identification of numbers of a scene from measurements."""

import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.diagnostics.record import warn_of_each
from sidtool.formats.file_names import scene_given
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.files import locate_errors

from ..sensitivity.functionals import parse_functionals
from ..sensitivity.identification import (
    Fit,
    Identification,
    Target,
    fit,
    measured_outputs,
    strongest_correlation,
)
from ..sensitivity.measurements import Measurement, as_measurements, read_measurements
from ..sensitivity.variables import find_variables, model_changes, scene_changes
from .cached_problem import CachedProblem
from .compiled_scene import Sids
from .motion_problem import RTOL, Problem, RunOptions

Path_ = str | os.PathLike[str]
Programs = Mapping[str, Any]
#: Correlation of two variables above which their effects are the same.
STRONG_CORRELATION = 0.999
#: Residuals below this part of the range of an output are no noise.
ROUNDING = 1e-6
#: Error of a derivative, relative to its size, that suffices for a fit.
GOOD_ERROR = 1e-5


def identify(
    scene: SceneFile | Path_,
    variables: str | Iterable[str],
    measured: Path_ | Mapping[str, ArrayLike] | None = None,
    *,
    targets: Mapping[str, tuple[float, float]] | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    sids: Sids | None = None,
    jobs: int | None = None,
    method: str = "auto",
    drives: Programs | None = None,
    forces: Programs | None = None,
    progress: Callable[[Array, Array], None] | None = None,
) -> Identification:
    """Fit numbers of a scene to measured motions, as `sidtool identify` does.

        found = sidtool.identify("scene.toml", ["spring.stiffness"], "measured.csv")
        print(found.report())

    Parameters
    ----------
    scene : a scene file, or its content; it holds the first values
    variables : keys of numbers, as of `sidtool.sensitivity`
    measured : a table (CSV) with `t` and outputs of the scene, or arrays by these names
    targets : measured value and standard deviation of functionals, such as
        {"frequency(1)": (12.3, 0.1)}
    ranges : least and largest value of variables
    sids, jobs, method, drives, forces : as of `sidtool.sensitivity`
    progress : called with variables and values of each evaluation

    Raises
    ------
    InputError : keys, outputs or measurements are wrong, there are too few values, or
        a derivative does not exist.
    sidtool.SimulationError : a run stops.
    """
    began, content = time.perf_counter(), scene_given(scene)
    with locate_errors(content):
        histories = _measurements(measured)
        outputs = measured_outputs(histories)
        wanted = [*(targets or {})]
        functionals = parse_functionals(wanted, content.folder) if wanted else []
        aims = [Target(f, *map(float, (targets or {})[f.text])) for f in functionals]
        if not outputs and not aims:
            raise InputError(
                "nothing is measured", place="measured", expected="a table, or targets"
            )
        found_variables = find_variables(variables, content)
        rtol = min(content.accuracy.rtol, RTOL)
        options = RunOptions(
            sids=sids, rtol=rtol, jobs=jobs, programs=(drives, forces), method=method
        )
        problem = Problem(content, found_variables, [*outputs, *functionals], options)
        names = [v.name for v in found_variables]
        evaluation = CachedProblem(problem, GOOD_ERROR, progress)
        fitted = fit(
            evaluation, outputs, aims, problem.x0, _bounds(names, ranges or {})
        )
    units = {v.name: v.unit for v in found_variables}
    units |= {f.text: f.unit(problem.scene) for f in (*outputs, *functionals)}
    bodies = {n: model_changes(found_variables, fitted.x, n) for n in problem.models}
    found = Identification(
        variables=tuple(names),
        start=problem.x0,
        fit=fitted,
        measured=histories,
        targets={aim.functional.text: (aim.value, aim.deviation) for aim in aims},
        changes=scene_changes(found_variables, fitted.x),
        model_changes=bodies,
        units=units,
        runs=evaluation.runs,
        seconds=time.perf_counter() - began,
        diagnostics=tuple(_diagnostics(fitted, names, histories)),
        title=content.title,
    )
    warn_of_each(found.diagnostics)
    return found


def _measurements(
    measured: Path_ | Mapping[str, ArrayLike] | None,
) -> dict[str, Measurement]:
    if measured is None:
        return {}
    if not isinstance(measured, Mapping):
        return read_measurements(Path(measured))
    columns = {name: np.asarray(values, float) for name, values in measured.items()}
    if "t" not in columns:
        raise InputError("has no times", place="measured", expected="the key t")
    times = columns.pop("t")
    return as_measurements(times, columns)


def _bounds(
    names: Sequence[str], ranges: Mapping[str, tuple[float, float]]
) -> tuple[Array, Array]:
    unknown = [name for name in ranges if name not in names]
    if unknown:
        raise InputError(
            f"there is no variable {unknown[0]!r}",
            place="ranges",
            expected=", ".join(names),
        )
    pairs = [ranges.get(name, (-np.inf, np.inf)) for name in names]
    low, high = np.array(pairs, float).T
    return low, high


def _diagnostics(
    fitted: Fit, names: Sequence[str], histories: Mapping[str, Measurement]
) -> list[Diagnostic]:
    """What makes intervals doubtful."""
    found = []
    count = (fitted.freedoms + len(names)) / max(1, len(histories))
    ratios = zip(histories, fitted.noises, fitted.autocorrelations, strict=True)
    for name, noise, correlation in ratios:
        if noise < ROUNDING * np.ptp(histories[name].values):
            continue
        if correlation > max(0.2, 4.0 / np.sqrt(count)):
            found.append(diagnose("N739", name, correlation=float(correlation)))
    pair = strongest_correlation(fitted, names)
    if pair is not None and abs(pair[2]) > STRONG_CORRELATION:
        first, second, correlation = pair
        found.append(
            diagnose("N740", first, other=second, correlation=float(correlation))
        )
    return found
