"""How each dialect prints numbers and stores matrices; one line of `STYLES` each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from .title import LAYOUTS, Layout


@dataclass(frozen=True)
class Style:
    """How one dialect prints what its `Layout` arranges.

    Attributes
    ----------
    layout : arrangement of columns and indices
    number : printf format of a real number
    letter : exponent letter
    stored : of a symmetric matrix, "both" halves, the "lower" one or "diagonal"
    j_is_3x3 : J as a matrix instead of its six elements
    names : blocks that this dialect calls differently
    """

    layout: Layout
    number: str = "% .11E"
    letter: str = "D"
    stored: str = "both"
    j_is_3x3: bool = False
    names: Mapping[str, str] | None = None


#: FEMBeam itself prints "%f" and loses small numbers; "%.12g" reads the same and
#: keeps 12 digits, with an exponent where a number is small or large.
STYLES = {
    "fembs": Style(LAYOUTS["fembs"]),
    "pysid": Style(LAYOUTS["pysid"], stored="diagonal"),
    "matmorembs": Style(
        LAYOUTS["matmorembs"],
        letter="E",
        stored="lower",
        names={"mdCM": "mCM", "J": "mmi"},
    ),
    "fembeam": Style(
        LAYOUTS["fembeam"], number="%.12g", letter="e", stored="lower", j_is_3x3=True
    ),
}
