"""What forces depend on at recorded states: their measures, and functions of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from formats.sid import Array

from .kernels import layout as at
from .kernels.drives import drive_value
from .motion import Motion, marker_motion
from .sampling import Samples
from .scene import System


class Measured(NamedTuple):
    """A measure of the motion of two markers and its rate, (nt,)."""

    g: Array
    rate: Array


def measured(system: System, samples: Samples, k: int) -> Measured:
    """The measure of row k of the force table, as in `kernels.planar_forces`."""
    row, element = system.arrays.force[k], system.forces[k]
    A = marker_motion(system, samples, int(row[at.F_A]))
    B = marker_motion(system, samples, int(row[at.F_B]))
    if element.kind in (at.TWIST, at.TILT):
        g, axis = _turning(system, k, A, B)
        return Measured(g, np.sum(axis * (B.w - A.w), axis=1))
    x, v = B.x - A.x, B.v - A.v
    if element.kind == at.SPAN:
        length = np.linalg.norm(x, axis=1)
        along = np.sum(x * v, axis=1)
        return Measured(length, along / np.maximum(length, 1e-300))
    local = np.array(element.data[:3])
    if system.planar:
        local = np.array([np.cos(local[0]), np.sin(local[0]), 0.0])
    n = A.R @ local
    rate = np.sum(n * v, axis=1) + np.sum(np.cross(A.w, n) * x, axis=1)
    return Measured(np.sum(n * x, axis=1), rate)


def deflection(system: System, samples: Samples, k: int) -> Array:
    """The rotation from rest of TWIST (nt, 1), the rotation vector of TILT (nt, 3)."""
    element = system.forces[k]
    if element.kind == at.TWIST:
        return measured(system, samples, k).g[:, None] - element.law.rest
    row = system.arrays.force[k]
    A = marker_motion(system, samples, int(row[at.F_A]))
    B = marker_motion(system, samples, int(row[at.F_B]))
    return _rotation_vector(A, B)


def torque_axis(system: System, samples: Samples, k: int) -> Array:
    """Inertial torque (nt, 3) on the second marker of a unit force on an angle."""
    row = system.arrays.force[k]
    A = marker_motion(system, samples, int(row[at.F_A]))
    B = marker_motion(system, samples, int(row[at.F_B]))
    return _turning(system, k, A, B)[1]


def _turning(system: System, k: int, A: Motion, B: Motion) -> tuple[Array, Array]:
    """The angle (nt,) of TWIST or TILT and the inertial axis (nt, 3) of its torque.

    Of a component of the rotation vector theta along e that is T(theta)^-T e, as in
    `kernels.spatial_forces`.
    """
    element = system.forces[k]
    if system.planar:
        axis = np.broadcast_to([0.0, 0.0, 1.0], (len(A.angle), 3))
        return B.angle - A.angle, axis
    data = np.array(element.data)
    if element.kind == at.TWIST:
        first, second = data[:3], data[3:6]
        b = np.einsum("tji,tj->ti", A.R, B.R @ first)
        rest = element.law.rest
        angle = np.arctan2(b @ second, b @ first) - rest
        angle -= 2.0 * np.pi * np.floor(0.5 + angle / (2.0 * np.pi))
        return rest + angle, A.R @ np.cross(first, second)
    theta = _rotation_vector(A, B)
    size = np.maximum(np.linalg.norm(theta, axis=1), 1e-9)
    c = 1.0 / size**2 - (1.0 + np.cos(size)) / (2.0 * size * np.sin(size))
    c = np.where(size < 1e-3, 1.0 / 12.0, c)
    turned = np.cross(theta, data)
    local = data + 0.5 * turned + c[:, None] * np.cross(theta, turned)
    return theta @ data, np.einsum("tij,tj->ti", A.R, local)


def _rotation_vector(A: Motion, B: Motion) -> Array:
    """From marker A to marker B, in the axes of A, below half a turn; (nt, 3)."""
    from scipy.spatial.transform import Rotation

    relative = np.einsum("tji,tjk->tik", A.R, B.R)
    return np.asarray(Rotation.from_matrix(relative).as_rotvec())


def function_values(system: System, function: int, times: Array) -> Array:
    """Values of a row of the table of functions, 1 for no function."""
    if function < 0:
        return np.ones(len(times))
    evaluate = drive_value.py_func
    return np.array(
        [
            evaluate(system.arrays, function, clock, t)[0]
            for clock, t in zip(system.clocks(times), times, strict=True)
        ]
    )
