"""The model file: one flexible body, from its geometry to the reduction.

SI units, angles in radians. See ``examples/slider_crank/rod_q4.toml``.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

from numpy.typing import ArrayLike
from pydantic import model_validator

from ..base.errors import InputError
from ..damping import RayleighDamping
from ..toml.files import Diagnostics, File, relocate_paths
from ..toml.reading import PARAMETERS, PARAMETERS_MEAN
from ..toml.tables import Entries, Field, Integer, OptionalInteger, Table, Takes
from .beams import BeamGeometry
from .discretisation import FITTING, Discretisation, IgaDiscretisation, Q4Discretisation
from .frames import FrameGeometry
from .geometry import SIDES, Geometry, NurbsGeometry, Point2, SectionForces
from .reduction import (
    BuckensFrame,
    ChordFrame,
    FrameSettings,
    ModalReduction,
    ReductionSettings,
    Stiffening,
    StressRecovery,
    TangentFrame,
    Tie,
    check_reduction,
)
from .tables import (
    Fraction,
    Material,
    Point3,
    check_name,
    check_node_numbers,
)

_SECTION_NAME = re.compile(r"[^\W\d][\w-]*")

__all__ = [
    "BuckensFrame",
    "ChordFrame",
    "IgaDiscretisation",
    "NodeMarker",
    "Material",
    "ModalReduction",
    "ModelFile",
    "NurbsGeometry",
    "Q4Discretisation",
    "RayleighDamping",
    "SIDES",
    "Stiffening",
    "StressRecovery",
    "TangentFrame",
    "Tie",
    "read_model",
]


class NodeMarker(Table):
    """A named point that joints and forces can use.

    Exactly one of `edge` (with `at`, the fraction of its parameter range, of a face
    two fractions, of `start` and `end` of a beam none), `parameters` (u, v and w in
    [0, 1]), `position` (x, y and z in m), `mesh_node` (a node number of a mesh file),
    `point` and `member` (with `at`, the fraction of its length) of a frame
    says where it is. A tied marker may stand anywhere, also beside the body or at a
    node that no element uses, as a rigid arm of what it is tied to; with `at = "axis"`
    it lies on the axis of the cylinder that this is, half-way between its ends (in
    the plane: in the centre of the circle), and without a place in the centre of its
    area.

    Attributes
    ----------
    edge : name of a side, a face or an end
    at : place on the edge or along the member, from 0 to 1; or "axis"
    parameters : of the place on a patch, in a volume or along a beam, from 0 to 1
    position : of the place [m]
    """

    node: Integer = Field(ge=1, le=99999, description="its node number in the SID")
    edge: str | None = None
    at: Fraction | tuple[Fraction, Fraction] | Literal["axis"] | None = None
    parameters: Takes[tuple[Fraction, ...] | None, ArrayLike | None] = Field(
        default=None, min_length=1, max_length=3
    )
    position: Takes[Point2 | Point3 | None, ArrayLike | None] = Field(default=None)
    mesh_node: OptionalInteger = Field(
        default=None, description="a node number of the mesh file"
    )
    point: str | None = Field(
        default=None, description="the name of a point of a frame"
    )
    member: str | None = Field(
        default=None, description="the name of a member of a frame, with `at`"
    )
    tie: Takes[Tie | None, Tie | Entries | None] = Field(default=None)


class ModelFile(File):
    """A model file: geometry, material, discretisation, frame, markers, reduction."""

    named: ClassVar[tuple[str, ...]] = ("markers", PARAMETERS)
    paths: ClassVar[tuple[tuple[str, ...], ...]] = (
        *(("geometry", key) for key in ("file", "stiffness", "mass", "nodes", "dofs")),
        ("geometry", "morphs", "*", "file"),
        ("geometry", "sections"),
        ("geometry", "sections", "file"),
        ("geometry", "members", "*", "sections"),
        ("geometry", "members", "*", "sections", "file"),
        ("reduction", "file"),
    )

    format: Literal["sidtool model"] = "sidtool model"
    version: Literal[1] = 1
    title: str = ""
    parameters: Takes[dict[str, float], Mapping[str, float | str]] = Field(
        default_factory=dict, description=PARAMETERS_MEAN
    )
    material: Takes[Material | None, Material | Entries | None] = Field(default=None)
    geometry: Takes[Geometry, Geometry | Entries]
    discretisation: Takes[Discretisation, Discretisation | Entries]
    frame: Takes[FrameSettings, FrameSettings | Entries]
    markers: Takes[dict[str, NodeMarker], Mapping[str, NodeMarker | Entries]] = Field(
        min_length=1
    )
    reduction: Takes[ReductionSettings, ReductionSettings | Entries]
    damping: Takes[RayleighDamping | None, RayleighDamping | Entries | None] = Field(
        default=None
    )
    stiffening: Takes[Stiffening | None, Stiffening | Entries | None] = Field(
        default=None
    )
    section_forces: Takes[SectionForces | None, SectionForces | Entries | None] = Field(
        default=None
    )
    stress: Takes[StressRecovery | None, StressRecovery | Entries | None] = Field(
        default=None
    )
    diagnostics: Takes[Diagnostics, Diagnostics | Entries] = Field(
        default=Diagnostics.model_construct()
    )

    @classmethod
    def _read(cls, data: dict[str, Any], path: Path) -> Self:
        """The files that it names are found from the working folder."""
        for place in cls.paths:
            relocate_paths(data, place, path.parent, Path("."))
        return super()._read(data, path)

    @property
    def folder(self) -> Path:
        """The working folder, where the files that it names are looked for."""
        return Path(".")

    @model_validator(mode="after")
    def _tables_are_consistent(self) -> Self:
        kind, fitting = self.discretisation.type, FITTING[self.geometry.type]
        if kind not in fitting:
            raise InputError(
                f"{kind!r} does not fit a geometry of type {self.geometry.type!r}",
                place="discretisation.type",
                expected=" or ".join(fitting),
            )
        geometry = self.geometry
        by_stations = (
            isinstance(geometry, BeamGeometry) and geometry.sections is not None
        )
        needs_none = by_stations or geometry.type in ("mesh", "matrices")
        if isinstance(geometry, FrameGeometry):
            needs_none = not geometry.members_of_default_material
        if self.material is None and not needs_none:
            raise InputError(
                "is missing", place="material", expected="a table [material]"
            )
        if self.material is not None and by_stations:
            raise InputError(
                "is not for sections at stations, which hold stiffness and mass",
                place="material",
                expected="no table [material]",
            )
        return self

    @property
    def comes_as_matrices(self) -> bool:
        """Whether matrices are all that is known of the body, without elements."""
        engine = getattr(self.geometry, "engine", None)
        return self.geometry.type == "matrices" or engine is not None

    @model_validator(mode="after")
    def _stress_is_available(self) -> Self:
        """Stress and stiffening need elements that know their stress."""
        geometry, stiffening = self.geometry, self.stiffening
        beam = isinstance(geometry, BeamGeometry | FrameGeometry)
        matrices = self.comes_as_matrices
        prestress = stiffening.prestress if stiffening else None
        found: list[tuple[str, Any]] = []
        if isinstance(geometry, BeamGeometry):
            found = [("", geometry.section)]
        elif isinstance(geometry, FrameGeometry):
            found = [
                (f" (member {name})", geometry.member_geometry(name).section)
                for name in geometry.members
            ]
        unshaped = [
            name for name, own in found if own is None or own.shape == "general"
        ]
        if unshaped and self.stress is not None:
            raise InputError(
                f"there is no stress in sections without a shape{unshaped[0]}",
                place="stress",
                expected="a section by its shape, such as a box; of others the section "
                "forces, [section_forces]",
            )
        unknown = {
            "stress": matrices and self.stress is not None,
            "stiffening": matrices and stiffening is not None,
            "stiffening.prestress.stress": beam
            and prestress is not None
            and prestress.stress is not None,
        }
        for place, requested in unknown.items():
            if requested:
                raise InputError(
                    "there is no uniform stress in beams"
                    if beam
                    else "there is no stress in bodies that came as matrices",
                    place=place,
                    expected=f"a body of solid elements, or nothing under {place}",
                )
        return self

    @model_validator(mode="after")
    def _sections_fit_the_geometry(self) -> Self:
        requested, geometry = self.section_forces, self.geometry
        if requested is None:
            return self
        if self.comes_as_matrices:
            raise InputError(
                "is not for bodies that came as matrices",
                place="section_forces",
                expected="a beam, a frame or a body of solid elements",
            )
        beam = isinstance(geometry, BeamGeometry | FrameGeometry)
        expected = "stations" if beam else "cuts, each with point and normal"
        if requested.stations is not None and not beam:
            raise InputError(
                "has stations of beams for a solid",
                place="section_forces",
                expected=expected,
            )
        if requested.cuts and beam:
            raise InputError(
                "has cuts of solids for a beam",
                place="section_forces",
                expected=expected,
            )
        if requested.stations is None and not requested.cuts:
            raise InputError(
                "names no section", place="section_forces", expected=expected
            )
        if requested.members is not None and not isinstance(geometry, FrameGeometry):
            raise InputError(
                "is for frames",
                place="section_forces.members",
                expected='a geometry of type "frame"',
            )
        if isinstance(geometry, FrameGeometry):
            for name in requested.members or ():
                check_name(name, geometry.members, "member", "section_forces.members")
        for key, names in (("stations", requested.fractions), ("cuts", requested.cuts)):
            for name in names:
                if not _SECTION_NAME.fullmatch(name):
                    raise InputError(
                        f"found the name {name!r}",
                        place=f"section_forces.{key}",
                        expected="letters, digits, _ and -, a letter first",
                    )
        for name, cut in requested.cuts.items():
            for marker in cut.markers or ():
                place = f"section_forces.cuts.{name}.markers"
                check_name(marker, self.markers, "marker", place)
        return self

    @model_validator(mode="after")
    def _choices_have_effect(self) -> Self:
        """Elements have the choices that the discretisation makes for them."""
        chosen = self.discretisation
        given = chosen.model_fields_set
        if chosen.type in ("hex20", "tet4", "tet10") and "formulation" in given:
            raise InputError(
                f"is not for {chosen.type}, which has no incompatible modes",
                place="discretisation.formulation",
                expected="hex8, or no formulation",
            )
        is_volume = isinstance(chosen, IgaDiscretisation) and len(chosen.degrees) == 3
        if is_volume and "state" in given:
            raise InputError(
                "is not for a volume",
                place="discretisation.state",
                expected="a plane patch, or no state",
            )
        return self

    @model_validator(mode="after")
    def _references(self) -> Self:
        edges = self.geometry.edge_names
        for name in self.frame.clamped_edges:
            check_name(name, edges, "edge", "frame.clamp")
        for name in self.frame.marker_names:
            check_name(name, self.markers, "marker", "frame.marker")
        check_reduction(self.reduction, self.markers, edges)
        for name in self.stiffening.marker_names if self.stiffening else ():
            check_name(name, self.markers, "marker", "stiffening")
        for name in (self.stress and self.stress.markers) or ():
            check_name(name, self.markers, "marker", "stress.markers")
        for name, marker in self.markers.items():
            place = f"markers.{name}"
            _check_place(marker, place, self.geometry)
            if marker.edge is not None:
                check_name(marker.edge, edges, "edge", f"{place}.edge")
            for tied in marker.tie.names if marker.tie else ():
                check_name(tied, edges, "edge", f"{place}.tie.to")
        check_node_numbers({name: m.node for name, m in self.markers.items()})
        return self


def read_model(path: str | Path, changes: Mapping[str, Any] | None = None) -> ModelFile:
    """Read a model file (TOML, or JSON by its ending), with `changes` as in
    `ModelFile.with_`.

    Raises
    ------
    InputError : names the file, the key, what was found and what was expected.
    """
    return ModelFile.load(path, changes)


def _check_place(marker: NodeMarker, place: str, geometry: Geometry) -> None:
    ways = ("edge", "parameters", "position", "mesh_node", "point", "member")
    given = [way for way in ways if getattr(marker, way) is not None]
    if marker.at == "axis":
        if given or marker.tie is None:
            raise InputError(
                'at = "axis" is given with another position or without a tie',
                place=place,
                expected='at = "axis" and tie = { type = ..., to = ... } alone',
            )
        return
    if isinstance(geometry, FrameGeometry):
        _check_place_in_frame(marker, place, geometry, given)
        return
    if {"point", "member"} & {*given}:
        raise InputError(
            "is for frames",
            place=f"{place}.{given[-1]}",
            expected='a geometry of type "frame"',
        )
    if len(given) != 1 and (given or marker.tie is None):
        raise InputError(
            f"gives {' and '.join(given) or 'no place'}",
            place=place,
            expected="exactly one of edge (with at), parameters, position, mesh_node",
        )
    end_of_beam = isinstance(geometry, BeamGeometry) and marker.edge is not None
    end_of_beam = end_of_beam and marker.at is None
    if (marker.edge is None) != (marker.at is None) and not end_of_beam:
        raise InputError(
            "edge and at do not come together",
            place=place,
            expected='for example edge = "left", at = 0.5, or the end of a beam alone',
        )


def _check_place_in_frame(
    marker: NodeMarker, place: str, geometry: FrameGeometry, given: list[str]
) -> None:
    alone = marker.tie is not None and given in ([], ["position"])
    if not alone and given not in (["point"], ["member"]):
        raise InputError(
            f"gives {' and '.join(given) or 'no place'}",
            place=place,
            expected="a point, or a member with at; of a tied marker a position",
        )
    if marker.point is not None:
        check_name(marker.point, geometry.points, "point", f"{place}.point")
    if marker.member is not None:
        check_name(marker.member, geometry.members, "member", f"{place}.member")
    if (marker.member is not None) != isinstance(marker.at, float):
        raise InputError(
            "member and at do not come together",
            place=place,
            expected='for example member = "boom", at = 0.5',
        )
