"""Base types of a scene file: strict tables, vectors, orientations."""

from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator

from ..toml.tables import Field, Number, OptionalNumber, OptionalNumbers, Table, Takes

Vector = Annotated[tuple[float, ...], Field(min_length=2, max_length=3)]
Vector3 = tuple[float, float, float]
Matrix3 = tuple[Vector3, Vector3, Vector3]
Quaternion = tuple[float, float, float, float]


def _number_or_vector(value: Any) -> Any:
    if _is_number(value) or _is_vector(value):
        return as_tuples(value)
    raise ValueError("a number (planar) or three numbers (spatial)")


def _inertia(value: Any) -> Any:
    rows = isinstance(value, list | tuple) and len(value) == 3
    if _is_number(value) or _is_vector(value) or (rows and all(map(_is_vector, value))):
        return as_tuples(value)
    raise ValueError("a number (planar), or [xx, yy, zz] or a 3 x 3 matrix (spatial)")


def as_tuples(value: Any) -> Any:
    """Convert lists to tuples: strict tuples accept no lists after a validator."""
    return tuple(map(as_tuples, value)) if isinstance(value, list) else value


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_vector(value: Any) -> bool:
    listed = isinstance(value, list | tuple) and len(value) == 3
    return listed and all(map(_is_number, value))


#: Angular velocity [rad/s]: a number in planar scenes, three in spatial ones.
AngularVelocity = Annotated[float | Vector3, BeforeValidator(_number_or_vector)]
#: Inertia about the centre of mass [kg m2]: zz, principal values or the tensor.
Inertia = Annotated[float | Vector3 | Matrix3, BeforeValidator(_inertia)]


class Placement(Table):
    """A position and an orientation; at most one of the ways to say the latter."""

    position: Takes[Vector | None, ArrayLike | None] = Field(
        default=None, description="two or three coordinates [m]"
    )
    angle: OptionalNumber = Field(
        default=None, description="rotation in the plane [rad]"
    )
    axis_angle: Takes[Vector3 | None, ArrayLike | None] = Field(
        default=None, description="rotation vector: axis times angle [rad]"
    )
    quaternion: Takes[Quaternion | None, ArrayLike | None] = Field(
        default=None, description="w, x, y, z"
    )
    matrix: Takes[Matrix3 | None, ArrayLike | None] = Field(
        default=None, description="rotation matrix, rows; local to parent components"
    )


def position_3d(placement: Placement | None) -> NDArray[np.float64]:
    """Return the position [m] as (3,), zero by default."""
    return as_3d(None if placement is None else placement.position)


def as_3d(vector: tuple[float, ...] | None) -> NDArray[np.float64]:
    """Two or three components as (3,); the plane is z = 0, nothing is zero."""
    result = np.zeros(3)
    if vector is not None:
        result[: len(vector)] = vector
    return result


def orientation_matrix(placement: Placement | None) -> NDArray[np.float64]:
    """Orientation as a (3, 3) rotation matrix, local to parent components."""
    if placement is None:
        return np.eye(3)
    if placement.matrix is not None:
        left, _, right = np.linalg.svd(np.array(placement.matrix))
        return left @ right
    if placement.quaternion is not None:
        return _from_quaternion(np.array(placement.quaternion))
    if placement.axis_angle is not None:
        return rotation_matrix(np.array(placement.axis_angle))
    if not placement.angle:
        return np.eye(3)
    return rotation_matrix(np.array([0.0, 0.0, placement.angle]))


def rotation_matrix(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrix (3, 3) of a rotation vector [rad]."""
    half = np.linalg.norm(vector) / 2
    axis = vector * np.sinc(half / np.pi) / 2
    return _from_quaternion(np.array([np.cos(half), *axis]))


def _from_quaternion(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


class Time(Table):
    """The time span [s] and when the motion is recorded: at multiples of the
    `output_step`, or at `output_times`, of which analyses of one state need none."""

    start: Number = Field(default=0.0, description="start of the simulation [s]")
    end: Number = Field(description="end of the simulation [s]")
    output_step: OptionalNumber = Field(default=None, gt=0, description="[s]")
    output_times: OptionalNumbers = Field(
        default=None, min_length=1, description="[s], growing"
    )
