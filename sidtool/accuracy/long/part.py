"""Long runs: what is left out is chosen in a first part and proven on all of the time.

A search makes some dozens of tight runs. Where these are long all of them are of the
first part of the motion only. What is chosen there runs to the end, and so does
everything that the SIDs have, so much more tightly that it tells what the chosen run
errs: errors that are told are seen on all of the time, as in a search of short runs.
What does not keep the request there is chosen again from less. Motions that have hardly
begun in the first part get a longer one, or a few runs of all of the time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sidtool.formats.errors import InputError
from sidtool.formats.result import BudgetLine
from sidtool.formats.sid import Array

from ..budget import budget
from ..candidates import Choice
from ..choose import ALL, Chosen, choose
from ..digits import with_digits
from ..frames import with_frames
from ..integration import TIGHT
from ..outside import OutsideTheory, check_inside
from ..reference import MEASURING, Reference, first_rtol, make_reference
from ..runs import Runs, Setting
from ..wanted import Request
from .sparing import chosen_sparingly
from .whole import (
    LONG,
    MEASURED,
    SAFETY,
    TIGHTER,
    Part,
    Proven,
    seen_on_the_whole,
    sharp_for,
)

#: The first part of the time span, and the longest one that is tried.
FIRST, LONGEST = 1.0 / 128.0, 1.0 / 8.0
#: Tight runs of all of the time that choices in a first part may cost.
CHEAP = 2.0
#: Of the variation of each output, what has to be seen in it.
SEEN = 0.7
#: Of what is allowed, how much is asked for in the first part, and of what a run errs
#: on the whole, where that was too much.
CAUTION, LESS, ROUNDS = 0.5, 0.6, 3
#: Of the tolerance of the first part, that of all of the time where joints rub: errors
#: grow by leaps there, and few of the steps are as long as tolerances allow.
RUBBING = 0.2
#: Of what is allowed, what digits of files may leave open in the first part.
DIGITS = 1e-3
#: Rows of results that a first part has at least.
ROWS = 16


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
    InputError : no run that the request needs can be had in a sensible time.
    OutsideTheory : a body leaves what its SID describes.
    """
    ends = _ends(runs)
    first = runs.until(ends[0]) if ends else runs
    if not ends or not _is_long(first, runs, whole, request):
        return None
    part = _tried(lambda: _first_part(first, whole, request, meshes))
    while part is None and len(ends) > 1:  # nothing may move at first
        ends = ends[1:]
        first = runs.until(ends[0])
        part = _tried(lambda first=first: _first_part(first, whole, request, meshes))  # type: ignore[misc]
    if part is None:
        return None
    found = _of_parts(runs, part, request, ends) if _is_cheap(runs, first) else None
    return found or chosen_sparingly(runs, part, request)


def _of_parts(
    runs: Runs, part: Part, request: Request, ends: list[float]
) -> Proven | None:
    """What the shortest first part chooses that shows the motion."""
    first = _found(runs, part, part.reference, CAUTION)
    if first is None:
        return None
    result = runs.attempt(first.choice, first.found.setting)
    if result is None:
        return None
    judged = np.isfinite(part.reference.allowed)
    values = runs.columns(first.choice, result)[:, judged]
    end = next((e for e in ends if _is_seen(result.t, values, e)), None)
    if end is None:
        return None
    if end == ends[0]:
        return _proven(runs, part, request, first)
    whole, meshes = part.reference.choice, part.reference.meshes
    longer = _tried(lambda: _first_part(runs.until(end), whole, request, meshes))
    if longer is None:
        return None
    again = _found(runs, longer, longer.reference, CAUTION)
    return None if again is None else _proven(runs, longer, request, again)


def _found(runs: Runs, part: Part, reference: Reference, share: float) -> Chosen | None:
    """What keeps a share of the request in the part, integrated for all of the time.

    reference : the whole one, or that of the part
    """
    decided = _asked(part, reference, share)
    found = _tried(lambda: choose(part.runs, decided))
    if found is None:
        return None
    return found if reference is not part.reference else _carefully(runs, found)


def _tried(make: Callable):  # type: ignore[type-arg, no-untyped-def]
    """What the first part tells, None where that cannot be run.

    Raises
    ------
    OutsideTheory : a body leaves what its SID describes, in all of the time then, too.
    """
    from sidtool.solver.errors import SimulationError

    try:
        return make()
    except OutsideTheory:
        raise
    except (InputError, SimulationError):
        return None


def _ends(runs: Runs) -> list[float]:
    """Ends of first parts, the shortest first, that have rows enough."""
    time = runs.scene.time
    if time.output_step is None:
        return []
    rows = np.rint((time.end - time.start) / time.output_step)
    if rows < 1:
        return []
    counts, count = [], int(np.ceil(rows * FIRST))
    while count <= rows * LONGEST:
        if count >= ROWS:
            counts.append(count)
        count *= 2
    return [float(time.start + n * time.output_step) for n in counts]


def _share(runs: Runs, part: Runs) -> float:
    """The part of the time."""
    long, short = runs.scene.time, part.scene.time
    return (short.end - short.start) / (long.end - long.start)


def _is_long(part: Runs, runs: Runs, whole: Choice, request: Request) -> bool:
    """Whether a tight run on the whole takes long, by one of the first part."""
    setting = Setting(MEASURING, first_rtol(request))
    seconds = part.seconds(whole, setting, short=np.inf)
    return np.isfinite(seconds) and bool(seconds > LONG * _share(runs, part))


def _is_cheap(runs: Runs, part: Runs) -> bool:
    """Whether choices in the part take no longer than a few runs of all of the time."""
    return sum(runs.expected.values()) * _share(runs, part) <= CHEAP


def _first_part(
    part: Runs, whole: Choice, request: Request, meshes: Array
) -> Part | None:
    """The tight reference of a first part; None where that does not do."""
    reference = make_reference(part, whole, request).with_meshes(meshes)
    check_inside(reference.result)
    reference, digits = with_digits(part, reference)
    frames = with_frames(part, reference, request, fixed=True)
    if reference.use(reference.digits) > DIGITS:
        return None
    return Part(part, reference, frames.theory, (*digits, *frames.sentences))


def _is_seen(times: Array, values: Array, end: float) -> bool:
    """Whether most of the variation of each output (nt, n) is seen until then."""
    seen = np.ptp(values[times <= end], axis=0)
    return bool((seen >= SEEN * np.ptp(values, axis=0)).all())


def _asked(part: Part, reference: Reference, share: float) -> Reference:
    """The reference of the part, of which a share of what is not open is allowed."""
    open_ = reference.use(reference.doubt)
    if reference is part.reference:
        open_ += SAFETY * MEASURED  # what that of all of the time will leave open
    allowed = share * (ALL - open_) / ALL * reference.allowed
    return replace(part.without_meshes, allowed=allowed)  # these are open


def _proven(
    runs: Runs, part: Part, request: Request, found: Chosen | None
) -> Proven | None:
    """What the part leaves out and keeps the request on the whole.

    found : what it chose first
    """
    reference, share = part.reference, CAUTION
    for _ in range(ROUNDS):
        if found is None:
            return None
        sharp = sharp_for(found.found.setting, part, runs, request, reference)
        if sharp is None or not _is_shown(runs, sharp, part):
            return None
        check_inside(sharp.result)
        seen, chosen = seen_on_the_whole(runs, sharp, found)
        use, open_ = seen.use(chosen.errors), sharp.use(sharp.doubt)
        if use <= 1.0:
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
        found = _found(runs, part, reference, share)
    return None


def _carefully(runs: Runs, found: Chosen) -> Chosen:
    """With a tolerance for all of the time."""
    setting = found.found.setting
    if not any(getattr(j, "friction", None) for j in runs.scene.joints.values()):
        return found
    careful = Setting(setting.integrator, max(RUBBING * setting.rtol, TIGHT))
    return replace(found, found=replace(found.found, setting=careful))


def _is_shown(runs: Runs, reference: Reference, part: Part) -> bool:
    """Whether the part shows what the finest model does, too."""
    values = runs.columns(reference.choice, reference.result)
    judged = np.isfinite(reference.allowed)
    return _is_seen(reference.result.t, values[:, judged], part.runs.scene.time.end)


def _lines(
    part: Part, reference: Reference, found: Chosen, chosen: Chosen
) -> tuple[BudgetLine, ...]:
    """The budget: single choices in the first part, their sum on the whole."""
    lines = budget(part.runs, part.reference, found, part.theory, TIGHTER)
    slower = chosen.found.seconds / part.runs.seconds(found.choice, found.found.setting)
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
