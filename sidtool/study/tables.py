"""Studies as text, as CSV, as a file and as a picture."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from sidtool.formats.storage.atomic import atomic_path
from sidtool.formats.study import StudyFile, StudyPoint, write_study

from ..report.result import note_lines
from ..report.tables import named, table
from .outcome import Study
from .points import Point, front, recommended
from .reference import changing, differing

#: What the columns of costs are called.
COSTS = ("size", "dofs", "conversion")
#: A reference is sharp up to here; outputs below this part of what it errs do not keep
#: it from being so.
SHARP, LIMITING = 1e-3, 0.1


def report(result: Study, wanted: Sequence[float]) -> str:
    """What is printed: fronts or all points, recommendations, what errors are."""
    parts = [] if result.of_integrators else _fronts(result)
    if result.of_integrators:
        parts.append(study_table(result.points, ()))
    parts.append(recommendation_table(result.points, wanted))
    return "\n\n".join([*parts, *remarks(result)])


def whole_report(result: Study, wanted: Sequence[float]) -> str:
    """The same with all points."""
    text = report(result, wanted)
    if result.of_integrators:
        return text
    points = study_table(result.points, axes_of(result))
    return f"{text}\n\nAll points\n\n{points}"


def axes_of(result: Study) -> tuple[str, ...]:
    """Axes that points are told by, beside integrator and setting."""
    return tuple(name for name in result.varied if name != "integrator")


def _fronts(result: Study) -> list[str]:
    axes, points = axes_of(result), result.points
    fast = front(points, lambda p: p.seconds)
    small = front(points, lambda p: p.size)
    return [
        f"Least error for the time: {len(fast)} of {len(points)} points",
        study_table(fast, axes),
        f"Least error for the size: {len(small)} of {len(points)} points",
        study_table(small, axes),
        "One choice at a time",
        study_table(alone(result), axes),
    ]


def alone(result: Study) -> list[Point]:
    """Points that differ from the first one, the scene as it is, in one choice."""
    base = result.points[0]

    def away(point: Point) -> int:
        different = sum(base.choices[k] != v for k, v in point.choices.items())
        return different + (point.setting != base.setting)

    return [point for point in result.points if away(point) <= 1]


def study_table(points: Iterable[Point], axes: Sequence[str]) -> str:
    """Points, one line each."""
    costs = COSTS if axes else ()
    rows = [
        [
            *(p.choices.get(name, "") for name in axes),
            p.setting.integrator,
            p.setting.value,
            *(_cost(p, name) for name in costs),
            str(p.steps) if not p.message else "",
            f"{p.seconds:.4f}" if not p.message else "",
            _error(p) if not p.message else p.message,
        ]
        for p in points
    ]
    header = [*axes, "integrator", "setting", *costs, "steps", "seconds", "error"]
    return table(header, rows)


def _cost(point: Point, name: str) -> str:
    if point.message or (name != "size" and not point.dofs):
        return ""
    value = getattr(point, name)
    return f"{value:.3f}" if name == "conversion" else str(value)


def _error(point: Point) -> str:
    return f"{point.error:.1e}" if point.told else f"<{point.error:.1e}"


def recommendation_table(points: Sequence[Point], wanted: Iterable[float]) -> str:
    """The recommended point for each wanted error."""
    rows = []
    for error in wanted:
        best = recommended(points, error)
        if best is None:
            rows.append([f"{error:.0e}", "", "", "none of these settings reaches it"])
            continue
        choices = "".join(f"{name} {value}, " for name, value in best.choices.items())
        rows.append(
            [f"{error:.0e}", f"{best.error:.1e}", f"{best.seconds:.4f}"]
            + [choices + best.setting.key]
        )
    return table(["wanted", "error", "seconds", "[accuracy]"], rows)


def _limit(result: Study) -> str:
    """Which outputs keep a reference from being sharp, and what to do."""
    reference = result.reference
    pairs = zip(reference.names, reference.floors, strict=True)
    errors = {name: float(floor) for name, floor in pairs}
    limit = max(LIMITING * reference.uncertainty, min(errors.values()))
    sharp = [name for name, floor in errors.items() if floor <= limit]
    finer = {"mesh": "finer meshes", "modes": "more modes"}
    remedy = " or ".join(t for axis, t in finer.items() if axis in result.varied)
    blunt = reference.uncertainty > SHARP and len(sharp) < len(errors)
    if not blunt or not remedy:
        return ""
    dull = ", ".join(f"{n} ({f:.0e})" for n, f in errors.items() if f > limit)
    best = max(errors[name] for name in sharp)
    them = " ".join(f"--of {name}" for name in sharp)
    return (
        f"\nThat is due to {dull}; {remedy} would tell more. The others are known to "
        f"{best:.0e}: {them} compares these alone."
    )


def remarks(result: Study) -> list[str]:
    """What errors are of, how far they can be told, and what is not compared."""
    reference = result.reference
    of = f" ({reference.model})" if reference.model else ""
    parts = [
        f"Errors are relative, of the worst of: {', '.join(reference.names)}.\n"
        f"The reference{of} is good to {reference.uncertainty:.0e}; smaller errors "
        "cannot be told."
        f"{_limit(result)}"
    ]
    if reference.left_out:
        parts.append(f"Left out, rounding only: {', '.join(reference.left_out)}.")
    if reference.unpredictable:
        found = differing(reference.unpredictable)
        parts.append(
            f"Not predictable over this time span: {found}. No setting above is "
            "recommended for them; a shorter time span may help."
        )
    if reference.unconverged:
        found = changing(reference.unconverged)
        parts.append(f"Not converged: {found}. Finer meshes or more modes may help.")
    if result.dropped:
        parts.append(
            "Not compared, as they belong to shape functions or frames that vary: "
            f"{', '.join(result.dropped)}."
        )
    if result.whole > len(result.points):
        parts.append(
            f"{len(result.points)} of {result.whole} combinations: those that differ "
            f"from the scene in at most {result.differ} choices. --differ "
            f"{result.differ + 1} adds more; those that are kept are not computed "
            "again."
        )
    if result.notes:
        lines = note_lines(result)
        parts.append(f"Notes of the reference\n{named(lines)}")
    return parts


def study_file(result: Study) -> StudyFile:
    """A study as it is kept."""
    points = tuple(
        StudyPoint(
            integrator=p.setting.integrator,
            rtol=p.setting.rtol,
            step=p.setting.step,
            error=p.error if np.isfinite(p.error) else None,
            seconds=p.seconds if np.isfinite(p.seconds) else None,
            steps=p.steps,
            message=p.message,
            told=p.told,
            choices=dict(p.choices),
            size=p.size,
            dofs=p.dofs,
            conversion=p.conversion,
            errors=dict(p.errors),
        )
        for p in result.points
    )
    reference = result.reference
    return StudyFile(
        title=result.title,
        outputs=reference.names,
        uncertainty=reference.uncertainty,
        reference=reference.model,
        varied=result.varied,
        notes=result.notes,
        warnings=result.warnings,
        points=points,
    )


def columns(content: StudyFile) -> dict[str, list[object]]:
    """All points by columns, with the error of each output; seconds, steps in s."""
    axes = [name for name in content.varied if name != "integrator"]
    found: dict[str, list[object]] = {
        name: [p.choices.get(name, "") for p in content.points] for name in axes
    }
    names = ["integrator", "rtol", "step", *COSTS, "steps", "seconds", "error"]
    for name in [*names, "told", "message"]:
        found[name] = [getattr(p, name) for p in content.points]
    for name in content.outputs:
        found[f"error {name}"] = [p.errors.get(name) for p in content.points]
    return found


def write_table(path: Path, content: StudyFile) -> None:
    """All points as CSV."""
    found = columns(content)
    found["told"] = [int(bool(told)) for told in found["told"]]
    with (
        atomic_path(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as stream,
    ):
        writer = csv.writer(stream)
        writer.writerow(found)
        writer.writerows(zip(*found.values(), strict=True))


def write_all(folder: Path, result: Study, wanted: Sequence[float]) -> list[str]:
    """Writes text, CSV, the study and pictures; their names.

    The text takes its place last: where it stands, nothing is missing.
    """
    from ..plot.precision import plot_study

    folder.mkdir(parents=True, exist_ok=True)
    names = [f"study.{end}" for end in ("txt", "csv", "json", "png", "svg")]
    text, numbers, data, *pictures = (folder / name for name in names)
    content = study_file(result)
    with atomic_path(text) as temporary:
        temporary.write_text(whole_report(result, wanted) + "\n", encoding="utf-8")
        for picture in pictures:
            plot_study(picture, content)
        write_table(numbers, content)
        write_study(data, content)
    return names
