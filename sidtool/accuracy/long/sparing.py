"""Long runs of which no first part shows enough: a few runs of all of the time.

Everything that the SIDs have runs to the end loosely, and again much more tightly,
until the second run shows that the first one keeps the request. Shape functions of the
least elastic energy are then left out in `TRIALS` loose runs, all of which are compared
with the tight one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.result import BudgetLine
from sidtool.formats.sid import Array

from ..budget import budget
from ..candidates import SHAPES, Candidate, Choice
from ..choose import ALL, Chosen
from ..frames import with_frames
from ..integration import STUCK, Found
from ..outside import check_inside
from ..reference import MEASURING, Reference
from ..runs import Runs, Setting
from ..sentences import listed
from ..wanted import Request
from .whole import (
    LONG,
    TIGHTER,
    Part,
    Proven,
    loose_setting,
    seen_on_the_whole,
    sharp_for,
)

#: Loose runs of everything at most; of the tolerance, what the next one gets of it at
#: least and at most, and of what a run errs at the tolerance that would just do.
LEVELS, LEAST, MOST, LESS = 4, 0.03, 0.5, 0.6
#: Models with fewer shape functions that are tried.
TRIALS = 2


def chosen_sparingly(runs: Runs, part: Part, request: Request) -> Proven | None:
    """A looser run of the reference, with fewer shape functions if these do.

    None where loose runs do not do and are short: a search over the whole time is
    cheap then, whatever a first part took on a busy machine.

    Parameters
    ----------
    part : tells how tightly everything has to be integrated

    Raises
    ------
    InputError : tighter runs do not become alike.
    OutsideTheory : a body leaves what its SID describes.
    """
    settled = _settled(runs, part, request)
    if settled is None:
        return None
    reference, bare = settled
    seen, chosen = _with_fewer(runs, reference, bare)
    frames = with_frames(runs, reference, request, fixed=True)
    lines = _lines(runs, seen, chosen, bare, frames.theory)
    told = (*_told(runs, reference, bare, chosen), *frames.sentences)
    return Proven(runs, seen, chosen, seen, frames.theory, lines, told)


def _settled(
    runs: Runs, part: Part, request: Request
) -> tuple[Reference, Chosen] | None:
    """The reference, and the loosest run of everything that keeps the request."""
    reference, last, setting = part.reference, np.inf, loose_setting(part)
    choice, nothing = reference.choice, np.zeros(len(runs.names))
    for _ in range(LEVELS):
        sharp = sharp_for(setting, part, runs, request, reference, (MEASURING,))
        if sharp is None:
            break
        check_inside(sharp.result)
        reference = sharp
        bare = Chosen(choice, Found(setting, nothing, 0.0), (), nothing)
        seen, bare = seen_on_the_whole(runs, reference, bare)
        use = seen.use(bare.errors)
        if use <= ALL:
            return reference, bare
        stuck = use > STUCK * last
        factor = LEAST if stuck else float(np.clip(LESS * ALL / use, LEAST, MOST))
        setting, last = Setting(setting.integrator, factor * setting.rtol), use
    seconds = runs.seconds(choice, setting)
    if seconds <= LONG:
        return None
    raise InputError(
        f"runs of {seconds:.2g} s at rtol {setting.rtol:.0e} do "
        "not show that the request can be kept, and tighter ones would take longer",
        place="accuracy.wanted",
        expected="a larger error, a shorter time span, or other outputs",
    )


def _with_fewer(
    runs: Runs, reference: Reference, bare: Chosen
) -> tuple[Reference, Chosen]:
    """The fastest that keeps the request, of some with fewer shape functions."""
    best = seen_on_the_whole(runs, reference, bare)
    setting, fits, fails = bare.found.setting, 0.0, 1.0
    for _ in range(TRIALS):
        share = 0.5 * (fits + fails)
        choice = _without(reference, share)
        found = replace(bare, choice=choice)
        if choice == best[1].choice or runs.attempt(choice, setting) is None:
            fails = share
            continue
        seen, chosen = seen_on_the_whole(runs, reference, found)
        if seen.use(chosen.errors) > ALL:
            fails = share
            continue
        fits = share
        if chosen.found.seconds < best[1].found.seconds:
            best = seen, chosen
    return best


def _without(reference: Reference, share: float) -> Choice:
    """Each body without a share of its shape functions, those of least energy."""
    choice = reference.choice
    for name, kept in choice.kept:
        if kept:
            shares = reference.result.bodies[name].energy_shares
            order = [k for _, k in sorted(zip(shares, kept, strict=True))]
            less = tuple(sorted(order[: int(share * len(order))]))
            choice = choice.without(Candidate(name, SHAPES, numbers=less))
    return choice


def _lines(
    runs: Runs, reference: Reference, chosen: Chosen, bare: Chosen, theory: Array
) -> tuple[BudgetLine, ...]:
    """The budget: loose runs tell what is left out, a tight one what they err."""
    alike = replace(reference, setting=chosen.found.setting)
    lines = budget(runs, alike, chosen, theory, TIGHTER)
    pairs = zip(runs.names, bare.errors, reference.allowed, strict=True)
    seen = {
        "errors": {n: float(e) for n, e, a in pairs if np.isfinite(a)},
        "finest": runs.seconds(reference.choice, reference.setting),
    }
    return tuple(
        line.model_copy(update=seen) if line.part == "integration" else line
        for line in lines
    )


def _told(
    runs: Runs, reference: Reference, bare: Chosen, chosen: Chosen
) -> tuple[str, ...]:
    """What was tried, and what came of it."""
    seconds = runs.seconds(reference.choice, reference.setting)
    head = (
        f"few runs, as they take up to {seconds:.2g} s and no first part of the motion "
    )
    head += "shows in less what the rest needs"
    left = []
    for name, kept in chosen.choice.kept:
        gone = [k for k in dict(bare.choice.kept)[name] if k not in kept]
        if gone:
            left.append(f"modes {listed(gone)} of {name}")
    what = ", ".join(left) or "nothing"
    return (f"{head}: {what} left out, of least energy; terms were not looked at",)
