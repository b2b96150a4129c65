"""Friction of a joint, from the load that the joint carries."""

from __future__ import annotations

from ..toml.constructor_types import Field, Number, OptionalNumber
from .base import Table


class JointFriction(Table):
    """Dry friction of a joint, from the load that it carries at each instant.

    The load N is the size of the joint's force across its axis. While the joint slides
    with the speed v, friction is mu(v) N against v, in a revolute joint times `radius`,
    with mu(v) = coefficient + (static - coefficient) exp(-(v / stribeck_velocity)^2).
    At rest the joint sticks, without creep, as long as that takes no more than
    static N (times `radius`); the instants of both are found inside the steps. Where
    drives prescribe the motion of the joint their force contains its friction, and at
    rest the drives hold it alone.
    """

    coefficient: Number = Field(ge=0, description="of sliding (kinetic) friction, mu")
    static: OptionalNumber = Field(
        default=None,
        ge=0,
        description="coefficient that holds the joint at rest, at least `coefficient`, "
        "which is the default",
    )
    stribeck_velocity: OptionalNumber = Field(
        default=None,
        gt=0,
        description="speed of the surfaces [m/s] over which friction falls from "
        "`static` to `coefficient`; default at once",
    )
    radius: OptionalNumber = Field(
        default=None, gt=0, description="of the pin of a revolute joint [m]"
    )
    length: OptionalNumber = Field(
        default=None,
        gt=0,
        description="of the guide or bearing [m], whose middle is the second marker: "
        "moments across the axis load its two ends; default only forces count",
    )
    viscous: Number = Field(
        default=0.0,
        ge=0,
        description="resistance to the rate of the coordinate [N s/m], [N m s/rad]",
    )
