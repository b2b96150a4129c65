"""Courses of outputs over time, grouped into axes with units."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.result import Result

from .figure import COLOURS, new_page, styled
from .words import ROW, broken, legend, rows_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

#: Curves in one pair of axes at most, each in a colour of its own.
MOST_CURVES = len(COLOURS)
#: Points of a curve that are drawn at most: eight to a column of a hundred to the inch.
MOST_POINTS = 6000
#: Opacity of bands.
_BAND = 0.3
#: Heights [inch]: of what a page has beside its axes, and between two of them.
_BESIDE, _GAP = 0.6, 0.35


@dataclass(frozen=True, eq=False)
class Curve:
    """A name for the legend and its values over common times.

    error : estimated, in the unit of the values; 0 where none is known
    """

    name: str
    values: Array
    error: float = 0.0

    @property
    def label(self) -> str:
        return f"{self.name} ± {self.error:.1e}" if self.error else self.name


def errors_of(result: Result) -> dict[str, float]:
    """Estimated errors by output, where the run was asked for an accuracy."""
    return {} if result.accuracy is None else result.accuracy.absolute()


def curves_of(
    names: Iterable[str],
    columns: Mapping[str, Array],
    errors: Mapping[str, float],
    prefix: str = "",
) -> list[Curve]:
    """Curves without a common prefix of their names."""
    return [
        Curve(name.removeprefix(prefix), columns[name], errors.get(name, 0.0))
        for name in names
    ]


def labels_of(curves: Sequence[Curve]) -> list[str]:
    """Of the legend: several curves have one, and those with a band, which may be
    narrower than the line."""
    if len(curves) > 1 or curves[0].error:
        return [curve.label for curve in curves]
    return []


def stacked(
    labels: Sequence[Sequence[str]], width: float, row: float
) -> tuple[Figure, list[Any]]:
    """A page with axes below each other.

    Parameters
    ----------
    labels : of the legend of each
    width, row : of the page, and the height of one row without its legend [inch]
    """
    legends = ROW * sum(rows_of(part, width) for part in labels)
    height = row * len(labels) + legends + _BESIDE
    page, axes = new_page(len(labels), 1, (width, height))
    return page, list(np.atleast_1d(axes))


def grouped(names: Sequence[str]) -> list[list[str]]:
    """Names that share axes: numbered ones of one owner, such as rod.q1, rod.q2."""
    groups: dict[tuple[str, int], list[str]] = {}
    for name in names:
        stem = re.sub(r"\d+$", "", name)
        part = 0
        while len(groups.get((stem, part), ())) >= MOST_CURVES:
            part += 1
        groups.setdefault((stem, part), []).append(name)
    return list(groups.values())


def label_of(names: Sequence[str], unit_of: Callable[[str], str]) -> str:
    """What an axis says: the common name and the unit."""
    stem = re.sub(r"\d+$", "", names[0]) if len(names) > 1 else names[0]
    unit = unit_of(names[0])
    return f"{stem} [{unit}]" if unit else stem


def draw(
    axes: Any, t: Array, curves: Sequence[Curve], label: str, height: float = 1.2
) -> None:
    """Curves over time, with the estimated error of each as a band around it.

    height : of the axes, for their label [inch]
    """
    for curve in curves:
        kept = extremes(curve.values)
        times, values = t[kept], curve.values[kept]
        (line,) = axes.plot(times, values, label=curve.label)
        if curve.error:
            edges = values - curve.error, values + curve.error
            colour = line.get_color()
            axes.fill_between(times, *edges, color=colour, alpha=_BAND, linewidth=0)
    axes.set_ylabel(broken(label, height))
    axes.set_xlim(t[0], t[-1] if t[-1] > t[0] else t[0] + 1.0)
    if labels_of(curves):
        legend(axes)


def extremes(values: Array) -> NDArray[np.intp]:
    """Places of the values that a picture of the curve shows, growing.

    All of up to `MOST_POINTS`; of more, the first, the least, the greatest and the last
    of each of so many parts that a line through these covers the same pixels.
    """
    parts = MOST_POINTS // 4
    if len(values) <= MOST_POINTS:
        return np.arange(len(values))
    edges = np.linspace(0, len(values), parts + 1).astype(np.intp)
    known = np.nan_to_num(values)
    found = [edges[:-1], edges[1:] - 1]
    for begin, end in pairwise(edges):
        part = known[begin:end]
        found.append(begin + np.array([part.argmin(), part.argmax()]))
    return np.unique(np.concatenate(found))


def drawn(
    t: Array,
    groups: Sequence[Sequence[str]],
    columns: Mapping[str, Array],
    errors: Mapping[str, float],
    unit_of: Callable[[str], str],
    size: tuple[float, float],
) -> tuple[Figure, list[Any]]:
    """A page of outputs over time, and its axes, one for each group.

    size : width of the page and height of a row [inch]
    """
    parts = [curves_of(group, columns, errors) for group in groups]
    page, axes = stacked([labels_of(part) for part in parts], *size)
    for place, group, curves in zip(axes, groups, parts, strict=True):
        draw(place, t, curves, label_of(group, unit_of), size[1] - _GAP)
    return page, axes


def drawn_svg(
    t: Array,
    columns: Mapping[str, Array],
    errors: Mapping[str, float],
    unit_of: Callable[[str], str],
) -> tuple[str, float, float]:
    """All outputs below each other as SVG, and where the axes begin and end across
    it, as shares of its width."""
    with styled():
        groups = grouped(list(columns))
        page, rows = drawn(t, groups, columns, errors, unit_of, (5.2, 1.4))
        rows[-1].set_xlabel("t [s]")
        page.draw_without_rendering()
        box = rows[0].get_position()
        stream = io.StringIO()
        page.savefig(stream, format="svg", metadata={"Date": None})
    text = stream.getvalue()
    return text[text.index("<svg") :], float(box.x0), float(box.x1)
