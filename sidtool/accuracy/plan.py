"""From a scene and a requested accuracy to the scene that is simulated."""

import time
from collections.abc import Iterable, Mapping
from dataclasses import astuple, dataclass, field, replace
from typing import Any, TypeVar

from sidtool.formats.base.progress import NamedStages, count_within
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.diagnostics import Diagnostic, from_data, without
from sidtool.formats.result import AccuracyReport, OutputError, Result, Sink
from sidtool.formats.result.data import Columns, Rows
from sidtool.formats.scene import SceneFile, expand_names, unit_of
from sidtool.formats.scene.accuracy import request_texts

from ..measurement import cache
from ..measurement.candidates import (
    Choice,
    bodies_with_stiffening,
    finest_model,
    scene_of_model,
    with_recorded_outputs,
)
from ..measurement.request import Request, Wanted, requested
from ..measurement.runs import Compile, Runs, Setting, check_validity, expected_runs
from ..pipeline.model_cache import BodyModel, Refinement
from ..pipeline.scene_changes import reduced_body_notes, rigid_body_notes
from .error_bounds import error_bounds, error_budget
from .frames import select_frames, sids_in_frames, with_matrix_damping
from .long_run_part import select_in_initial_interval
from .long_run_reference import VerifiedChoice
from .mesh_choice import RefinedBodies, bodies_from_cache, refine_bodies
from .reference_run import Reference, make_reference
from .report import (
    decision_list,
    excluded_errors,
    outputs_without_error,
    theory_diagnostics,
)
from .selection import SelectedModel, select_model
from .sid_rounding import with_rounding_error

Kind = TypeVar("Kind", bound=Result)

#: Approximate duration of the mesh search of one body, relative to the model search.
MESH_SEARCH_DURATION = 1.0


@dataclass(frozen=True)
class Plan:
    """The scene that is simulated, with its integrator, and the accuracy report.

    Attributes
    ----------
    choice, setting : selected model and integration
    sids : SIDs of all bodies that have one
    frames : frames of bodies whose SIDs are in another frame
    evaluated_run : run of the search whose errors are known; None if no run recorded
        all outputs of the scene
    search_diagnostics : of the search
    reference_diagnostics : of the run of the finest model
    """

    scene: SceneFile
    report: AccuracyReport
    choice: Choice
    setting: Setting
    sids: Mapping[str, SID]
    frames: Mapping[str, str] = field(default_factory=dict)
    evaluated_run: Result | None = None
    search_diagnostics: tuple[Diagnostic, ...] = ()
    reference_diagnostics: tuple[Diagnostic, ...] = ()

    @property
    def diagnostics(self) -> list[Diagnostic]:
        """Return the diagnostics of the result on the selected model."""
        made = *rigid_body_notes(self.scene), *reduced_body_notes(self.scene)
        return [*made, *self.search_diagnostics]

    def certified(self, sink: Sink) -> Sink:
        """Return a sink that writes the errors of the outputs with the result."""
        return Certified(sink, self)

    def known_result(self, of_run: Iterable[Diagnostic]) -> Result | None:
        """Return the result of the search that a run of this scene would give, or None.

        Parameters
        ----------
        of_run : diagnostics after those of the compiled scene
        """
        if self.evaluated_run is None:
            return None
        found = (*of_run, *self.evaluated_run.diagnostics)
        ignored = self.scene.diagnostics.ignore
        known = replace(self.evaluated_run, diagnostics=without(found, ignored))
        return self.with_errors(known)

    def with_errors(self, result: Kind) -> Kind:
        """Return the result of the run with the accuracy report, and with the warnings
        of the finest model that its own run does not have.
        """
        known = {(each.code, each.subject) for each in result.diagnostics}
        more = (
            each
            for each in self.reference_diagnostics
            if each.is_warning and (each.code, each.subject) not in known
        )
        found = without((*result.diagnostics, *more), self.scene.diagnostics.ignore)
        return replace(result, accuracy=self.report, diagnostics=found)


class Certified:
    """Sink that adds the accuracy report to its result."""

    def __init__(self, sink: Sink, plan: Plan) -> None:
        self._sink, self._plan = sink, plan

    def begin(self, columns: Columns, most: int) -> None:
        self._sink.begin(columns, most)

    def add(self, rows: Rows) -> None:
        self._sink.add(rows)

    def finish(self, result: Result) -> None:
        self._sink.finish(self._plan.with_errors(result))


def make_accuracy_plan(
    scene: SceneFile,
    sids: Mapping[str, SID],
    wanted: Wanted,
    compile_: Compile,
    *,
    models: Mapping[str, BodyModel] | None = None,
    keep: bool = True,
    frames: bool = True,
) -> Plan:
    """Find the fastest model and integration whose errors are within the request.

    A repeated request is answered from the cache.

    Parameters
    ----------
    scene : the scene with its own reductions; its rtol and integrator do not count
    sids : SIDs of all bodies that have one
    wanted : see `[accuracy] wanted`
    compile_ : function that compiles a scene with SIDs
    models : models of bodies, whose meshes are refined as needed
    keep : False if the scene does not define the motion completely, as with callables
    frames : False if bodies must stay in the frames of their SIDs

    Raises
    ------
    OutsideTheory : a body leaves the range of its SID.
    InputError : an output cannot be predicted with this accuracy, or the scene cannot
        be simulated.
    SimulationError : the finest model cannot be run to its end.
    """
    models = models or {}
    key = cache.cache_key(scene, sids, (wanted, frames), models) if keep else ""
    entry = cache.read_entry(key) if keep else None
    before = None if entry is None else _plan_from_cache(entry, scene, sids, models)
    if before is not None:
        return before
    began = time.perf_counter()
    request = requested(scene, sids, wanted)
    with count_within(
        NamedStages({"meshes": MESH_SEARCH_DURATION * len(models), "choices": 1.0})
    ) as parts:
        parts.enter("meshes")
        meshes = refine_bodies(scene, sids, models, request, compile_)
        scene, sids = meshes.scene(scene), meshes.sids(sids)
        parts.enter("choices")
        plan = _search_model(scene, sids, request, meshes, compile_, frames)
    seconds = time.perf_counter() - began
    report = plan.report.model_copy(
        update={"wanted": request_texts(wanted), "seconds": seconds}
    )
    if keep:
        levels = {n: astuple(f)[:3] for n, f in meshes.refinements.items()}
        entry = cache.CacheEntry(
            key=key,
            choice=plan.choice,
            setting=plan.setting,
            report=report,
            models=levels,
            frames=dict(plan.frames),
            diagnostics=_as_records(plan.search_diagnostics),
            reference_diagnostics=_as_records(plan.reference_diagnostics),
        )
        cache.write_entry(entry)
    return replace(plan, report=report)


def _plan_from_cache(
    entry: cache.CacheEntry,
    scene: SceneFile,
    sids: Mapping[str, SID],
    models: Mapping[str, BodyModel],
) -> Plan | None:
    """Make the plan of a cached choice; None if it does not fit the scene."""
    if not (
        entry.models.keys() == models.keys() and entry.frames.keys() <= sids.keys()
    ):
        return None
    meshes = bodies_from_cache(
        models, {n: Refinement(*entry.models[n]) for n in models}
    )
    scene = meshes.scene(scene)
    there = sids_in_frames(scene, meshes.sids(sids), entry.frames)
    scene = with_matrix_damping(scene, entry.frames)
    if not entry.choice.is_part_of(finest_model(scene, there)):
        return None
    model = scene_of_choice(scene, there, entry.choice, entry.setting)
    report = entry.report.model_copy(update={"searched": False})
    return Plan(
        model,
        report,
        entry.choice,
        entry.setting,
        there,
        entry.frames,
        search_diagnostics=tuple(map(from_data, entry.diagnostics)),
        reference_diagnostics=tuple(map(from_data, entry.reference_diagnostics)),
    )


def _as_records(diagnostics: Iterable[Diagnostic]) -> tuple[dict[str, Any], ...]:
    return tuple(each.as_data() for each in diagnostics)


def _search_model(
    scene: SceneFile,
    sids: Mapping[str, SID],
    request: Request,
    meshes: RefinedBodies,
    compile_: Compile,
    free: bool,
) -> Plan:
    """The search among what the SIDs have, in other frames if these are `free`."""
    whole = finest_model(scene, sids)
    expected = expected_runs(whole, scene.dimension)
    runs = Runs(scene, sids, compile_, request.names, expected)
    with count_within(runs.parts):
        runs.begin("reference")
        selected = select_in_initial_interval(runs, whole, request, meshes.errors)
        selected = selected or _select_by_full_runs(runs, whole, request, meshes, free)
    reference, chosen = selected.reference, selected.chosen
    terms = bodies_with_stiffening(scene, sids, chosen.choice.flat)
    decided = decision_list(request, selected.decision_reference, chosen)
    outputs = _output_errors(
        request, reference, chosen, selected.bounds, selected.theory, scene
    )
    bodies = meshes.converted_bodies
    has_output = chosen.choice.has_output
    lost = [n for n in _recorded_outputs(scene, sids) if not has_output(n)]
    found = (
        *excluded_errors(scene, reference, sids, terms, bodies, meshes.unstiffened),
        *theory_diagnostics(outputs),
        *meshes.diagnostics,
        *selected.diagnostics,
        *outputs_without_error(request, reference, lost),
    )
    report = AccuracyReport(
        wanted={},
        outputs=outputs,
        budget=selected.lines,
        decisions=(*meshes.decisions, *decided),
        runs=selected.runs.count,
        seconds=0.0,
    )
    runs, choice = selected.runs, chosen.choice
    setting = chosen.accepted_run.setting
    model = scene_of_choice(runs.scene, runs.sids, choice, setting)
    as_asked = model.outputs.record == tuple(filter(choice.has_output, runs.names))
    ran = runs.attempt(choice, setting) if as_asked else None
    return Plan(
        model,
        report,
        choice,
        setting,
        runs.sids,
        selected.frames,
        ran,
        found,
        reference.result.diagnostics,
    )


def _select_by_full_runs(
    runs: Runs, whole: Choice, request: Request, meshes: RefinedBodies, free: bool
) -> VerifiedChoice:
    """Select a model by runs over the full interval."""
    reference = make_reference(runs, whole, request)
    check_validity(reference.result)
    reference = reference.with_mesh_errors(meshes.errors)
    reference, digits = with_rounding_error(runs, reference)
    frames = select_frames(runs, reference, request, fixed=not free)
    runs, reference = frames.runs, frames.reference
    chosen = select_model(runs, reference)
    runs.begin("errors")
    proven = error_bounds(
        runs, reference.choice, chosen.choice, chosen.accepted_run.setting
    )
    lines = error_budget(runs, reference, chosen, frames.theory)
    found = (*digits, *frames.diagnostics)
    return VerifiedChoice(
        runs,
        reference,
        chosen,
        reference,
        frames.theory,
        lines,
        found,
        proven,
        frames.chosen,
    )


def scene_of_choice(
    scene: SceneFile, sids: Mapping[str, SID], choice: Choice, setting: Setting
) -> SceneFile:
    """Return the scene of the chosen model; it records the outputs that the model
    has.
    """
    reduced = scene_of_model(scene, choice, sids)
    known = tuple(filter(choice.has_output, _recorded_outputs(scene, sids)))
    accuracy = reduced.accuracy.model_copy(
        update={"integrator": setting.integrator, "rtol": setting.rtol}
    )
    return with_recorded_outputs(
        reduced.model_copy(update={"accuracy": accuracy}), known
    )


def _recorded_outputs(scene: SceneFile, sids: Mapping[str, SID]) -> tuple[str, ...]:
    """Return the recorded outputs with expanded wildcards; q* stays as it is."""
    return expand_names(scene.outputs.record, scene, sids, "outputs.record")


def _output_errors(
    request: Request,
    reference: Reference,
    chosen: SelectedModel,
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
