"""Rotations as vectors: axis times angle."""

from __future__ import annotations

import numpy as np

from sidtool.formats.scene import Placement, rotation
from sidtool.formats.sid import Array

from .packing import quaternion


def rotation_matrix(vector: Array) -> Array:
    """Of a rotation vector [rad], (3, 3)."""
    return rotation(Placement(axis_angle=tuple(vector)))


def rotation_vector(matrix: Array) -> Array:
    """Axis times angle [rad] of a rotation matrix, (3,)."""
    q = quaternion(matrix)
    size = float(np.linalg.norm(q[1:]))
    return q[1:] * (2.0 * np.arctan2(size, q[0]) / size if size > 0.0 else 2.0)


def shortest_rotation(source: Array, target: Array) -> Array:
    """The smallest rotation of one unit vector onto another, (3, 3)."""
    across = np.cross(source, target)
    size = np.linalg.norm(across)
    angle = np.arctan2(size, source @ target)
    if size < 1e-12:
        across = np.cross(target, np.eye(3)[int(np.argmin(abs(target)))])
        size = np.linalg.norm(across)
    return rotation_matrix(angle * across / size)
