"""Long runs: what is left out is chosen in a first part and proven on all of the time.

A search makes some twenty tight runs. Where these are long all of them are of the first
part of the motion only. Everything that the SIDs have runs to the end once, and so does
what was chosen: errors that are told are seen on all of the time, as in a search of
short runs. What does not keep the request there is chosen again from less; of motions
that have hardly begun in the first part, that part is made longer.
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
from .choose import ALL, Chosen, choose
from .digits import with_digits
from .frames import with_frames
from .integration import Found
from .outside import check_inside
from .reference import MEASURING, Reference, first_rtol, make_reference
from .runs import Runs, Setting
from .wanted import Request
from .whole import (
    Part,
    loose_setting,
    on_the_whole,
    seen_on_the_whole,
    sharp_for,
    tight_setting,
)

#: Runs are long that take more than this [s]; of those that take more than `ENOUGH` no
#: more than a few are made.
LONG, ENOUGH = 0.2, 1.0
#: The first part of the time span, and the longest one that is tried.
FIRST, LONGEST = 1.0 / 128.0, 1.0 / 8.0
#: Of the variation of each output, what has to be seen in it.
SEEN = 0.7
#: Of what is allowed, how much is asked for in the first part, and of what a run errs
#: on the whole, where that was too much.
CAUTION, LESS, ROUNDS = 0.5, 0.6, 2
#: Of what is allowed, what digits of files may leave open in the first part.
DIGITS = 1e-3
#: How errors of the reference are known, in words.
TIGHTER = "a tighter run"
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
    loose = loose_setting(part) if part is not None else None
    tight = tight_setting(part, loose) if part is not None and loose else None
    if part is None or loose is None or tight is None:
        return None
    reference = on_the_whole(part, runs, request, tight)
    if reference is None:
        return None
    check_inside(reference.result)
    end = next((e for e in ends if _is_seen(runs, reference, e)), None)
    if end is not None and end != ends[0]:
        part = _tried(lambda: _first_part(runs, whole, request, meshes, end))
    found = None
    if end is not None and part is not None:
        found = _chosen(runs, reference, part, request)
    return found or _without_choice(runs, reference, loose)


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


def _is_long(runs: Runs, whole: Choice, request: Request, end: float) -> bool:
    """Whether a tight run on the whole takes long, by one of the first part."""
    part, time = runs.until(end), runs.scene.time
    setting = Setting(MEASURING, first_rtol(request))
    seconds = part.seconds(whole, setting, short=np.inf)
    share = (end - time.start) / (time.end - time.start)
    return np.isfinite(seconds) and bool(seconds > LONG * share)


def _first_part(
    runs: Runs, whole: Choice, request: Request, meshes: Array, end: float
) -> Part | None:
    """The tight reference of a first part; None where that does not do."""
    part = runs.until(end)
    reference = make_reference(part, whole, request).with_meshes(meshes)
    check_inside(reference.result)
    reference, digits = with_digits(part, reference)
    frames = with_frames(part, reference, request, fixed=True)
    if reference.use(reference.digits) > DIGITS:
        return None
    return Part(part, reference, frames.theory, (*digits, *frames.sentences))


def _is_seen(runs: Runs, reference: Reference, end: float) -> bool:
    """Whether most of the variation of each output is seen until then."""
    counts = np.isfinite(reference.allowed)
    values = runs.columns(reference.choice, reference.result)[:, counts]
    seen = np.ptp(values[reference.result.t <= end], axis=0)
    return bool((seen >= SEEN * reference.variation[counts]).all())


def _chosen(
    runs: Runs, reference: Reference, part: Part, request: Request
) -> Proven | None:
    """What the first part leaves out and keeps the request on the whole."""
    share = CAUTION
    for _ in range(ROUNDS):
        open_ = reference.use(reference.doubt)
        asked = share * (ALL - open_) / ALL * reference.allowed
        decided = replace(part.without_meshes, allowed=asked)  # they are in open_
        found = _tried(lambda decided=decided: choose(part.runs, decided))  # type: ignore[misc]
        if found is None:
            return None
        setting = found.found.setting
        sharp = sharp_for(setting, reference, part, runs, request)
        if sharp is None:
            return None
        seen, chosen = seen_on_the_whole(runs, sharp, found)
        use = seen.use(chosen.errors)
        if use <= ALL:
            return Proven(
                runs,
                seen,
                chosen,
                replace(part.reference, allowed=seen.allowed),
                part.theory,
                _lines(part, seen, found, chosen),
                (_told(runs, part), *part.sentences),
            )
        share *= LESS * (ALL - open_) / (use - open_)
        reference = sharp
    return None


def _without_choice(
    runs: Runs, reference: Reference, setting: Setting
) -> Proven | None:
    """A looser run of the reference, where another search would take too long."""
    choice = reference.choice
    seconds = runs.seconds(choice, reference.setting)
    if seconds < ENOUGH:
        return None
    nothing = np.zeros(len(runs.names))
    bare = Chosen(choice, Found(setting, nothing, seconds), (), nothing)
    seen, chosen = seen_on_the_whole(runs, reference, bare)
    if seen.use(chosen.errors) > ALL:
        return None
    lines = budget(runs, seen, chosen, nothing, TIGHTER)
    told = (
        f"nothing left out, as runs take {seconds:.2g} s and no first part of the "
        "motion shows what the rest needs: trying would take longer than it saves. "
        "frames: not judged"
    )
    return Proven(runs, seen, chosen, seen, nothing, lines, (told,))


def _lines(
    part: Part, reference: Reference, found: Chosen, chosen: Chosen
) -> tuple[BudgetLine, ...]:
    """The budget: single choices in the first part, their sum on the whole."""
    lines = budget(part.runs, part.reference, found, part.theory, TIGHTER)
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


def _told(runs: Runs, part: Part) -> str:
    time = runs.scene.time
    return (
        f"long runs: choices were made, and single effects seen, in {part.told}; the "
        f"errors of all together were seen on all {time.end - time.start:.3g} s"
    )
