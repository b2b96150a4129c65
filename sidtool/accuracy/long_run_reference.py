"""Reference of a long run: one run of the finest model over the full interval.

The reference is integrated with a thirtieth of the tolerance of the run that it is
compared with, or more tightly where the initial interval shows that this is not enough.
Its own error in that interval counts twice as uncertainty. Later growth of errors is
not visible there: the selected run is integrated so much more loosely that the
difference of both is the error of that run, and a part of the difference counts as
uncertainty as well.

`select_with_few_runs` serves long runs for which no initial interval is sufficient. The
full model is run to the end loosely, and again much more tightly, until the second run
shows that the first one meets the request. Shape functions of the least elastic energy
are then omitted in `MAX_TRIALS` loose runs, all of which are compared with the tight
one.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.result import BudgetLine

from ..measurement.candidates import SHAPES, Candidate, Choice
from ..measurement.request import Request, refuse_accuracy
from ..measurement.runs import Runs, Setting, check_validity, max_difference
from .error_bounds import error_budget
from .frames import select_frames
from .reference_run import (
    CHECKING_INTEGRATOR,
    MEASURING_INTEGRATOR,
    MIN_COMPARISON_RTOL,
    REFERENCE_SAFETY,
    Reference,
    reference_of_one_run,
)
from .report import format_ranges
from .selection import (
    FULL_SHARE,
    STAGNATION_RATIO,
    TIGHTEST_RTOL,
    AcceptedRun,
    SelectedModel,
    estimate_errors,
    largest_sufficient_tolerance,
)

#: Runs that take more than this [s] are long.
LONG_RUN_SECONDS = 0.1
#: Shares of the allowed error: of a loose run of the finest model in the initial
#: interval, of its reference there, and of the uncertainty over the full interval.
LOOSE_SHARE, REFERENCE_SHARE, MAX_UNCERTAINTY_SHARE = 0.3, 0.03, 0.3
#: Share of the allowed error that two runs at loose tolerances may have in common, as
#: methods that both step from one output to the next have similar errors.
COMMON_ERROR_SHARE = 0.005
#: Largest tolerance of a run of the finest model, and of its reference; requested and
#: largest ratio of the tolerance of the reference to that of the compared run.
MAX_RTOL, MAX_REFERENCE_RTOL, REFERENCE_RTOL_RATIO, MAX_REFERENCE_RTOL_RATIO = (
    3e-3,
    3e-4,
    0.03,
    0.1,
)
#: Share of the difference to the reference that counts as uncertainty.
OWN_ERROR_SHARE = 0.3
#: Text on the origin of the errors of the reference.
TIGHTER_RUN_TEXT = "a tighter run"

#: Largest number of loose full runs; smallest and largest ratio of the next tolerance;
#: safety factor on the tolerance that would just be sufficient.
MAX_LEVELS, MIN_RTOL_RATIO, MAX_RTOL_RATIO, RTOL_SAFETY = 4, 0.03, 0.5, 0.6
#: Number of models with fewer shape functions that are tried.
MAX_TRIALS = 2


@dataclass(frozen=True, eq=False)
class VerifiedChoice:
    """A choice whose errors were verified over the full interval.

    Attributes
    ----------
    decision_reference : reference that the simplifications were compared with
    theory : (n,) terms neglected by linear theory
    lines : error budget
    bounds : error bounds by output, if there are any
    frames : other frames of bodies
    """

    runs: Runs
    reference: Reference
    chosen: SelectedModel
    decision_reference: Reference
    theory: Array
    lines: tuple[BudgetLine, ...]
    diagnostics: tuple[Diagnostic, ...]
    bounds: Mapping[str, float] = field(default_factory=dict)
    frames: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class InitialInterval:
    """An initial interval of the motion: its runs, and its reference."""

    runs: Runs
    reference: Reference
    theory: Array
    diagnostics: tuple[Diagnostic, ...]

    @property
    def time_text(self) -> str:
        time = self.runs.scene.time
        return f"the first {time.end - time.start:.3g} s"

    @property
    def reference_without_mesh_errors(self) -> Reference:
        """Return the reference without errors of meshes."""
        return self.reference.with_mesh_errors(np.zeros(len(self.runs.names)))

    def errors(self, setting: Setting) -> Array:
        """Return the errors (n,) in this interval of a full run of the finest model."""
        choice, best = self.reference.choice, self.reference.result
        one = self.runs.run_initial_interval(choice, setting).result
        if one is None:
            return np.full(len(self.runs.names), np.inf)
        rows = slice(len(best.t))
        partial = one.t[rows], self.runs.columns(choice, one)[rows]
        errors = max_difference(partial, (best.t, self.runs.columns(choice, best)))
        return errors + self.reference.uncertainty


def relaxed_setting(part: InitialInterval) -> Setting:
    """Return the setting of a finest run whose error is a part of the allowed one."""
    reference = part.reference_without_mesh_errors
    setting = largest_sufficient_tolerance(
        part.runs, reference, reference.choice, MEASURING_INTEGRATOR, LOOSE_SHARE
    )
    return Setting(
        MEASURING_INTEGRATOR, min(setting.rtol if setting else TIGHTEST_RTOL, MAX_RTOL)
    )


def reference_setting(
    setting: Setting,
    part: InitialInterval,
    runs: Runs,
    request: Request,
    known: Reference,
    methods: tuple[str, ...] = (MEASURING_INTEGRATOR, CHECKING_INTEGRATOR),
) -> Reference | None:
    """Return the cheapest reference that resolves the error of a run, or None.

    Parameters
    ----------
    known : reference that was already run, or that of the initial interval
    """
    most = min(MAX_REFERENCE_RTOL_RATIO * setting.rtol, MAX_REFERENCE_RTOL)
    if known is not part.reference and known.setting.rtol <= most:
        return known
    rtol = min(REFERENCE_RTOL_RATIO * setting.rtol, MAX_REFERENCE_RTOL)
    settings = [_tighten_setting(part, Setting(method, rtol)) for method in methods]
    best = min(
        (setting for setting in settings if setting is not None),
        key=lambda setting: part.runs.cost(part.reference.choice, setting),
        default=None,
    )
    return None if best is None else full_reference(part, runs, request, best)


def _tighten_setting(part: InitialInterval, setting: Setting) -> Setting | None:
    """Tighten a setting until its error in the initial interval is small; None if it
    stays.
    """
    while setting.rtol >= MIN_COMPARISON_RTOL:
        if part.reference.used_share(part.errors(setting)) <= REFERENCE_SHARE:
            return setting
        setting = Setting(setting.integrator, REFERENCE_RTOL_RATIO * setting.rtol)
    return None


def full_reference(
    part: InitialInterval, runs: Runs, request: Request, setting: Setting
) -> Reference | None:
    """Return the full reference, or None if its uncertainty is too large."""
    choice = part.reference.choice
    if runs.attempt(choice, setting) is None:
        return None
    reference = reference_of_one_run(runs, choice, request, setting)
    unseen = np.where(
        np.isfinite(reference.allowed), COMMON_ERROR_SHARE * reference.allowed, 0.0
    )
    errors = REFERENCE_SAFETY * np.maximum(part.errors(setting), unseen)
    digits = REFERENCE_SAFETY * part.reference.digits  # their effect may grow later
    reference = replace(
        reference,
        uncertainty=reference.uncertainty + errors,
        meshes=part.reference.meshes,
        digits=digits,
    )
    return (
        reference
        if reference.used_share(reference.uncertainty) <= MAX_UNCERTAINTY_SHARE
        else None
    )


def verify_full_interval(
    runs: Runs, reference: Reference, selected: SelectedModel
) -> tuple[Reference, SelectedModel]:
    """Run the selected model to the end; errors include the uncertainty of its
    reference.
    """
    choice, setting = selected.choice, selected.accepted_run.setting
    one = runs.attempt(choice, setting)
    errors = runs.max_differences((choice, one), (reference.choice, reference.result))
    there = AcceptedRun(setting, errors, runs.seconds(choice, setting))
    verified_reference = replace(
        reference, uncertainty=reference.uncertainty + OWN_ERROR_SHARE * errors
    )
    return verified_reference, replace(
        selected, accepted_run=there, errors=estimate_errors(errors, verified_reference)
    )


def select_with_few_runs(
    runs: Runs, part: InitialInterval, request: Request
) -> VerifiedChoice | None:
    """Select a looser run of the reference, with fewer shape functions if possible.

    None if loose runs do not meet the request and are short: a search over the full
    interval is cheap then, whatever an initial interval took on a busy machine.

    Parameters
    ----------
    part : initial interval, which determines the tolerances

    Raises
    ------
    InputError : tighter runs do not converge.
    OutsideTheory : a body leaves the range of its SID.
    """
    settled = _reference_and_accepted_run(runs, part, request)
    if settled is None:
        return None
    reference, full_model = settled
    verified_reference, chosen = _with_fewer_shapes(runs, reference, full_model)
    frames = select_frames(runs, reference, request, fixed=True)
    lines = _budget_of_few_runs(
        runs, verified_reference, chosen, full_model, frames.theory
    )
    found = (
        _trial_diagnostic(runs, reference, full_model, chosen),
        *frames.diagnostics,
    )
    return VerifiedChoice(
        runs,
        verified_reference,
        chosen,
        verified_reference,
        frames.theory,
        lines,
        found,
    )


def _reference_and_accepted_run(
    runs: Runs, part: InitialInterval, request: Request
) -> tuple[Reference, SelectedModel] | None:
    """Return the reference and the loosest run of the full model that meets the
    request.
    """
    reference, last, setting = part.reference, np.inf, relaxed_setting(part)
    choice, nothing = reference.choice, np.zeros(len(runs.names))
    for _ in range(MAX_LEVELS):
        sharp = reference_setting(
            setting, part, runs, request, reference, (MEASURING_INTEGRATOR,)
        )
        if sharp is None:
            break
        check_validity(sharp.result)
        reference = sharp
        full_model = SelectedModel(
            choice, AcceptedRun(setting, nothing, 0.0), (), nothing
        )
        verified_reference, full_model = verify_full_interval(
            runs, reference, full_model
        )
        use = verified_reference.used_share(full_model.errors)
        if use <= FULL_SHARE:
            return reference, full_model
        stuck = use > STAGNATION_RATIO * last
        factor = (
            MIN_RTOL_RATIO
            if stuck
            else float(
                np.clip(RTOL_SAFETY * FULL_SHARE / use, MIN_RTOL_RATIO, MAX_RTOL_RATIO)
            )
        )
        setting, last = Setting(setting.integrator, factor * setting.rtol), use
    seconds = runs.seconds(choice, setting)
    if seconds <= LONG_RUN_SECONDS:
        return None
    raise refuse_accuracy(
        f"runs of {seconds:.2g} s at rtol {setting.rtol:.0e} do not keep it, and "
        "tighter ones would take longer",
        "a larger error, a shorter time span, or other outputs",
    )


def _with_fewer_shapes(
    runs: Runs, reference: Reference, full_model: SelectedModel
) -> tuple[Reference, SelectedModel]:
    """Return the fastest run that keeps the request among some with fewer shape
    functions.
    """
    best = verify_full_interval(runs, reference, full_model)
    setting, fits, fails = full_model.accepted_run.setting, 0.0, 1.0
    for _ in range(MAX_TRIALS):
        share = 0.5 * (fits + fails)
        choice = _without_low_energy_shapes(reference, share)
        reduced = replace(full_model, choice=choice)
        if choice == best[1].choice or runs.attempt(choice, setting) is None:
            fails = share
            continue
        verified_reference, chosen = verify_full_interval(runs, reference, reduced)
        if verified_reference.used_share(chosen.errors) > FULL_SHARE:
            fails = share
            continue
        fits = share
        if chosen.accepted_run.seconds < best[1].accepted_run.seconds:
            best = verified_reference, chosen
    return best


def _without_low_energy_shapes(reference: Reference, share: float) -> Choice:
    """Return the model without the shape functions of least energy of each body."""
    choice = reference.choice
    for name, kept in choice.kept:
        if kept:
            shares = reference.result.bodies[name].energy_shares
            order = [k for _, k in sorted(zip(shares, kept, strict=True))]
            less = tuple(sorted(order[: int(share * len(order))]))
            choice = choice.without(Candidate(name, SHAPES, numbers=less))
    return choice


def _budget_of_few_runs(
    runs: Runs,
    reference: Reference,
    chosen: SelectedModel,
    full_model: SelectedModel,
    theory: Array,
) -> tuple[BudgetLine, ...]:
    """Build the budget: loose runs show the omissions, a tight one their integration
    error.
    """
    alike = replace(reference, setting=chosen.accepted_run.setting)
    lines = error_budget(runs, alike, chosen, theory, TIGHTER_RUN_TEXT)
    pairs = zip(runs.names, full_model.errors, reference.allowed, strict=True)
    known_errors = {
        "errors": {n: float(e) for n, e, a in pairs if np.isfinite(a)},
        "finest": runs.seconds(reference.choice, reference.setting),
    }
    return tuple(
        line.model_copy(update=known_errors) if line.part == "integration" else line
        for line in lines
    )


def _trial_diagnostic(
    runs: Runs, reference: Reference, full_model: SelectedModel, chosen: SelectedModel
) -> Diagnostic:
    """Diagnose that few runs were compared (N618)."""
    omitted = []
    for name, kept in chosen.choice.kept:
        gone = [k for k in dict(full_model.choice.kept)[name] if k not in kept]
        if gone:
            omitted.append(f"modes {format_ranges(gone)} of {name}")
    seconds = runs.seconds(reference.choice, reference.setting)
    return diagnose("N618", seconds=seconds, omitted=omitted)
