"""Joints as short tables of primitive constraints between two markers.

A `Row` is one primitive of `kernels.layout`. One entry in `JOINTS` adds a joint.
Directions are given in the frame of the first marker.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from formats.scene import Joint, as_3d
from formats.sid import Array

from .kernels.layout import ALONG, ANGLE, COINCIDENT, PERPENDICULAR


@dataclass(frozen=True)
class Primitive:
    """A primitive constraint: its kind, its numbers, and whether a drive moves it."""

    kind: int
    data: tuple[float, ...] = ()
    driven: bool = False


def planar_primitives(joint: Joint, driven: bool) -> list[Primitive]:
    """Primitives of a planar joint; ALONG holds the angle of its direction."""
    return PLANAR[joint.type](planar_axis(joint), driven)


def spatial_primitives(joint: Joint, driven: bool) -> list[Primitive]:
    """Primitives of a spatial joint; directions are unit vectors."""
    return SPATIAL[joint.type](spatial_axis(joint), driven)


def planar_axis(joint: Joint) -> float:
    axis = getattr(joint, "axis", None)
    return math.atan2(axis[1], axis[0]) if axis else 0.0


def spatial_axis(joint: Joint) -> Array:
    """Unit direction of a joint, in the first marker's frame."""
    default = (0.0, 0.0, 1.0) if joint.type == "revolute" else (1.0, 0.0, 0.0)
    axis = as_3d(getattr(joint, "axis", None) or default)
    return axis / np.linalg.norm(axis)


def normals(axis: Array) -> tuple[Array, Array]:
    """Two unit vectors that complete `axis` to a right-handed frame."""
    helper = np.eye(3)[int(np.argmin(abs(axis)))]
    first = np.cross(helper, axis)
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)


_POINT = [Primitive(COINCIDENT)]


def _planar_revolute(axis: float, driven: bool) -> list[Primitive]:
    turn = [Primitive(ANGLE, (0.0,), driven=True)] if driven else []
    return _POINT + turn


def _planar_prismatic(axis: float, driven: bool) -> list[Primitive]:
    slide = [Primitive(ALONG, (axis, 0.0), driven=True)] if driven else []
    guide = Primitive(ALONG, (axis + 0.5 * math.pi, 0.0))
    return [guide, Primitive(ANGLE, (0.0,)), *slide]


PLANAR: dict[str, Callable[[float, bool], list[Primitive]]] = {
    "fixed": lambda axis, driven: [*_POINT, Primitive(ANGLE, (0.0,))],
    "revolute": _planar_revolute,
    "prismatic": _planar_prismatic,
    "point_on_line": lambda axis, driven: [
        Primitive(ALONG, (axis + 0.5 * math.pi, 0.0))
    ],
    "coincident": lambda axis, driven: list(_POINT),
}


def _no_rotation(about: Array | None = None) -> list[Primitive]:
    """Perpendicular axes: all three rotations locked, or all but one about an axis."""
    if about is None:
        x, y, z = np.eye(3)
        pairs = [(x, y), (y, z), (z, x)]
    else:
        first, second = normals(about)
        pairs = [(first, about), (second, about)]
    return [Primitive(PERPENDICULAR, (*a, *b)) for a, b in pairs]


def _spatial_revolute(axis: Array, driven: bool) -> list[Primitive]:
    first, second = normals(axis)
    turn = [Primitive(ANGLE, (*first, *second), driven=True)] if driven else []
    return [*_POINT, *_no_rotation(axis), *turn]


def _spatial_prismatic(axis: Array, driven: bool) -> list[Primitive]:
    slide = [Primitive(ALONG, (*axis, 0.0), driven=True)] if driven else []
    return [*_on_line(axis), *_no_rotation(), *slide]


def _on_line(axis: Array) -> list[Primitive]:
    return [Primitive(ALONG, (*normal, 0.0)) for normal in normals(axis)]


SPATIAL: dict[str, Callable[[Array, bool], list[Primitive]]] = {
    "fixed": lambda axis, driven: [*_POINT, *_no_rotation()],
    "revolute": _spatial_revolute,
    "prismatic": _spatial_prismatic,
    "point_on_line": lambda axis, driven: _on_line(axis),
    "coincident": lambda axis, driven: list(_POINT),
}
