"""Long runs: what is left out is chosen in a first part and proven on all of the time.

A search makes some twenty tight runs. Where these are long all of them are of the first
part of the motion only. How tightly two methods have to integrate, so that they differ
by a small part of what is allowed, is seen there as well, against a tight reference.
These two then run to the end with everything that the SIDs have, and so does what was
chosen: errors that are told are seen on all of the time, as in a search of short runs.
What does not keep the request there is chosen again from less; of motions that have
hardly begun in the first part, that part is made longer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.result import BudgetLine
from sidtool.formats.sid import Array

from .budget import budget
from .candidates import Choice
from .choose import ALL, Chosen, choose, estimated
from .digits import with_digits
from .frames import with_frames
from .integration import Found, loosest
from .outside import check_inside
from .reference import (
    CHECKING,
    MEASURING,
    SAFETY,
    Reference,
    first_rtol,
    make_reference,
)
from .reference import of_two_runs as compared
from .runs import Runs, Setting
from .wanted import Request

#: Runs are long that take more than this [s]; of those that take more than `ENOUGH` no
#: more than a few are made.
LONG, ENOUGH = 0.2, 1.0
#: The first part of the time span, and the longest one that is tried.
FIRST, LONGEST = 1.0 / 128.0, 1.0 / 8.0
#: Of the variation of each output, what has to be seen in it.
SEEN = 0.7
#: Of what is allowed: what each method may err in the first part, and what the
#: reference may leave open on the whole.
MEASURED, OPEN = 0.05, 0.3
#: Of what is allowed, what two methods at loose tolerances do not show of each other.
UNSEEN = 0.005
#: The loosest tolerance of the first method. The other is asked for more, as methods
#: that both step from one output to the next err alike at loose tolerances.
LOOSEST, SHARPER = 1e-3, 0.03
#: Of what is allowed, how much is asked for in the first part, and of what a run errs
#: on the whole, where that was too much.
CAUTION, LESS, ROUNDS = 0.5, 0.6, 2
#: Of what is allowed, what digits of files may leave open in the first part.
DIGITS = 1e-3
#: Rows of results that a first part has at least.
ROWS = 16


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
class _Part:
    """The first part of the motion: its runs, and the finest of them."""

    runs: Runs
    reference: Reference
    theory: Array
    sentences: tuple[str, ...]

    @property
    def told(self) -> str:
        time = self.runs.scene.time
        return f"the first {time.end - time.start:.3g} s"


def chosen_in_part(
    runs: Runs, whole: Choice, request: Request, meshes: Array
) -> Proven | None:
    """What is chosen where runs are long; None where all of them have to be whole.

    Parameters
    ----------
    whole : everything that the SIDs have
    meshes : (n,) what meshes of bodies and modes that they lack add

    Raises
    ------
    OutsideTheory : a body leaves what its SID describes.
    """
    ends = _ends(runs)
    if not ends or not _is_long(runs, whole, request, ends[0]):
        return None
    part = _tried(lambda: _first_part(runs, whole, request, meshes, ends[0]))
    pair = _tried(lambda: _methods(part, whole)) if part is not None else None
    if part is None or pair is None:
        return None
    reference = _on_the_whole(runs, whole, request, pair)
    if reference is None:
        return None
    reference = reference.with_meshes(meshes)
    digits = SAFETY * part.reference.digits  # they may do more later on
    reference = replace(reference, digits=digits)
    check_inside(reference.result)
    end = next((e for e in ends if _is_seen(runs, reference, e)), None)
    if end is not None and end != ends[0]:
        part = _tried(lambda: _first_part(runs, whole, request, meshes, end))
    found = None
    if end is not None and part is not None:
        found = _chosen(runs, reference, part)
    return found or _without_choice(runs, reference, request)


def _tried(make: Callable):  # type: ignore[type-arg, no-untyped-def]
    """What the first part tells, None where that cannot be run."""
    from sidtool.solver.errors import SimulationError

    try:
        return make()
    except (InputError, SimulationError):
        return None


def _ends(runs: Runs) -> list[float]:
    """Ends of first parts, the shortest first, that have rows enough."""
    time = runs.scene.time
    if time.output_step is None:
        return []
    rows = np.rint((time.end - time.start) / time.output_step)
    counts, count = [], int(np.ceil(rows * FIRST))
    while count <= rows * LONGEST:
        if count >= ROWS:
            counts.append(count)
        count *= 2
    return [float(time.start + n * time.output_step) for n in counts]


def _cut(runs: Runs, end: float) -> Runs:
    scene = runs.scene
    time = scene.time.model_copy(update={"end": end})
    part = scene.model_copy(update={"time": time})
    return runs.elsewhere({}, runs.names, part)


def _is_long(runs: Runs, whole: Choice, request: Request, end: float) -> bool:
    """Whether a tight run on the whole takes long, by one of the first part."""
    part, time = _cut(runs, end), runs.scene.time
    setting = Setting(MEASURING, first_rtol(request))
    seconds = part.seconds(whole, setting, short=np.inf)
    share = (end - time.start) / (time.end - time.start)
    return np.isfinite(seconds) and bool(seconds > LONG * share)


def _first_part(
    runs: Runs, whole: Choice, request: Request, meshes: Array, end: float
) -> _Part | None:
    """The tight reference of a first part; None where that does not do."""
    part = _cut(runs, end)
    reference = make_reference(part, whole, request).with_meshes(meshes)
    check_inside(reference.result)
    reference, digits = with_digits(part, reference)
    frames = with_frames(part, reference, request, fixed=True)
    if reference.use(reference.digits) > DIGITS:
        return None
    return _Part(part, reference, frames.theory, (*digits, *frames.sentences))


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two methods for the whole of the time.

    shared : (n,) what the tighter one errs in the first part, which the difference of
        both need not show; a small part of what is allowed at least
    """

    looser: Setting
    tighter: Setting
    shared: Array


def _methods(part: _Part, whole: Choice) -> _Pair | None:
    """Two methods that err by a small part of what is allowed."""
    runs, reference = part.runs, part.reference
    reference = replace(reference, meshes=np.zeros(len(runs.names)))
    one = loosest(runs, reference, whole, MEASURING, MEASURED)
    two = loosest(runs, reference, whole, CHECKING, MEASURED)
    if one is None or two is None:
        return None
    rtol = min(one.rtol, LOOSEST)
    two = Setting(CHECKING, min(SHARPER * rtol, two.rtol))
    found = runs.attempt(whole, two)
    shared = runs.between((whole, found), (whole, reference.result))
    unseen = np.where(np.isfinite(reference.allowed), UNSEEN * reference.allowed, 0.0)
    shared = np.maximum(shared + reference.uncertainty, unseen)
    return _Pair(Setting(MEASURING, rtol), two, shared)


def _on_the_whole(
    runs: Runs, whole: Choice, request: Request, pair: _Pair
) -> Reference | None:
    """The reference by two methods; the looser one is tightened if they are not close
    enough, then the other."""
    one, two = pair.looser, pair.tighter
    for tightened in ("looser", "tighter", ""):
        if runs.attempt(whole, one) is None or runs.attempt(whole, two) is None:
            return None
        found = compared(runs, whole, request, one, two)
        found = replace(found, uncertainty=found.uncertainty + SAFETY * pair.shared)
        use = found.use(found.uncertainty)
        if use <= OPEN:
            return found
        less = float(np.clip(0.3 * OPEN / use, 1e-3, 0.3))
        if tightened == "looser":
            one = Setting(one.integrator, less * one.rtol)
        elif tightened:
            two = Setting(two.integrator, less * two.rtol)
    return None


def _is_seen(runs: Runs, reference: Reference, end: float) -> bool:
    """Whether most of the variation of each output is seen until then."""
    counts = np.isfinite(reference.allowed)
    values = runs.columns(reference.choice, reference.result)[:, counts]
    seen = np.ptp(values[reference.result.t <= end], axis=0)
    return bool((seen >= SEEN * reference.variation[counts]).all())


def _chosen(runs: Runs, reference: Reference, part: _Part) -> Proven | None:
    """What the first part leaves out and keeps the request on the whole."""
    open_ = reference.use(reference.doubt)
    asked = CAUTION * (ALL - open_)
    bare = part.reference.with_meshes(np.zeros(len(runs.names)))  # they are in open_
    for _ in range(ROUNDS):
        decided = replace(bare, allowed=asked / ALL * reference.allowed)
        found = _tried(lambda decided=decided: choose(part.runs, decided))  # type: ignore[misc]
        if found is None:
            return None
        chosen = _seen_on_the_whole(runs, reference, found)
        use = reference.use(chosen.errors)
        if use <= ALL:
            lines = _lines(part, reference, found, chosen)
            return Proven(
                runs,
                reference,
                chosen,
                replace(part.reference, allowed=reference.allowed),
                part.theory,
                lines,
                (_told(runs, part), *part.sentences),
            )
        asked *= LESS * (ALL - open_) / (use - open_)
    return None


def _seen_on_the_whole(runs: Runs, reference: Reference, found: Chosen) -> Chosen:
    """The chosen run to the end beside the reference."""
    choice, setting = found.choice, found.found.setting
    one = runs.attempt(choice, setting)
    errors = runs.between((choice, one), (reference.choice, reference.result))
    seconds = runs.seconds(choice, setting)
    seen = Found(setting, errors, seconds)
    return replace(found, found=seen, errors=estimated(errors, reference))


def _without_choice(
    runs: Runs, reference: Reference, request: Request
) -> Proven | None:
    """The looser run of the reference, where another search would take too long."""
    choice, setting = reference.choice, reference.setting
    seconds = runs.seconds(choice, setting)
    if seconds < ENOUGH:
        return None
    one = runs.attempt(choice, setting)
    errors = runs.between((choice, one), (choice, reference.result))
    chosen = Chosen(
        choice, Found(setting, errors, seconds), (), estimated(errors, reference)
    )
    nothing = np.zeros(len(request.names))
    if reference.use(chosen.errors) > ALL:
        return None
    lines = budget(runs, reference, chosen, nothing)
    told = (
        f"nothing left out, as runs take {seconds:.2g} s and no first part of the "
        "motion shows what the rest needs: trying would take longer than it saves. "
        "frames: not judged"
    )
    return Proven(runs, reference, chosen, reference, nothing, lines, (told,))


def _lines(
    part: _Part, reference: Reference, found: Chosen, chosen: Chosen
) -> tuple[BudgetLine, ...]:
    """The budget: single choices in the first part, their sum on the whole."""
    lines = budget(part.runs, part.reference, found, part.theory)
    slower = chosen.found.seconds / found.found.seconds
    seen = {"reference": reference.uncertainty, "all together": chosen.errors}
    result = []
    for line in lines:
        finest = None if line.finest is None else slower * line.finest
        changes: dict[str, object] = {"seconds": chosen.found.seconds, "finest": finest}
        if line.part in seen:
            pairs = zip(
                part.runs.names, seen[line.part], reference.allowed, strict=True
            )
            changes["errors"] = {n: float(e) for n, e, a in pairs if np.isfinite(a)}
        elif line.part != "mesh":
            changes["choice"] = f"{line.choice}; {part.told}"
        result.append(line.model_copy(update=changes))
    return tuple(result)


def _told(runs: Runs, part: _Part) -> str:
    time = runs.scene.time
    return (
        f"long runs: choices were made, and single effects seen, in {part.told}; the "
        f"errors of all together were seen on all {time.end - time.start:.3g} s"
    )
