"""A figure that is no window."""

from __future__ import annotations

import io

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

#: Pixels to the inch.
PIXELS = 100


class Page(Figure):
    """A figure of its own canvas, without global state of pyplot; notebooks show it.

    size : width and height [inch]
    """

    def __init__(self, size: tuple[float, float]) -> None:
        super().__init__(figsize=size, layout="constrained")
        FigureCanvasAgg(self)

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        self.savefig(stream, dpi=PIXELS, format="png")
        return stream.getvalue()
