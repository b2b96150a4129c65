"""How fast drives and forces excite a scene."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sidtool.formats.result import Excitation
from sidtool.formats.scene import driven_coordinate
from sidtool.formats.sid import Array

from ..space import layout as at
from ..system.kernel_calls import function_history
from ..system.scene import System

#: Times at which a drive is looked at in each of its smooth intervals, and in all.
SAMPLES, LEAST = 200, 3
#: How the names of driven angles begin: angle, angle_1, rotation of a marker.
ANGLES = ("angle", "rotation")
_GOLDEN = 0.6180339887498949
#: Times at which a function is looked at in each of its pieces.
IN_PIECE = 9
#: A function varies by nothing below this part of its values; it jumps by more than
#: this part of its amplitude, and bends by more than this part of its steepest slope;
#: and shorter pieces than this part of a run are kinks.
NOTHING, JUMP, BEND, KINK = 1e-12, 1e-6, 1e-2, 1e-6
#: Slopes that differ by less than this part of the steepest may do so by errors of a
#: callable's polynomials.
STRAIGHT = 1e-5


@dataclass(frozen=True, eq=False)
class DriveHistory:
    """Functions of drives over the whole span of a scene.

    times : (n,)
    values : drive -> (3, n) value and two derivatives
    """

    times: Array
    values: Mapping[str, Array]


def excitation(system: System, history: DriveHistory) -> Excitation:
    """The fastest excitation by drives and by forces that are functions of time.

    A jump of a force excites all frequencies. Else a function f is as fast as a
    harmonic of its range and its largest curvature, sqrt(max |f''| / amplitude); one
    with kinks also as a triangular wave of its range and its steepest slope; a
    prescribed angle that goes round also as its rotation.
    """
    found = [Excitation()]
    for row, name in enumerate(system.scene.drives):
        found += [_of_function(system, row, name), _rotation(system, history, name)]
    for element in system.forces:
        given = element.kind <= at.FOLLOWING
        if element.function >= 0 and (any(element.data) or not given):
            found.append(_of_function(system, element.function, element.name))
    return max(found, key=lambda e: e.frequency)


def _of_function(system: System, row: int, name: str) -> Excitation:
    _, _, first, kind = system.arrays.drive[row]
    if kind == at.SUM:
        rows = range(first, first + int(system.arrays.drive[row, at.D_PIECES]))
        parts = [_of_function(system, part, name) for part in rows]
        return max(parts, key=lambda e: e.frequency)
    if kind == at.HARMONIC:
        omega, amplitude = _harmonic_of(system, row)
        return Excitation(omega / (2.0 * math.pi), name) if amplitude else Excitation()
    t, clocks = _instants(system, row)
    found = function_history(system, row, clocks.ravel(), t.ravel())
    f, slope = found[:, :2].T.reshape(2, *t.shape)
    amplitude = 0.5 * np.ptp(f)
    if amplitude <= NOTHING * np.abs(f).max():
        return Excitation()
    joined = np.nextafter(t[1:, 0], -np.inf) == t[:-1, -1]
    if (np.abs(f[1:, 0] - f[:-1, -1])[joined] > JUMP * amplitude).any():
        return Excitation(math.inf, f"{name} jumps")
    steepest = np.abs(slope).max()
    bends = np.abs(np.diff(slope, axis=1))
    curvature = (bends / np.diff(t, axis=1))[bends > STRAIGHT * steepest]
    omega = math.sqrt(curvature.max(initial=0.0) / amplitude)
    if (np.abs(slope[1:, 0] - slope[:-1, -1]) > BEND * steepest).any():
        omega = max(omega, 0.5 * math.pi * float(steepest) / amplitude)
    return Excitation(omega / (2.0 * math.pi), name) if omega else Excitation()


def _harmonic_of(system: System, row: int) -> tuple[float, float]:
    """Angular frequency [rad/s] and amplitude of a harmonic function."""
    start = system.arrays.drive[row, at.D_DATA]
    _, amplitude, omega, _ = system.arrays.pool[start : start + 4]
    return abs(float(omega)), abs(float(amplitude))


def _instants(system: System, row: int) -> tuple[Array, Array]:
    """Times (n, IN_PIECE) in every piece of a function, just up to its end, and clocks.

    Pieces that surround a kink are too short to be looked at.
    """
    first, last = system.scene.time.start, system.scene.time.end
    pieces, start = (int(system.arrays.drive[row, k]) for k in (at.D_PIECES, at.D_DATA))
    inner = system.arrays.pool[start : start + pieces]
    edges = np.array([first, *inner[(inner > first) & (inner < last)], last])
    lengths = np.diff(edges)
    long = lengths > KINK * (last - first)
    starts, lengths = edges[:-1][long], lengths[long]
    t = starts[:, None] + lengths[:, None] * np.linspace(0.0, 1.0, IN_PIECE)
    t[:, -1] = np.nextafter(edges[1:][long], -np.inf)
    return t, np.repeat((starts + 0.5 * lengths)[:, None], IN_PIECE, axis=1)


def fastest_rotation(system: System, history: DriveHistory) -> tuple[float, str]:
    """The largest prescribed rate of an angle [rad/s] and its drive."""
    return max(
        [(_rate_of_angle(system, history, name), name) for name in history.values],
        default=(0.0, ""),
    )


def _rotation(system: System, history: DriveHistory, name: str) -> Excitation:
    rate = _rate_of_angle(system, history, name)
    if np.ptp(history.values[name][0]) < 2.0 * math.pi:
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
    values = {
        name: function_history(system, row, clocks, times).T
        for row, name in enumerate(system.scene.drives)
    }
    return DriveHistory(times, values)
