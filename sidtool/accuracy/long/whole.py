"""The reference of a long run: one run of the finest model on all of the time.

It is integrated for a thirtieth of the tolerance of the run that it is compared with,
more tightly where the first part of the motion shows that this does not do. What it
errs there is open, twice over. How errors grow later on, it does not show itself: the
chosen run is integrated so much more loosely that both differ by what that errs, and a
part of the difference is open as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from sidtool.formats.result import BudgetLine
from sidtool.formats.sid import Array

from ..choose import Chosen, estimated
from ..integration import TIGHT, Found, loosest
from ..reference import (
    CHECKING,
    MEASURING,
    SAFETY,
    TIGHTEST,
    Reference,
    of_one_run,
)
from ..runs import Runs, Setting, apart
from ..wanted import Request

#: Runs are long that take more than this [s].
LONG = 0.1
#: Of what is allowed: what a loose run of the finest model errs in the first part,
#: what its reference may, and what that may leave open on the whole.
LOOSE, MEASURED, OPEN = 0.3, 0.03, 0.3
#: Of what is allowed, what two runs at loose tolerances do not show of each other, as
#: methods that both step from one output to the next err alike.
UNSEEN = 0.005
#: The loosest tolerance of a run of the finest model, and of its reference; that of the
#: reference over that of the run that it is compared with, as it is asked for and at
#: most.
LOOSEST, TOLD, SHARPER, SHARP = 3e-3, 3e-4, 0.03, 0.1
#: Of the difference of the chosen run to the reference, what that may err.
OWN = 0.3
#: How errors of the reference are known, in words.
TIGHTER = "a tighter run"


@dataclass(frozen=True, eq=False)
class Proven:
    """A choice whose errors were seen on all of the time.

    decided : the reference that what could be left out was compared with
    theory : (n,) what small deformations leave out
    lines : the budget
    bounds : of errors, by outputs that have one
    frames : other ones that bodies were put in
    """

    runs: Runs
    reference: Reference
    chosen: Chosen
    decided: Reference
    theory: Array
    lines: tuple[BudgetLine, ...]
    sentences: tuple[str, ...]
    bounds: Mapping[str, float] = field(default_factory=dict)
    frames: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Part:
    """The first part of the motion: its runs, and the finest of them."""

    runs: Runs
    reference: Reference
    theory: Array
    sentences: tuple[str, ...]

    @property
    def told(self) -> str:
        time = self.runs.scene.time
        return f"the first {time.end - time.start:.3g} s"

    @property
    def without_meshes(self) -> Reference:
        """The reference, of which meshes leave nothing open."""
        return self.reference.with_meshes(np.zeros(len(self.runs.names)))

    def errors(self, setting: Setting) -> Array:
        """What a run of the finest model to the end errs in this part, (n,)."""
        choice, best = self.reference.choice, self.reference.result
        one = self.runs.begun(choice, setting).result
        if one is None:
            return np.full(len(self.runs.names), np.inf)
        rows = slice(len(best.t))
        found = one.t[rows], self.runs.columns(choice, one)[rows]
        errors = apart(found, (best.t, self.runs.columns(choice, best)))
        return errors + self.reference.uncertainty


def loose_setting(part: Part) -> Setting:
    """For a run of the finest model that keeps a part of what is allowed."""
    reference = part.without_meshes
    found = loosest(part.runs, reference, reference.choice, MEASURING, LOOSE)
    return Setting(MEASURING, min(found.rtol if found else TIGHT, LOOSEST))


def sharp_for(
    setting: Setting,
    part: Part,
    runs: Runs,
    request: Request,
    known: Reference,
    methods: tuple[str, ...] = (MEASURING, CHECKING),
) -> Reference | None:
    """The cheapest reference that shows what a run errs; None where there is none.

    known : one that was run already, or that of the part
    """
    most = min(SHARP * setting.rtol, TOLD)
    if known is not part.reference and known.setting.rtol <= most:
        return known
    rtol = min(SHARPER * setting.rtol, TOLD)
    tried = [_tightened(part, Setting(method, rtol)) for method in methods]
    best = min(
        (setting for setting in tried if setting is not None),
        key=lambda setting: part.runs.cost(part.reference.choice, setting),
        default=None,
    )
    return None if best is None else on_the_whole(part, runs, request, best)


def _tightened(part: Part, setting: Setting) -> Setting | None:
    """Until it errs by little in the first part; None where it never does."""
    while setting.rtol >= TIGHTEST:
        if part.reference.use(part.errors(setting)) <= MEASURED:
            return setting
        setting = Setting(setting.integrator, SHARPER * setting.rtol)
    return None


def on_the_whole(
    part: Part, runs: Runs, request: Request, setting: Setting
) -> Reference | None:
    """The reference; None where it leaves too much open."""
    choice = part.reference.choice
    if runs.attempt(choice, setting) is None:
        return None
    found = of_one_run(runs, choice, request, setting)
    unseen = np.where(np.isfinite(found.allowed), UNSEEN * found.allowed, 0.0)
    errors = SAFETY * np.maximum(part.errors(setting), unseen)
    digits = SAFETY * part.reference.digits  # they may do more later on
    found = replace(
        found,
        uncertainty=found.uncertainty + errors,
        meshes=part.reference.meshes,
        digits=digits,
    )
    return found if found.use(found.uncertainty) <= OPEN else None


def seen_on_the_whole(
    runs: Runs, reference: Reference, found: Chosen
) -> tuple[Reference, Chosen]:
    """The chosen run to the end beside the reference, with what that may err itself."""
    choice, setting = found.choice, found.found.setting
    one = runs.attempt(choice, setting)
    errors = runs.between((choice, one), (reference.choice, reference.result))
    there = Found(setting, errors, runs.seconds(choice, setting))
    seen = replace(reference, uncertainty=reference.uncertainty + OWN * errors)
    return seen, replace(found, found=there, errors=estimated(errors, seen))
