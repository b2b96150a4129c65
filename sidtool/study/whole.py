"""A study: bodies are converted, references run, and then all points."""

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

from sidtool.formats.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import SID

from ..accuracy.candidates import recording
from ..accuracy.wanted import requested
from ..made import Source, digest_of
from ..swaps import swapped
from .axes import Values, Variant
from .base import check_base
from .bodies import Bodies, absolute, elastic_size, known
from .finest import best_reference
from .kept import Store
from .measuring import Course, is_hopeless
from .outcome import Study
from .plan import Plan, comparable, planned
from .points import Point, point_of, skipped
from .pool import each, pool
from .reference import Reference, check_recorded
from .settings import Setting
from .tasks import Converted, Programs, Run, compiled, convert, run

#: Told what is done: a text, points that are done and all, and seconds that are left.
Say = Callable[[str, int, int, float | None], None]


def study(
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
    """Run a scene in many variants and compare each run with one that is far richer.

    Parameters
    ----------
    over : axes and their values, see `axes.AXES`, () for the defaults; default
        integrators and tolerances alone
    sids : that replace those of the scene
    models : model files by body, which replace its SID; several are variants, the first
        of each body together, the second of each, and so on
    settings : how runs are integrated; default all integrators at `TOLERANCES`, and
        fewer where other things vary, too
    outputs : names of those that count, default all that the scene records
    differ : in how many choices a point differs from the scene at most, default as many
        as make `plan.MOST` points
    keep : folder of finished points, which are not computed again
    jobs : processes; 1 for this one
    dask : address of a Dask scheduler, whose cluster is used instead
    stop : asked from time to time why to end, if at all
    say : told what is done
    programs : callables for `drives` and `forces`, in this process only

    Raises
    ------
    InputError : the scene records nothing, or not what `outputs` asks for; an axis does
        not fit the scene; no model of it can be run.
    Ended : `stop` said why.
    """
    folder = Path(base_folder or scene.folder)
    bodies = _bodies(scene, folder, sids or {}, models or {})
    plan = planned(bodies, over or {}, settings, differ)
    with workers(jobs, dask, keep, stop, say) as doing:
        return _Study(plan, doing, outputs, programs or {}).whole()


def _bodies(
    scene: SceneFile,
    folder: Path,
    sids: Mapping[str, SID | str | os.PathLike[str]],
    models: Mapping[str, Sequence[str | os.PathLike[str]]],
) -> Bodies:
    from sidtool.formats.sid_files import read_sid

    content, given = swapped(scene, sids, folder)
    unknown = [name for name in models if name not in content.flexible]
    if unknown:
        raise InputError(
            f"there is no flexible body {unknown[0]!r}",
            place="--model",
            expected=", ".join(content.flexible) or "a scene with flexible bodies",
        )
    sources: dict[str, Sequence[Source]] = {}
    known: dict[str, SID] = dict(given)
    for name, body in content.sid_bodies.items():
        if name in models:
            sources[name] = [Source(Path(path), folder) for path in models[name]]
        elif body.model and name not in given and not body.sid:
            sources[name] = [Source(folder / body.model, folder)]
        elif name not in given:
            known[name] = read_sid(folder / body.sid)
    most = max((len(found) for found in sources.values()), default=1)
    for name, found in sources.items():
        if len(found) not in (1, most):
            raise InputError(
                f"{name} has {len(found)} models, another body {most}",
                place="--model",
                expected="one model for a body, or as many as for the others",
            )
        sources[name] = [*found] * (most // len(found))
    return Bodies(content, known, sources)


@contextmanager
def workers(
    jobs: int,
    dask: str | None = None,
    keep: Path | None = None,
    stop: Callable[[], str] | None = None,
    say: Say | None = None,
) -> Iterator[Workers]:
    """Processes, or a cluster, for conversions and runs; arguments as of `study`."""
    with pool(jobs, dask) as (executor, width):
        yield Workers(executor, width, Store(keep), stop or _never, say or _silent)


@dataclass
class Workers:
    """Tasks that are done by somebody, and kept."""

    executor: Executor
    width: int
    store: Store
    stop: Callable[[], str]
    say: Say

    def convert(self, models: Mapping[str, ModelFile]) -> dict[str, Converted]:
        """Models by their digests, each once."""
        found: dict[str, Converted] = {}
        for key, model in models.items():
            before = self.store.converted(model)
            if before is not None:
                found[key] = before
        left = {key: model for key, model in models.items() if key not in found}
        keys = {id(m): key for key, m in left.items()}
        away = {key: absolute(model) for key, model in left.items()}
        keys |= {id(model): key for key, model in away.items()}
        for model, made in self._each(convert, iter(away.values())):
            key = keys[id(model)]
            self.store.keep_converted(left[key], made)
            found[key] = made
            self.say("converting bodies", len(found), len(models), None)
        return found

    def runs(self, tasks: Iterator[Run]) -> Iterator[tuple[Run, Course, bool]]:
        """Runs as they are done, and whether they were made now."""
        known: list[tuple[Run, Course]] = []

        def unknown() -> Iterator[Run]:
            for task in tasks:
                before = self.store.course(task)
                if before is None:
                    yield task
                else:
                    known.append((task, before))

        for task, made in self._each(run, unknown()):
            self.store.keep_course(task, made)
            yield from ((t, c, False) for t, c in known)
            known.clear()
            yield task, made, True
        yield from ((t, c, False) for t, c in known)

    def _each(self, do: Callable, tasks: Iterator) -> Iterator:  # type: ignore[type-arg]
        return each(self.executor, self.width, do, tasks, self.stop)


@dataclass
class _Study:
    plan: Plan
    doing: Workers
    outputs: Sequence[str]
    programs: Programs
    made: dict[str, Converted] = field(default_factory=dict)

    def whole(self) -> Study:
        sids = {**self.plan.bodies.sids, **self._sids(Variant())}
        bodies = replace(self.plan.bodies, sids=sids)
        plan = self.plan = replace(self.plan, bodies=bodies)
        names, dropped = self._names()
        check_base(plan, names, self.run_of)
        self.made |= self.doing.convert(self._models())
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
        """All models that are still to be converted, by their digests."""
        found: dict[str, ModelFile] = {}
        variants = dict.fromkeys(v for v, _ in self.plan.points)
        for variant in (Variant(), *variants, *self.plan.richest()):
            try:
                models = self.plan.bodies.to_convert(variant)
            except InputError:
                continue
            found |= {digest_of(model): model for model in models.values()}
        return {key: model for key, model in found.items() if key not in self.made}

    def _sid(self, model: ModelFile) -> SID:
        """Converted by now, or now: the reference may need what no point has."""
        key = digest_of(model)
        if key not in self.made:
            self.made |= self.doing.convert({key: model})
        made = self.made[key]
        if made.sid is None:
            raise InputError(made.message)
        return made.sid

    def _names(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Outputs that are compared, and those that are not."""
        scene, sids = self.plan.bodies.as_scene(Variant(), self._sids(Variant()))
        asked = dict.fromkeys(self.outputs, 1.0)
        check_recorded(scene.outputs.record)
        compile_ = partial(compiled, programs=self.programs)
        names = requested(scene, sids, asked or 1.0).names
        compile_(recording(scene, names), sids)
        kept, dropped = comparable(names, scene, self.plan.varied, bool(asked))
        if not kept:
            raise InputError(
                f"{', '.join(dropped)} do not mean the same in all variants",
                place="outputs.record",
                expected="outputs such as piston.x, rod.tip.y or pin.fx, which belong "
                "to no shape functions and to no body frame",
            )
        return kept, dropped

    def _sids(self, variant: Variant) -> dict[str, SID]:
        models = self.plan.bodies.to_convert(variant)
        return {name: self._sid(model) for name, model in models.items()}

    def run_of(
        self, variant: Variant, setting: Setting, names: Sequence[str]
    ) -> tuple[Run, int]:
        """A run and its number of elastic coordinates.

        Raises
        ------
        InputError : the variant cannot be made.
        """
        made = self._sids(variant)
        scene, sids = self.plan.bodies.as_scene(variant, made)
        scene = recording(scene, known(names, scene, sids)).model_copy(
            update={"title": ""}
        )
        task = Run(scene, sids, setting, programs=self.programs)
        return task, elastic_size(scene, sids)

    def _tight(self, tasks: Sequence[Run]) -> list[Course]:
        """References, which are run once."""
        tasks = [replace(task, once=True) for task in tasks]
        found = {}
        for task, course, _ in self.doing.runs(iter(tasks)):
            found[id(task)] = course
            self.doing.say("reference", len(found), len(tasks), None)
        return [found[id(task)] for task in tasks]

    def _cost(self, variant: Variant) -> tuple[int, float]:
        """Degrees of freedom and seconds of all models of a variant, each once."""
        models = self.plan.bodies.to_convert(variant).values()
        made = {digest_of(m): self.made[digest_of(m)] for m in models}.values()
        return sum(m.dofs for m in made), sum(m.seconds for m in made)

    def _points(self, names: Sequence[str], reference: Reference) -> tuple[Point, ...]:
        places: dict[int, tuple[int, Variant, Setting, int]] = {}
        points: dict[int, Point] = {}
        slow: dict[tuple[Variant, str], float] = {}
        plan, labels = self.plan, self.plan.labels

        def tasks() -> Iterator[Run]:
            for row, (variant, setting) in enumerate(plan.points):
                if (setting.rtol or np.inf) < slow.get(_chain(variant, setting), 0.0):
                    message = "left out, far too slow"
                    points[row] = skipped(labels(variant), setting, message)
                    continue
                try:
                    task, size = self.run_of(variant, setting, names)
                except InputError as error:
                    points[row] = skipped(labels(variant), setting, str(error))
                    continue
                places[id(task)] = row, variant, setting, size
                kept.append(task)
                yield task

        kept: list[Run] = []  # so that no other task takes its id
        began, count = time.perf_counter(), 0
        for task, course, now in self.doing.runs(tasks()):
            row, variant, setting, size = places[id(task)]
            point = point_of(course, reference, labels(variant), setting, size)
            dofs, seconds = self._cost(variant)
            points[row] = replace(point, dofs=dofs, conversion=seconds)
            others = ((p.seconds, p.error) for p in points.values())
            if setting.rtol and is_hopeless(point.seconds, point.error, others):
                slow[_chain(variant, setting)] = setting.rtol
            count += now
            left = (len(plan.points) - len(points)) * (time.perf_counter() - began)
            text = " ".join([*labels(variant).values(), setting.integrator])
            told = f"{text} {setting.value}"
            self.doing.say(
                told, len(points), len(plan.points), left / count if count else None
            )
        return tuple(points[row] for row in sorted(points))


def _chain(variant: Variant, setting: Setting) -> tuple[Variant, str]:
    """Points that differ in their tolerance alone."""
    return variant, setting.integrator


def _never() -> str:
    return ""


def _silent(_: str, __: int, ___: int, ____: float | None) -> None:
    return None
