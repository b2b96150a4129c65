"""Axes in space that fill their part of a page, with readable ticks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox
from mpl_toolkits.mplot3d.proj3d import proj_transform

from sidtool.formats.base.taylor import Array

from .figure import text_boxes

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Viewing direction [degree].
_ELEVATION, _AZIMUTH = 30.0, -60.0
#: Margins around the box for ticks: left, right, below, above [inch].
_TICK_MARGINS = (0.35, 0.85, 0.75, 0.1)
#: Smallest distance of two ticks, horizontal and vertical [inch].
_TICK_DISTANCE_X, _TICK_DISTANCE_Y = 0.4, 0.17
#: Distances from an axis to its label that are tried; matplotlib scales them with the
#: length of the axis.
_LABEL_PADS = (*range(-6, 60, 3), *range(60, 300, 12))
#: Smallest edge of the box relative to the longest; largest ratio of height to width.
_MIN_EDGE_RATIO, _MAX_HEIGHT_RATIO = 0.04, 1.0


class BodyAxes:
    """Axes with a common window for any number of pictures.

    Parameters
    ----------
    low, high : (3,) corners of the window [m]
    width : of a picture on the page [inch]
    """

    def __init__(self, low: Array, high: Array, width: float) -> None:
        spare = (
            np.clip(_MIN_EDGE_RATIO * (high - low).max() - (high - low), 0.0, None) / 2
        )
        self.low, self.high = low - spare, high + spare
        self.width = width
        self.pads: dict[str, int] = {}
        e, a = np.radians([_ELEVATION, _AZIMUTH])
        #: (2, 3) projection of the unit vector of each axis on the page
        self.sight = np.array(
            [
                [-np.sin(a), np.cos(a), 0.0],
                [-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)],
            ]
        )
        left, right, below, above = _TICK_MARGINS
        visible_extent = np.abs(self.sight) @ (self.high - self.low)
        free = np.array(
            [width - left - right, _MAX_HEIGHT_RATIO * width - below - above]
        )
        #: inches on the page per metre
        self.scale = float((free / visible_extent).min())
        self.height = float(self.scale * visible_extent[1]) + below + above

    def add(self, page: Figure, x: float, y: float) -> Any:
        """Add axes in a part of a page with the lower left corner at x, y [inch]."""
        left, right, below, above = _TICK_MARGINS
        side = max(self.width, self.height)
        middle = np.array(
            [x + (self.width + left - right) / 2, y + (self.height + below - above) / 2]
        )
        corner, total = middle - side / 2, page.get_size_inches()
        place = (*(corner / total), *(side / total))
        axes = cast(Any, page.add_axes(place, projection="3d"))
        axes.computed_zorder = False  # points inside bores are visible through the body
        axes.patch.set_visible(False)
        axes.set_proj_type("ortho")
        axes.view_init(_ELEVATION, _AZIMUTH)
        lows, highs = self.low, self.high
        limits = zip("xyz", lows, highs, strict=True)
        axes.set(**{f"{name}lim": ends for name, *ends in limits})
        for number, name in enumerate("xyz"):
            axes.set(**{f"{name}ticks": self._ticks(number)})
        axes.tick_params(labelsize="x-small", pad=0)
        self._zoom(axes, middle)
        self._label(axes)
        return axes

    def _label(self, axes: Any) -> None:
        """Set the names of the axes as close as the tick labels allow."""
        for name in "xyz":
            for pad in [self.pads[name]] if name in self.pads else _LABEL_PADS:
                set_label = getattr(axes, f"set_{name}label")
                set_label(f"{name} [m]", fontsize="x-small", labelpad=pad)
                if name not in self.pads and _is_label_free(axes, name):
                    self.pads[name] = pad
                    break

    def _zoom(self, axes: Any, middle: Array) -> None:
        """Scale the box to its size and centre it at `middle` [inch]."""
        size = self.high - self.low
        axes.set_box_aspect(tuple(size), zoom=1.0)  # matplotlib modifies arrays
        wanted = np.linalg.norm(self.sight @ size) * self.scale
        zoom = wanted / np.linalg.norm(np.diff(self._ends(axes), axis=0))
        axes.set_box_aspect(tuple(size), zoom=float(zoom))
        off = (middle - self._ends(axes).mean(axis=0)) / axes.figure.get_size_inches()
        axes.set_position(axes.get_position(original=True).translated(*off))

    def _ends(self, axes: Any) -> Array:
        """Return the positions (2, 2) of the lowest and the highest corner of the box
        [inch].
        """
        projected = self.project(axes, [self.low, self.high])
        return np.asarray(axes.transData.transform(projected) / axes.figure.dpi)

    def _ticks(self, number: int) -> list[float]:
        """Return the ticks of an axis, at distances at which their numbers do not
        overlap.
        """
        low, high = self.low[number], self.high[number]
        across, up = self.scale * np.abs(self.sight[:, number])
        distance = min(
            _TICK_DISTANCE_X / max(across, 1e-12), _TICK_DISTANCE_Y / max(up, 1e-12)
        )
        count = max(1, int((high - low) / distance))
        for bins in range(count, 0, -1):
            ticks = MaxNLocator(bins, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high)
            visible = [float(tick) for tick in ticks if low <= tick <= high]
            if visible and (len(visible) < 2 or visible[1] - visible[0] >= distance):
                return visible
        return [0.0] if low <= 0 <= high else [float((low + high) / 2)]

    def project(self, axes: Any, points: Any) -> Array:
        """Return the projections (n, 2) of points (n, 3), in the data of the axes."""
        axes.apply_aspect()
        x, y, _ = proj_transform(*np.reshape(points, (-1, 3)).T, axes.get_proj())
        return np.column_stack([x, y])

    def occupied_box(self, page: Figure, x: float, y: float) -> Bbox:
        """Return the part of a page that a picture occupies [pixels]."""
        corners = np.array([[x, y], [x + self.width, y + self.height]])
        return Bbox(corners * page.dpi)


def _is_label_free(axes: Any, name: str) -> bool:
    """Return whether the label of an axis overlaps no other text of the axes."""
    axes.figure.draw_without_rendering()
    label = getattr(axes, f"{name}axis").label
    mine = label.get_window_extent().padded(2)
    return not any(mine.overlaps(box) for box in text_boxes(axes, label))
