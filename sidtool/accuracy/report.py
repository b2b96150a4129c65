"""Sentences on what was omitted and the reasons."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from sidtool.formats.base.sid import SID
from sidtool.formats.result import AccuracyReport, Decision
from sidtool.formats.scene import SceneFile, unit_of

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

#: Smaller changes of stiffness get no note.
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
    name = request.names[row]
    runs = bool(np.isfinite(one.errors[row]))
    effect = float(max(one.errors[row], reference.resolution[row])) if runs else 0.0
    allowed, kept = float(reference.allowed[row]), is_in_model(choice, one.candidate)
    unit = reference.units[row]
    amount = f"{effect:.1e} {unit}".rstrip() + f" in {name}"
    if runs and one.errors[row] <= reference.resolution[row]:
        amount = f"less than {amount}"
    if not runs:
        amount = "the scene does not run without it"
    return Decision(
        body=one.candidate.body,
        what=one.candidate.what,  # type: ignore[arg-type]
        number=one.candidate.number,
        numbers=one.candidate.numbers,
        output=name,
        effect=effect,
        allowed=allowed,
        unit=unit,
        kept=kept,
        sentence=f"{_subject(one.candidate)}: {amount}, "
        f"{_decision_text(one.candidate, kept)}",
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


def _subject(candidate: Candidate) -> str:
    if candidate.what == SHAPE:
        return f"mode {candidate.number} of {candidate.body}"
    if candidate.what == SHAPES:
        return f"modes {format_ranges(candidate.numbers)} of {candidate.body} together"
    if candidate.what == SPACE:
        return "motion out of the plane z = 0"
    return f"{candidate.what} of {candidate.body}"


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


def _decision_text(candidate: Candidate, is_part_of_model: bool) -> str:
    if candidate.what == FLEXIBILITY:
        return "kept flexible" if is_part_of_model else "rigid"
    if candidate.what == SPACE:
        return "solved in space" if is_part_of_model else "solved in the plane"
    return "kept" if is_part_of_model else "dropped"


def accuracy_notes(
    scene: SceneFile,
    request: Request,
    reference: Reference,
    sids: Mapping[str, SID],
    stiffened: dict[str, bool],
    models: Collection[str],
    unstiffened: Collection[str],
) -> Iterator[str]:
    """Return notes on what cannot be assessed and what does not count.

    Parameters
    ----------
    models : bodies whose mesh is assessed
    unstiffened : bodies whose missing stiffening is assessed
    """
    for name, removable in stiffened.items():
        if not removable:
            yield (
                f"geometric stiffening of {name}: kept, as the blocks of a SID in "
                "space do not tell what it would be without"
            )
    for name, body in reference.result.bodies.items():
        measure = body.found or body.expected
        known = name in stiffened or name in unstiffened
        if (
            not known
            and not measure.axial
            and abs(measure.ratio) > MIN_NOTED_STIFFENING
        ):
            yield (
                f"geometric stiffening of {name}: not in its SID, and not in these "
                f"errors, while {measure.sentence()}"
            )
    flexible = [n for n, kept in reference.choice.kept if kept and n not in models]
    if flexible:
        yield (
            "mesh: not judged, as a SID does not tell its own "
            f"({', '.join(flexible)}); shape functions beyond those of the SID neither"
            f"{_static_shape_names(flexible, scene)}"
        )
    if reference.left_out:
        listed = ", ".join(reference.left_out)
        yield f"not judged, as they hold rounding only: {listed}"
    if request.ignored:
        yield f"not judged, as no quantities: {', '.join(request.ignored)}"


def _static_shape_names(names: Sequence[str], scene: SceneFile) -> str:
    """Name the static shape functions that a SID may lack for the loads of
    this scene.
    """
    places = [f"{n}.{marker}" for n in names for marker in loaded_nodes(scene, n)]
    if not places:
        return ""
    return f", such as static ones for loads at {', '.join(places)}"


def bound_notes(proven: Mapping[str, float], scene: SceneFile) -> Iterator[str]:
    """Describe the error bounds by output."""
    if proven:
        amounts = [
            f"{n} {b:.1e} {unit_of(n, scene)}".rstrip()
            for n, b in sorted(proven.items())
        ]
        yield (
            f"bounds of errors against all that the SIDs hold: {', '.join(amounts)}; "
            "frames are prescribed and the equations linear. They hold the energy of "
            "all errors together, and are loose for what hardly errs. All else is an "
            "estimate"
        )


def theory_notes(report: AccuracyReport) -> Iterator[str]:
    """Name outputs for which the neglected terms of linear theory exceed the
    request.
    """
    left = [(o, o.theory) for o in report.outputs if (o.theory or 0.0) > o.allowed]
    if left:
        worst, most = max(left, key=lambda pair: (pair[1] or 0.0) / pair[0].allowed)
        size, allowed_text = (
            f"{e:.1e} {worst.unit}".rstrip() for e in (most, worst.allowed)
        )
        more = f" ({len(left) - 1} others likewise)" if len(left) > 1 else ""
        yield (
            f"small deformations leave out about {size} of {worst.name}, more than the "
            f"{allowed_text} that was asked for{more}; this is no part of "
            "result.error, see the line theory of its budget"
        )
