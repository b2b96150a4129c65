"""What forces depend on at recorded states: their measures, and functions of time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sidtool.formats.sid import Array

from ..kernels import layout as at
from ..kernels.drives import drive_value
from ..system.forces import Element
from ..system.scene import System
from .motion import Motion, marker_motion
from .sampling import Samples


class Measured(NamedTuple):
    """A measure of the motion of two markers and its rate, (nt,)."""

    g: Array
    rate: Array


def measured(system: System, samples: Samples, element: Element) -> Measured:
    """The measure of a force or a coordinate, as in `kernels.planar_forces`."""
    A, B = _ends(system, samples, element)
    if element.kind >= at.TWIST:
        axis = torque_axis(system, samples, element)
        rate = np.sum(axis * (B.w - A.w), axis=1)
        if element.kind == at.LEAN:
            first, second = np.reshape(element.data, (2, 3))
            return Measured(np.sum((A.R @ first) * (B.R @ second), axis=1), rate)
        if system.planar:
            return Measured(B.angle - A.angle - element.data[0], rate)
        return Measured(_turned(system, samples, element.turn), rate)
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


def torque_axis(system: System, samples: Samples, element: Element) -> Array:
    """Inertial torque (nt, 3) on the second marker of a unit force on an angle.

    Of a component of the rotation vector theta along e that is T(theta)^-T e, as in
    `kernels.spatial_forces`.
    """
    A, B = _ends(system, samples, element)
    if system.planar:
        return np.broadcast_to([0.0, 0.0, 1.0], A.x.shape)
    data = np.array(element.data)
    if element.kind == at.LEAN:
        return np.cross(B.R @ data[3:], A.R @ data[:3])
    if element.kind == at.TWIST:
        axis, b = A.R @ np.cross(data[:3], data[3:]), B.R @ data[:3]
        off = np.sum(axis * b, axis=1, keepdims=True)
        flat = b - off * axis
        return axis - off * flat / np.sum(flat**2, axis=1, keepdims=True)
    first = element.turn - int(np.argmax(data))
    theta = np.column_stack([_turned(system, samples, first + i) for i in range(3)])
    size = np.maximum(np.linalg.norm(theta, axis=1), 1e-9)
    c = 1.0 / size**2 - 0.5 / (size * np.tan(0.5 * size))
    c = np.where(size < 1e-3, 1.0 / 12.0, c)
    turned = np.cross(theta, data)
    local = data + 0.5 * turned + c[:, None] * np.cross(theta, turned)
    return np.einsum("tij,tj->ti", A.R, local)


def _ends(system: System, samples: Samples, element: Element) -> tuple[Motion, Motion]:
    """The markers of a force or a coordinate."""
    assert element.a is not None
    a, b = system.markers[element.a], system.markers[element.b]
    return marker_motion(system, samples, a), marker_motion(system, samples, b)


def _turned(system: System, samples: Samples, entry: int) -> Array:
    """An angle in space (nt,), zero where it is not counted."""
    if entry >= system.n_turns:
        return np.zeros(len(samples.z))
    return samples.z[:, system.n_positions - system.n_turns + entry]


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
