"""What is told of a run at its end."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.result import Result
from sidtool.formats.result.bodies import (
    LARGE,
    LARGE_ROTATION,
    MEANINGLESS,
    find_failure,
    find_warnings,
)
from sidtool.formats.result.data import TABLES
from sidtool.formats.scene import watched
from sidtool.formats.sid import Array
from sidtool.formats.storage.versions import versions

from .advice import notes
from .advice.asked.carried_away import carried_away
from .advice.bifurcations import crossings
from .advice.body_measures import find_state_warnings
from .advice.far_starts import far_starts
from .advice.stopping import (
    CAUSES,
    REMEDIES,
    demanded_too_much,
    explained,
    jammed,
    lost_inertia,
    near_singular,
    too_light,
)
from .integrators import stepping
from .linear.memory import Memory
from .recording import outputs
from .recording.sampling import Samples
from .start import assembly
from .start.displacements import told_displacements
from .start.settings import made_with
from .start.turn_counts import lost_turn
from .system.forces.lapses import lapse, rejected_trials

if TYPE_CHECKING:
    from .running import Run
    from .system.scene import System

#: Velocity coordinates up to which a static start is tried before it is advised.
MOST_TRIED = 300


def result_of(
    run: Run, seconds: dict[str, float], failure: str, rows: Mapping[str, Any]
) -> Result:
    """What a run found; what is told of it waits until somebody looks at it.

    rows : t and the tables, where they are known; default they are empty
    """
    system, recorder = run.system, run.recorder
    columns = recorder.columns
    tables: dict[str, Any] = {TABLES[table]: names for table, names in columns.items()}
    if not rows:
        none = {table: np.zeros((0, len(names))) for table, names in columns.items()}
        rows = {"t": np.zeros(0), **none}
    known = Result(
        title=system.scene.title,
        **tables,
        **rows,
        counters=_counters(run) | seconds,
        drift={
            "position": run.control.drift,
            "velocity": run.control.drift_rate,
        },
        settings=_settings(run),
        events=tuple(sorted(recorder.events, key=lambda event: event.t)),
        sids=system.sids,
        versions=versions(),
        completed=not failure,
        message=failure or _event_at_the_end(run),
    )
    scene, settings = system.scene, run.settings
    known = known.late(lambda: {"scene": made_with(scene, settings)}, "scene")
    return known.late(lambda: _told(run), "bodies", "notes", "warnings")


def _told(run: Run) -> dict[str, Any]:
    """What is known of a run beside its numbers."""
    scene, remarks = run.system.scene, run.recorder.verdicts.found.remarks
    warnings = find_warnings(run.recorder.bodies)
    return {
        "bodies": run.recorder.bodies,
        "notes": (*warnings, *_notes(run), *remarks.sentences(watched(scene))),
        "warnings": warnings,
    }


def may_leave_theory(run: Run) -> bool:
    """Whether a body may have left linear theory by its deformation; False is certain.

    Cheap, while the warnings of a result are found once somebody looks at them.
    """
    return run.recorder.may_exceed(LARGE, LARGE_ROTATION)


def why_failed(run: Run, stopped: str) -> str:
    """Why a run stopped early, or why its numbers mean nothing; empty if they do.

    stopped : why the run stopped early, if it did
    """
    if stopped:
        return explained(stopped, run.recorder.bodies)
    if not run.recorder.may_exceed(MEANINGLESS, np.inf):
        return ""
    return find_failure(run.recorder.bodies)


def failure_of(run: Run, code: int) -> str:
    """Why the step loop could not go on."""
    system, work, control = run.system, run.work, run.control
    said = lapse(system, work, since=run.now)
    if said:
        return f"stopped at t = {run.now:.9g} s: {said}"
    cause = CAUSES.get(code, f"code {code}")
    if code in (stepping.TOO_SMALL, stepping.OFF_CONSTRAINTS):
        cause = lost_turn(system, work, control) or cause
    worst = outputs.busiest_body(system, control)
    text = f"stopped at t = {run.now:.9g} s: {cause} (fastest change: {worst})"
    if why := demanded_too_much(system, run.now, *_last_sound_state(run)):
        return f"{text}; {why}"
    fixed = control.fixed_step == 1
    text += REMEDIES.get(code, "") if fixed else ""
    text += (
        lost_inertia(system, work, run.now)
        or too_light(system, work)
        or jammed(system, run.memory, run.now, control)
        or near_singular(control, bool(run.method.passing_loop))
    )
    if system.redundant:
        rows = assembly.names_of_rows(system, system.redundant)
        names = ", ".join(dict.fromkeys(rows))
        text += f"; redundant at the start, perhaps contradicting now: {names}"
    return text


def _last_sound_state(run: Run) -> tuple[Array, Array]:
    """Positions and velocities of the last known state within linear theory.

    Where a body has deformed by more, its frame is anywhere, and rounding decides which
    joints can be met from there. A state with values that are not finite is returned as
    it is.
    """
    system, control = run.system, run.control
    if not np.isfinite(control.z).all():
        return control.z, control.v
    _, z, v = run.window.reached(control)
    states = [(control.z, control.v), *zip(z[::-1], v[::-1], strict=True)]
    for positions, velocities in states:
        if not find_state_warnings(system, positions[None]):
            return positions, velocities
    return run.recorder.sound or (run.start.z, run.start.v)


def _settings(run: Run) -> dict[str, str | float]:
    """How the run was made."""
    settings = run.settings
    name = settings.integrator
    if not math.isnan(run.switched):
        name += f", then {settings.when_stiff} from t = {run.switched:.6g} s"
    told: dict[str, str | float] = {"integrator": name, "rtol": settings.rtol}
    told["step"] = settings.step or 0.0
    if run.method.damps:
        told["spectral_radius"] = settings.radius
    return told


def _notes(run: Run) -> Iterator[str]:
    """What a reader has to know of the numbers."""
    system, recorder, rtol = run.system, run.recorder, run.settings.rtol
    steps = run.memory.steps
    yield from dict.fromkeys((*run.told, *run.ready.asked))
    yield from crossings(system, run.kernels, run.control, rtol, run.start.z)
    yield from told_displacements(system, recorder.sampler.work, run.start, rtol)
    if run.now >= system.scene.time.end and not _event_at_the_end(run):
        yield from notes.of_output_times(system.scene, float(run.times[-1:][0]))
    yield from notes.of_programs(system)
    yield from notes.of_peaks(system)
    yield from notes.of_sampled_loops(system, run.control, run.start.z)
    if run.control.fixed_step != 1:
        span = run.now - system.scene.time.start
        yield from recorder.verdicts.found.vibrations.sentences(steps, span)
    yield from notes.hidden_errors(system, run.control, rtol, steps)
    reached_end = run.now >= system.scene.time.end or _event_at_the_end(run)
    if reached_end:  # speeds where a run stops are those of its failure
        yield from notes.many_turns(run.control, run.settings)
        yield from rejected_trials(system, run.work)
    yield from notes.passed_over(system, run.control, run.settings)
    yield from _forced(run)
    ends = (system.scene.time.start, run.now)
    start, control = run.start, run.control
    if reached_end:
        yield from carried_away(
            system, ends, np.array([start.z, control.z]), np.array([start.v, control.v])
        )
    bodies = recorder.bodies
    if bodies and run.now > system.scene.time.start:
        yield from far_starts(
            system, _first(run), bodies, lambda: _has_static_start(system)
        )


def _has_static_start(system: System) -> bool:
    """Whether the scene can start in a static equilibrium, and does not yet.

    It is tried: a free mechanism has none, or has one by its springs. Not for large
    scenes, nor where a program gives functions.
    """
    from . import compile_scene

    scene = system.scene
    asked = scene.initial.state == "static" or bool(system.seen)
    if asked or system.n_velocities > MOST_TRIED:
        return False
    initial = scene.initial.model_copy(update={"state": "static"})
    at_rest = scene.model_copy(update={"initial": initial})
    try:
        compile_scene(at_rest, sids=system.sids)
    except InputError:
        return False
    return True


def _forced(run: Run) -> Iterator[str]:
    """What joints and drives deform instead of loads."""
    bent = [n for n, body in run.recorder.bodies.items() if body.deflection > LARGE]
    if bent and run.now >= run.system.scene.time.end:
        why = demanded_too_much(run.system, run.now, *_last_sound_state(run))
        if why:
            yield (
                f"joints and drives deform {', '.join(bent)}: {why}; such motions may "
                f"magnify errors, and rtol = {run.settings.rtol:g} is not promised"
            )


def _first(run: Run) -> Samples:
    """The start, with accelerations."""
    t, start = np.array([run.system.scene.time.start]), run.start
    return run.recorder.sampler.sample(t, start.z[None], start.v[None])


def _counters(run: Run) -> dict[str, Any]:
    stiff = run.control.stiff_steps
    explicit = {"stiff_steps": stiff} if run.method.explicit else {}
    return {name: getattr(run.memory, name) for name in Memory.kind.scalars} | explicit


def _event_at_the_end(run: Run) -> str:
    """What ended the run before the end of the time span, if an event did."""
    if run.watch is None or not run.watch.ended:
        return ""
    t = run.watch.moments[-1].t
    return f"event {run.watch.ended} ended the run at t = {t:.9g} s"
