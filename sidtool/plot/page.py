"""A figure that is no window, and what it says as text."""

from __future__ import annotations

import io
import re
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import LogFormatterSciNotation

from sidtool.formats.errors import printable

#: Pixels to the inch.
PIXELS = 100
_RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


class Page(Figure):
    """A figure of its own canvas, without global state of pyplot; notebooks show it.

    Control characters in its texts are question marks: fonts have none, and a picture
    in XML may hold none.

    size : width and height [inch]
    """

    def __init__(self, size: tuple[float, float], layout: Any = "constrained") -> None:
        super().__init__(figsize=size, layout=layout)
        FigureCanvasAgg(self)

    def draw(self, renderer: Any) -> None:
        for text in self.findobj(Text):
            assert isinstance(text, Text)
            shown = printable(text.get_text())
            if shown != text.get_text():
                text.set_text(shown)
        super().draw(renderer)

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        self.savefig(stream, dpi=PIXELS, format="png")
        return stream.getvalue()


class PowersOfTen(LogFormatterSciNotation):
    """Numbers at a logarithmic axis as text, not as mathematics."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        text = super().__call__(x, pos).replace(r"\times", "×")
        text = re.sub(r"\^\{(.*?)\}", lambda m: m[1].translate(_RAISED), text)
        return re.sub(r"\$|\\math\w+|[{}]", "", text)
