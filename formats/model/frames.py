"""Frames that a model file can describe: beams that share points."""

import math
from collections.abc import Mapping
from typing import Any, Literal, Self

from numpy.typing import ArrayLike
from pydantic import model_validator

from ..base.errors import InputError
from ..toml.tables import Entries, Field, Table, Takes
from .beams import BeamGeometry, ShapedSection, Twist, check_sections
from .stations import StationTable
from .tables import Count, Material, NonNegative, Point3, Positive, check_name

Direction = Literal["x", "y", "z", "rx", "ry", "rz"]
_ORIGIN = (0.0, 0.0, 0.0)
#: Points nearer than this, relative to the size of the frame, are at one place.
_SAME_PLACE = 1e-9


class MemberReleases(Table):
    """Directions in which the ends of a member are free of their points.

    They are those of the axes of the member at this end: x along the member, y and z of
    its cross-section, rx, ry and rz about them.

    Attributes
    ----------
    start, end : such as ["ry", "rz"] for a pin that passes on torsion
    """

    start: tuple[Direction, ...] = ()
    end: tuple[Direction, ...] = ()


class MemberOffsets(Table):
    """Rigid arms from the points to the ends of a member.

    Attributes
    ----------
    start, end : [x, y, z] in m, from the point to the end
    """

    start: Point3 = _ORIGIN
    end: Point3 = _ORIGIN


class FrameMember(Table):
    """A beam between two points of a frame, straight or curved.

    Attributes
    ----------
    start, end : names of points
    through : points between them for a curved axis, see the geometry of a beam
    y_axis : direction of the local y axis at the start, instead of that of the frame
    section : a name in `sections` of the frame, or a section by its shape
    sections : instead of it, stiffness and mass at stations, as for a single beam
    twist, interpolation : as for a single beam
    material : a name in `materials` of the frame, by default [material]
    elements : along the member, instead of those of [discretisation]
    releases, offsets : of its ends
    """

    start: str
    end: str
    through: tuple[Point3, ...] = ()
    y_axis: Takes[Point3 | None, ArrayLike | None] = Field(default=None)
    twist: Twist = 0.0
    interpolation: Literal["linear", "smooth", "polynomial"] = "linear"
    section: Takes[str | ShapedSection | None, str | ShapedSection | Entries | None] = (
        Field(default=None)
    )
    sections: Takes[str | StationTable | None, str | StationTable | Entries | None] = (
        Field(default=None)
    )
    material: str | None = None
    elements: Count | None = None
    releases: MemberReleases = MemberReleases()
    offsets: MemberOffsets = MemberOffsets()


class FrameMass(Table):
    """A rigid particle at a point of a frame.

    Attributes
    ----------
    point : name of the point
    mass : [kg]
    inertia : [xx, yy, zz] about its own centre, axes of the model [kg m^2]
    offset : [x, y, z] of its centre from the point [m]
    """

    point: str
    mass: Takes[Positive, float | str]
    inertia: tuple[NonNegative, NonNegative, NonNegative] = _ORIGIN
    offset: Point3 = _ORIGIN


class FrameSpring(Table):
    """A spring between two points of a frame, without mass.

    Attributes
    ----------
    points : names of two points, which may be at one place
    stiffness : one number along the line between them [N/m]; or six along and about
        the axes x, y, z of the model [N/m], [N m/rad], of the motion relative to each
        other half-way between them
    """

    points: tuple[str, str]
    stiffness: Positive | tuple[NonNegative, ...]

    @model_validator(mode="after")
    def _six(self) -> Self:
        if isinstance(self.stiffness, tuple) and len(self.stiffness) != 6:
            raise InputError(
                f"has {len(self.stiffness)} numbers",
                place="stiffness",
                expected="one number, or six along and about x, y, z",
            )
        return self


class FrameGeometry(Table):
    """Beams that share points: machine frames, cranes, trusses, portals.

    The ends of members at a point move and turn as one, unless they are released. Every
    point is a place that `clamp` and ties can name.

    Attributes
    ----------
    points : name -> [x, y, z] in m
    members : name -> beam between two points
    sections : name -> section by its shape, for `section` of members
    materials : name -> material, for `material` of members
    y_axis : direction of the local y axis of members that have none of their own, by
        default that of a single beam
    masses, springs : at points, and between two
    """

    type: Literal["frame"] = "frame"
    points: dict[str, Point3] = Field(min_length=2)
    members: dict[str, FrameMember] = Field(min_length=1)
    sections: dict[str, ShapedSection] = {}
    materials: dict[str, Material] = {}
    y_axis: Takes[Point3 | None, ArrayLike | None] = Field(default=None)
    masses: tuple[FrameMass, ...] = ()
    springs: dict[str, FrameSpring] = {}

    @model_validator(mode="after")
    def _names_are_known(self) -> Self:
        for table in ("points", "members", "sections"):
            for name in getattr(self, table):
                if "." in name:
                    raise InputError(
                        f"{name!r} cannot be a name",
                        place=f"geometry.{table}",
                        expected="a name without dots, which separate names in outputs",
                    )
        for name, member in self.members.items():
            place = f"geometry.members.{name}"
            for end in ("start", "end"):
                self._check_point(getattr(member, end), f"{place}.{end}")
            if isinstance(member.section, str):
                check_name(member.section, self.sections, "section", f"{place}.section")
            if member.material is not None:
                check_name(
                    member.material, self.materials, "material", f"{place}.material"
                )
            _check_member(member, place)
        for k, mass in enumerate(self.masses):
            self._check_point(mass.point, f"geometry.masses[{k}].point")
        for name, spring in self.springs.items():
            if "ground" in spring.points and "ground" not in self.points:
                raise InputError(
                    "ends at the ground, which the body moves against",
                    place=f"geometry.springs.{name}.points",
                    expected="two points of the frame; a spring to the ground is a "
                    "bushing of the scene between ground and a marker",
                )
            for point in spring.points:
                self._check_point(point, f"geometry.springs.{name}.points")
            if spring.points[0] == spring.points[1]:
                raise InputError(
                    f"starts and ends at {spring.points[0]}",
                    place=f"geometry.springs.{name}.points",
                    expected="two points that differ",
                )
        return self

    def _check_point(self, name: str, place: str) -> None:
        check_name(name, self.points, "point", place)

    @model_validator(mode="after")
    def _points_differ(self) -> Self:
        """Two points at one place are a slip, unless a spring is between them."""
        joined = {frozenset(spring.points) for spring in self.springs.values()}
        first, *others = self.points.values()
        size = max(math.dist(first, other) for other in others)
        found = sorted(self.points.items(), key=lambda item: item[1])
        for k, (name, place) in enumerate(found):
            for other, there in found[k + 1 :]:
                if there[0] - place[0] > _SAME_PLACE * size:
                    break
                same = math.dist(place, there) <= _SAME_PLACE * size
                if same and frozenset((name, other)) not in joined:
                    raise InputError(
                        f"points {name} and {other} are at one place",
                        place=f"geometry.points.{other}",
                        expected="one point, or a spring between the two",
                    )
        return self

    @property
    def edge_names(self) -> Mapping[str, Any]:
        """The points, which `clamp` and ties name."""
        return self.points

    @property
    def members_of_default_material(self) -> list[str]:
        """Names of the members that have the material of the table [material]."""
        return [
            name
            for name, member in self.members.items()
            if member.sections is None and member.material is None
        ]

    def member_geometry(self, name: str) -> BeamGeometry:
        """Return a member as a single beam between its ends."""
        member = self.members[name]
        ends = [
            tuple(a + b for a, b in zip(self.points[point], offset, strict=True))
            for point, offset in (
                (member.start, member.offsets.start),
                (member.end, member.offsets.end),
            )
        ]
        section: Any = member.section
        if isinstance(section, str):
            section = self.sections[section]
        return BeamGeometry.model_construct(  # checked already, or with a complex step
            start=ends[0],
            end=ends[1],
            through=member.through,
            y_axis=self.y_axis if member.y_axis is None else member.y_axis,
            twist=member.twist,
            interpolation=member.interpolation,
            section=section,
            sections=member.sections,
        )


def _check_member(member: FrameMember, place: str) -> None:
    if member.start == member.end and not member.through:
        raise InputError(
            f"starts and ends at {member.start}",
            place=place,
            expected="two points that differ",
        )
    if member.sections is not None and member.material is not None:
        raise InputError(
            "is not for sections at stations, which hold stiffness and mass",
            place=f"{place}.material",
            expected="no material",
        )
    check_sections(member, place)
