"""Drives: prescribe a coordinate of a joint or marker by a function or a law."""

from typing import Literal

from numpy.typing import ArrayLike

from ..toml.constructor_types import (
    Entries,
    Field,
    Number,
    Takes,
)
from .base import Table, Vector3
from .joints import Joint
from .laws import Expression, ForceFunction, Pid, states_of

#: Coordinates of a marker that a drive may prescribe, by dimension of the scene.
MARKER_COORDINATES = {
    "planar": ("x", "y", "angle"),
    "spatial": ("x", "y", "z", "rotation"),
}


class Drive(Table):
    """Prescribes a coordinate of `joint`, or of `marker` seen from `reference`.

    `rotation` of a marker in space is its whole orientation: that of the reference,
    turned about `axis` by the function of time.

    The function may be a law of outputs of the motion, with states of its own: a servo
    with a reference model. A motion has accelerations, so that with `of = "value"` the
    formula has to have two derivatives that are known without accelerations: a state
    x with x' = v, v' = ..., or a first-order lag of a position. With `of = "rate"` or
    "acceleration" the law, or a function of time, gives these; what they add up to are
    the states `value` and `rate` of the law, which it may read.
    """

    joint: str | None = Field(default=None, description="name of a joint")
    marker: str | None = Field(default=None, description="as BODY.MARKER")
    reference: str = Field(default="ground", description="another marker, for `marker`")
    coordinate: str | None = Field(
        default=None,
        description="such as angle, displacement, length, x or rotation; default the "
        "joint's first",
    )
    axis: Takes[Vector3 | None, ArrayLike | None] = Field(
        default=None, description="of a rotation, in the axes of the reference"
    )
    of: Literal["value", "rate", "acceleration"] = Field(
        default="value", description="what the function gives of the coordinate"
    )
    start: Number = Field(
        default=0.0, description="of a rate or an acceleration: the value at the start"
    )
    start_rate: Number = Field(
        default=0.0, description="of an acceleration: the rate at the start"
    )
    function: Takes[ForceFunction, ForceFunction | Entries]

    @property
    def has_law(self) -> bool:
        """Whether the motion is not known before the run."""
        return self.of != "value" or isinstance(self.function, Expression | Pid)

    @property
    def integrated(self) -> tuple[str, ...]:
        """Names of the states that a rate or an acceleration adds up to."""
        return {"value": (), "rate": ("value",), "acceleration": ("value", "rate")}[
            self.of
        ]

    @property
    def states(self) -> tuple[str, ...]:
        """Names of all states."""
        return (*states_of(self.function), *self.integrated)


def driven_coordinate(drive: Drive, joints: dict[str, Joint]) -> str:
    """The coordinate that a drive prescribes."""
    if drive.coordinate is not None:
        return drive.coordinate
    assert drive.joint is not None
    return joints[drive.joint].coordinates[0]
