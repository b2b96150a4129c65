"""Courses of outputs over time, grouped into axes with units."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .figure import COLOURS, new_page, styled

Array = NDArray[np.float64]

#: Curves in one pair of axes at most, each in a colour of its own.
MOST_CURVES = len(COLOURS)
#: Opacity of bands; letters of a label that are more than its row is high.
_BAND, _LONG = 0.3, 20


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


def draw(axes: Any, t: Array, curves: Sequence[Curve], label: str) -> None:
    """Curves over time, with the estimated error of each as a band around it.

    Several curves have a legend above the axes, and those with a band, which may be
    narrower than the line.
    """
    for curve in curves:
        (line,) = axes.plot(t, curve.values, label=curve.label)
        if curve.error:
            edges = curve.values - curve.error, curve.values + curve.error
            colour = line.get_color()
            axes.fill_between(t, *edges, color=colour, alpha=_BAND, linewidth=0)
    # A row has room for some twenty letters: the unit of a long name goes below it.
    axes.set_ylabel(label if len(label) < _LONG else label.replace(" [", "\n["))
    axes.set_xlim(t[0], t[-1] if t[-1] > t[0] else t[0] + 1.0)
    if len(curves) > 1 or curves[0].error:
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=4, borderaxespad=0)


def drawn_svg(
    t: Array, columns: Mapping[str, Array], unit_of: Callable[[str], str]
) -> tuple[str, float, float]:
    """All outputs below each other as SVG, and where the axes begin and end across
    it, as shares of its width."""
    groups = grouped(list(columns))
    with styled():
        height = 1.5 * len(groups) + 0.5
        page, axes = new_page(len(groups), 1, (5.2, height))
        rows = np.atleast_1d(axes)
        for place, names in zip(rows, groups, strict=True):
            curves = [Curve(name, columns[name]) for name in names]
            draw(place, t, curves, label_of(names, unit_of))
        rows[-1].set_xlabel("t [s]")
        page.draw_without_rendering()
        box = rows[0].get_position()
        stream = io.StringIO()
        page.savefig(stream, format="svg", metadata={"Date": None})
    text = stream.getvalue()
    return text[text.index("<svg") :], float(box.x0), float(box.x1)
