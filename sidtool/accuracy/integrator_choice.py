"""Integrator and tolerance of a model: the fastest whose measured error is allowed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.sid import Array

from ..measurement.candidates import Choice
from ..measurement.runs import Runs, Setting
from .reference_run import Reference

#: The loosest and tightest tolerances that are tried.
LOOSEST_RTOL, TIGHTEST_RTOL = 0.1, 1e-12
#: A run that uses at least this share of the allowed error is not loosened further.
SUFFICIENT_SHARE = 0.4
#: Largest number of runs of one integrator.
MAX_RUNS = 7
#: Smallest ratio to the next tolerance; errors above this fraction of the previous ones
#: do not decrease with the tolerance.
MIN_RTOL_RATIO, STAGNATION_RATIO = 1e-2, 0.98
#: Minimum fraction of time that another integrator than the default must save.
MIN_SAVING = 0.1
DEFAULT_INTEGRATOR, EXPLICIT_INTEGRATOR = "radau9", "auto"
#: Requests from which on integrators of lower and of higher order are tried as well.
LOW_ORDER, HIGH_ORDER = ("radau5", 1e-5), ("radau13", 1e-4)


@dataclass(frozen=True, eq=False)
class AcceptedRun:
    """A run that meets the request.

    Attributes
    ----------
    errors : (n,) differences to the reference
    """

    setting: Setting
    errors: Array
    seconds: float


def fastest_setting(
    runs: Runs, reference: Reference, choice: Choice, share: float
) -> AcceptedRun | None:
    """Return the fastest run that uses at most a share of the allowed error."""
    integrators = _integrators(reference, choice)
    settings = [
        largest_sufficient_tolerance(runs, reference, choice, name, share)
        for name in integrators
    ]
    fit = [setting for setting in settings if setting is not None]
    seconds = runs.cost if len(fit) > 1 else runs.seconds
    accepted = [
        AcceptedRun(s, _errors(runs, reference, choice, s), seconds(choice, s))
        for s in fit
    ]
    default = next(
        (f for f in accepted if f.setting.integrator == DEFAULT_INTEGRATOR), None
    )
    best = min(accepted, key=lambda f: f.seconds, default=None)
    if best is None or default is None:
        return best
    return best if best.seconds < (1.0 - MIN_SAVING) * default.seconds else default


def largest_sufficient_tolerance(
    runs: Runs, reference: Reference, choice: Choice, integrator: str, share: float
) -> Setting | None:
    """Return the largest tolerance found that uses at most a share of the allowed
    error.

    For the next guess the error is assumed to be proportional to the tolerance. Between
    a sufficient and an insufficient tolerance the geometric mean is tried. Errors that
    do not decrease, for example of oscillations below the tolerance, need much smaller
    tolerances.
    """
    target = share - reference.used_share(reference.difference_uncertainty)
    fits, fails, last = 0.0, np.inf, np.inf
    rtol = float(np.clip(_tightest_request(reference), TIGHTEST_RTOL, LOOSEST_RTOL))
    for _ in range(MAX_RUNS):
        setting = Setting(integrator, rtol)
        use = reference.used_share(_errors(runs, reference, choice, setting))
        if use <= target:
            fits = rtol
            if use >= SUFFICIENT_SHARE * share or rtol >= LOOSEST_RTOL:
                break
        else:
            fails = rtol
            if rtol <= TIGHTEST_RTOL:
                break
        guess = rtol * float(
            np.clip(0.7 * target / max(use, 1e-12), MIN_RTOL_RATIO, 30.0)
        )
        if not fits and use > STAGNATION_RATIO * last:
            guess = MIN_RTOL_RATIO * rtol
        last = use
        if fits and np.isfinite(fails):
            if fails < 2.0 * fits:
                break
            guess = float(np.sqrt(fits * fails))
        rtol = float(np.clip(guess, TIGHTEST_RTOL, LOOSEST_RTOL))
    return Setting(integrator, fits) if fits else None


def _errors(
    runs: Runs, reference: Reference, choice: Choice, setting: Setting
) -> Array:
    result = runs.attempt(choice, setting)
    return runs.max_differences((choice, result), (reference.choice, reference.result))


def _integrators(reference: Reference, choice: Choice) -> list[str]:
    """Return the default integrator, and those whose order suits the request."""
    wanted, integrators = _tightest_request(reference), [DEFAULT_INTEGRATOR]
    if wanted >= LOW_ORDER[1]:
        integrators.append(LOW_ORDER[0])
    if wanted <= HIGH_ORDER[1]:
        integrators.append(HIGH_ORDER[0])
    if not any(kept for _, kept in choice.kept):
        integrators.append(EXPLICIT_INTEGRATOR)
    return integrators


def _tightest_request(reference: Reference) -> float:
    """Return the smallest requested error relative to the variation of an output."""
    with np.errstate(divide="ignore"):
        parts = reference.allowed / reference.variation
    return float(np.clip(parts.min(), TIGHTEST_RTOL, 1.0))
