"""Decisions of the search, and diagnostics on what its errors do not include."""

from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.geometric_stiffening import SIGNIFICANT_CHANGE
from sidtool.formats.result import Decision, OutputError
from sidtool.formats.scene import SceneFile

from ..measurement.candidates import (
    FLEXIBILITY,
    SHAPE,
    SHAPES,
    SPACE,
    STIFFENING,
    Candidate,
    Choice,
    loaded_nodes,
)
from ..measurement.request import Request
from .reference_run import Reference
from .selection import MeasuredReduction, SelectedModel

#: Smaller changes of stiffness get no diagnostic.
MIN_NOTED_STIFFENING = 1e-3


def decision_list(
    request: Request, reference: Reference, chosen: SelectedModel
) -> tuple[Decision, ...]:
    """Return a decision for every possible simplification."""
    return tuple(
        _decision(request, reference, chosen.choice, one) for one in chosen.measured
    )


def _decision(
    request: Request, reference: Reference, choice: Choice, one: MeasuredReduction
) -> Decision:
    row = reference.worst_output(one.errors)
    runs = bool(np.isfinite(one.errors[row]))
    return Decision(
        body=one.candidate.body,
        what=one.candidate.what,  # type: ignore[arg-type]
        number=one.candidate.number,
        numbers=one.candidate.numbers,
        output=request.names[row],
        effect=float(max(one.errors[row], reference.resolution[row])) if runs else 0.0,
        allowed=float(reference.allowed[row]),
        unit=reference.units[row],
        kept=is_in_model(choice, one.candidate),
        runs_without=runs,
    )


def is_in_model(choice: Choice, candidate: Candidate) -> bool:
    """Return whether the selected model retains what a candidate would omit."""
    if candidate.what == SPACE:
        return not choice.flat
    numbers = dict(choice.kept)[candidate.body]
    if candidate.what == FLEXIBILITY:
        return bool(numbers)
    if candidate.what == SHAPE:
        return candidate.number in numbers
    if candidate.what == SHAPES:
        return any(number in numbers for number in candidate.numbers)
    if candidate.what == STIFFENING:
        return bool(numbers) and candidate.body not in choice.unstiffened
    return bool(numbers) and candidate.body in choice.quadratic


def format_ranges(numbers: Sequence[int]) -> str:
    """Format increasing numbers as in "1, 3 to 5, 8"."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    parts = [
        f"{run[0]} to {run[-1]}" if len(run) > 2 else ", ".join(map(str, run))
        for run in runs
    ]
    return ", ".join(parts)


def excluded_errors(
    scene: SceneFile,
    reference: Reference,
    sids: Mapping[str, SID],
    stiffened: Collection[str],
    models: Collection[str],
    unstiffened: Collection[str],
) -> Iterator[Diagnostic]:
    """Diagnose what the errors do not include (N603, N605).

    Parameters
    ----------
    stiffened : bodies whose SIDs have geometric stiffening
    models : bodies whose mesh is assessed
    unstiffened : bodies whose missing stiffening is assessed
    """
    judged = np.isfinite(reference.allowed) & (reference.variation > 0.0)
    least = min(reference.allowed[judged] / reference.variation[judged], default=0.0)
    for name, body in reference.result.bodies.items():
        measure, known = body.found or body.expected, {*stiffened, *unstiffened}
        share = abs(measure.ratio)
        is_noted = max(MIN_NOTED_STIFFENING, least) < share < SIGNIFICANT_CHANGE
        if is_noted and name not in known and not measure.axial:
            yield diagnose("N605", name, ratio=measure.ratio)
    flexible = [n for n, kept in reference.choice.kept if kept and n not in models]
    if flexible:
        yield diagnose(
            "N603",
            ", ".join(flexible),
            what="mesh and missing shape functions",
            reason="only a SID is given",
            remedy="Give its model.",
            loads=[f"{n}.{m}" for n in flexible for m in loaded_nodes(scene, n)],
        )


def outputs_without_error(
    request: Request, reference: Reference, unrecorded: Sequence[str]
) -> Iterator[Diagnostic]:
    """Diagnose outputs that have no error (N615).

    Parameters
    ----------
    unrecorded : recorded outputs of the scene that the chosen model does not have
    """
    reasons = {
        "varying by rounding only": reference.left_out,
        "no quantity that could have one": request.ignored,
        "not in the chosen model, and not recorded": unrecorded,
    }
    for reason, names in reasons.items():
        if names:
            yield diagnose("N615", ", ".join(names), reason=reason)


def theory_diagnostics(outputs: Sequence[OutputError]) -> Iterator[Diagnostic]:
    """Diagnose neglected terms of linear theory that exceed the request (N609)."""
    ratios = {o.name: o.theory / o.allowed for o in outputs if o.theory}
    beyond = [o for o in outputs if ratios.get(o.name, 0.0) > 1.0]
    if beyond:
        worst = max(beyond, key=lambda o: ratios[o.name])
        yield diagnose(
            "N609",
            worst.name,
            amount=f"{worst.theory:.2g} {worst.unit}".rstrip(),
            error=worst.theory or 0.0,
            ratio=ratios[worst.name],
            count=len(beyond),
        )
