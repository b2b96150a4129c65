"""Joints of a scene and their friction.

A new kind of joint is one class and one entry in `Joint`.

Drives: prescribe a coordinate of a joint or marker by a function or a law.
"""

from typing import Annotated, ClassVar, Literal, get_args

from numpy.typing import ArrayLike

from ..toml.tables import (
    Entries,
    Field,
    Number,
    Numbers,
    OptionalNumber,
    OptionalTexts,
    Takes,
    Texts,
    TwoTexts,
)
from .base import Table, Vector, Vector3
from .laws import Expression, ForceFunction, Pid, states_of

#: Coordinates of a marker that a drive may prescribe, by dimension of the scene.
MARKER_COORDINATES = {
    "planar": ("x", "y", "angle"),
    "spatial": ("x", "y", "z", "rotation"),
}

_MARKERS = "two markers, as BODY.MARKER or ground or ground.MARKER"


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


class _Joint(Table):
    #: what the joint leaves free that a drive may prescribe; the first is the default
    coordinates: ClassVar[tuple[str, ...]] = ()
    #: kinds of scene that know it
    dimensions: ClassVar[tuple[str, ...]] = ("planar", "spatial")


class _Pair(_Joint):
    markers: TwoTexts = Field(description=_MARKERS)


class _AxialJoint(_Pair):
    #: where the axis points if the file does not say
    default_axis: ClassVar[tuple[float, float, float]] = (1.0, 0.0, 0.0)
    #: planar scenes know the axis already: it is z
    axis_is_normal: ClassVar[bool] = False

    axis: Takes[Vector | None, ArrayLike | None] = Field(
        default=None, description="direction in the first marker's frame"
    )


class _OrientingJoint(_AxialJoint):
    second_axis: Takes[Vector | None, ArrayLike | None] = Field(
        default=None,
        description="the axis in the second marker's frame; default that of the start "
        "where `initial` states how both bodies are turned, else as `axis`",
    )


class _JointWithFriction(_AxialJoint):
    friction: Takes[JointFriction | None, JointFriction | Entries | None] = Field(
        default=None, description="dry friction from the load of the joint"
    )


class Fixed(_Pair):
    """No relative motion of the two markers, which have one place, and the axes that
    `initial` states for both bodies, else the same; of a point mass, which has no
    orientation, its place is held."""

    type: Literal["fixed"] = "fixed"


class Revolute(_JointWithFriction, _OrientingJoint):
    """Rotation about `axis`, default z. The coordinate is the angle [rad]."""

    coordinates: ClassVar[tuple[str, ...]] = ("angle",)
    default_axis: ClassVar[tuple[float, float, float]] = (0.0, 0.0, 1.0)
    axis_is_normal: ClassVar[bool] = True
    type: Literal["revolute"] = "revolute"


class Prismatic(_JointWithFriction, _OrientingJoint):
    """Translation along `axis`, default x, no rotation; displacement [m]."""

    coordinates: ClassVar[tuple[str, ...]] = ("displacement",)
    type: Literal["prismatic"] = "prismatic"


class Cylindrical(_OrientingJoint):
    """Rotation about and translation along `axis`, default z."""

    coordinates: ClassVar[tuple[str, ...]] = ("angle", "displacement")
    default_axis: ClassVar[tuple[float, float, float]] = (0.0, 0.0, 1.0)
    dimensions: ClassVar[tuple[str, ...]] = ("spatial",)
    type: Literal["cylindrical"] = "cylindrical"


class Screw(_OrientingJoint):
    """Rotation about `axis`, default z, that moves along it by `pitch` in a turn: a nut
    on a spindle. A drive prescribes one of both coordinates."""

    coordinates: ClassVar[tuple[str, ...]] = ("angle", "displacement")
    default_axis: ClassVar[tuple[float, float, float]] = (0.0, 0.0, 1.0)
    dimensions: ClassVar[tuple[str, ...]] = ("spatial",)
    type: Literal["screw"] = "screw"
    pitch: Number = Field(
        description="displacement in one turn [m], negative for a left-hand thread"
    )
    offset: OptionalNumber = Field(
        default=None,
        description="displacement at the angle zero [m], up to whole pitches, default "
        "that of the start",
    )


class Spherical(_Pair):
    """The two origins coincide; all rotations are free."""

    dimensions: ClassVar[tuple[str, ...]] = ("spatial",)
    type: Literal["spherical"] = "spherical"


class Universal(_AxialJoint):
    """The origins coincide; `axis` of the first marker stays at right angles to
    `second_axis` of the second one (Cardan, Hooke).

    With the frames of the markers aligned both angles are zero: `angle_1` turns about
    `axis`, `angle_2` about `second_axis`. Defaults are x and y.
    """

    coordinates: ClassVar[tuple[str, ...]] = ("angle_1", "angle_2")
    dimensions: ClassVar[tuple[str, ...]] = ("spatial",)
    type: Literal["universal"] = "universal"
    second_axis: Takes[Vector | None, ArrayLike | None] = Field(
        default=None,
        description="direction in the second marker's frame, at right angles to `axis`",
    )


class PlanarJoint(_OrientingJoint):
    """The second marker slides on the plane through the first one across `axis`,
    default z, and turns about it."""

    coordinates: ClassVar[tuple[str, ...]] = ("angle",)
    default_axis: ClassVar[tuple[float, float, float]] = (0.0, 0.0, 1.0)
    dimensions: ClassVar[tuple[str, ...]] = ("spatial",)
    type: Literal["planar"] = "planar"


class PointOnLine(_JointWithFriction):
    """The second marker's origin stays on the first one's `axis`, default x."""

    coordinates: ClassVar[tuple[str, ...]] = ("displacement",)
    type: Literal["point_on_line"] = "point_on_line"


class PointOnPlane(_AxialJoint):
    """The second marker's origin stays on the plane through the first one across
    `axis`, default z; all rotations are free."""

    default_axis: ClassVar[tuple[float, float, float]] = (0.0, 0.0, 1.0)
    dimensions: ClassVar[tuple[str, ...]] = ("spatial",)
    type: Literal["point_on_plane"] = "point_on_plane"


class Coincident(_Pair):
    """The two origins coincide; all rotations are free."""

    type: Literal["coincident"] = "coincident"


class Distance(_Pair):
    """The two origins keep their distance: a massless rod with ball joints.

    The distance is `length`, or that of the assembled start.
    """

    coordinates: ClassVar[tuple[str, ...]] = ("length",)
    type: Literal["distance"] = "distance"
    length: OptionalNumber = Field(default=None, gt=0, description="[m]")


class _Coupled(_Joint):
    """Coordinates of other joints, angles and displacements, depend on each other."""

    coordinate: OptionalTexts = Field(
        default=None, description="one for each joint, default the first it has"
    )
    offset: OptionalNumber = Field(
        default=None, description="constant of the sum, default that of the start"
    )


class Gear(_Coupled):
    """The coordinate of the second joint is `ratio` times that of the first plus
    `offset`, which is taken from the assembled start if it is not given.

    Angles in spatial scenes need a ratio of whole numbers, such as of teeth.
    """

    type: Literal["gear"] = "gear"
    joints: TwoTexts = Field(description="names of two joints")
    ratio: Number = Field(
        description="of the second coordinate to the first, negative for wheels that "
        "mesh outside"
    )


class Coupling(_Coupled):
    """The sum of the coordinates of `joints`, times `weights`, is `offset`: a
    differential, a planetary gear, a rack, a screw."""

    type: Literal["coupling"] = "coupling"
    joints: Texts = Field(min_length=2, description="names of joints")
    weights: Numbers = Field(description="one for each joint")


Joint = Annotated[
    Fixed
    | Revolute
    | Prismatic
    | Cylindrical
    | Screw
    | Spherical
    | Universal
    | PlanarJoint
    | PointOnLine
    | PointOnPlane
    | Coincident
    | Distance
    | Gear
    | Coupling,
    Field(discriminator="type"),
]


#: Coordinates of all joints.
COORDINATES = frozenset(
    name for kind in get_args(get_args(Joint)[0]) for name in kind.coordinates
)


def driven_coordinate(drive: Drive, joints: dict[str, Joint]) -> str:
    """The coordinate that a drive prescribes."""
    if drive.coordinate is not None:
        return drive.coordinate
    assert drive.joint is not None
    return joints[drive.joint].coordinates[0]


def marker_names(joint: Joint) -> tuple[str, ...]:
    """The markers that a joint connects; a coupling has those of its joints."""
    return getattr(joint, "markers", ())


def coupled_coordinates(
    joint: Gear | Coupling, joints: dict[str, Joint]
) -> list[tuple[str, str, float]]:
    """(joint, coordinate, weight) of each term of a coupling."""
    weights = (-joint.ratio, 1.0) if isinstance(joint, Gear) else joint.weights
    names = joint.coordinate or tuple(
        joints[name].coordinates[0] for name in joint.joints
    )
    return list(zip(joint.joints, names, weights, strict=True))
