"""From a scene and a wanted accuracy to the scene that is simulated."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping
from dataclasses import astuple, dataclass, field, replace
from typing import TypeVar

from sidtool.formats.progress import Course, along
from sidtool.formats.result import AccuracyReport, OutputError, Result, Sink
from sidtool.formats.result.rows import Columns, Rows
from sidtool.formats.scene import SceneFile, expanded, unit_of
from sidtool.formats.scene.wanted import told
from sidtool.formats.sid import SID, Array

from ..made import Fineness, Source
from ..rigid import told_left_out, told_rigid
from . import cached
from .bounds import bounds
from .budget import budget
from .candidates import Choice, as_scene, finest, recording, stiffened
from .choose import Chosen, choose
from .digits import with_digits
from .elsewhere import by_matrices, in_frames
from .frames import with_frames
from .long import Proven, chosen_in_part
from .meshes import Meshes, as_made, refined_meshes
from .outside import check_inside
from .reference import Reference, make_reference
from .runs import Compile, Runs, Setting, expected_runs
from .sentences import decisions, remarks, told_bounds, told_theory
from .wanted import Request, Wanted, requested

Kind = TypeVar("Kind", bound=Result)

#: How long the search of meshes for one body takes beside that of all else, about.
MESHES = 1.0


@dataclass(frozen=True)
class Plan:
    """What is simulated: the scene with its integrator, and what it came to.

    choice, setting : what was chosen
    sids : of all bodies that have one
    frames : that bodies were put in, of those whose SIDs are not in their own
    ran : the run of it whose errors the search has seen; None where there is none that
        recorded all that the scene asks for
    """

    scene: SceneFile
    report: AccuracyReport
    choice: Choice
    setting: Setting
    sids: Mapping[str, SID]
    frames: Mapping[str, str] = field(default_factory=dict)
    ran: Result | None = None

    @property
    def told(self) -> list[str]:
        """Sentences for the notes of the result."""
        theory = told_theory(self.report)
        return [*told_rigid(self.scene), *told_left_out(self.scene), *theory]

    def delivered(self, told: Iterable[str]) -> Result | None:
        """What the search has run, as another run of its scene would be.

        told : sentences for the notes, behind those of the compiled scene
        """
        if self.ran is None:
            return None
        notes = tuple(dict.fromkeys((*told, *self.ran.notes)))
        return self.certified(replace(self.ran, notes=notes))

    def certified(self, result: Kind) -> Kind:
        """The result of the run with its errors."""
        return replace(result, accuracy=self.report)


class Certified:
    """A sink whose result carries its errors."""

    def __init__(self, sink: Sink, plan: Plan) -> None:
        self._sink, self._plan = sink, plan

    def begin(self, columns: Columns, most: int) -> None:
        self._sink.begin(columns, most)

    def add(self, rows: Rows) -> None:
        self._sink.add(rows)

    def finish(self, result: Result) -> None:
        self._sink.finish(self._plan.certified(result))


def planned(
    scene: SceneFile,
    sids: Mapping[str, SID],
    wanted: Wanted,
    compile_: Compile,
    *,
    models: Mapping[str, Source] | None = None,
    keep: bool = True,
    frames: bool = True,
) -> Plan:
    """The cheapest model and integration whose errors are within what is wanted.

    The second time nothing is searched.

    Parameters
    ----------
    scene : with whatever it leaves out itself; its rtol and integrator do not count
    sids : of all bodies that have one
    wanted : see `[accuracy] wanted`
    compile_ : makes a system of a scene and SIDs
    models : of bodies that are made of them, whose meshes are refined as needed
    keep : False where the scene is not all that is simulated, as with callables
    frames : False where bodies must stay in the frames that their SIDs have

    Raises
    ------
    OutsideTheory : a body leaves what its SID describes.
    InputError : an output cannot be predicted as exactly as that, or the scene cannot
        be simulated.
    SimulationError : the finest model cannot be run to its end.
    """
    models = models or {}
    key = cached.key_of(scene, sids, (wanted, frames), models) if keep else ""
    kept = cached.read(key) if keep else None
    before = None if kept is None else _as_kept(kept, scene, sids, models)
    if before is not None:
        return before
    began = time.perf_counter()
    request = requested(scene, sids, wanted)
    with along(Course({"meshes": MESHES * len(models), "choices": 1.0})) as parts:
        parts.enter("meshes")
        meshes = refined_meshes(scene, sids, models, request, compile_)
        scene, sids = meshes.scene(scene), meshes.sids(sids)
        parts.enter("choices")
        plan = _chosen(scene, sids, request, meshes, compile_, frames)
    seconds = time.perf_counter() - began
    report = plan.report.model_copy(update={"wanted": told(wanted), "seconds": seconds})
    if keep:
        levels = {n: astuple(f)[:3] for n, f in meshes.finenesses.items()}
        kept = cached.Kept(
            key=key,
            choice=plan.choice,
            setting=plan.setting,
            report=report,
            models=levels,
            frames=dict(plan.frames),
        )
        cached.write(kept)
    return replace(plan, report=report)


def _as_kept(
    kept: cached.Kept,
    scene: SceneFile,
    sids: Mapping[str, SID],
    models: Mapping[str, Source],
) -> Plan | None:
    """The plan for a scene by a choice that was kept; None where it does not fit."""
    if not (kept.models.keys() == models.keys() and kept.frames.keys() <= sids.keys()):
        return None
    meshes = as_made(models, {n: Fineness(*kept.models[n]) for n in models})
    scene = meshes.scene(scene)
    there = in_frames(scene, meshes.sids(sids), kept.frames)
    scene = by_matrices(scene, kept.frames)
    if not kept.choice.is_part_of(finest(scene, there)):
        return None
    model = chosen_scene(scene, there, kept.choice, kept.setting)
    report = kept.report.model_copy(update={"searched": False})
    return Plan(model, report, kept.choice, kept.setting, there, kept.frames)


def _chosen(
    scene: SceneFile,
    sids: Mapping[str, SID],
    request: Request,
    meshes: Meshes,
    compile_: Compile,
    free: bool,
) -> Plan:
    """The search among what the SIDs have, in other frames if these are `free`."""
    whole = finest(scene, sids)
    expected = expected_runs(whole, scene.dimension)
    runs = Runs(scene, sids, compile_, request.names, expected)
    with along(runs.parts):
        runs.begin("reference")
        found = chosen_in_part(runs, whole, request, meshes.errors)
        found = found or _of_whole_runs(runs, whole, request, meshes, free)
    reference, chosen = found.reference, found.chosen
    terms = stiffened(scene, sids, chosen.choice.flat)
    made = decisions(request, found.decided, chosen)
    sentences = (
        *meshes.sentences,
        *(decision.sentence for decision in made),
        *remarks(
            scene, request, reference, sids, terms, meshes.made, meshes.unstiffened
        ),
        *found.sentences,
        *told_bounds(found.bounds, scene),
        *_not_recorded(scene, sids, chosen),
    )
    report = AccuracyReport(
        wanted={},
        outputs=_outputs(request, reference, chosen, found.bounds, found.theory, scene),
        budget=found.lines,
        decisions=made,
        sentences=sentences,
        runs=found.runs.count,
        seconds=0.0,
        notes=reference.result.notes,
    )
    runs, choice = found.runs, chosen.choice
    setting = chosen.found.setting
    model = chosen_scene(runs.scene, runs.sids, choice, setting)
    as_asked = model.outputs.record == tuple(filter(choice.knows, runs.names))
    ran = runs.attempt(choice, setting) if as_asked else None
    return Plan(model, report, choice, setting, runs.sids, found.frames, ran)


def _of_whole_runs(
    runs: Runs, whole: Choice, request: Request, meshes: Meshes, free: bool
) -> Proven:
    """What is chosen by runs of all of the time."""
    reference = make_reference(runs, whole, request)
    check_inside(reference.result)
    reference = reference.with_meshes(meshes.errors)
    reference, digits = with_digits(runs, reference)
    frames = with_frames(runs, reference, request, fixed=not free)
    runs, reference = frames.runs, frames.reference
    chosen = choose(runs, reference)
    runs.begin("errors")
    proven = bounds(runs, reference.choice, chosen.choice, chosen.found.setting)
    lines = budget(runs, reference, chosen, frames.theory)
    told = (*digits, *frames.sentences)
    return Proven(
        runs,
        reference,
        chosen,
        reference,
        frames.theory,
        lines,
        told,
        proven,
        frames.chosen,
    )


def chosen_scene(
    scene: SceneFile, sids: Mapping[str, SID], choice: Choice, setting: Setting
) -> SceneFile:
    """The scene of the chosen model, that records what of its outputs there is."""
    found = as_scene(scene, choice, sids)
    known = tuple(filter(choice.knows, _recorded(scene, sids)))
    accuracy = found.accuracy.model_copy(
        update={"integrator": setting.integrator, "rtol": setting.rtol}
    )
    return recording(found.model_copy(update={"accuracy": accuracy}), known)


def _not_recorded(
    scene: SceneFile, sids: Mapping[str, SID], chosen: Chosen
) -> tuple[str, ...]:
    """A sentence about outputs that the chosen model does not have."""
    names = [n for n in _recorded(scene, sids) if not chosen.choice.knows(n)]
    return (f"not recorded, as left out: {', '.join(names)}",) if names else ()


def _recorded(scene: SceneFile, sids: Mapping[str, SID]) -> tuple[str, ...]:
    """Recorded outputs, with wildcards expanded; q* stands as it is."""
    return expanded(scene.outputs.record, scene, sids, "outputs.record")


def _outputs(
    request: Request,
    reference: Reference,
    chosen: Chosen,
    proven: Mapping[str, float],
    theory: Array,
    scene: SceneFile,
) -> tuple[OutputError, ...]:
    rows = zip(
        request.names,
        chosen.errors,
        reference.variation,
        reference.allowed,
        theory,
        strict=True,
    )
    return tuple(
        OutputError(
            name=name,
            unit=unit_of(name, scene),
            error=float(error),
            variation=float(variation),
            allowed=float(allowed),
            bound=proven.get(name),
            theory=float(left_out) if left_out else None,
        )
        for name, error, variation, allowed, left_out in rows
        if name not in reference.left_out
    )
