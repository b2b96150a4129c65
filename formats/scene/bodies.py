"""Bodies of a scene: rigid bodies, flexible bodies with a SID, and their damping.

Shapes of rigid bodies, for pictures: they have no part in the motion.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from numpy.typing import ArrayLike
from pydantic import (
    BeforeValidator,
    Discriminator,
    Tag,
    field_validator,
    model_validator,
)

from ..base.sid import SID
from ..damping import RayleighDamping
from ..toml.tables import Entries, Field, Number, OptionalNumbers, Takes
from .base import AngularVelocity, Inertia, Placement, Table, Vector, Vector3


class Marker(Placement):
    """A frame fixed to a rigid body or to the ground, in the body frame."""


class PlacedShape(Table):
    """A shape with its own frame in the body frame."""

    placement: Takes[Marker, Marker | Entries] = Field(
        default=Marker.model_construct(),
        description="its position and orientation in the body frame",
    )


class Box(PlacedShape):
    """A box about its origin."""

    type: Literal["box"] = "box"
    size: Takes[Vector3, ArrayLike] = Field(description="edges along x, y and z [m]")


class Cylinder(PlacedShape):
    """A cylinder about its origin, around its z axis."""

    type: Literal["cylinder"] = "cylinder"
    radius: Number = Field(gt=0, description="[m]")
    length: Number = Field(gt=0, description="along its z axis [m]")


class Sphere(PlacedShape):
    """A sphere about its origin."""

    type: Literal["sphere"] = "sphere"
    radius: Number = Field(gt=0, description="[m]")


class SurfaceMesh(PlacedShape):
    """Triangles of an STL file."""

    type: Literal["mesh"] = "mesh"
    file: str = Field(
        min_length=1,
        description="STL file, relative to the scene file, and for pictures to the "
        "result or the working folder",
    )
    scale: Number = Field(
        default=1.0, gt=0, description="of its coordinates, 1e-3 for millimetres"
    )


Shape = Annotated[Box | Cylinder | Sphere | SurfaceMesh, Field(discriminator="type")]


Values = tuple[Annotated[float, Field(ge=0)], ...]


class SidDamping(Table):
    """The matrix De of the SID."""

    type: Literal["sid"] = "sid"


def _numbers(value: Any) -> Any:
    single = isinstance(value, int | float) and not isinstance(value, bool)
    if single:
        return (float(value),)
    return tuple(value) if isinstance(value, list) else value


class ModalDamping(Table):
    """A share of the critical damping for each natural mode of Me and Ke.

    One value holds for all modes; several are for the modes by growing frequency. These
    are the modes of the body whose frame is held: in mean axes those of the free body.
    """

    type: Literal["modal"] = "modal"
    ratio: Annotated[
        Values,
        BeforeValidator(_numbers, json_schema_input_type=float | Values),
        Field(min_length=1, description="damping ratio of all or of each mode"),
    ]


class FrequencyDamping(Table):
    """The default of commercial codes: by the frequency of each natural mode.

    1 % of the critical damping up to 100 Hz, 10 % up to 1000 Hz, critical beyond.
    """

    type: Literal["frequency"] = "frequency"


Damping = Annotated[
    SidDamping | RayleighDamping | ModalDamping | FrequencyDamping,
    Field(discriminator="type"),
]


if TYPE_CHECKING:
    from ..model import ModelFile
else:
    ModelFile = Any  # costs scenes without one its time to be imported


def _as_text(value: Any) -> Any:
    return str(value) if isinstance(value, int) and value is not True else value


#: Node ids are integers in most files and texts in some.
NodeId = Annotated[str, BeforeValidator(_as_text, json_schema_input_type=int | str)]


class Initial(Placement):
    """Where a body starts; the assembly moves it unless it is `fixed`.

    Velocities that are not stated are zero, or what joints and drives make of others.
    """

    velocity: Takes[Vector | None, ArrayLike | None] = Field(
        default=None, description="of the frame's origin, in inertial axes [m/s]"
    )
    angular_velocity: Takes[AngularVelocity | None, ArrayLike | None] = Field(
        default=None, description="in inertial axes [rad/s]"
    )
    fixed: bool = Field(
        default=False, description="true: the assembly must not move it"
    )


class ElasticInitial(Initial):
    """Where a flexible body starts; elastic coordinates default to zero."""

    elastic: OptionalNumbers = Field(
        default=None, description="elastic coordinates that are kept"
    )
    elastic_velocity: OptionalNumbers = Field(
        default=None, description="velocities of the elastic coordinates"
    )


class RigidBody(Table):
    """A rigid body; without `inertia` a point mass, which does not rotate."""

    mass: Number = Field(
        gt=0, description="the mass [kg] of a rigid body (or `sid` for a flexible one)"
    )
    inertia: Takes[Inertia | None, ArrayLike | None] = Field(
        default=None,
        description="about the centre of mass [kg m2]: zz, [xx, yy, zz] or 3 x 3",
    )
    centre_of_mass: Takes[Vector | None, ArrayLike | None] = Field(
        default=None, description="in the body frame [m], default its origin"
    )
    markers: Takes[dict[str, Marker], Mapping[str, Marker | Entries]] = Field(
        default_factory=dict
    )
    initial: Takes[Initial, Initial | Entries] = Field(
        default=Initial.model_construct()
    )
    shape: Takes[Shape | None, Shape | Entries | None] = Field(
        default=None,
        description="how pictures and exports show it; default lines "
        "between its markers, or a box with the proportions of its inertia",
    )


class SidBody(Table):
    """A flexible body: any SID file. Its markers are nodes of that file.

    Its elastic force is ksigma + Ke(q) q, also with a first-order term of Ke, if that
    has an energy. First-order terms of Me, De and ksigma are refused.

    In Python `sid` may be a SID, and `model` a Model, which is converted as it is.
    """

    sid: Takes[str, str | SID] = Field(
        default="", min_length=1, description="SID file, relative to the scene file"
    )
    model: Takes[str | None, str | ModelFile | None] = Field(
        default=None,
        min_length=1,
        description="model file that the body is made of, in place of `sid`: "
        "every command converts it once and keeps the SID in a folder .sidtool beside "
        "the scene; with [accuracy] wanted mesh and shape functions are refined as far "
        "as needed",
    )
    markers: Takes[dict[str, NodeId], Mapping[str, int | str]] = Field(
        default_factory=dict, description="names for nodes of the SID"
    )
    initial: Takes[ElasticInitial, ElasticInitial | Entries] = Field(
        default=ElasticInitial.model_construct()
    )
    frame: Literal["free", "held"] = Field(
        default="free",
        description="held: the body frame stays where it starts, whatever its nodes; "
        "also for a SID whose body cannot move freely",
    )
    rigid: bool = Field(
        default=False,
        description="true: of the SID only mass, inertia and the places of nodes "
        "count; elastic coordinates and stresses are then not recorded",
    )
    quadratic_inertia: bool | None = Field(
        default=None,
        description="keep the term q.Me.q of the moments of inertia; default where the "
        "mass matrix would not stay positive without it at deformations of a tenth of "
        "the size; a body with geometric stiffening by acceleration always has it",
    )
    shape_functions: Takes[
        tuple[Annotated[int, Field(ge=1)], ...] | None, Sequence[int] | None
    ] = Field(
        default=None,
        min_length=1,
        description="numbers of those that are kept, from 1 as in the SID, default "
        "all; the body does not move in the others, and q1, q2, ... keep their numbers",
    )
    geometric_stiffening: bool = Field(
        default=True,
        description="false: without the terms of geometric stiffening that the SID "
        "holds; in space for shape functions that each move along one axis alone",
    )
    damping: Takes[Damping | None, Damping | Entries | None] = Field(
        default=None, description="of the elastic coordinates, default that of the SID"
    )

    @model_validator(mode="after")
    def _has_sid_or_model(self) -> Self:
        if not self.sid and self.model is None:
            raise ValueError("the name of a SID file, or of a model file as `model`")
        return self

    @field_validator("shape_functions")
    @classmethod
    def _numbers_are_distinct(
        cls, numbers: tuple[int, ...] | None
    ) -> tuple[int, ...] | None:
        if numbers is not None and len(set(numbers)) < len(numbers):
            raise ValueError("each number once")
        return numbers

    def numbers(self, nq: int) -> tuple[int, ...]:
        """Numbers from 1 of the elastic coordinates, of a SID that has nq."""
        if self.rigid:
            return ()
        return (
            tuple(range(1, nq + 1))
            if self.shape_functions is None
            else tuple(sorted(self.shape_functions))
        )


def _kind_of_body(value: Any) -> str:
    if isinstance(value, RigidBody | SidBody):
        return "flexible body" if isinstance(value, SidBody) else "rigid body"
    flexible = isinstance(value, dict) and ("sid" in value or "model" in value)
    return "flexible body" if flexible else "rigid body"


Body = Annotated[
    Annotated[RigidBody, Tag("rigid body")] | Annotated[SidBody, Tag("flexible body")],
    Discriminator(_kind_of_body),
]


class Ground(Table):
    """The inertial frame; its markers are fixed."""

    markers: Takes[dict[str, Marker], Mapping[str, Marker | Entries]] = Field(
        default_factory=dict
    )
