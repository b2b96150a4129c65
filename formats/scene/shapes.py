"""Shapes of rigid bodies, for pictures: they have no part in the motion."""

from typing import Annotated, Literal

from numpy.typing import ArrayLike

from ..toml.constructor_types import Entries, Field, Number, Takes
from .base import Placement, Table, Vector3


class Marker(Placement):
    """A frame fixed to a rigid body or to the ground, in the body frame."""


class PlacedShape(Table):
    """A shape with its own frame in the body frame."""

    placement: Takes[Marker, Marker | Entries] = Field(
        default=Marker(), description="its position and orientation in the body frame"
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
