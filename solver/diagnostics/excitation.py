"""Excitation of a scene by drives and forces, and motion of prescribed frames."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.sid import Array, Node
from sidtool.formats.result import Excitation
from sidtool.formats.scene import (
    Joint,
    Placement,
    driven_coordinate,
    marker_names,
    marker_reference,
    orientation_matrix,
)

from ..spatial import system_arrays as at
from ..system.joints import planar_axis, spatial_axis
from ..system.sid_packing import nearest_rotation
from ..system.system import GROUND_NAME, System
from ..system.work_arrays import function_history

#: Times at which a drive is looked at in each of its smooth intervals, and in all.
SAMPLES_PER_INTERVAL, MIN_SAMPLES = 200, 3
#: How the names of driven angles begin: angle, angle_1, rotation of a marker.
ANGLES = ("angle", "rotation")
_GOLDEN = 0.6180339887498949
#: Times at which a function is looked at in each of its pieces.
SAMPLES_PER_PIECE = 9
#: A function varies by nothing below this part of its values; it jumps by more than
#: this part of its amplitude, and bends by more than this part of its steepest slope;
#: and shorter pieces than this part of a run are kinks.
NO_VARIATION, JUMP_TOLERANCE, SLOPE_JUMP_TOLERANCE, KINK_PIECE = 1e-12, 1e-6, 1e-2, 1e-6
#: Slopes that differ by less than this part of the steepest may do so by errors of a
#: callable's polynomials.
CURVATURE_TOLERANCE = 1e-5

_DRIVEN_COORDINATE = {"fixed": "", "revolute": "angle", "prismatic": "displacement"}


@dataclass(frozen=True, eq=False)
class DriveHistory:
    """Functions of drives over the whole span of a scene.

    Attributes
    ----------
    times : (n,)
    values
        Drive -> (3, n) value and two derivatives.
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
    excitations = [Excitation()]
    for row, name in enumerate(system.scene.drives):
        excitations += [
            _function_excitation(system, row, name),
            _rotation_excitation(system, history, name),
        ]
    for element in system.forces:
        given = element.kind <= at.FOLLOWER_LOAD
        if element.function >= 0 and (any(element.data) or not given):
            excitations.append(
                _function_excitation(system, element.function, element.name)
            )
    return max(excitations, key=lambda e: e.frequency)


def _function_excitation(system: System, row: int, name: str) -> Excitation:
    _, _, first, kind = system.arrays.drive[row]
    if kind == at.SUM:
        rows = range(first, first + int(system.arrays.drive[row, at.D_PIECES]))
        parts = [_function_excitation(system, part, name) for part in rows]
        return max(parts, key=lambda e: e.frequency)
    if kind == at.HARMONIC:
        omega, amplitude = _harmonic_parameters(system, row)
        return Excitation(omega / (2.0 * math.pi), name) if amplitude else Excitation()
    t, interval_times = _sample_times(system, row)
    histories = function_history(system, row, interval_times.ravel(), t.ravel())
    f, slope = histories[:, :2].T.reshape(2, *t.shape)
    amplitude = 0.5 * np.ptp(f)
    if amplitude <= NO_VARIATION * np.abs(f).max():
        return Excitation()
    is_adjacent = np.nextafter(t[1:, 0], -np.inf) == t[:-1, -1]
    if (np.abs(f[1:, 0] - f[:-1, -1])[is_adjacent] > JUMP_TOLERANCE * amplitude).any():
        return Excitation(math.inf, f"{name} jumps")
    steepest = np.abs(slope).max()
    slope_changes = np.abs(np.diff(slope, axis=1))
    curvature = (slope_changes / np.diff(t, axis=1))[
        slope_changes > CURVATURE_TOLERANCE * steepest
    ]
    omega = math.sqrt(curvature.max(initial=0.0) / amplitude)
    if (np.abs(slope[1:, 0] - slope[:-1, -1]) > SLOPE_JUMP_TOLERANCE * steepest).any():
        omega = max(omega, 0.5 * math.pi * float(steepest) / amplitude)
    return Excitation(omega / (2.0 * math.pi), name) if omega else Excitation()


def _harmonic_parameters(system: System, row: int) -> tuple[float, float]:
    """Angular frequency [rad/s] and amplitude of a harmonic function."""
    start = system.arrays.drive[row, at.D_DATA]
    _, amplitude, omega, _ = system.arrays.real_data[start : start + 4]
    return abs(float(omega)), abs(float(amplitude))


def _sample_times(system: System, row: int) -> tuple[Array, Array]:
    """Times (n, IN_PIECE) in every piece of a function, just up to its end, and clocks.

    Pieces that surround a kink are too short to be looked at.
    """
    first, last = system.scene.time.start, system.scene.time.end
    pieces, start = (int(system.arrays.drive[row, k]) for k in (at.D_PIECES, at.D_DATA))
    inner = system.arrays.real_data[start : start + pieces]
    edges = np.array([first, *inner[(inner > first) & (inner < last)], last])
    lengths = np.diff(edges)
    long = lengths > KINK_PIECE * (last - first)
    starts, lengths = edges[:-1][long], lengths[long]
    t = starts[:, None] + lengths[:, None] * np.linspace(0.0, 1.0, SAMPLES_PER_PIECE)
    t[:, -1] = np.nextafter(edges[1:][long], -np.inf)
    return t, np.repeat((starts + 0.5 * lengths)[:, None], SAMPLES_PER_PIECE, axis=1)


def fastest_rotation(system: System, history: DriveHistory) -> tuple[float, str]:
    """The largest prescribed rate of an angle [rad/s] and its drive."""
    return max(
        [
            (_largest_angular_rate(system, history, name), name)
            for name in history.values
        ],
        default=(0.0, ""),
    )


def _rotation_excitation(
    system: System, history: DriveHistory, name: str
) -> Excitation:
    rate = _largest_angular_rate(system, history, name)
    if np.ptp(history.values[name][0]) < 2.0 * math.pi:
        return Excitation()
    text = f"{name} turns at up to {rate:.4g} rad/s"
    return Excitation(rate / (2.0 * math.pi), text)


def _largest_angular_rate(system: System, history: DriveHistory, name: str) -> float:
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
    count = max(MIN_SAMPLES, SAMPLES_PER_INTERVAL // len(starts))
    inner = np.sort((np.arange(1, count - 1) * _GOLDEN) % 1.0)
    shares = np.concatenate([[0.0], inner, [1.0]])
    times = (starts[:, None] + shares * lengths[:, None]).ravel()
    interval_times = np.repeat(starts + 0.5 * lengths, count)
    values = {
        name: function_history(system, row, interval_times, times).T
        for row, name in enumerate(system.scene.drives)
    }
    return DriveHistory(times, values)


@dataclass(frozen=True, eq=False)
class FrameHistory:
    """Motion of a body frame, one row per instant.

    Attributes
    ----------
    R : (nt, 3, 3)
        Body to inertial axes.
    a, w, alpha : (nt, 3)
        Acceleration of the origin, angular velocity and angular acceleration, absolute,
        in body axes.
    """

    R: Array
    a: Array
    w: Array
    alpha: Array

    def repeated(self, count: int) -> FrameHistory:
        """The same at `count` instants, for the motion at one."""
        parts = (self.R, self.a, self.w, self.alpha)
        return FrameHistory(*(np.repeat(part, count, axis=0) for part in parts))


def prescribed_frames(system: System, history: DriveHistory) -> dict[str, FrameHistory]:
    """Motion of all bodies whose frame is prescribed, by name, without the ground."""
    zero = np.zeros((len(history.times), 3))
    known = {GROUND_NAME: FrameHistory(zero[:, :, None] + np.eye(3), zero, zero, zero)}
    drives = {
        (drive.joint, driven_coordinate(drive, system.scene.joints)): name
        for name, drive in system.scene.drives.items()
        if drive.joint is not None and name not in system.drive_law_rows
    }
    changed = True
    while changed:
        changed = False
        for name, joint in system.scene.joints.items():
            coordinate = _DRIVEN_COORDINATE.get(joint.type)
            drive = drives.get((name, coordinate or ""))
            if coordinate is None or (coordinate and drive is None):
                continue
            ends = [marker_reference(text) for text in marker_names(joint)]
            if (ends[0][0] in known) == (ends[1][0] in known):
                continue
            is_reversed = ends[1][0] in known
            base, tip = ends[::-1] if is_reversed else ends
            q = np.zeros((3, len(zero)))
            if drive is not None:
                q = history.values[drive]
            nodes = [system.bodies[system.index(b)].node(m) for b, m in (base, tip)]
            axis = _joint_direction(joint, system.planar)
            rotation, displacement = (
                (q, 0.0 * q) if coordinate == "angle" else (0.0 * q, q)
            )
            sign = -1.0 if is_reversed else 1.0
            known[tip[0]] = _child_frame(
                known[base[0]],
                nodes[0],
                nodes[1],
                axis,
                sign * rotation,
                sign * displacement,
            )
            changed = True
    del known[GROUND_NAME]
    return known


def start_frame(system: System, z: Array, v: Array, body: str) -> FrameHistory:
    """Orientation and angular velocity of a frame at one state; no accelerations."""
    row = system.arrays.body[system.index(body)]
    p, u, rigid = int(row[at.POS]), int(row[at.VEL]), int(row[at.RD])
    w, pose = np.zeros(3), Placement()
    if rigid == 3 and system.planar:
        w[2], pose = v[u + 2], Placement(angle=z[p + 2])
    elif rigid == 6:
        w[:], pose = v[u + 3 : u + 6], Placement(quaternion=tuple(z[p + 3 : p + 7]))
    nothing = np.zeros((1, 3))
    return FrameHistory(orientation_matrix(pose)[None], nothing, w[None], nothing)


def _joint_direction(joint: Joint, planar: bool) -> Array:
    """Axis of rotation or direction of sliding, in the frames of both markers."""
    if not planar:
        return spatial_axis(joint)
    if joint.type != "prismatic":
        return np.array([0.0, 0.0, 1.0])
    angle = planar_axis(joint)
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def _child_frame(
    base: FrameHistory,
    A: Node,
    B: Node,
    axis: Array,
    rotation_: Array,
    displacement: Array,
) -> FrameHistory:
    """The frame that hangs on a joint; turn and slide with two derivatives, (3, nt)."""
    first, second = nearest_rotation(A.AP.m0), nearest_rotation(B.AP.m0)
    Q = first @ _rotation_matrices(axis, rotation_[0]) @ second.T
    n, e = second @ axis, first @ axis
    arm = A.position + np.outer(displacement[0], e)
    a = (
        base.a
        + _point_acceleration(base.w, base.alpha, arm)
        + np.outer(displacement[2], e)
    )
    a = a + 2.0 * np.cross(base.w, np.outer(displacement[1], e))
    base_omega = _rotate_inverse(Q, base.w)
    w = base_omega + np.outer(rotation_[1], n)
    alpha = _rotate_inverse(Q, base.alpha) + np.outer(rotation_[2], n)
    alpha = alpha + np.cross(base_omega, np.outer(rotation_[1], n))
    a = _rotate_inverse(Q, a) - _point_acceleration(
        w, alpha, np.broadcast_to(B.position, w.shape)
    )
    return FrameHistory(base.R @ Q, a, w, alpha)


def _point_acceleration(w: Array, alpha: Array, arm: Array) -> Array:
    """Acceleration of a point at `arm` of a turning frame."""
    return np.cross(alpha, arm) + np.cross(w, np.cross(w, arm))


def _rotate_inverse(Q: Array, vectors: Array) -> Array:
    """Components in the second frame of vectors (nt, 3) in the first."""
    return np.einsum("tba,tb->ta", Q, vectors)


def _rotation_matrices(axis: Array, angle: Array) -> Array:
    """(nt, 3, 3) rotations about a unit axis (Rodrigues)."""
    x, y, z = axis
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * k + (1.0 - c) * (k @ k)
