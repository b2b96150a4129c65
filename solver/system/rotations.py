"""Vectors and rotations of the plane embedded in space; rotation vectors."""

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import Placement, orientation_matrix

from .sid_packing import quaternion


def to_3d(x: Array) -> Array:
    """Vectors (..., 3), of the plane in x and y; rotations of the plane (..., 1) turn
    about z."""
    count = x.shape[-1]
    x3 = np.zeros((*x.shape[:-1], 3))
    x3[..., slice(2, 3) if count == 1 else slice(count)] = x
    return x3


def to_rotation_matrices(R: Array) -> Array:
    """Rotation matrices (..., 3, 3) of what kernels keep: cosine and sine, or nine."""
    if R.shape[-1] == 9:
        return R.reshape(*R.shape[:-1], 3, 3)
    R3 = np.zeros((*R.shape[:-1], 3, 3))
    R3[..., 0, 0] = R3[..., 1, 1] = R[..., 0]
    R3[..., 1, 0], R3[..., 0, 1] = R[..., 1], -R[..., 1]
    R3[..., 2, 2] = 1.0
    return R3


def rotation_matrix(vector: Array) -> Array:
    """Of a rotation vector [rad], (3, 3)."""
    return orientation_matrix(Placement(axis_angle=tuple(vector)))


def rotation_vector(matrix: Array) -> Array:
    """Axis times angle [rad] of a rotation matrix, (3,)."""
    q = quaternion(matrix)
    size = float(np.linalg.norm(q[1:]))
    return q[1:] * (2.0 * np.arctan2(size, q[0]) / size if size > 0.0 else 2.0)


def shortest_rotation(source: Array, target: Array) -> Array:
    """The smallest rotation of one unit vector onto another, (3, 3)."""
    axis = np.cross(source, target)
    size = np.linalg.norm(axis)
    angle = np.arctan2(size, source @ target)
    if size < 1e-12:
        axis = np.cross(target, np.eye(3)[int(np.argmin(abs(target)))])
        size = np.linalg.norm(axis)
    return rotation_matrix(angle * axis / size)
