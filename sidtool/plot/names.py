"""Names of points in a picture, beside each other and beside all other words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axis import Axis
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from matplotlib.transforms import Bbox, BboxBase
from numpy.typing import NDArray

from .words import width

Array = NDArray[np.float64]

#: Height of a line in sizes of its letters; from a point to its name [pt].
_LINE, _OFF = 1.25, 3.0
#: Letters as they are drawn are up to so much larger than their outlines.
_SPARE = 1.15
#: Of a name beside its point, tried in this order.
_SIDES = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 1), (1, -1), (-1, -1))


def place_names(axes: Any, places: Mapping[str, Array], room: BboxBase) -> list[str]:
    """Writes names beside their points, each where nothing else is written.

    Parameters
    ----------
    places : (2,) by name, in the data of the axes on the page
    room : of the page that names may take [pixels]

    Returns
    -------
    names for which there is no room
    """
    page = axes.figure
    size = float(matplotlib.rcParams["font.size"]) * 0.7
    pixel = page.dpi / 72.0
    taken = written(page)
    dots = axes.transData.transform(np.reshape(list(places.values()), (-1, 2)))
    taken += [Bbox(np.array([dot - 2 * pixel, dot + 2 * pixel])) for dot in dots]
    left = []
    for (name, place), dot in zip(places.items(), dots, strict=True):
        across, up = width(name, size) * page.dpi, _LINE * size * pixel
        extent = _SPARE * np.array([across, up])
        found = _free(dot, extent, _OFF * pixel, taken, room)
        if found is None:
            left.append(name)
            continue
        taken.append(found)
        middle = found.get_points().mean(axis=0)
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


def _free(
    dot: Array, extent: Array, off: float, taken: list[Bbox], room: BboxBase
) -> Bbox | None:
    """A box of this extent beside a point that meets no other."""
    for side in np.array(_SIDES, float):
        middle = dot + side * (extent / 2 + off)
        found = Bbox(np.array([middle - extent / 2, middle + extent / 2]))
        inside = room.contains(*found.min) and room.contains(*found.max)
        if inside and not any(found.overlaps(other) for other in taken):
            return found
    return None


def written(part: Any, but: Text | None = None) -> list[Bbox]:
    """Boxes of all words of a page, or of a part of it, but one."""
    beyond = {label for axis in part.findobj(Axis) for label in _beyond(axis)}
    return [
        text.get_window_extent()
        for text in part.findobj(Text)
        if text is not but and text not in beyond and _shown(text)
    ]


def _shown(text: Text) -> bool:
    return bool(text.get_visible() and text.get_text().strip())


def _beyond(axis: Axis) -> list[Text]:
    """Numbers at ticks beyond the ends of an axis, which are not drawn."""
    low, high = sorted(axis.get_view_interval())
    ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
    return [tick.label1 for tick in ticks if not low <= tick.get_loc() <= high]
