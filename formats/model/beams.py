"""Beams that a model file can describe: an axis, its sections, and lumped masses."""

from typing import Annotated, Any, Literal, Self

from numpy.typing import ArrayLike
from pydantic import model_validator

from ..base.errors import InputError
from ..toml.tables import Entries, Field, Number, Table, Takes
from .stations import StationTable, read_stations
from .tables import NonNegative, Point3, Positive

Stations = Annotated[tuple[Positive, ...], Field(min_length=1)]
Twist = float | Annotated[tuple[float, ...], Field(min_length=1)]

_Length = Takes[Positive, float | str]


class RectangularSection(Table):
    """A rectangular cross-section that may vary along a beam.

    One number holds everywhere; several belong to stations, at equal steps from start
    to end, see `interpolation` of the geometry.

    Attributes
    ----------
    height : along the local y axis [m]
    width : along the local z axis [m]
    """

    shape: Literal["rectangle"] = "rectangle"
    height: Positive | Stations
    width: Positive | Stations


class GeneralSection(Table):
    """A constant cross-section given by its properties.

    Attributes
    ----------
    area [m^2]; iy, iz : second moments of area about the local y and z axes [m^4];
    torsion : torsion constant [m^4], by default iy + iz
    shear_y, shear_z : shear areas divided by the area
    """

    shape: Literal["general"] = "general"
    area: Takes[Positive, float | str]
    iy: Takes[Positive, float | str]
    iz: Takes[Positive, float | str]
    torsion: Takes[Positive | None, float | str | None] = Field(default=None)
    shear_y: Takes[Positive, float | str] = Field(default=5 / 6)
    shear_z: Takes[Positive, float | str] = Field(default=5 / 6)


class CircularSection(Table):
    """A solid circle.

    Attributes
    ----------
    diameter : [m]
    """

    shape: Literal["circle"] = "circle"
    diameter: _Length


class TubeSection(Table):
    """A round tube.

    Attributes
    ----------
    diameter : outer diameter [m]
    thickness : of the wall [m]
    """

    shape: Literal["tube"] = "tube"
    diameter: _Length
    thickness: _Length


class BoxSection(Table):
    """A rectangular tube.

    Attributes
    ----------
    height, width : outer sizes along the local y and z axes [m]
    thickness : of the walls [m]
    """

    shape: Literal["box"] = "box"
    height: _Length
    width: _Length
    thickness: _Length


class _ProfileSection(Table):
    """Web along the local y axis and flanges along z.

    Attributes
    ----------
    height, width : outer sizes along the local y and z axes [m]
    web, flange : their thickness [m]
    fillet : radius between web and flanges [m]
    """

    height: _Length
    width: _Length
    web: _Length
    flange: _Length
    fillet: Takes[NonNegative, float | str] = Field(default=0.0)


class ISection(_ProfileSection):
    """Two equal flanges and a web between their middles."""

    shape: Literal["I"] = "I"


class TSection(_ProfileSection):
    """A flange on the side of positive y, and a web from its middle."""

    shape: Literal["T"] = "T"


class CSection(_ProfileSection):
    """A channel: two equal flanges from a web towards positive z."""

    shape: Literal["C"] = "C"


class LSection(Table):
    """An angle: legs from its corner towards positive y and positive z.

    Attributes
    ----------
    height, width : outer sizes along the local y and z axes [m]
    thickness : of both legs [m]
    fillet : radius between the legs [m]
    """

    shape: Literal["L"] = "L"
    height: _Length
    width: _Length
    thickness: _Length
    fillet: Takes[NonNegative, float | str] = Field(default=0.0)


#: Constant sections by their sizes.
NamedSection = (
    CircularSection
    | TubeSection
    | BoxSection
    | ISection
    | TSection
    | CSection
    | LSection
)


ShapedSection = Annotated[
    RectangularSection | GeneralSection | NamedSection, Field(discriminator="shape")
]


class LumpedMass(Table):
    """A rigid particle fixed to a beam.

    Attributes
    ----------
    at : fraction of the length of the beam
    mass : [kg]
    inertia : [xx, yy, zz] about its own centre: about the tangent of the beam and the
        axes y and z of its section there [kg m^2]
    """

    at: Number = Field(ge=0, le=1)
    mass: Takes[Positive, float | str]
    inertia: tuple[NonNegative, NonNegative, NonNegative] = (0.0, 0.0, 0.0)


class BeamGeometry(Table):
    """A beam, straight or curved, with or without pre-twist. Its ends are called start
    and end.

    Attributes
    ----------
    start, end : [x, y, z] in m
    through : points between them, in order, for a curved axis: a cubic spline through
        start, these points and end; more points follow a curve better
    y_axis : direction of the local y axis at the start, made perpendicular to the
        beam; by default y, or -x for a beam along y. Along a curved beam it is carried
        without a rotation about the tangent
    section : by its shape. The axis of the beam is the line of its centroids
    sections : instead of `section` and [material], stiffness and mass at stations along
        the axis: a CSV file or its columns. Centres may lie beside the axis
    twist : pre-twist, the angle [rad] by which cross-sections are turned about the
        tangent from y to z; several numbers belong to stations, at equal steps from
        start to end. With `sections` one number, which is added to theirs
    interpolation : of `section` and twist between their stations: `linear`, a `smooth`
        cubic spline, or one `polynomial` through all, which swings beside steps
    """

    type: Literal["beam"] = "beam"
    start: Takes[Point3, ArrayLike]
    end: Takes[Point3, ArrayLike]
    through: tuple[Point3, ...] = ()
    y_axis: Takes[Point3 | None, ArrayLike | None] = Field(default=None)
    twist: Twist = 0.0
    interpolation: Literal["linear", "smooth", "polynomial"] = "linear"
    section: Takes[ShapedSection | None, ShapedSection | Entries | None] = Field(
        default=None
    )
    sections: Takes[str | StationTable | None, str | StationTable | Entries | None] = (
        Field(default=None)
    )
    masses: tuple[LumpedMass, ...] = ()

    @model_validator(mode="after")
    def _one_kind_of_sections(self) -> Self:
        check_sections(self, "geometry")
        return self

    def station_table(self) -> StationTable:
        """Return the table of `sections`, read from its file if it names one.

        Raises
        ------
        InputError : the file is not sound.
        """
        given = self.sections
        if isinstance(given, str):
            return read_stations(given)
        assert given is not None
        return given if given.file is None else read_stations(given.file, given.order)

    @property
    def edge_names(self) -> dict[str, tuple[int, int]]:
        """start and end."""
        return {"start": (0, 0), "end": (0, 1)}


def check_sections(table: Any, place: str) -> None:
    """Check that a beam has a section, or sections at stations without a second twist.

    Parameters
    ----------
    table : with section, sections, twist and interpolation

    Raises
    ------
    InputError : it has not.
    """
    if (table.section is None) == (table.sections is None):
        both = table.section is not None
        raise InputError(
            "gives section and sections" if both else "has no section",
            place=place,
            expected="a section by its shape, or sections at stations",
        )
    if table.sections is None:
        return
    for key, given in (
        ("twist", isinstance(table.twist, tuple)),
        ("interpolation", "interpolation" in table.model_fields_set),
    ):
        if given:
            raise InputError(
                "is not for sections at stations",
                place=f"{place}.{key}",
                expected="a table that holds the twist, linear between stations",
            )
