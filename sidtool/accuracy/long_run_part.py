"""Selection of a model in an initial interval of a long run, verified over all of it.

A search makes dozens of tight runs. For a long motion these runs cover an initial
interval only. The selected model is then run to the end, and so is the full model, so
much more tightly that their difference is the error of the selected run. Reported
errors therefore refer to the full interval, as for short runs. If the selected model
does not meet the request there, the selection is repeated with a smaller allowed error.
Motions that have hardly begun in the initial interval get a longer one, or a few runs
over the full interval.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.result import BudgetLine

from ..measurement.candidates import Choice
from ..measurement.request import Request
from ..measurement.runs import OutsideTheory, Runs, Setting, check_validity
from .error_bounds import error_budget
from .frames import select_frames
from .long_run_reference import (
    LONG_RUN_SECONDS,
    REFERENCE_SAFETY,
    REFERENCE_SHARE,
    TIGHTER_RUN_TEXT,
    InitialInterval,
    VerifiedChoice,
    reference_setting,
    select_with_few_runs,
    verify_full_interval,
)
from .reference_run import MEASURING_INTEGRATOR, Reference, initial_rtol, make_reference
from .selection import FULL_SHARE, TIGHTEST_RTOL, SelectedModel, select_model
from .sid_rounding import with_rounding_error

#: Shortest and longest initial interval, as fractions of the time span.
FIRST_FRACTION, LARGEST_FRACTION = 1.0 / 128.0, 1.0 / 8.0
#: Largest cost of a selection in an initial interval, in full tight runs.
MAX_FULL_RUNS = 2.0
#: Share of the variation of each output that must occur in the interval.
MIN_VARIATION_SHARE = 0.7
#: Share of the allowed error that is requested in the initial interval; ratio of the
#: next request where the full run exceeded it, and number of repetitions.
REQUEST_SHARE, REDUCTION_FACTOR, MAX_ROUNDS = 0.5, 0.6, 3
#: Ratio of the tolerance of the full run to that of the initial interval with friction:
#: errors grow by jumps there, and few of the steps are as long as tolerances allow.
FRICTION_RTOL_RATIO = 0.2
#: Share of the allowed error that printed digits may cause in the initial interval.
MAX_DIGITS_SHARE = 1e-3
#: Minimum number of output times in an initial interval.
MIN_ROWS = 16


def select_in_initial_interval(
    runs: Runs, whole: Choice, request: Request, meshes: Array
) -> VerifiedChoice | None:
    """Select a model of a long run; None if all runs have to cover the full interval.

    Parameters
    ----------
    whole : the full model with all shape functions and terms
    meshes : (n,) errors caused by the meshes of bodies and by missing modes

    Raises
    ------
    InputError : the request needs runs that take too long.
    OutsideTheory : a body leaves the range of its SID.
    """
    ends = _interval_ends(runs)
    first = runs.shortened_to(ends[0]) if ends else runs
    if not ends or not _is_long(first, runs, whole, request):
        return None
    part = _reference_or_none(lambda: _initial_interval(first, whole, request, meshes))
    while part is None and len(ends) > 1:  # nothing may move initially
        ends = ends[1:]
        first = runs.shortened_to(ends[0])
        part = _reference_or_none(
            lambda first=first: _initial_interval(first, whole, request, meshes)
        )  # type: ignore[misc]
    if part is None:
        return None
    selected = (
        _select_in_shortest_interval(runs, part, request, ends)
        if _is_cheap(runs, first)
        else None
    )
    return selected or select_with_few_runs(runs, part, request)


def _select_in_shortest_interval(
    runs: Runs, part: InitialInterval, request: Request, ends: list[float]
) -> VerifiedChoice | None:
    """Select a model in the shortest initial interval that shows the motion."""
    first = _select_for_share(runs, part, part.reference, REQUEST_SHARE)
    if first is None:
        return None
    result = runs.attempt(first.choice, first.accepted_run.setting)
    if result is None:
        return None
    judged = np.isfinite(part.reference.allowed)
    values = runs.columns(first.choice, result)[:, judged]
    end = next((e for e in ends if _shows_motion(result.t, values, e)), None)
    if end is None:
        return None
    if end == ends[0]:
        return _verify_selection(runs, part, request, first)
    whole, meshes = part.reference.choice, part.reference.meshes
    longer = _reference_or_none(
        lambda: _initial_interval(runs.shortened_to(end), whole, request, meshes)
    )
    if longer is None:
        return None
    again = _select_for_share(runs, longer, longer.reference, REQUEST_SHARE)
    return None if again is None else _verify_selection(runs, longer, request, again)


def _select_for_share(
    runs: Runs, part: InitialInterval, reference: Reference, share: float
) -> SelectedModel | None:
    """Select a model that keeps a share of the request, integrated for the full
    interval.

    Parameters
    ----------
    reference : reference of the full or of the initial interval
    """
    decided = _with_error_share(part, reference, share)
    selected = _reference_or_none(lambda: select_model(part.runs, decided))
    if selected is None:
        return None
    return (
        selected
        if reference is not part.reference
        else _with_full_tolerance(runs, selected)
    )


def _reference_or_none(make: Callable):  # type: ignore[type-arg, no-untyped-def]
    """Return the result of the initial interval, or None if it cannot be run.

    Raises
    ------
    OutsideTheory : a body leaves the range of its SID, then also in the full interval.
    """
    from sidtool.solver.system.errors import SimulationError

    try:
        return make()
    except OutsideTheory:
        raise
    except (InputError, SimulationError):
        return None


def _interval_ends(runs: Runs) -> list[float]:
    """Return the ends of initial intervals with enough output times, the shortest
    first.
    """
    time = runs.scene.time
    if time.output_step is None:
        return []
    rows = np.rint((time.end - time.start) / time.output_step)
    if rows < 1:
        return []
    counts, count = [], int(np.ceil(rows * FIRST_FRACTION))
    while count <= rows * LARGEST_FRACTION:
        if count >= MIN_ROWS:
            counts.append(count)
        count *= 2
    return [float(time.start + n * time.output_step) for n in counts]


def _time_share(runs: Runs, part: Runs) -> float:
    """Return the length of the interval as a fraction of the time span."""
    long, short = runs.scene.time, part.scene.time
    return (short.end - short.start) / (long.end - long.start)


def _is_long(part: Runs, runs: Runs, whole: Choice, request: Request) -> bool:
    """Estimate from a partial run whether a full tight run is long."""
    setting = Setting(MEASURING_INTEGRATOR, initial_rtol(request))
    seconds = part.seconds(whole, setting, short=np.inf)
    return np.isfinite(seconds) and bool(
        seconds > LONG_RUN_SECONDS * _time_share(runs, part)
    )


def _is_cheap(runs: Runs, part: Runs) -> bool:
    """Return whether a selection in the interval costs no more than a few full runs."""
    return sum(runs.expected.values()) * _time_share(runs, part) <= MAX_FULL_RUNS


def _initial_interval(
    part: Runs, whole: Choice, request: Request, meshes: Array
) -> InitialInterval | None:
    """Return the tight reference of an initial interval, or None if it is
    unsuitable.
    """
    reference = make_reference(part, whole, request).with_mesh_errors(meshes)
    check_validity(reference.result)
    reference, digits = with_rounding_error(part, reference)
    frames = select_frames(part, reference, request, fixed=True)
    if reference.used_share(reference.digits) > MAX_DIGITS_SHARE:
        return None
    found = (*digits, *frames.diagnostics)
    return InitialInterval(part, reference, frames.theory, found)


def _shows_motion(times: Array, values: Array, end: float) -> bool:
    """Check that most of the variation of each output (nt, n) occurs before a time."""
    variation_until_end = np.ptp(values[times <= end], axis=0)
    return bool(
        (variation_until_end >= MIN_VARIATION_SHARE * np.ptp(values, axis=0)).all()
    )


def _with_error_share(
    part: InitialInterval, reference: Reference, share: float
) -> Reference:
    """Return the reference with a share of the remaining allowed error."""
    open_ = reference.used_share(reference.difference_uncertainty)
    if reference is part.reference:
        open_ += REFERENCE_SAFETY * REFERENCE_SHARE  # uncertainty of the full reference
    allowed = share * (FULL_SHARE - open_) / FULL_SHARE * reference.allowed
    return replace(
        part.reference_without_mesh_errors, allowed=allowed
    )  # errors of the meshes


def _verify_selection(
    runs: Runs, part: InitialInterval, request: Request, selected: SelectedModel | None
) -> VerifiedChoice | None:
    """Verify over the full interval what was selected in the initial interval.

    Parameters
    ----------
    selected : first selection
    """
    reference, share = part.reference, REQUEST_SHARE
    for _ in range(MAX_ROUNDS):
        if selected is None:
            return None
        sharp = reference_setting(
            selected.accepted_run.setting, part, runs, request, reference
        )
        if sharp is None or not _shows_finest_model(runs, sharp, part):
            return None
        check_validity(sharp.result)
        verified_reference, chosen = verify_full_interval(runs, sharp, selected)
        use, open_ = (
            verified_reference.used_share(chosen.errors),
            sharp.used_share(sharp.difference_uncertainty),
        )
        if use <= 1.0:
            return VerifiedChoice(
                runs,
                verified_reference,
                chosen,
                replace(part.reference, allowed=verified_reference.allowed),
                part.theory,
                _budget_lines(part, verified_reference, selected, chosen),
                (_interval_diagnostic(runs, part), *part.diagnostics),
            )
        share *= REDUCTION_FACTOR * (FULL_SHARE - open_) / (use - open_)
        reference = sharp
        selected = _select_for_share(runs, part, reference, share)
    return None


def _with_full_tolerance(runs: Runs, selected: SelectedModel) -> SelectedModel:
    """Return the selection with a tolerance for the full interval."""
    setting = selected.accepted_run.setting
    if not any(getattr(j, "friction", None) for j in runs.scene.joints.values()):
        return selected
    careful = Setting(
        setting.integrator, max(FRICTION_RTOL_RATIO * setting.rtol, TIGHTEST_RTOL)
    )
    return replace(
        selected, accepted_run=replace(selected.accepted_run, setting=careful)
    )


def _shows_finest_model(
    runs: Runs, reference: Reference, part: InitialInterval
) -> bool:
    """Return whether the interval also shows the motion of the finest model."""
    values = runs.columns(reference.choice, reference.result)
    judged = np.isfinite(reference.allowed)
    return _shows_motion(
        reference.result.t, values[:, judged], part.runs.scene.time.end
    )


def _budget_lines(
    part: InitialInterval,
    reference: Reference,
    selected: SelectedModel,
    chosen: SelectedModel,
) -> tuple[BudgetLine, ...]:
    """Return the budget: single choices in the initial interval, their sum in the full
    run.
    """
    lines = error_budget(
        part.runs, part.reference, selected, part.theory, TIGHTER_RUN_TEXT
    )
    slower = chosen.accepted_run.seconds / part.runs.seconds(
        selected.choice, selected.accepted_run.setting
    )
    known_errors = {"reference": reference.uncertainty, "all together": chosen.errors}
    result = []
    for line in lines:
        finest = None if line.finest is None else slower * line.finest
        changes: dict[str, object] = {
            "seconds": chosen.accepted_run.seconds,
            "finest": finest,
        }
        if line.part in known_errors:
            pairs = zip(
                part.runs.names, known_errors[line.part], reference.allowed, strict=True
            )
            changes["errors"] = {n: float(e) for n, e, a in pairs if np.isfinite(a)}
        elif line.part != "mesh":
            changes["choice"] = f"{line.choice}; {part.time_text}"
        result.append(line.model_copy(update=changes))
    return tuple(result)


def _interval_diagnostic(runs: Runs, part: InitialInterval) -> Diagnostic:
    """Diagnose that choices were compared in an initial interval (N616)."""
    lengths = [r.scene.time.end - r.scene.time.start for r in (part.runs, runs)]
    return diagnose("N616", part=lengths[0], span=lengths[1])
