"""What a study found, for scripts and notebooks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sidtool.formats.errors import InputError
from sidtool.formats.html import html_table

from .points import Point, front, recommended
from .reference import Reference

if TYPE_CHECKING:
    import os

    import pandas

#: Errors that settings are recommended for, where none is asked for.
WANTED = (1e-3, 1e-6, 1e-9)
_COSTS = ("seconds", "size", "dofs")


@dataclass(frozen=True, kw_only=True)
class Study:
    """All points of a scene and their reference.

    Attributes
    ----------
    points : one for each variant and setting, with its error, seconds and size
    reference : the motion that errors are measured against
    varied : axes with several values
    dropped : outputs that do not mean the same in all variants
    differ : in how many choices points differ from the scene at most
    whole : points that the whole grid has
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
    def notes(self) -> tuple[str, ...]:
        """Of the run that errors are measured against."""
        return self.reference.notes

    @property
    def warnings(self) -> tuple[str, ...]:
        """Those of the notes that say that numbers may be wrong."""
        return self.reference.warnings

    def front(self, cost: str = "seconds") -> list[Point]:
        """Points of which none other has less error for no more cost, the cheapest
        first.

        cost : "seconds", "size" (elastic coordinates) or "dofs" (of the meshes)

        Raises
        ------
        InputError : there is no such cost.
        """
        if cost not in _COSTS:
            raise InputError(
                f"found {cost!r}", place="cost", expected=" or ".join(_COSTS)
            )
        return front([p for p in self.points if not p.message], attrgetter(cost))

    def recommended(self, wanted: float) -> Point | None:
        """The fastest point with at most this relative error; None if there is none."""
        return recommended(self.points, wanted)

    def report(self, wanted: Sequence[float] = WANTED) -> str:
        """Tables and remarks as `sidtool study` prints them.

        wanted : relative errors that settings are recommended for
        """
        from .tables import report

        return report(self, wanted)

    def to_dataframe(self) -> pandas.DataFrame:
        """A pandas table: a row per point; units in `attrs`. An `error NAME` is that of
        one output, relative to its variation.

        Raises
        ------
        InputError : pandas is not installed.
        """
        from ..results import installed
        from .tables import columns, study_file

        table = installed("pandas").DataFrame(columns(study_file(self)))
        table.attrs["units"] = dict.fromkeys(("step", "conversion", "seconds"), "s")
        return table

    def plot(self, path: str | os.PathLike[str] | None = None) -> Any:
        """A matplotlib figure of error over time, and over size where that varies.

        path : writes a picture as well (.png, .svg, .pdf)

        Raises
        ------
        InputError : no point gave an error.
        """
        from ..plot.precision import plot_study
        from .tables import study_file

        return plot_study(None if path is None else Path(path), study_file(self))

    def save(
        self, folder: str | os.PathLike[str], wanted: Sequence[float] = WANTED
    ) -> None:
        """Write what `sidtool study -o FOLDER` writes: text, CSV, the study, pictures.

        Raises
        ------
        InputError, OSError : a file cannot be written.
        """
        from .tables import write_all

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
            + [p.message or f"{'' if p.told else '<'}{p.error:.1e}"]
            for p in self.points
        ]
        return html_table(rows, header, repr(self)[1:-1])
