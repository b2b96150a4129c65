"""Forces and torques that the forces of a scene put on markers at recorded states."""

from __future__ import annotations

import numpy as np

from sidtool.formats.scene import marker_names, marker_reference
from sidtool.formats.sid import Array

from ..kernels import layout as at
from ..system.scene import System
from .force_measures import measured, torque_axis
from .motion import Motion, marker_motion
from .sampling import Samples

#: Force and moment, in inertial axes.
Wrench = tuple[Array, Array]


def force_wrench(system: System, samples: Samples, times: Array, owner: str) -> Array:
    """Force and torque of a force on its (second) marker in inertial axes, (nt, 6)."""
    total = np.zeros((len(times), 6))
    for k, element in enumerate(system.forces):
        if element.name != owner or not element.acts:
            continue
        if element.kind <= at.FOLLOWING:
            pair = given(system, samples, k)
        else:
            pair = between(system, samples, k)[_second(system, k)]
        total += np.column_stack(pair)
    return total


def _second(system: System, k: int) -> int:
    """Which end of an element is the second marker: a joint may exchange them."""
    element = system.forces[k]
    force = system.scene.forces[element.name]
    joint = getattr(force, "joint", None)
    if joint is None:
        return 1
    second = marker_reference(marker_names(system.scene.joints[joint])[1])
    return int(element.b == second)


def motion_of(system: System, samples: Samples, end: tuple[str, str]) -> Motion:
    """Of a marker that is named."""
    return marker_motion(system, samples, system.markers[end])


def given(system: System, samples: Samples, k: int) -> Wrench:
    """Force and moment (nt, 3) of a force with components."""
    element = system.forces[k]
    factor = samples.factors[:, k, None]
    force, moment = components(system, element.data)
    if element.kind == at.FOLLOWING:
        R = motion_of(system, samples, element.b).R
        return factor * (R @ force), factor * (R @ moment)
    return factor * force, factor * moment


def components(system: System, data: tuple[float, ...]) -> Wrench:
    """Force and moment, (3,) each, of the data of a given force."""
    if system.planar:
        return np.array([*data[:2], 0.0]), np.array([0.0, 0.0, data[2]])
    return np.array(data[:3]), np.array(data[3:])


def between(system: System, samples: Samples, k: int) -> tuple[Wrench, Wrench]:
    """Forces and moments on both markers of a force between two, (nt, 3) each."""
    element = system.forces[k]
    assert element.a is not None
    size = _size(system, samples, k)[:, None]
    if element.kind >= at.TWIST:
        torque = size * torque_axis(system, samples, element)
        return (0.0 * torque, -torque), (0.0 * torque, torque)
    A, B = (motion_of(system, samples, end) for end in (element.a, element.b))
    line = B.x - A.x
    if element.kind == at.SPAN:
        length = np.linalg.norm(line, axis=1, keepdims=True)
        force = size * line / np.maximum(length, 1e-300)
        return (-force, 0.0 * force), (force, 0.0 * force)
    local = np.array(element.data[:3])
    if system.planar:
        local = np.array([np.cos(local[0]), np.sin(local[0]), 0.0])
    force = size * (A.R @ local)
    return (-force, np.cross(force, line)), (force, 0.0 * force)


def _size(system: System, samples: Samples, k: int) -> Array:
    """What a force law yields, (nt,) [N] or [N m]."""
    element = system.forces[k]
    law, measure = element.law, measured(system, samples, element)
    size = law.applied * samples.factors[:, k]
    size = size - law.stiffness.value(measure.g - law.rest)
    size = size - law.damping.value(measure.rate)
    return size - law.friction * np.tanh(measure.rate / law.speed)
