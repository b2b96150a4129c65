"""Drives: a coordinate of a joint or of a marker as a function of time."""

from __future__ import annotations

from pydantic import Field

from .base import Table, Vector3
from .joints import Joint
from .laws import ForceFunction

#: Coordinates of a marker that a drive may prescribe, by dimension of the scene.
MARKER_COORDINATES = {
    "planar": ("x", "y", "angle"),
    "spatial": ("x", "y", "z", "rotation"),
}


class Drive(Table):
    """Prescribes a coordinate of `joint`, or of `marker` seen from `reference`.

    `rotation` of a marker in space is its whole orientation: that of the reference,
    turned about `axis` by the function of time.
    """

    joint: str | None = Field(default=None, description="name of a joint")
    marker: str | None = Field(default=None, description="as BODY.MARKER")
    reference: str = Field(default="ground", description="another marker, for `marker`")
    coordinate: str | None = Field(
        default=None,
        description="such as angle, displacement, length, x or rotation; default the "
        "joint's first",
    )
    axis: Vector3 | None = Field(
        default=None, description="of a rotation, in the axes of the reference"
    )
    function: ForceFunction


def driven_coordinate(drive: Drive, joints: dict[str, Joint]) -> str:
    """The coordinate that a drive prescribes."""
    if drive.coordinate is not None:
        return drive.coordinate
    assert drive.joint is not None
    return joints[drive.joint].coordinates[0]
