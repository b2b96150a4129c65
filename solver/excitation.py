"""How fast drives and forces excite a scene."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from formats.result import Excitation
from formats.scene import Function, Harmonic, driven_coordinate
from formats.sid import Array

from .kernels.drives import drive_value
from .scene import System

#: Times at which a drive is looked at in each of its smooth intervals, and in all.
SAMPLES, LEAST = 200, 3
#: How the names of driven angles begin: angle, angle_1, rotation of a marker.
ANGLES = ("angle", "rotation")
_GOLDEN = 0.6180339887498949


@dataclass(frozen=True, eq=False)
class DriveHistory:
    """Functions of drives over the whole span of a scene.

    times : (n,)
    values : drive -> (3, n) value and two derivatives
    """

    times: Array
    values: Mapping[str, Array]


def excitation(system: System, history: DriveHistory) -> Excitation:
    """The highest frequency of harmonic functions and of prescribed rotations."""
    scene, found = system.scene, [Excitation()]
    for name, drive in scene.drives.items():
        function = _harmonic(name, drive.function)
        found.append(function or _rotation(system, history, name))
    for name, force in scene.forces.items():
        function = _harmonic(name, getattr(force, "function", None))
        found.append(function or Excitation())
    return max(found, key=lambda e: e.frequency)


def fastest_rotation(system: System, history: DriveHistory) -> tuple[float, str]:
    """The largest prescribed rate of an angle [rad/s] and its drive."""
    return max(
        [(_rate_of_angle(system, history, name), name) for name in history.values],
        default=(0.0, ""),
    )


def _harmonic(name: str, function: Function | None) -> Excitation | None:
    """The frequency of a harmonic function; None for others."""
    if not isinstance(function, Harmonic):
        return None
    hertz = function.frequency
    if hertz is None:
        hertz = (function.angular_frequency or 0.0) / (2.0 * math.pi)
    if not function.amplitude:
        return Excitation()
    return Excitation(abs(hertz), name)


def _rotation(system: System, history: DriveHistory, name: str) -> Excitation:
    rate = _rate_of_angle(system, history, name)
    if rate == 0.0:
        return Excitation()
    words = f"{name} turns at up to {rate:.4g} rad/s"
    return Excitation(rate / (2.0 * math.pi), words)


def _rate_of_angle(system: System, history: DriveHistory, name: str) -> float:
    """Largest rate of what a drive prescribes, 0 if that is no angle."""
    scene = system.scene
    coordinate = driven_coordinate(scene.drives[name], scene.joints)
    if not coordinate.startswith(ANGLES):
        return 0.0
    return float(np.abs(history.values[name][1]).max())


def drive_history(system: System) -> DriveHistory:
    """At both ends of each smooth interval, and between them so that no period fits."""
    edges = np.array([system.scene.time.start, *system.breaks])
    starts, lengths = edges[:-1], np.diff(edges)
    count = max(LEAST, SAMPLES // len(starts))
    inner = np.sort((np.arange(1, count - 1) * _GOLDEN) % 1.0)
    shares = np.concatenate([[0.0], inner, [1.0]])
    times = (starts[:, None] + shares * lengths[:, None]).ravel()
    clocks = np.repeat(starts + 0.5 * lengths, count)
    evaluate = drive_value.py_func
    values = {
        name: np.array(
            [
                evaluate(system.arrays, row, clock, t)
                for clock, t in zip(clocks, times, strict=True)
            ]
        ).T
        for row, name in enumerate(system.scene.drives)
    }
    return DriveHistory(times, values)
