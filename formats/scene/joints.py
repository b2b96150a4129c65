"""Joints of a scene. A new kind is one class and one entry in `Joint`."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from .base import Table, Vector

_MARKERS = "two markers, as BODY.MARKER or ground or ground.MARKER"


class _Joint(Table):
    #: what the joint leaves free that a drive may prescribe
    coordinate: ClassVar[str | None] = None
    #: kinds of scene that know it
    dimensions: ClassVar[tuple[str, ...]] = ("planar", "spatial")

    markers: tuple[str, str] = Field(description=_MARKERS)


class _AxialJoint(_Joint):
    axis: Vector | None = Field(
        default=None, description="direction in the first marker's frame"
    )


class Fixed(_Joint):
    """No relative motion of the two markers."""

    type: Literal["fixed"]


class Revolute(_AxialJoint):
    """Rotation about `axis`, default z. The coordinate is the angle [rad]."""

    coordinate: ClassVar[str | None] = "angle"
    type: Literal["revolute"]


class Prismatic(_AxialJoint):
    """Translation along `axis`, default x, no rotation; displacement [m]."""

    coordinate: ClassVar[str | None] = "displacement"
    type: Literal["prismatic"]


class PointOnLine(_AxialJoint):
    """The second marker's origin stays on the first one's `axis`, default x."""

    type: Literal["point_on_line"]


class Coincident(_Joint):
    """The two origins coincide; all rotations are free."""

    type: Literal["coincident"]


Joint = Annotated[
    Fixed | Revolute | Prismatic | PointOnLine | Coincident,
    Field(discriminator="type"),
]
