"""Figures without a display, written wholly or not at all."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sidtool.formats.endings import check_ending
from sidtool.formats.storage.atomic import atomic_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Okabe and Ito's colours, told apart by everyone: blue, orange, green, ...
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


@contextmanager
def figure(
    path: Path | None, rows: int = 1, columns: int = 1, *, size: tuple[float, float]
) -> Iterator[Any]:
    """Yield the axes of a new figure; it is saved to `path` (by its ending) afterwards,
    if there is one.

    Parameters
    ----------
    rows, columns : of the grid of axes; one of each yields the axes themselves
    size : width and height [inch]
    """
    with styled():
        page, axes = new_page(rows, columns, size)
        yield axes
        if path is not None:
            saved(page, path)


def saved(page: Figure, path: Path) -> None:
    """Writes a figure as what the ending of its name says.

    Raises
    ------
    InputError : it is not that of a picture.
    """
    from .page import PIXELS

    check_ending(path, "picture")
    with atomic_path(path) as temporary:
        page.savefig(temporary, dpi=PIXELS, format=path.suffix[1:].lower())


@contextmanager
def styled() -> Iterator[None]:
    """What is drawn inside looks like all pictures of sidtool.

    No text is read as mathematics. A character that the fonts lack is a box.
    """
    import matplotlib

    style = _STYLE | {"axes.prop_cycle": _cycle()}
    with matplotlib.rc_context(style), warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph \d+ .* missing from")
        yield


def new_page(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, Any]:
    """A page and the axes on it."""
    from .page import Page

    page = Page(size)
    return page, page.subplots(rows, columns, sharex="col")


def use_log_scale(axis: Any) -> None:
    """Make an axis logarithmic, with powers of ten whose exponents are characters."""
    from .page import PowersOfTen

    (axis.axes.set_xscale if axis.axis_name == "x" else axis.axes.set_yscale)("log")
    axis.set_major_formatter(PowersOfTen())
    axis.set_minor_formatter(PowersOfTen(labelOnlyBase=False))


def _cycle() -> Any:
    from cycler import cycler

    return cycler(color=COLOURS)
