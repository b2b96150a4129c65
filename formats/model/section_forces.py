"""Cross-sections at which a simulation evaluates section forces."""

from collections.abc import Mapping
from typing import Annotated

from numpy.typing import ArrayLike

from ..toml.constructor_types import Entries, Field, OptionalTexts, Takes
from ..toml.tables import Table
from .geometry import Point2
from .tables import Fraction, Point3


class PlaneCut(Table):
    """A plane through a solid body, and the part beyond it.

    Attributes
    ----------
    point : of the plane, [x, y] or [x, y, z] in m
    normal : of the plane, towards the part beyond; the x axis of the section
    y_axis : direction of the section's y axis in space, made perpendicular to the
        normal; by default y, or -x for a normal along y
    nearest : where the plane meets the body in several places, whether the section is
        the one nearest to the point, and the part beyond what is connected with it
    markers : names of the markers beyond; by default those that lie there
    """

    point: Takes[Point2 | Point3, ArrayLike]
    normal: Takes[Point2 | Point3, ArrayLike]
    y_axis: Takes[Point3 | None, ArrayLike | None] = Field(default=None)
    nearest: bool = False
    markers: OptionalTexts = Field(default=None)


class SectionForces(Table):
    """Cross-sections at which a simulation evaluates section forces.

    Attributes
    ----------
    stations : of beams: a number of equal steps' ends from start to end, called s1, s2,
        ..., or fractions of the length, called so too, or name = fraction
    members : of a frame, whose sections are called MEMBER.s1 and so on; by default all
    cuts : of solid bodies: planes by the names of their sections
    """

    stations: (
        Annotated[int, Field(ge=2, le=1000)]
        | Annotated[tuple[Fraction, ...], Field(min_length=1)]
        | Annotated[dict[str, Fraction], Field(min_length=1)]
        | None
    ) = None
    members: OptionalTexts = Field(default=None, min_length=1)
    cuts: Takes[dict[str, PlaneCut], Mapping[str, PlaneCut | Entries]] = Field(
        default_factory=dict
    )

    @property
    def fractions(self) -> dict[str, float]:
        """Name of every section of a beam -> fraction of the length."""
        if isinstance(self.stations, dict):
            return self.stations
        values = self.stations or ()
        if isinstance(values, int):
            values = tuple(k / (values - 1) for k in range(values))
        return {f"s{k}": value for k, value in enumerate(values, 1)}
