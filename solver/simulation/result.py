"""Result of a run, its notes, and the message of a failure."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose, stop_message, without
from sidtool.formats.geometric_stiffening import SIGNIFICANT_CHANGE
from sidtool.formats.result import FlexibleBody, Result
from sidtool.formats.result.accuracy_report import (
    MAX_DEFLECTION,
    MAX_ROTATION,
    MEANINGLESS_DEFLECTION,
    meaningless_body,
    validity_diagnostics,
)
from sidtool.formats.result.data import TABLES
from sidtool.formats.scene import observed_outputs
from sidtool.formats.scene.unused_keys import unused_keys
from sidtool.formats.storage.hdf5_files import versions

from ..diagnostics import result_notes
from ..diagnostics.body_loads import find_state_warnings
from ..diagnostics.failure_causes import (
    friction_lock_causes,
    infeasible_drive_cause,
    lost_inertia_cause,
    mass_rounding_cause,
    near_singular_cause,
    singular_passage_notes,
    step_loop_failure,
)
from ..diagnostics.implausible_values import runaway_warnings
from ..diagnostics.initial_deformation import (
    initial_deformation_notes,
    may_vibrate_from_start,
)
from ..initial_state.displacement_report import displacement_notes
from ..initial_state.given_state import lost_rotation
from ..initial_state.integrator_start import scene_with_settings
from ..integrators import loop_state
from ..linear.factor_storage import Memory
from ..output import columns
from ..output.samples import Samples
from ..system.control_laws import law_failure, rejected_trials
from .run_loop import Run, Stepper, Stop

#: Causes of a stop after which loads and stiffness are those of no body, and the
#: diagnostics of such loads.
LOST_INERTIA_CODES = frozenset({"N307", "N312"})
LOAD_CODES = frozenset({"N405", "N406", "N407", "N408"})
#: A scene is stiff if stability limits at least one step in this number.
STIFF_STEP_SHARE = 4


def build_result(
    run: Run,
    seconds: dict[str, float],
    failure: tuple[Diagnostic, ...],
    rows: Mapping[str, Any],
) -> Result:
    """What a run found; what is reported of it waits until somebody looks at it.

    Parameters
    ----------
    failure
        Why it stopped early, or why its numbers mean nothing.
    rows
        t and the tables, where they are known; default they are empty.
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
            "position": run.control.position_drift,
            "velocity": run.control.velocity_drift,
        },
        settings=_settings_table(run),
        events=tuple(sorted(recorder.events, key=lambda event: event.t)),
        sids=system.sids,
        versions=versions(),
        completed=not failure,
        message=stop_message(failure) or _stopping_event_text(run),
    )
    scene, settings = system.scene, run.settings
    known = known.with_lazy_fields(
        lambda: {"scene": scene_with_settings(scene, settings)}, "scene"
    )
    known = known.with_lazy_fields(lambda: {"bodies": recorder.bodies}, "bodies")
    return known.with_lazy_fields(
        lambda: {"diagnostics": _diagnostics(run, failure, recorder.bodies)},
        "diagnostics",
    )


def _diagnostics(
    run: Run, failure: tuple[Diagnostic, ...], bodies: Mapping[str, FlexibleBody]
) -> tuple[Diagnostic, ...]:
    """Diagnostics of a result with some flexible bodies, found when they are read."""
    scene, remarks = run.system.scene, run.recorder.verdicts.output_notes
    beyond_theory = validity_diagnostics(bodies)
    if any(each.code in LOST_INERTIA_CODES for each in failure):
        # Loads and stiffness at the end are those of no body.
        beyond_theory = tuple(d for d in beyond_theory if d.code not in LOAD_CODES)
    far = {each.subject for each in failure if each.code == "N414"}
    beyond_theory = tuple(
        d for d in beyond_theory if d.code != "N411" or d.subject not in far
    )
    found = (
        *failure,
        *beyond_theory,
        *(limit for name, body in bodies.items() for limit in body.model_limits(name)),
        *_run_diagnostics(run, bodies),
        *remarks.diagnostics(observed_outputs(scene)),
    )
    return without(found, scene.diagnostics.ignore)


def find_warnings(run: Run, result: Result) -> Iterator[Diagnostic]:
    """The diagnostics of a complete result that are warnings.

    Bounds rule out warnings of most bodies. Their loads and deformations, which take
    most of the time to find, then wait until somebody reads them.
    """
    if run.start.resume is not None or _bodies_may_have_warnings(run):
        found = result.diagnostics
    else:
        found = _diagnostics(run, (), run.start.initialised.expected_bodies)
    return (each for each in found if each.is_warning)


def _bodies_may_have_warnings(run: Run) -> bool:
    """True if loads or deformations of a body may need a warning (N220, N330, N404 to
    N413); False is certain.

    That of the frequencies of a body (N412) is known before the run.
    """
    system = run.system
    if not system.flexible:
        return False
    if may_exceed_linear_theory(run) or run.recorder.may_soften(SIGNIFICANT_CHANGE / 2):
        return True
    _, z, _ = run.window.reached_states(run.control)
    bodies = run.start.initialised.expected_bodies
    return may_vibrate_from_start(system, _initial_samples(run), bodies, z)


def may_exceed_linear_theory(run: Run) -> bool:
    """True if a body may have left linear theory by its deformation; False is certain.

    Cheap, while the warnings of a result are found once somebody looks at them.
    """
    return run.recorder.may_exceed(MAX_DEFLECTION, MAX_ROTATION)


def meaningless_numbers(run: Run) -> tuple[Diagnostic, ...]:
    """Why the numbers of a finished run mean nothing (N414); empty if they do."""
    if not run.recorder.may_exceed(MEANINGLESS_DEFLECTION, np.inf):
        return ()
    bodies = run.recorder.bodies
    return meaningless_body({name: body.deflection for name, body in bodies.items()})


def stop_causes(run: Stepper, stop: Stop) -> tuple[Diagnostic, ...]:
    """Return why a run ends early, and then the likely cause."""
    if stop.code is None:
        return stop.causes
    system, work, control = run.system, run.work, run.control
    t = run.current_time
    if invalid := law_failure(system, work, t, since=t):
        return (invalid,)
    fastest = columns.fastest_body(system, control)
    failure = step_loop_failure(stop.code, fastest, run.settings, t)
    if stop.code in (loop_state.TOO_SMALL, loop_state.OFF_CONSTRAINTS):
        failure = lost_rotation(system, work, control) or failure
    found = [
        infeasible_drive_cause(system, t, *_last_sound_state(run)),
        lost_inertia_cause(system, work, t),
    ]
    if not any(found):
        found = [mass_rounding_cause(system, work)]
    if causes := tuple(cause for cause in found if cause is not None):
        return (failure, *causes)
    if locked := friction_lock_causes(system, run.memory, t, control):
        return (failure, *locked)
    passes = bool(run.method.singular_loop)
    singular = near_singular_cause(system, control, passes)
    return (failure, singular) if singular else (failure,)


def _last_sound_state(run: Stepper) -> tuple[Array, Array]:
    """Positions and velocities of the last known state within linear theory.

    Where a body has deformed by more, its frame is arbitrary, and rounding decides
    which joints can be met from there. A state with values that are not finite is
    returned unchanged, as is the first one where no later one is within it.
    """
    state = run.control.z, run.control.v
    if not np.isfinite(run.control.z).all():
        return state
    for state in run.known_states():
        if not find_state_warnings(run.system, state[0][None]):
            return state
    return state


def _settings_table(run: Run) -> dict[str, str | float]:
    """Settings of the run, as a table."""
    settings = run.settings
    name = settings.integrator
    if not math.isnan(run.switch_time):
        name += f", then {settings.when_stiff} from t = {run.switch_time:.6g} s"
    table: dict[str, str | float] = {"integrator": name, "rtol": settings.rtol}
    table["step"] = settings.step or 0.0
    if run.method.has_spectral_radius:
        table["spectral_radius"] = settings.radius
    return table


def _run_diagnostics(
    run: Run, bodies: Mapping[str, FlexibleBody]
) -> Iterator[Diagnostic]:
    """Diagnostics of the numbers of a run."""
    is_known = any(body.found is not None for body in bodies.values())
    system, recorder, rtol = run.system, run.recorder, run.settings.rtol
    steps, initial = run.memory.steps, run.start.initial
    yield from run.start.scene_diagnostics
    yield from run.start.initialised.implausible_inputs
    yield from singular_passage_notes(system, run.kernels, run.control, rtol, initial.z)
    yield from displacement_notes(system, recorder.sampler.work, initial, rtol)
    if run.current_time >= system.scene.time.end and not _stopping_event_text(run):
        yield from result_notes.output_time_notes(
            system.scene, float(run.start.times[-1:][0])
        )
    yield from result_notes.callable_notes(system)
    yield from unused_keys(
        system.scene,
        fixed_step=run.settings.step is not None,
        spectral_radius=run.method.has_spectral_radius,
    )
    yield from result_notes.peak_stress_notes(system)
    yield from result_notes.sampled_loop_notes(system, run.control, initial.z)
    if run.control.fixed_step != 1 and is_known:
        span = run.current_time - system.scene.time.start
        yield from recorder.verdicts.found.vibrations.diagnostics(steps, span)
    yield from result_notes.rounding_notes(system, run.control, rtol, steps)
    reached_end = run.current_time >= system.scene.time.end or _stopping_event_text(run)
    if reached_end:  # speeds where a run stops are those of its failure
        yield from rejected_trials(system, run.work)
    yield from result_notes.skipped_feature_notes(system, run.control, run.settings)
    yield from _constraint_deformation_notes(run, bodies)
    yield from _stability_limit_notes(run)
    ends = (system.scene.time.start, run.current_time)
    control = run.control
    if reached_end:
        yield from runaway_warnings(
            system,
            ends,
            np.array([initial.z, control.z]),
            np.array([initial.v, control.v]),
        )
    if is_known and run.current_time > system.scene.time.start:
        yield from initial_deformation_notes(system, _initial_samples(run), bodies)


def _stability_limit_notes(run: Run) -> Iterator[Diagnostic]:
    """Steps that stability of an explicit method limited, not the tolerance (N321)."""
    steps, stiff = run.memory.steps, run.control.stiff_steps
    if run.method.explicit and STIFF_STEP_SHARE * stiff > steps:
        yield diagnose("N321", share=stiff / steps, method=run.settings.integrator)


def _constraint_deformation_notes(
    run: Run, bodies: Mapping[str, FlexibleBody]
) -> Iterator[Diagnostic]:
    """Deformations that joints and drives impose instead of loads (N330)."""
    deformed = [n for n, body in bodies.items() if body.deflection > MAX_DEFLECTION]
    if deformed and run.current_time >= run.system.scene.time.end:
        why = infeasible_drive_cause(
            run.system, run.current_time, *_last_sound_state(run)
        )
        if why is not None:
            yield diagnose("N330", ", ".join(deformed), reason=why.message)


def _initial_samples(run: Run) -> Samples:
    """The start, with accelerations; projected as a copy, as later runs begin there."""
    t, start = np.array([run.system.scene.time.start]), run.start.initial
    return run.recorder.sampler.sample(t, start.z[None].copy(), start.v[None].copy())


def _counters(run: Run) -> dict[str, Any]:
    stiff = run.control.stiff_steps
    explicit = {"stiff_steps": stiff} if run.method.explicit else {}
    return {name: getattr(run.memory, name) for name in Memory.kind.scalars} | explicit


def _stopping_event_text(run: Run) -> str:
    """The event that ended the run before the end of the time span, as a sentence."""
    detector = run.plan.event_detector
    if detector is None or not detector.stopping_event:
        return ""
    t = detector.events_found[-1].t
    return f"event {detector.stopping_event} ended the run at t = {t:.9g} s"
