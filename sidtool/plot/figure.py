"""Figures without a display, and texts and labels in them."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from matplotlib.textpath import TextPath
from matplotlib.ticker import LogFormatterSciNotation
from matplotlib.transforms import Bbox, BboxBase

from sidtool.formats.base.errors import printable
from sidtool.formats.base.sid import Array
from sidtool.formats.file_names import check_ending
from sidtool.formats.storage.atomic import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Pixels per inch.
PIXELS_PER_INCH = 100
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")

#: Okabe and Ito's colours, distinguishable with colour blindness: blue, orange, green,
#: ... ...
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_STYLE: dict[Any, Any] = {
    "axes.formatter.useoffset": False,
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "font.size": 9.0,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "svg.fonttype": "none",
    "svg.hashsalt": "sidtool",
    "text.parse_math": False,
}
#: Points per inch; height of a row of a legend [inch].
POINTS_PER_INCH, LEGEND_ROW_HEIGHT = 72.0, 0.19
#: Width of the line sample in a legend, and gap to the next entry [font sizes].
_HANDLE_WIDTH, _ENTRY_GAP = 2.8, 2.0
#: Width of the labels at the left axis, and of the power of ten above it [inch].
_LEFT_MARGIN = 1.5
#: Line height in font sizes; distance from a point to its name [pt].
_LINE, _NAME_DISTANCE = 1.25, 3.0
#: Safety factor: drawn letters are larger than their outlines.
_LETTER_MARGIN = 1.15
#: Positions of a name next to its point, in the order of trial.
_SIDES = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1))


class NotebookFigure(Figure):
    """A figure with its own canvas, without global state of pyplot; notebooks show it.
    Control characters in its texts become question marks: fonts lack them, and XML does
    not allow them.

    size : width and height [inch]
    """

    def __init__(self, size: tuple[float, float], layout: Any = "constrained") -> None:
        super().__init__(figsize=size, layout=layout)
        FigureCanvasAgg(self)

    def draw(self, renderer: Any) -> None:
        if self.stale:  # not once more for the second pass of a layout
            for text in self.findobj(Text):
                assert isinstance(text, Text)
                printed = printable(text.get_text())
                if printed != text.get_text():
                    text.set_text(printed)
        super().draw(renderer)

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        self.savefig(stream, dpi=PIXELS_PER_INCH, format="png")
        return stream.getvalue()


class PowersOfTen(LogFormatterSciNotation):
    """Tick labels of a logarithmic axis as text, not as mathematics."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        text = super().__call__(x, pos).replace(r"\times", "×")
        text = re.sub(r"\^\{(.*?)\}", lambda m: m[1].translate(_SUPERSCRIPTS), text)
        return re.sub(r"\$|\\math\w+|[{}]", "", text)


@contextmanager
def saved_figure(
    path: Path | None, rows: int = 1, columns: int = 1, *, size: tuple[float, float]
) -> Iterator[Any]:
    """Yield the axes of a new figure; it is saved to `path` (by its ending) afterwards,
    if there is one.

    Parameters
    ----------
    rows, columns : of the grid of axes; one of each yields the axes themselves
    size : width and height [inch]
    """
    with figure_style():
        page, axes = new_figure(rows, columns, size)
        yield axes
        if path is not None:
            save_figure(page, path)


def save_figure(page: Figure, path: Path) -> None:
    """Write a figure in the format of its ending.

    Raises
    ------
    InputError : it is not that of a picture.
    """

    check_ending(path, "picture")
    with atomic_path(path) as temporary:
        page.savefig(temporary, dpi=PIXELS_PER_INCH, format=path.suffix[1:].lower())


@contextmanager
def figure_style() -> Iterator[None]:
    """Apply the style of sidtool to figures made inside the context.

    No text is parsed as mathematics. Characters that the fonts lack become boxes.
    """
    import matplotlib

    style = _STYLE | {"axes.prop_cycle": _colour_cycle()}
    with matplotlib.rc_context(style), warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph \d+ .* missing from")
        yield


def new_figure(
    rows: int, columns: int, size: tuple[float, float]
) -> tuple[Figure, Any]:
    """Return a page and its axes."""

    page = NotebookFigure(size)
    return page, page.subplots(rows, columns, sharex="col")


def use_log_scale(axis: Any) -> None:
    """Make an axis logarithmic, with powers of ten whose exponents are characters."""

    (axis.axes.set_xscale if axis.axis_name == "x" else axis.axes.set_yscale)("log")
    axis.set_major_formatter(PowersOfTen())
    axis.set_minor_formatter(PowersOfTen(labelOnlyBase=False))


def _colour_cycle() -> Any:
    from cycler import cycler

    return cycler(color=COLOURS)


def text_width(text: str, size: float | None = None) -> float:
    """Return the width of a text [inch].

    Parameters
    ----------
    size : size of its letters, by default that of the picture [pt]
    """
    size = matplotlib.rcParams["font.size"] if size is None else size
    printed = printable(text).replace("$", "S")
    if not text.strip():
        return 0.0
    path = TextPath((0, 0), printed, prop=FontProperties(size=size))
    # outlines have points at their ends: the box of all curves takes ten times as long
    on_outline = np.asarray(path.codes) != TextPath.CLOSEPOLY
    return float(np.ptp(np.asarray(path.vertices)[on_outline, 0])) / POINTS_PER_INCH


def legend_columns(labels: Sequence[str], room: float) -> int:
    """Return the number of columns of a legend that fit into a width [inch]."""
    if not labels:
        return 1
    size = matplotlib.rcParams["font.size"] / POINTS_PER_INCH
    entry = max(map(text_width, labels)) + (_HANDLE_WIDTH + _ENTRY_GAP) * size
    return max(1, min(len(labels), int((room + _ENTRY_GAP * size) / entry)))


def legend_rows(labels: Sequence[str], page_width: float) -> int:
    """Return the number of rows of the legend that `draw_legend` draws."""
    return -(-len(labels) // legend_columns(labels, page_width - _LEFT_MARGIN))


def draw_legend(axes: Any) -> None:
    """Draw a legend above the axes, in rows from left to right. The axes are as wide as
    their page.
    """
    handles, labels = axes.get_legend_handles_labels()
    columns = legend_columns(labels, axes.figure.get_figwidth() - _LEFT_MARGIN)
    axes.legend(
        *order_by_rows(handles, labels, columns),
        loc="lower right",
        bbox_to_anchor=(1, 1),
        ncols=columns,
        borderaxespad=0,
    )


def order_by_rows(
    handles: Sequence[Any], labels: Sequence[str], columns: int
) -> tuple[list[Any], list[str]]:
    """Reorder entries to fill rows, where matplotlib fills columns."""
    order = [k for c in range(columns) for k in range(c, len(labels), columns)]
    return [handles[k] for k in order], [labels[k] for k in order]


def wrap_text(text: str, room: float) -> str:
    """Wrap a sentence to a width [inch] between words."""
    lines: list[str] = []
    for word in text.split():
        if lines and text_width(f"{lines[-1]} {word}") <= room:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return "\n".join(lines)


def wrap_label(label: str, room: float) -> str:
    """Wrap a label to a width [inch] after dots, after `_`, or before units."""
    lines = [""]
    for piece in re.findall(r"[^._\[]*[._]|[^._\[]+|\[.*", label):
        longer = lines[-1] + piece
        if lines[-1] and text_width(longer) > room:
            lines[-1] = lines[-1].rstrip()
            lines.append(piece)
        else:
            lines[-1] = longer
    return "\n".join(lines)


def place_names(axes: Any, places: Mapping[str, Array], room: BboxBase) -> list[str]:
    """Write names next to their points without overlaps.

    Parameters
    ----------
    places : (2,) by name, in the data of the axes on the page
    room : part of the page for names [pixels]

    Returns
    -------
    names for which there is no room
    """
    page = axes.figure
    size = float(matplotlib.rcParams["font.size"]) * 0.7
    pixel = page.dpi / 72.0
    taken = text_boxes(page)
    dots = axes.transData.transform(np.reshape(list(places.values()), (-1, 2)))
    taken += [Bbox(np.array([dot - 2 * pixel, dot + 2 * pixel])) for dot in dots]
    left = []
    for (name, place), dot in zip(places.items(), dots, strict=True):
        across, up = text_width(name, size) * page.dpi, _LINE * size * pixel
        extent = _LETTER_MARGIN * np.array([across, up])
        box = _free_box(dot, extent, _NAME_DISTANCE * pixel, taken, room)
        if box is None:
            left.append(name)
            continue
        taken.append(box)
        middle = box.get_points().mean(axis=0)
        text = axes.annotate(
            name,
            place,
            (middle - dot) / pixel,
            textcoords="offset points",
            fontsize=size,
            ha="center",
            va="center",
            zorder=6,
            annotation_clip=False,
            path_effects=[withStroke(linewidth=1.5, foreground="white", alpha=0.6)],
        )
        text.set_in_layout(False)
    return left


def _free_box(
    dot: Array, extent: Array, off: float, taken: list[Bbox], room: BboxBase
) -> Bbox | None:
    """Return a box of this extent next to a point that overlaps no other box,
    or None.
    """
    for side in np.array(_SIDES, float):
        middle = dot + side * (extent / 2 + off)
        box = Bbox(np.array([middle - extent / 2, middle + extent / 2]))
        inside = room.contains(*box.min) and room.contains(*box.max)
        if inside and not any(box.overlaps(other) for other in taken):
            return box
    return None


def text_boxes(part: Any, but: Text | None = None) -> list[Bbox]:
    """Return the boxes of all texts of a page, or a part of it, except one."""
    beyond = {label for axis in part.findobj(Axis) for label in _ticks_outside(axis)}
    return [
        text.get_window_extent()
        for text in part.findobj(Text)
        if text is not but and text not in beyond and _is_visible_text(text)
    ]


def _is_visible_text(text: Text) -> bool:
    return bool(text.get_visible() and text.get_text().strip())


def _ticks_outside(axis: Axis) -> list[Text]:
    """Yield tick labels beyond the ends of an axis, which are not drawn."""
    low, high = sorted(axis.get_view_interval())
    ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
    return [tick.label1 for tick in ticks if not low <= tick.get_loc() <= high]
