"""Drives: a coordinate of a joint or of a marker as a function of time."""

from __future__ import annotations

from pydantic import Field

from .base import Table
from .functions import Function
from .joints import Joint

#: Coordinates of a marker that a drive may prescribe, by dimension of the scene.
MARKER_COORDINATES = {"planar": ("x", "y", "angle"), "spatial": ("x", "y", "z")}


class Drive(Table):
    """Prescribes a coordinate of `joint`, or of `marker` seen from `reference`."""

    joint: str | None = Field(default=None, description="name of a joint")
    marker: str | None = Field(default=None, description="as BODY.MARKER")
    reference: str = Field(default="ground", description="another marker, for `marker`")
    coordinate: str | None = Field(
        default=None,
        description="such as angle, displacement, length or x; default the joint's "
        "first",
    )
    function: Function


def driven_coordinate(drive: Drive, joints: dict[str, Joint]) -> str:
    """The coordinate that a drive prescribes."""
    if drive.coordinate is not None:
        return drive.coordinate
    assert drive.joint is not None
    return joints[drive.joint].coordinates[0]
