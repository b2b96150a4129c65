"""Words in pictures: legends and labels as wide as there is room for."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import matplotlib
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

from sidtool.formats.errors import printable

#: Points to the inch; a row of a legend [inch].
_POINTS, ROW = 72.0, 0.19
#: What a legend takes for a line beside each text, and to the next [font sizes].
_HANDLE, _BETWEEN = 2.8, 2.0
#: Of the width of a page, what labels of the axis at the left take, and the power of
#: ten above the axis [inch].
_LEFT = 1.5


def width(text: str, size: float | None = None) -> float:
    """Of a text [inch].

    size : of its letters, by default that of the picture [pt]
    """
    size = matplotlib.rcParams["font.size"] if size is None else size
    shown = printable(text).replace("$", "S")
    path = TextPath((0, 0), shown, prop=FontProperties(size=size))
    return float(path.get_extents().width) / _POINTS if text.strip() else 0.0


def columns_of(labels: Sequence[str], room: float) -> int:
    """Columns of a legend that fit into a width [inch]."""
    if not labels:
        return 1
    size = matplotlib.rcParams["font.size"] / _POINTS
    entry = max(map(width, labels)) + (_HANDLE + _BETWEEN) * size
    return max(1, min(len(labels), int((room + _BETWEEN * size) / entry)))


def rows_of(labels: Sequence[str], page_width: float) -> int:
    """Rows of the legend that `legend` draws on such a page."""
    return -(-len(labels) // columns_of(labels, page_width - _LEFT))


def legend(axes: Any) -> None:
    """A legend above the axes, where no curve runs, in rows from left to right.

    The axes are as wide as their page.
    """
    handles, labels = axes.get_legend_handles_labels()
    columns = columns_of(labels, axes.figure.get_figwidth() - _LEFT)
    axes.legend(
        *by_rows(handles, labels, columns),
        loc="lower right",
        bbox_to_anchor=(1, 1),
        ncols=columns,
        borderaxespad=0,
    )


def by_rows(
    handles: Sequence[Any], labels: Sequence[str], columns: int
) -> tuple[list[Any], list[str]]:
    """Entries so that they stand in rows, where matplotlib fills columns."""
    order = [k for c in range(columns) for k in range(c, len(labels), columns)]
    return [handles[k] for k in order], [labels[k] for k in order]


def wrapped(text: str, room: float) -> str:
    """A sentence in lines of a width [inch], ended between words."""
    lines: list[str] = []
    for word in text.split():
        if lines and width(f"{lines[-1]} {word}") <= room:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return "\n".join(lines)


def broken(label: str, room: float) -> str:
    """A label in lines of a width [inch], ended after dots, after `_`, before units."""
    lines = [""]
    for piece in re.findall(r"[^._\[]*[._]|[^._\[]+|\[.*", label):
        longer = lines[-1] + piece
        if lines[-1] and width(longer) > room:
            lines[-1] = lines[-1].rstrip()
            lines.append(piece)
        else:
            lines[-1] = longer
    return "\n".join(lines)
