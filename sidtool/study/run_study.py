"""Run a study: convert bodies, run references, run all points.

First runs of a study: the scene itself, and its finest variant as the reference.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile

from ..measurement.candidates import with_recorded_outputs
from ..measurement.outputs import RunRecord, is_hopeless
from ..measurement.points import (
    Point,
    Reference,
    StoppedEarly,
    check_recorded,
    point_of,
    reference_of_runs,
    skipped_point,
)
from ..measurement.request import requested
from ..measurement.runs import check_validity
from ..measurement.tasks import (
    ConversionOutcome,
    PointCache,
    Programs,
    RunTask,
    as_completed,
    compile_task,
    convert_model,
    make_executor,
    run_task,
)
from ..measurement.variants import (
    BodyVariants,
    Setting,
    Values,
    Variant,
    available_outputs,
    elastic_size,
    tight_settings,
    with_absolute_paths,
    with_choice,
)
from ..pipeline.model_cache import BodyModel, model_digest
from ..pipeline.scene_changes import replace_sids
from .plan import StudyPlan, comparable_outputs, make_plan
from .study_result import Study

#: Number of runs with coarser meshes and with fewer modes for the error estimate.
COARSER_MESHES, FEWER_MODES = 2, 1
RunOf = Callable[[Variant, Setting, Sequence[str]], tuple[RunTask, int]]
#: Progress callback: text, finished points, all points, remaining seconds.
Say = Callable[[str, int, int, float | None], None]


def check_base_runs(plan: StudyPlan, names: Sequence[str], run_of: RunOf) -> None:
    """Check that the scene itself stays in the range of linear theory.

    Otherwise all variants share errors that no reference shows. The check applies to
    studies that vary more than integrators. A scene that leaves the range because it
    lacks geometric stiffening or a better body frame may stay inside with the full
    models.

    Raises
    ------
    InputError : the run stops early.
    OutsideTheory : a body leaves the range of its SID.
    """
    if not set(plan.varied) - {"integrator"}:
        return
    problems: list[InputError] = []
    for variant in (Variant(), *plan.finest_variants()[:1]):
        try:
            task, _ = run_of(variant, tight_settings(plan.settings)[0], names)
            check_validity(_run_base(task))
        except InputError as error:
            problems.append(error)
        else:
            return
    raise problems[0]


def _run_base(task: RunTask) -> Result:
    """Run the scene with its own accuracy.

    Raises
    ------
    StoppedEarly : the run stops early.
    """
    from sidtool.solver import simulate
    from sidtool.solver.system.errors import SimulationError

    try:
        return simulate(compile_task(task.scene, task.sids, task.programs))
    except SimulationError as stop:
        raise StoppedEarly(
            f"the scene as it is {stop}",
            place="--over",
            expected="a scene that runs to its end",
        ) from None


def best_reference(
    plan: StudyPlan,
    names: Sequence[str],
    run_of: RunOf,
    tight_runs: Callable[[Sequence[RunTask]], list[RunRecord]],
) -> Reference:
    """Return the best converged of the finest variants of all models.

    Raises
    ------
    InputError : none can be run.
    """
    references: list[Reference] = []
    problems: list[InputError] = []
    for model in range(plan.bodies.models):
        variants = [v for v in plan.finest_variants() if v.model == model]
        try:
            references.append(
                _reference_of_variants(plan, variants, names, run_of, tight_runs)
            )
        except InputError as error:
            problems.append(error)
    if not references:
        raise problems[0]
    return min(references, key=lambda reference: reference.uncertainty)


def _reference_of_variants(
    plan: StudyPlan,
    variants: Sequence[Variant],
    names: Sequence[str],
    run_of: RunOf,
    tight_runs: Callable[[Sequence[RunTask]], list[RunRecord]],
) -> Reference:
    """Return the reference of the first variant that can be run, the largest first."""
    first, second = tight_settings(plan.settings)
    problem: InputError | None = None
    for variant in _order_by_size(variants, names, run_of, first):
        try:
            coarser = _coarser_variants(plan, variant, "mesh", COARSER_MESHES)
            fewer = _coarser_variants(plan, variant, "modes", FEWER_MODES)
            tasks = [run_of(variant, s, names)[0] for s in (first, second)]
            tasks += [run_of(v, second, names)[0] for v in (*coarser, *fewer)]
        except InputError as error:
            problem = problem or error
            continue
        tight_run, check, *others = tight_runs(tasks)
        messages = [c.message for c in (tight_run, check, *others) if c.message]
        if not messages:
            title = ", ".join(
                text if axis == "model" else f"{axis} {text}"
                for axis, text in plan.labels(variant).items()
            )
            count = len(coarser)
            meshes, modes = others[:count], others[count:]
            return reference_of_runs(names, tight_run, check, meshes, modes, title)
        problem = problem or StoppedEarly(
            f"the reference {messages[0]}",
            place="--over",
            expected="a scene whose richest variant can be run to its end",
        )
    assert problem is not None
    raise problem


def _order_by_size(
    variants: Sequence[Variant],
    names: Sequence[str],
    run_of: RunOf,
    setting: Setting,
) -> list[Variant]:
    """Sort variants: those with all terms first, and the largest of them."""
    sizes: dict[Variant, int] = {}
    for variant in variants:
        try:
            sizes[variant] = run_of(variant, setting, names)[1]
        except InputError:
            sizes[variant] = -1
    terms = list(dict.fromkeys(v.terms for v in variants))
    return sorted(variants, key=lambda v: (terms.index(v.terms), -sizes[v]))


def _coarser_variants(
    plan: StudyPlan, variant: Variant, axis: str, count: int
) -> list[Variant]:
    """Return variants that are coarser on an axis, at most `count` steps, the next
    first.
    """
    own = getattr(variant, axis)
    values = sorted(v for v in plan.values.get(axis, ()) if v is not None)
    below = [v for v in values if own is not None and v < own]
    return [with_choice(variant, axis, v) for v in below[: -count - 1 : -1]]


def run_study(
    scene: SceneFile,
    over: Values | None = None,
    *,
    sids: Mapping[str, SID | str | os.PathLike[str]] | None = None,
    models: Mapping[str, Sequence[str | os.PathLike[str]]] | None = None,
    base_folder: str | os.PathLike[str] | None = None,
    settings: Sequence[Setting] | None = None,
    outputs: Sequence[str] = (),
    differ: int | None = None,
    keep: Path | None = None,
    jobs: int = 1,
    dask: str | None = None,
    stop: Callable[[], str] | None = None,
    say: Say | None = None,
    programs: Programs | None = None,
) -> Study:
    """Run a scene in many variants and compare each run with a much finer one.

    Parameters
    ----------
    over : axes and their values, see `variants.AXES`, () for the defaults; default
        integrators and tolerances only
    sids : SIDs that replace those of the scene
    models : model files by body, which replace its SID; several are variants, the first
        of each body together, the second of each, and so on
    settings : integration of the runs; default all integrators at `TOLERANCES`, and
        fewer if other axes vary
    outputs : names of the compared outputs, default all recorded ones
    differ : largest number of choices in which a point differs from the scene, default
        as many as give at most `plan.MAX_POINTS` points
    keep : folder of finished points, which are not computed again
    jobs : number of processes; 1 for the current process
    dask : address of a Dask scheduler, whose cluster is used instead
    stop : called repeatedly; returns a reason to end, or an empty text
    say : progress callback
    programs : callables for `drives` and `forces`, for the current process only

    Raises
    ------
    InputError : the scene records nothing, or not the given `outputs`; an axis does not
        fit the scene; no model can be run.
    StudyInterrupted : `stop` returned a reason.
    """
    folder = Path(base_folder or scene.folder)
    bodies = _make_bodies(scene, folder, sids or {}, models or {})
    plan = make_plan(bodies, over or {}, settings, differ)
    with workers(jobs, dask, keep, stop, say) as doing:
        return _StudyRun(plan, doing, outputs, programs or {}).whole()


def _make_bodies(
    scene: SceneFile,
    folder: Path,
    sids: Mapping[str, SID | str | os.PathLike[str]],
    models: Mapping[str, Sequence[str | os.PathLike[str]]],
) -> BodyVariants:
    from sidtool.formats.sid_files import read_sid

    content, given = replace_sids(scene, sids, folder)
    unknown = [name for name in models if name not in content.flexible]
    if unknown:
        raise InputError(
            f"there is no flexible body {unknown[0]!r}",
            place="--model",
            expected=", ".join(content.flexible) or "a scene with flexible bodies",
        )
    sources: dict[str, Sequence[BodyModel]] = {}
    known: dict[str, SID] = dict(given)
    for name, body in content.sid_bodies.items():
        if name in models:
            sources[name] = [BodyModel(Path(path), folder) for path in models[name]]
        elif body.model and name not in given and not body.sid:
            sources[name] = [BodyModel(folder / body.model, folder)]
        elif name not in given:
            known[name] = read_sid(folder / body.sid)
    most = max((len(models_of_body) for models_of_body in sources.values()), default=1)
    for name, models_of_body in sources.items():
        if len(models_of_body) not in (1, most):
            raise InputError(
                f"{name} has {len(models_of_body)} models, another body {most}",
                place="--model",
                expected="one model for a body, or as many as for the others",
            )
        sources[name] = [*models_of_body] * (most // len(models_of_body))
    return BodyVariants(content, known, sources)


@contextmanager
def workers(
    jobs: int,
    dask: str | None = None,
    keep: Path | None = None,
    stop: Callable[[], str] | None = None,
    say: Say | None = None,
) -> Iterator[Workers]:
    """Return the executor for conversions and runs, on processes or a cluster."""
    with make_executor(jobs, dask) as (executor, width):
        yield Workers(
            executor,
            width,
            PointCache(keep),
            stop or _never_stop,
            say or _ignore_message,
        )


@dataclass
class Workers:
    """Executor of tasks, with the cache of their results."""

    executor: Executor
    width: int
    store: PointCache
    stop: Callable[[], str]
    say: Say

    def convert(self, models: Mapping[str, ModelFile]) -> dict[str, ConversionOutcome]:
        """Convert models, each once; return the outcomes by digest."""
        outcomes: dict[str, ConversionOutcome] = {}
        for key, model in models.items():
            before = self.store.converted(model)
            if before is not None:
                outcomes[key] = before
        left = {key: model for key, model in models.items() if key not in outcomes}
        keys = {id(m): key for key, m in left.items()}
        away = {key: with_absolute_paths(model) for key, model in left.items()}
        keys |= {id(model): key for key, model in away.items()}
        for model, outcome in self._each(convert_model, iter(away.values())):
            key = keys[id(model)]
            self.store.store_conversion(left[key], outcome)
            outcomes[key] = outcome
            self.say("converting bodies", len(outcomes), len(models), None)
        return outcomes

    def runs(
        self, tasks: Iterator[RunTask]
    ) -> Iterator[tuple[RunTask, RunRecord, bool]]:
        """Yield runs as they are completed, and whether they were computed now."""
        known: list[tuple[RunTask, RunRecord]] = []

        def unknown() -> Iterator[RunTask]:
            for task in tasks:
                before = self.store.load_run(task)
                if before is None:
                    yield task
                else:
                    known.append((task, before))

        for task, record in self._each(run_task, unknown()):
            self.store.store_run(task, record)
            yield from ((t, c, False) for t, c in known)
            known.clear()
            yield task, record, True
        yield from ((t, c, False) for t, c in known)

    def _each(self, do: Callable, tasks: Iterator) -> Iterator:  # type: ignore[type-arg]
        return as_completed(self.executor, self.width, do, tasks, self.stop)


@dataclass
class _StudyRun:
    plan: StudyPlan
    doing: Workers
    outputs: Sequence[str]
    programs: Programs
    conversions: dict[str, ConversionOutcome] = field(default_factory=dict)

    def whole(self) -> Study:
        sids = {**self.plan.bodies.sids, **self._sids(Variant())}
        bodies = replace(self.plan.bodies, sids=sids)
        plan = self.plan = replace(self.plan, bodies=bodies)
        names, dropped = self._names()
        check_base_runs(plan, names, self.run_of)
        self.conversions |= self.doing.convert(self._models())
        reference = best_reference(plan, names, self.run_of, self._tight)
        points = self._points(names, reference)
        return Study(
            points=points,
            reference=reference,
            varied=plan.varied,
            dropped=dropped,
            differ=plan.differ,
            whole=plan.whole,
        )

    def _models(self) -> dict[str, ModelFile]:
        """Return the models that are not converted yet, by digest."""
        model_of: dict[str, ModelFile] = {}
        variants = dict.fromkeys(v for v, _ in self.plan.points)
        for variant in (Variant(), *variants, *self.plan.finest_variants()):
            try:
                models = self.plan.bodies.to_convert(variant)
            except InputError:
                continue
            model_of |= {model_digest(model): model for model in models.values()}
        return {
            key: model for key, model in model_of.items() if key not in self.conversions
        }

    def _sid(self, model: ModelFile) -> SID:
        """Return the SID of a model; convert it if only the reference needs it."""
        key = model_digest(model)
        if key not in self.conversions:
            self.conversions |= self.doing.convert({key: model})
        conversion = self.conversions[key]
        if conversion.sid is None:
            raise InputError(conversion.message)
        return conversion.sid

    def _names(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the outputs that are compared, and those that are not."""
        scene, sids = self.plan.bodies.as_scene(Variant(), self._sids(Variant()))
        requested_names = dict.fromkeys(self.outputs, 1.0)
        check_recorded(scene.outputs.record)
        compile_ = partial(compile_task, programs=self.programs)
        names = requested(scene, sids, requested_names or 1.0).names
        compile_(with_recorded_outputs(scene, names), sids)
        compared, dropped = comparable_outputs(
            names, scene, self.plan.varied, bool(requested_names)
        )
        if not compared:
            raise InputError(
                f"{', '.join(dropped)} do not mean the same in all variants",
                place="outputs.record",
                expected="outputs such as piston.x, rod.tip.y or pin.fx, which belong "
                "to no shape functions and to no body frame",
            )
        return compared, dropped

    def _sids(self, variant: Variant) -> dict[str, SID]:
        models = self.plan.bodies.to_convert(variant)
        return {name: self._sid(model) for name, model in models.items()}

    def run_of(
        self, variant: Variant, setting: Setting, names: Sequence[str]
    ) -> tuple[RunTask, int]:
        """Return a run and its number of elastic coordinates.

        Raises
        ------
        InputError : the variant cannot be created.
        """
        model_sids = self._sids(variant)
        scene, sids = self.plan.bodies.as_scene(variant, model_sids)
        scene = with_recorded_outputs(
            scene, available_outputs(names, scene, sids)
        ).model_copy(update={"title": ""})
        task = RunTask(scene, sids, setting, programs=self.programs)
        return task, elastic_size(scene, sids)

    def _tight(self, tasks: Sequence[RunTask]) -> list[RunRecord]:
        """Run references, each only once."""
        tasks = [replace(task, once=True) for task in tasks]
        references = {}
        for task, record, _ in self.doing.runs(iter(tasks)):
            references[id(task)] = record
            self.doing.say("reference", len(references), len(tasks), None)
        return [references[id(task)] for task in tasks]

    def _cost(self, variant: Variant) -> tuple[int, float]:
        """Return degrees of freedom and conversion time [s] of the models of a
        variant.
        """
        models = self.plan.bodies.to_convert(variant).values()
        conversions = {
            model_digest(m): self.conversions[model_digest(m)] for m in models
        }.values()
        return sum(m.dofs for m in conversions), sum(m.seconds for m in conversions)

    def _points(self, names: Sequence[str], reference: Reference) -> tuple[Point, ...]:
        places: dict[int, tuple[int, Variant, Setting, int]] = {}
        points: dict[int, Point] = {}
        slow: dict[tuple[Variant, str], float] = {}
        plan, labels = self.plan, self.plan.labels

        def tasks() -> Iterator[RunTask]:
            for row, (variant, setting) in enumerate(plan.points):
                if (setting.rtol or np.inf) < slow.get(
                    _points_by_tolerance(variant, setting), 0.0
                ):
                    message = "left out, far too slow"
                    points[row] = skipped_point(labels(variant), setting, message)
                    continue
                try:
                    task, size = self.run_of(variant, setting, names)
                except InputError as error:
                    points[row] = skipped_point(labels(variant), setting, str(error))
                    continue
                places[id(task)] = row, variant, setting, size
                tasks_alive.append(task)
                yield task

        tasks_alive: list[RunTask] = []  # so that no other task takes its id
        began, count = time.perf_counter(), 0
        for task, record, now in self.doing.runs(tasks()):
            row, variant, setting, size = places[id(task)]
            point = point_of(record, reference, labels(variant), setting, size)
            dofs, seconds = self._cost(variant)
            points[row] = replace(point, dofs=dofs, conversion=seconds)
            others = ((p.seconds, p.error) for p in points.values())
            if setting.rtol and is_hopeless(point.seconds, point.error, others):
                slow[_points_by_tolerance(variant, setting)] = setting.rtol
            count += now
            left = (len(plan.points) - len(points)) * (time.perf_counter() - began)
            text = " ".join([*labels(variant).values(), setting.integrator])
            stage = f"{text} {setting.value}"
            self.doing.say(
                stage, len(points), len(plan.points), left / count if count else None
            )
        return tuple(points[row] for row in sorted(points))


def _points_by_tolerance(variant: Variant, setting: Setting) -> tuple[Variant, str]:
    """Group points that differ in their tolerance only."""
    return variant, setting.integrator


def _never_stop() -> str:
    return ""


def _ignore_message(_: str, __: int, ___: int, ____: float | None) -> None:
    return None
