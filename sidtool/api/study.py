"""Studies as requested on the command line and in Python."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.file_names import scene_given
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.files import locate_errors

from ..measurement.variants import (
    VALUE_SEPARATOR,
    Setting,
    default_settings,
    parse_axes,
)
from ..study.run_study import Say
from ..study.run_study import run_study as whole
from ..study.study_result import Study
from .result import emit_warnings

Path_ = str | os.PathLike[str]
Over = str | Iterable[str] | Mapping[str, Iterable[Any]]
#: Limits of tolerances and fixed steps [s].
_TOLERANCE_LIMITS, _STEP_LIMITS = (1e-13, 0.1), (1e-12, 1e12)


def study(
    scene: SceneFile | Path_,
    over: Over = (),
    *,
    sids: Mapping[str, SID | Path_] | None = None,
    models: Mapping[str, Path_ | Sequence[Path_]] | None = None,
    base_folder: Path_ | None = None,
    integrators: Sequence[str] = (),
    rtol: Sequence[float] = (),
    step: Sequence[float] = (),
    outputs: Sequence[str] = (),
    differ: int | None = None,
    folder: Path_ | None = None,
    jobs: int = 1,
    dask: str | None = None,
    title: str = "",
    stop: Callable[[], str] | None = None,
    progress: Say | None = None,
    drives: Mapping[str, Any] | None = None,
    forces: Mapping[str, Any] | None = None,
) -> Study:
    """Measure error against time and size for a scene, as `sidtool study` does.

        found = sidtool.study("slider_crank.toml", over=["modes=1:3:5", "terms"])
        found.recommended(1e-3)
        found.to_dataframe()

    Parameters
    ----------
    scene : a scene file, or its content
    over : axes to vary, as for the option `--over`: "mesh", "modes", "reduction",
        "frame", "terms", "integrator", or with values, "modes=2:4:8"; or a mapping such
        as {"modes": [2, 4, 8], "terms": []}. Default integrators and tolerances alone
    sids : SIDs, or SID files, that replace those of the scene, by body
    models : model files by body, which replace its SID; several are compared
    base_folder : folder of relative paths, as for `sidtool.simulate`
    integrators, rtol, step : integration of the runs, fixed steps in seconds; default
        all integrators at 1e-2 to 1e-9, and fewer if other axes vary
    outputs : names of the compared outputs, default all recorded ones
    differ : largest number of choices in which a point differs from the scene, default
        as many as give at most 300 points
    folder : finished points are stored in its folder `points`, as by `-o`, and are not
        computed again; `Study.save` writes the other files
    jobs : number of processes; 1 for the current process
    dask : address of a Dask scheduler, whose cluster is used instead
    title : title of figures, default that of the scene
    stop : called repeatedly; returns a reason to end, or an empty text
    progress : called with a text, the numbers of finished and of all points, and the
        remaining seconds or None
    drives, forces : callables by name, as for `sidtool.simulate`; they run in the
        current process only, and their points are not stored

    Raises
    ------
    InputError : the scene records nothing, or not the given `outputs`; an axis does not
        fit the scene; no model can be run; callables are given together with `jobs`,
        `dask` or `folder`.
    sidtool.study.StudyInterrupted : `stop` returned a reason.
    """
    _check_numbers("--rtol", rtol, *_TOLERANCE_LIMITS)
    _check_numbers("--step", step, *_STEP_LIMITS)
    programs = programs_here(drives, forces, jobs, dask, folder)
    axes = parse_axes(_axis_texts(over))
    settings = _requested_settings(axes, integrators, rtol, step)
    content = scene_given(scene)
    with locate_errors(content):
        result = whole(
            content,
            axes,
            sids=sids,
            models={
                name: _as_sequence(files) for name, files in (models or {}).items()
            },
            base_folder=base_folder,
            settings=settings,
            outputs=outputs,
            differ=differ,
            keep=None if folder is None else Path(folder) / "points",
            jobs=jobs,
            dask=dask,
            stop=stop,
            say=progress,
            programs=programs,
        )
    return emit_warnings(replace(result, title=title or content.title))


def programs_here(
    drives: Mapping[str, Any] | None,
    forces: Mapping[str, Any] | None,
    jobs: int,
    dask: str | None,
    folder: Path_ | None,
) -> dict[str, Any]:
    """Return callables by the table of the scene, empty if there are none.

    Raises
    ------
    InputError : callables are given together with `jobs`, `dask` or `folder`.
    """
    if not (drives or forces):
        return {}
    if jobs != 1 or dask is not None or folder is not None:
        raise InputError(
            "other processes and kept runs do not know callables",
            place="jobs, dask, folder",
            expected="callables with one job and no folder, or functions of the scene",
        )
    return {"drives": drives, "forces": forces}


def _axis_texts(over: Over) -> list[str]:
    """Return the axes as texts of the command line."""
    if isinstance(over, str):
        return [over]
    if not isinstance(over, Mapping):
        return [*over]
    texts = []
    for name, values in over.items():
        several = (values,) if isinstance(values, str | int) else tuple(values)
        text = VALUE_SEPARATOR.join(str(value) for value in several)
        texts.append(f"{name}={text}" if text else name)
    return texts


def _as_sequence(files: Path_ | Sequence[Path_]) -> Sequence[Path_]:
    return [files] if isinstance(files, str | os.PathLike) else files


def _check_numbers(
    name: str, numbers: Sequence[float], least: float, most: float
) -> None:
    for number in numbers:
        if not least <= number <= most:
            raise InputError(
                f"found {number:g}", place=name, expected=f"{least:g} to {most:g}"
            )


def _requested_settings(
    axes: dict[str, tuple[Any, ...]],
    integrators: Sequence[str],
    tolerances: Sequence[float],
    steps: Sequence[float],
) -> list[Setting] | None:
    """Return the requested settings; only a few by default if other axes vary."""
    names = (*axes.get("integrator", ()), *integrators)
    if axes and not (integrators or tolerances or steps):
        default_settings(names)
        return None
    if names or not axes or "integrator" in axes:
        return default_settings(names, tolerances, steps)
    return default_settings(("radau9",), tolerances, steps)
