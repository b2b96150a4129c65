"""Studies and sweeps as requested on the command line and in Python."""

import os
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics.record import warn_of_each
from sidtool.formats.file_names import scene_given
from sidtool.formats.scene import SceneFile, matching_names, unit_of
from sidtool.formats.sid_files import read_sid
from sidtool.formats.toml.files import locate_errors

from ..measurement.outputs import RunRecord
from ..measurement.tasks import ConversionOutcome, RunTask, compile_task
from ..measurement.variants import (
    VALUE_SEPARATOR,
    Setting,
    default_settings,
    parse_axes,
    setting_of,
)
from ..pipeline.model_cache import model_digest
from ..report.diagnostics import first_of_each_code
from ..study.run_study import Say, Workers, run_study as whole, workers
from ..study.study_result import Study
from ..sweep.design import (
    Design,
    Designs,
    axis_combinations,
    models_of_designs,
    parse_axes as parse_sweep_axes,
)
from ..sweep.sweep_result import (
    MEASURES,
    TIME,
    Measure,
    Sweep,
    SweepPoint,
    parse_measures,
)
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


Programs = Mapping[str, Any]


def sweep(
    scene: SceneFile | Path_,
    over: Over,
    of: str | Iterable[str],
    *,
    sids: Mapping[str, SID | Path_] | None = None,
    folder: Path_ | None = None,
    jobs: int = 1,
    dask: str | None = None,
    title: str = "",
    stop: Callable[[], str] | None = None,
    progress: Say | None = None,
    drives: Programs | None = None,
    forces: Programs | None = None,
) -> Sweep:
    """Simulate a scene for values of its keys, as `sidtool sweep` does.

        found = sidtool.sweep("arm.toml", {"parameters.h": [0.01, 0.02]}, "tip.y.max")
        found["tip.y.max"]
        found.to_dataframe()

    Parameters
    ----------
    scene : a scene file, or its content
    over : values by keys of the scene, or of the model of a body as `BODY.model.KEY`;
        or texts as for the option `--over`, "parameters.h=0.01:0.02:11". Several keys
        make a full grid
    of : outputs with the suffix `.max`, `.min`, `.end`, `.mean`, `.rms` or
        `.amplitude`; `t.end` is the time at which a run ends
    sids : SIDs, or SID files, that replace those of the scene, by body
    folder : folder of finished runs, which are not run again
    jobs : number of processes; 1 for the current process
    dask : address of a Dask scheduler, whose cluster is used instead
    title : title of figures, default that of the scene
    stop : called repeatedly; returns a reason to end, or an empty text
    progress : called with a text, the numbers of finished and of all points, and the
        remaining seconds or None
    drives, forces : callables by name, as for `sidtool.simulate`; they run in the
        current process only, and their runs are not stored

    Raises
    ------
    InputError : an axis or a measure has another form, or no point can be set up.
        Single points that cannot be set up or run have a `message` instead.
    sidtool.study.StudyInterrupted : `stop` returned a reason.
    """
    programs = programs_here(drives, forces, jobs, dask, folder)
    points, measures = axis_combinations(parse_sweep_axes(over)), parse_measures(of)
    content = scene_given(scene)
    given = {
        name: sid if isinstance(sid, SID) else read_sid(sid)
        for name, sid in (sids or {}).items()
    }
    keep = None if folder is None else Path(folder)
    with locate_errors(content), workers(jobs, dask, keep, stop, progress) as doing:
        record = [m.output for m in measures if m.output != TIME]
        designs = Designs(content, given, list(dict.fromkeys(record)))
        result = _Sweep(designs, points, measures, doing, programs).run_all(
            title or content.title
        )
    warn_of_each(first_of_each_code(result.runs))
    return result


class _Sweep:
    def __init__(
        self,
        designs: Designs,
        values: Sequence[Mapping[str, Any]],
        measures: Sequence[Measure],
        doing: Workers,
        programs: Mapping[str, Any],
    ) -> None:
        self.designs, self.values, self.measures = designs, values, measures
        self.doing, self.programs = doing, programs
        self.points: dict[int, SweepPoint] = {}
        self.names: dict[str, None] = {}
        self.conversions: dict[str, ConversionOutcome] = {}

    def run_all(self, title: str) -> Sweep:
        """Run all points and return the sweep.

        Raises
        ------
        InputError : no point can be set up.
        """
        designs = self._set_up()
        self.conversions = self.doing.convert(models_of_designs(list(designs.values())))
        self._run(designs)
        points = tuple(self.points[row] for row in range(len(self.values)))
        if all(point.message for point in points):
            self._refuse(next(iter(designs.values())))
        axes = tuple(self.values[0])
        measures = self._names(next(iter(designs.values())).scene)
        units = {key: self.designs.unit(key) for key in axes} | measures
        return Sweep(
            points=points,
            axes=axes,
            measures=tuple(measures),
            units=units,
            title=title,
        )

    def _set_up(self) -> dict[int, Design]:
        """Return designs by the numbers of their points."""
        designs: dict[int, Design] = {}
        first: InputError | None = None
        for row, values in enumerate(self.values):
            try:
                designs[row] = self.designs.design(values)
            except InputError as error:
                first = first or error
                self.points[row] = SweepPoint(values, message=str(error))
        if first is not None and not designs:
            raise first
        return designs

    def _run(self, designs: Mapping[int, Design]) -> None:
        rows: dict[int, int] = {}
        tasks_alive: list[RunTask] = []  # so that no other task takes its id

        def tasks() -> Iterator[RunTask]:
            for row, design in designs.items():
                try:
                    task = self._task(design)
                except InputError as error:
                    self._add(row, message=str(error))
                    continue
                rows[id(task)] = row
                tasks_alive.append(task)
                yield task

        began, count = time.perf_counter(), 0
        for task, record, now in self.doing.runs(tasks()):
            row = rows[id(task)]
            self._add(
                row,
                self._measured(record),
                record.message,
                record.diagnostics,
            )
            count += now
            left = (len(self.values) - len(self.points)) * (time.perf_counter() - began)
            text = ", ".join(f"{k} = {v}" for k, v in self.values[row].items())
            done = len(self.points), len(self.values)
            self.doing.say(text, *done, left / count if count else None)

    def _add(self, row: int, *outcome: Any, **more: Any) -> None:
        self.points[row] = SweepPoint(self.values[row], *outcome, **more)

    def _task(self, design: Design) -> RunTask:
        """Return the task that runs a design.

        Raises
        ------
        InputError : a model cannot be converted, or a SID does not fit.
        """
        model_sids: dict[str, SID] = {}
        for name, model in design.models.items():
            converted = self.conversions[model_digest(model)]
            if converted.sid is None:
                raise InputError(converted.message, place=f"bodies.{name}.model")
            model_sids[name] = converted.sid
        scene, sids = design.with_sids(model_sids)
        setting = setting_of(scene)
        return RunTask(scene, sids, setting, once=True, programs=self.programs)

    def _measured(self, record: RunRecord) -> dict[str, float]:
        if record.message:
            return {}
        measured: dict[str, float] = {}
        for output, name in self.measures:
            if output == TIME:
                names, columns = [TIME], record.times[:, None]
            else:
                names = matching_names(output, record.names)
                columns = record.columns(names)
            for each, column in zip(names, columns.T, strict=True):
                measured[f"{each}.{name}"] = MEASURES[name](record.times, column)
        return measured

    def _names(self, scene: SceneFile) -> dict[str, str]:
        """Return measures without wildcards, in the requested order, with
        their units.
        """
        found: dict[str, str] = {}
        measured = dict.fromkeys(n for p in self.points.values() for n in p.measures)
        for output, name in self.measures:
            names = [n.rpartition(".") for n in measured]
            outputs = [o for o, _, measure in names if measure == name]
            listed = matching_names(output, outputs) if "*" in output else [output]
            for each in listed:
                unit = "s" if each == TIME else unit_of(each, scene)
                found[f"{each}.{name}"] = unit
        return found

    def _refuse(self, design: Design) -> None:
        """Raise the error that prevents every run.

        Raises
        ------
        InputError : the scene cannot be compiled.
        """
        task = self._task(design)
        compile_task(task.scene, task.sids, self.programs)
