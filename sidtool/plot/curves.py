"""Curves of outputs over time, of one run or of several."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.sid import Array
from sidtool.formats.result import Result

from .figure import (
    COLOURS,
    LEGEND_ROW_HEIGHT,
    draw_legend,
    figure_style,
    legend_rows,
    new_figure,
    saved_figure,
    wrap_label,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Largest number of curves in one pair of axes, each with its own colour.
MOST_CURVES = len(COLOURS)
#: Largest number of drawn points of a curve: eight per pixel column at 100 per inch.
MOST_POINTS = 6000
#: Opacity of bands.
_BAND_OPACITY = 0.3
#: Heights [inch]: margin of a page, and gap between two pairs of axes.
_MARGIN_HEIGHT, _AXES_GAP = 0.6, 0.35

_LINES = ("-", "--", ":", "-.")


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve: its name in the legend and its values over common times.

    error : estimated error in the unit of the values; 0 if it is not known
    """

    name: str
    values: Array
    error: float = 0.0

    @property
    def label(self) -> str:
        return f"{self.name} ± {self.error:.1e}" if self.error else self.name


def output_errors(result: Result) -> dict[str, float]:
    """Return estimated errors by output, of a run with a requested accuracy."""
    return {} if result.accuracy is None else result.accuracy.absolute()


def make_curves(
    names: Iterable[str],
    columns: Mapping[str, Array],
    errors: Mapping[str, float],
    prefix: str = "",
) -> list[Curve]:
    """Return curves with names without their common prefix."""
    return [
        Curve(name.removeprefix(prefix), columns[name], errors.get(name, 0.0))
        for name in names
    ]


def legend_labels(curves: Sequence[Curve]) -> list[str]:
    """Return the labels of the legend.

    Several curves have one, and curves with an error band, which may be narrower than
    the line.
    """
    if len(curves) > 1 or curves[0].error:
        return [curve.label for curve in curves]
    return []


def stacked_axes(
    labels: Sequence[Sequence[str]], width: float, row: float
) -> tuple[Figure, list[Any]]:
    """Return a page with axes below each other.

    Parameters
    ----------
    labels : labels of the legend of each pair of axes
    width, row : width of the page, and height of one row without its legend [inch]
    """
    legends = LEGEND_ROW_HEIGHT * sum(legend_rows(part, width) for part in labels)
    height = row * len(labels) + legends + _MARGIN_HEIGHT
    page, axes = new_figure(len(labels), 1, (width, height))
    return page, list(np.atleast_1d(axes))


def group_outputs(names: Sequence[str]) -> list[list[str]]:
    """Group names that share axes: numbered ones of one owner, such as rod.q1,
    rod.q2.
    """
    groups: dict[tuple[str, int], list[str]] = {}
    for name in names:
        stem = re.sub(r"\d+$", "", name)
        part = 0
        while len(groups.get((stem, part), ())) >= MOST_CURVES:
            part += 1
        groups.setdefault((stem, part), []).append(name)
    return list(groups.values())


def axis_label(names: Sequence[str], unit_of: Callable[[str], str]) -> str:
    """Return the label of an axis: the common name and the unit."""
    stem = re.sub(r"\d+$", "", names[0]) if len(names) > 1 else names[0]
    unit = unit_of(names[0])
    return f"{stem} [{unit}]" if unit else stem


def draw_axes(
    axes: Any, t: Array, curves: Sequence[Curve], label: str, height: float = 1.2
) -> None:
    """Draw curves over time, with the estimated error of each as a band around it.

    height : height of the axes, for their label [inch]
    """
    for curve in curves:
        rows = extremes(curve.values)
        times, values = t[rows], curve.values[rows]
        (line,) = axes.plot(times, values, label=curve.label)
        if curve.error:
            edges = values - curve.error, values + curve.error
            colour = line.get_color()
            axes.fill_between(
                times, *edges, color=colour, alpha=_BAND_OPACITY, linewidth=0
            )
    axes.set_ylabel(wrap_label(label, height))
    axes.set_xlim(t[0], t[-1] if t[-1] > t[0] else t[0] + 1.0)
    if legend_labels(curves):
        draw_legend(axes)


def extremes(values: Array) -> NDArray[np.intp]:
    """Return increasing indices of the values that a picture of the curve needs. These
    are all values up to `MOST_POINTS`. For longer curves they are the first, least,
    greatest and last value of each part; a line through them covers the same pixels.
    """
    parts = MOST_POINTS // 4
    if len(values) <= MOST_POINTS:
        return np.arange(len(values))
    edges = np.linspace(0, len(values), parts + 1).astype(np.intp)
    known = np.nan_to_num(values)
    rows = [edges[:-1], edges[1:] - 1]
    for begin, end in pairwise(edges):
        part = known[begin:end]
        rows.append(begin + np.array([part.argmin(), part.argmax()]))
    return np.unique(np.concatenate(rows))


def draw_curves(
    t: Array,
    groups: Sequence[Sequence[str]],
    columns: Mapping[str, Array],
    errors: Mapping[str, float],
    unit_of: Callable[[str], str],
    size: tuple[float, float],
) -> tuple[Figure, list[Any]]:
    """Draw a page of outputs over time; return it and its axes, one for each group.

    size : width of the page and height of a row [inch]
    """
    parts = [make_curves(group, columns, errors) for group in groups]
    page, axes = stacked_axes([legend_labels(part) for part in parts], *size)
    for place, group, curves in zip(axes, groups, parts, strict=True):
        draw_axes(place, t, curves, axis_label(group, unit_of), size[1] - _AXES_GAP)
    return page, axes


def draw_curves_svg(
    t: Array,
    columns: Mapping[str, Array],
    errors: Mapping[str, float],
    unit_of: Callable[[str], str],
) -> tuple[str, float, float]:
    """Return all outputs below each other as SVG, and the left and right ends of the
    axes as fractions of its width.
    """
    with figure_style():
        groups = group_outputs(list(columns))
        page, rows = draw_curves(t, groups, columns, errors, unit_of, (5.2, 1.4))
        rows[-1].set_xlabel("t [s]")
        page.draw_without_rendering()
        box = rows[0].get_position()
        stream = io.StringIO()
        page.savefig(stream, format="svg", metadata={"Date": None})
    text = stream.getvalue()
    return text[text.index("<svg") :], float(box.x0), float(box.x1)


def plot_motions(
    path: Path, results: Mapping[str, Result], outputs: Mapping[str, str]
) -> None:
    """Draw each output of all runs over time, and their differences below it.

    Parameters
    ----------
    results : runs by the name for the legend, on the same output times; differences
        are taken from the first
    outputs : name of an output -> label of its axis

    Raises
    ------
    InputError : a run lacks an output.
    """
    first, *others = results.items()
    rows = len(outputs) * (2 if others else 1)
    with saved_figure(path, rows, size=(7.0, 1.8 * rows + 0.4)) as axes:
        column = axes if rows > 1 else [axes]
        for number, (name, label) in enumerate(outputs.items()):
            here = column[number * (rows // len(outputs)) :]
            _draw_overlay(here[0], results, name, label)
            if others:
                _draw_difference(here[1], first, others, name, label)
        column[-1].set_xlabel("t [s]")


def _draw_overlay(
    axes: Any, results: Mapping[str, Result], name: str, label: str
) -> None:
    for number, (run, result) in enumerate(results.items()):
        axes.plot(
            result.t,
            result[name],
            _LINES[number % len(_LINES)],
            color=COLOURS[number % len(COLOURS)],
            label=run,
        )
    axes.set_ylabel(label)
    draw_legend(axes)


def _draw_difference(
    axes: Any,
    first: tuple[str, Result],
    others: Sequence[tuple[str, Result]],
    name: str,
    label: str,
) -> None:
    for number, (run, result) in enumerate(others, 1):
        axes.plot(
            result.t,
            result[name] - first[1][name],
            color=COLOURS[(number + 1) % len(COLOURS)],
            label=f"{run} - {first[0]}",
        )
    axes.set_ylabel(f"difference\n{label}")
    axes.ticklabel_format(axis="y", style="sci", scilimits=(-2, 3))
    draw_legend(axes)
