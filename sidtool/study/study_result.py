"""Result of a study: points, fronts, tables, CSV, files and pictures."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.html import html_table
from sidtool.formats.diagnostics import Diagnostic, diagnose, each_once
from sidtool.formats.storage.atomic import atomic_path
from sidtool.formats.study import StudyFile, StudyPoint, write_study

from ..measurement.points import (
    Point,
    Reference,
    pareto_front,
    recommend_point,
    unconverged_outputs,
    unpredictable_outputs,
)
from ..report.diagnostics import (
    diagnostic_lines,
    first_of_each_code,
    table_of_codes,
)
from ..report.tables import import_optional, named_values, text_table

if TYPE_CHECKING:
    import os

    import pandas

#: Default errors for which settings are recommended.
RECOMMENDED_ERRORS = (1e-3, 1e-6, 1e-9)
_COSTS = ("seconds", "size", "dofs")

#: Columns of costs.
COSTS = ("size", "dofs", "conversion")
#: Largest uncertainty of a sharp reference; outputs with less than this fraction of it
#: are not limiting.
SHARP_UNCERTAINTY, LIMITING_SHARE = 1e-3, 0.1


@dataclass(frozen=True, kw_only=True)
class Study:
    """All points of a scene and their reference.

    Attributes
    ----------
    points : one for each variant and setting, with its error, seconds and size
    reference : the motion that errors are measured against
    varied : axes with several values
    dropped : outputs that are not comparable between all variants
    differ : largest number of choices in which points differ from the scene
    whole : number of points of the full grid
    title : of pictures
    """

    points: tuple[Point, ...]
    reference: Reference
    varied: tuple[str, ...] = ("integrator",)
    dropped: tuple[str, ...] = ()
    differ: int = 1
    whole: int = 0
    title: str = ""

    @property
    def of_integrators(self) -> bool:
        """Whether nothing but integrators and tolerances vary."""
        return not set(self.varied) - {"integrator"}

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """Diagnostics of the comparison and of the reference; of the other runs those
        whose codes the reference does not have.
        """
        known = {each.code for each in self.reference.diagnostics}
        of_runs = first_of_each_code(self.runs)
        more = [d for d in of_runs if d.is_warning and d.code not in known]
        found = *study_diagnostics(self), *self.reference.diagnostics, *more
        return each_once(found)

    @property
    def runs(self) -> list[tuple[str, tuple[Diagnostic, ...]]]:
        """Return the diagnostics of all runs under their settings."""
        runs = [("reference", self.reference.diagnostics)]
        runs += [
            (" ".join([*p.choices.values(), p.setting.key]), p.diagnostics)
            for p in self.points
        ]
        return runs

    def front(self, cost: str = "seconds") -> list[Point]:
        """Return the Pareto front: no other point has a smaller error at no more cost.
        The cheapest point is first.

        cost : "seconds", "size" (elastic coordinates) or "dofs" (of the meshes)

        Raises
        ------
        InputError : there is no such cost.
        """
        if cost not in _COSTS:
            raise InputError(
                f"found {cost!r}", place="cost", expected=" or ".join(_COSTS)
            )
        return pareto_front([p for p in self.points if not p.message], attrgetter(cost))

    def recommended(self, wanted: float) -> Point | None:
        """Return the fastest point with at most this relative error, or None."""
        return recommend_point(self.points, wanted)

    def report(
        self, wanted: Sequence[float] = RECOMMENDED_ERRORS, verbose: bool = False
    ) -> str:
        """Return tables and notes as `sidtool study` prints them.

        Parameters
        ----------
        wanted : relative errors for which settings are recommended
        verbose : all points, not only those with the least error for their time
        """

        return study_report(self, wanted, verbose)

    def to_dataframe(self) -> pandas.DataFrame:
        """Return a pandas table: a row per point; units in `attrs`. A column `error
        NAME` is the error of one output relative to its variation.

        Raises
        ------
        InputError : pandas is not installed.
        """
        table = import_optional("pandas").DataFrame(study_columns(study_file(self)))
        table.attrs["units"] = dict.fromkeys(("step", "conversion", "seconds"), "s")
        return table

    def plot(self, path: str | os.PathLike[str] | None = None) -> Any:
        """Return a matplotlib figure of error over time, and over size if that varies.

        path : file to which the figure is written as well (.png, .svg, .pdf)

        Raises
        ------
        InputError : no point gave an error.
        """
        from ..plot.studies import plot_study

        return plot_study(None if path is None else Path(path), study_file(self))

    def save(
        self,
        folder: str | os.PathLike[str],
        wanted: Sequence[float] = RECOMMENDED_ERRORS,
    ) -> None:
        """Write what `sidtool study -o FOLDER` writes: text, CSV, the study, pictures.

        Raises
        ------
        InputError, OSError : a file cannot be written.
        """

        write_all(Path(folder), self, wanted)

    def __repr__(self) -> str:
        name = f" {self.title!r}" if self.title else ""
        failed = sum(bool(point.message) for point in self.points)
        parts = [f"{len(self.points)} points over {', '.join(self.varied)}"]
        if failed:
            parts.append(f"{failed} failed")
        parts.append(f"reference good to {self.reference.uncertainty:.0e}")
        return f"<Study{name}: {'; '.join(parts)}>"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        axes = [name for name in self.varied if name != "integrator"]
        header = [*axes, "integrator", "setting", "size", "seconds", "error"]
        rows = [
            [*(p.choices.get(name, "") for name in axes), p.setting.integrator]
            + [p.setting.value, p.size, f"{p.seconds:.4f}"]
            + [p.message or f"{'' if p.is_resolved else '<'}{p.error:.1e}"]
            for p in self.points
        ]
        return html_table(rows, header, repr(self)[1:-1])


def study_report(result: Study, wanted: Sequence[float], verbose: bool = False) -> str:
    """Return the printed text: fronts, recommendations, notes on errors, all points.

    verbose : all points, too
    """
    parts = [*_pareto_tables(result), recommendation_table(result.points, wanted)]
    parts += study_notes(result)
    if verbose:
        parts += ["All points", study_table(result.points, varied_axes(result))]
    return "\n\n".join(parts)


def varied_axes(result: Study) -> tuple[str, ...]:
    """Return the axes that distinguish points, beside integrator and setting."""
    return tuple(name for name in result.varied if name != "integrator")


def _pareto_tables(result: Study) -> list[str]:
    axes, points = varied_axes(result), result.points
    fast = pareto_front(points, lambda p: p.seconds)
    fastest = [
        f"Least error for the time: {len(fast)} of {len(points)} points",
        study_table(fast, axes),
    ]
    if result.of_integrators:
        return fastest
    small = pareto_front(points, lambda p: p.size)
    return [
        *fastest,
        f"Least error for the size: {len(small)} of {len(points)} points",
        study_table(small, axes),
        "One choice at a time",
        study_table(one_factor_points(result), axes),
    ]


def one_factor_points(result: Study) -> list[Point]:
    """Return the points that differ from the first one (the scene) in one choice."""
    base = result.points[0]

    def number_of_changes(point: Point) -> int:
        different = sum(base.choices[k] != v for k, v in point.choices.items())
        return different + (point.setting != base.setting)

    return [point for point in result.points if number_of_changes(point) <= 1]


def study_table(points: Iterable[Point], axes: Sequence[str]) -> str:
    """Tabulate points, one per line."""
    costs = COSTS if axes else ()
    rows = [
        [
            *(p.choices.get(name, "") for name in axes),
            p.setting.integrator,
            p.setting.value,
            *(_point_cost(p, name) for name in costs),
            str(p.steps) if not p.message else "",
            f"{p.seconds:.4f}" if not p.message else "",
            _error_text(p) if not p.message else p.message,
        ]
        for p in points
    ]
    header = [*axes, "integrator", "setting", *costs, "steps", "seconds", "error"]
    return text_table(header, rows)


def _point_cost(point: Point, name: str) -> str:
    if point.message or (name != "size" and not point.dofs):
        return ""
    value = getattr(point, name)
    return f"{value:.3f}" if name == "conversion" else str(value)


def _error_text(point: Point) -> str:
    return f"{point.error:.1e}" if point.is_resolved else f"<{point.error:.1e}"


def recommendation_table(points: Sequence[Point], wanted: Iterable[float]) -> str:
    """Tabulate the recommended point for each requested error."""
    rows = []
    for error in wanted:
        best = recommend_point(points, error)
        if best is None:
            rows.append([f"{error:.0e}", "", "", "none of these settings reaches it"])
            continue
        choices = "".join(f"{name} {value}, " for name, value in best.choices.items())
        rows.append(
            [f"{error:.0e}", f"{best.error:.1e}", f"{best.seconds:.4f}"]
            + [choices + best.setting.key]
        )
    return text_table(["wanted", "error", "seconds", "[accuracy]"], rows)


def _limiting_outputs(result: Study) -> Iterator[Diagnostic]:
    """Diagnose the outputs that limit the reference (N730)."""
    reference = result.reference
    pairs = zip(reference.names, reference.floors, strict=True)
    errors = {name: float(floor) for name, floor in pairs}
    limit = max(LIMITING_SHARE * reference.uncertainty, min(errors.values()))
    sharp = [name for name, floor in errors.items() if floor <= limit]
    finer = {"mesh": "finer meshes", "modes": "more modes"}
    remedy = " or ".join(t for axis, t in finer.items() if axis in result.varied)
    blunt = reference.uncertainty > SHARP_UNCERTAINTY and len(sharp) < len(errors)
    if blunt and remedy:
        best = max(errors[name] for name in sharp)
        them = " ".join(f"--of {name}" for name in sharp)
        yield diagnose(
            "N730",
            uncertainty=reference.uncertainty,
            limiting=[n for n, f in errors.items() if f > limit],
            remedy=f"Use {remedy}, or compare {them} alone ({best:.0e}).",
        )


def study_notes(result: Study) -> list[str]:
    """Return what the errors are relative to, and diagnostics by code."""
    reference = result.reference
    of = f" ({reference.model})" if reference.model else ""
    parts: list[str] = [
        named_values(
            [
                ("error", f"relative, of the worst of {', '.join(reference.names)}"),
                ("reference", f"good to {reference.uncertainty:.0e}{of}"),
            ]
        )
    ]
    infos = [d for d in study_diagnostics(result) if not d.is_warning]
    failed = [point for point in result.points if point.message]
    if failed:
        parts[0] += f"\nfailed     {len(failed)} of {len(result.points)} points: "
        parts[0] += f"{failed[0].setting.key}: {failed[0].message}"
    parts += [diagnostic_lines(infos)] if infos else []
    table = table_of_codes(result.runs)
    parts += [table] if table else []
    return parts


def study_diagnostics(result: Study) -> Iterator[Diagnostic]:
    """Diagnose the comparison: outputs that cannot be compared, and what limits it."""
    reference = result.reference
    yield from unpredictable_outputs(reference.unpredictable)
    yield from unconverged_outputs(reference.unconverged)
    reasons = {
        "varying by rounding only": reference.left_out,
        "of shape functions or frames that vary": result.dropped,
    }
    for reason, names in reasons.items():
        if names:
            yield diagnose("N615", ", ".join(names), reason=reason)
    yield from _limiting_outputs(result)
    if result.whole > len(result.points):
        yield diagnose(
            "N733",
            count=len(result.points),
            all=result.whole,
            differ=result.differ,
            next=result.differ + 1,
        )


def study_file(result: Study) -> StudyFile:
    """Return a study as it is stored."""
    points = tuple(
        StudyPoint(
            integrator=p.setting.integrator,
            rtol=p.setting.rtol,
            step=p.setting.step,
            error=p.error if np.isfinite(p.error) else None,
            seconds=p.seconds if np.isfinite(p.seconds) else None,
            steps=p.steps,
            message=p.message,
            told=p.is_resolved,
            choices=dict(p.choices),
            size=p.size,
            dofs=p.dofs,
            conversion=p.conversion,
            errors=dict(p.errors),
            diagnostics=tuple(d.as_data() for d in p.diagnostics if d.is_warning),
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
        diagnostics=tuple(each.as_data() for each in result.diagnostics),
        points=points,
    )


def study_columns(content: StudyFile) -> dict[str, list[object]]:
    """Return the columns of all points, with the error of each output; times in s."""
    axes = [name for name in content.varied if name != "integrator"]
    columns: dict[str, list[object]] = {
        name: [p.choices.get(name, "") for p in content.points] for name in axes
    }
    names = ["integrator", "rtol", "step", *COSTS, "steps", "seconds", "error"]
    for name in [*names, "told", "message"]:
        columns[name] = [getattr(p, name) for p in content.points]
    columns["warnings"] = [
        " ".join(dict.fromkeys(d["code"] for d in p.diagnostics))
        for p in content.points
    ]
    for name in content.outputs:
        columns[f"error {name}"] = [p.errors.get(name) for p in content.points]
    return columns


def write_table(path: Path, content: StudyFile) -> None:
    """Write all points as CSV."""
    columns = study_columns(content)
    columns["told"] = [int(bool(is_resolved)) for is_resolved in columns["told"]]
    with (
        atomic_path(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as stream,
    ):
        writer = csv.writer(stream)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))


def write_all(folder: Path, result: Study, wanted: Sequence[float]) -> list[str]:
    """Write text, CSV, the study and pictures; return their names.

    The text is written last: if it exists, nothing is missing.
    """
    from ..plot.studies import plot_study

    folder.mkdir(parents=True, exist_ok=True)
    names = [f"study.{end}" for end in ("txt", "csv", "json", "png", "svg")]
    text, numbers, data, *pictures = (folder / name for name in names)
    content = study_file(result)
    with atomic_path(text) as temporary:
        temporary.write_text(
            study_report(result, wanted, True) + "\n", encoding="utf-8"
        )
        for picture in pictures:
            plot_study(picture, content)
        write_table(numbers, content)
        write_study(data, content)
    return names
