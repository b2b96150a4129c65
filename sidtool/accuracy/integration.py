"""Integrator and tolerance for a model: the cheapest whose error is seen to do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sidtool.formats.sid import Array

from .candidates import Choice
from .reference import Reference
from .runs import Runs, Setting

#: The loosest and tightest tolerances that are tried.
LOOSE, TIGHT = 0.1, 1e-12
#: Enough of what is allowed is used; from then on nothing looser is looked for.
ENOUGH = 0.4
#: Runs of one integrator at most.
TRIES = 7
#: Of the tolerance, the least that is tried next; errors that do not fall to this part
#: of the last ones are those of motions that tolerances are too loose for.
LEAST, STUCK = 1e-2, 0.98
#: Another integrator than the default has to save this part of its time.
SAVING = 0.1
DEFAULT, EXPLICIT = "radau9", "auto"
#: Requests from which on integrators of lower and of higher order are tried as well.
LOW_ORDER, HIGH_ORDER = ("radau5", 1e-5), ("radau13", 1e-4)


@dataclass(frozen=True, eq=False)
class Found:
    """A run that keeps the request.

    errors : (n,) differences to the reference
    """

    setting: Setting
    errors: Array
    seconds: float


def cheapest(
    runs: Runs, reference: Reference, choice: Choice, share: float
) -> Found | None:
    """The fastest run that uses at most a share of what is allowed."""
    tried = _integrators(reference, choice)
    settings = [loosest(runs, reference, choice, name, share) for name in tried]
    fit = [setting for setting in settings if setting is not None]
    seconds = runs.cost if len(fit) > 1 else runs.seconds
    found = [
        Found(s, _errors(runs, reference, choice, s), seconds(choice, s)) for s in fit
    ]
    default = next((f for f in found if f.setting.integrator == DEFAULT), None)
    best = min(found, key=lambda f: f.seconds, default=None)
    if best is None or default is None:
        return best
    return best if best.seconds < (1.0 - SAVING) * default.seconds else default


def loosest(
    runs: Runs, reference: Reference, choice: Choice, integrator: str, share: float
) -> Setting | None:
    """The loosest tolerance found that uses at most a share of what is allowed.

    The error is taken to grow like the tolerance for the next guess; between one that
    does and one that does not, the geometric mean is tried. Errors that do not fall, as
    of oscillations that are too small to be followed, need much less.
    """
    target = share - reference.use(reference.doubt)
    fits, fails, last = 0.0, np.inf, np.inf
    rtol = float(np.clip(_smallest(reference), TIGHT, LOOSE))
    for _ in range(TRIES):
        setting = Setting(integrator, rtol)
        use = reference.use(_errors(runs, reference, choice, setting))
        if use <= target:
            fits = rtol
            if use >= ENOUGH * share or rtol >= LOOSE:
                break
        else:
            fails = rtol
            if rtol <= TIGHT:
                break
        guess = rtol * float(np.clip(0.7 * target / max(use, 1e-12), LEAST, 30.0))
        if not fits and use > STUCK * last:
            guess = LEAST * rtol
        last = use
        if fits and np.isfinite(fails):
            if fails < 2.0 * fits:
                break
            guess = float(np.sqrt(fits * fails))
        rtol = float(np.clip(guess, TIGHT, LOOSE))
    return Setting(integrator, fits) if fits else None


def _errors(
    runs: Runs, reference: Reference, choice: Choice, setting: Setting
) -> Array:
    result = runs.attempt(choice, setting)
    return runs.between((choice, result), (reference.choice, reference.result))


def _integrators(reference: Reference, choice: Choice) -> list[str]:
    """The default, and those whose order fits the request."""
    wanted, found = _smallest(reference), [DEFAULT]
    if wanted >= LOW_ORDER[1]:
        found.append(LOW_ORDER[0])
    if wanted <= HIGH_ORDER[1]:
        found.append(HIGH_ORDER[0])
    if not any(kept for _, kept in choice.kept):
        found.append(EXPLICIT)
    return found


def _smallest(reference: Reference) -> float:
    """The sharpest request relative to the variation of an output."""
    with np.errstate(divide="ignore"):
        parts = reference.allowed / reference.variation
    return float(np.clip(parts.min(), TIGHT, 1.0))
