"""Forces of a scene. A new kind is one class and one entry in `Force`."""

from typing import Annotated, Any, ClassVar, Literal

from numpy.typing import ArrayLike
from pydantic import BeforeValidator

from ..toml.tables import Entries, Field, Number, OptionalTwoTexts, Takes, TwoTexts
from .base import AngularVelocity, Table, Vector
from .laws import ForceFunction

Values = tuple[float, ...]
#: Rows of a matrix.
Rows = tuple[Values, ...]

_MARKERS = "two markers: the force acts on the second, and backwards on the first"
_JOINT = "a joint instead of markers: the force acts on its coordinate"
_COORDINATE = "coordinate of the joint, such as angle, default the first it has"


def _numbers(value: Any) -> Any:
    """One number stands for a sequence of one."""
    single = isinstance(value, int | float) and not isinstance(value, bool)
    if single:
        return (float(value),)
    return tuple(value) if isinstance(value, list) else value


#: Coefficients of powers 1, 2, ...; a number alone is the linear one.
Powers = Annotated[
    Values,
    BeforeValidator(_numbers, json_schema_input_type=float | Values),
    Field(min_length=1),
]


class Characteristic(Table):
    """A table of forces: straight lines between its points, as stops and play have.

    `interpolation = "smooth"` makes one curve without corners and without overshoot of
    it: monotone piecewise cubic interpolation (F. N. Fritsch, R. E. Carlson, SIAM J.
    Numer. Anal. 17, 1980). Beyond its points the force goes on in a straight line, with
    the slope at the end.
    """

    deflection: Takes[Values, ArrayLike] = Field(
        min_length=2, description="growing, [m] or [rad]"
    )
    force: Takes[Values, ArrayLike] = Field(
        min_length=2, description="as many values, [N] or [N m]"
    )
    interpolation: Literal["linear", "smooth"] = Field(
        default="linear", description="between the points"
    )


class _Force(Table):
    #: keys that name markers, of which those for a pair may stand for a joint
    dimensions: ClassVar[tuple[str, ...]] = ("planar", "spatial")


class PointForce(_Force):
    """A force and a torque at a marker, with constant components times a function.

    `axes` are the directions of the components: the inertial ones, or those of the
    marker, which the force then follows.
    """

    type: Literal["force"] = "force"
    marker: str = Field(description="where it acts, as BODY.MARKER")
    force: Takes[Vector | None, ArrayLike | None] = Field(
        default=None, description="components [N]"
    )
    torque: Takes[AngularVelocity | None, ArrayLike | None] = Field(
        default=None, description="a number (planar) or three [N m]"
    )
    axes: Literal["inertial", "marker"] = Field(
        default="inertial", description="directions of the components"
    )
    function: Takes[ForceFunction | None, ForceFunction | Entries | None] = Field(
        default=None, description="of time or of outputs: scales both, default 1"
    )


class _Pair(_Force):
    markers: OptionalTwoTexts = Field(default=None, description=_MARKERS)
    joint: str | None = Field(default=None, description=_JOINT)
    coordinate: str | None = Field(default=None, description=_COORDINATE)


class SpringDamper(_Pair):
    """A spring and a damper along the line between two markers, or in a joint.

    With the deflection x = (length or joint coordinate) - rest the force that pulls
    back is k1 x + k2 x^2 + ... + d1 x' + d2 x'^2 + ..., or that of a `table`.

    A spring about an axis counts turns. What orientations leave open at the start of a
    spatial scene is the angle nearest to `rest`, or to that of a drive of the joint.
    """

    type: Literal["spring_damper"] = "spring_damper"
    rest: Number = Field(
        default=0.0, description="length [m], or coordinate, without force"
    )
    stiffness: Takes[Powers | None, ArrayLike | None] = Field(
        default=None, description="k1 or [k1, k2, ...] [N/m], [N m/rad]"
    )
    table: Takes[Characteristic | None, Characteristic | Entries | None] = Field(
        default=None, description="deflection and force, instead of stiffness"
    )
    damping: Takes[Powers | None, ArrayLike | None] = Field(
        default=None, description="d1 or [d1, d2, ...] [N s/m], [N m s/rad]"
    )


class Actuator(_Pair):
    """A force that pushes two markers apart, or drives a joint.

    It is a function of time, or of outputs of the motion: a formula (`expression`) or a
    controller (`pid`). In a joint, a force or torque in the direction in which its
    coordinate grows.
    """

    type: Literal["actuator"] = "actuator"
    rest: Number = Field(
        default=0.0,
        description="length [m], or coordinate, from which its `deflection` counts",
    )
    function: Takes[ForceFunction, ForceFunction | Entries]


class Bushing(_Force):
    """Springs and dampers along and about the axes of the first marker.

    Planar: x, y and the angle. Spatial: x, y, z and the three components of the
    rotation vector from the first to the second marker, which is at most half a turn at
    the start; a run stops before a full one (at 6 rad), where it has no direction.
    With `shaft` the second marker turns without limit about that axis of both markers:
    the angle about it counts, and of the tilts about the other two axes their sines.

    With matrices K and D the components of force and torque are -K q - D q', q the
    displacements and rotations in the same order: foundations, journal bearings. They
    need not be symmetric. What is not so of K is no potential, but supplies energy.
    """

    type: Literal["bushing"] = "bushing"
    markers: TwoTexts = Field(description=_MARKERS)
    stiffness: Takes[Values | Rows, ArrayLike] = Field(
        description="3 (planar) or 6 values, or a matrix, by rows [N/m], [N m/rad]"
    )
    damping: Takes[Values | Rows | None, ArrayLike | None] = Field(
        default=None,
        description="3 (planar) or 6 values, or a matrix, by rows [N s/m], [N m s/rad]",
    )
    shaft: Literal["x", "y", "z"] | None = Field(
        default=None, description="spatial: the axis about which full turns are made"
    )


class Friction(_Force):
    """Regularised Coulomb friction in a joint: force tanh(rate / speed) + viscous rate.

    Below `speed` a held joint creeps instead of sticking. The limit is given and does
    not follow the load: friction coefficient times normal force (times radius in a
    bearing) has to be put in as a number. Friction from the load, with stick, is a part
    of the joint itself, [joints.NAME.friction].
    """

    type: Literal["friction"] = "friction"
    joint: str = Field(description="a joint with a coordinate")
    coordinate: str | None = Field(default=None, description=_COORDINATE)
    force: Number = Field(gt=0, description="constant limit [N] or [N m]")
    speed: Number = Field(
        gt=0, description="width of the regularisation [m/s] or [rad/s]"
    )
    viscous: Number = Field(default=0.0, ge=0, description="[N s/m] or [N m s/rad]")


Force = Annotated[
    PointForce | SpringDamper | Actuator | Bushing | Friction,
    Field(discriminator="type"),
]
