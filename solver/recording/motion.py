"""Motion of frames and markers at recorded states, in three dimensions.

Planar scenes are embedded in z = 0, so that what is made of a motion is written once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sidtool.formats.sid import Array

from ..kernels import planar_columns as planar
from ..kernels import spatial_columns as spatial
from ..system.scene import System
from .sampling import Samples


@dataclass(frozen=True, eq=False)
class Motion:
    """Of a marker: position x, velocity v, orientation R, angular velocity w, inertial.

    (nt, 3) and, R, (nt, 3, 3); angle is the one of a planar marker, without limits.
    """

    x: Array
    v: Array
    R: Array
    w: Array
    angle: Array


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """Of a body frame: inertial position X, orientation R; body-resolved V and W."""

    X: Array
    R: Array
    V: Array
    W: Array


def marker_motion(system: System, samples: Samples, m: int) -> Motion:
    """Motion of the marker in row m of the marker table."""
    point = samples.points[:, m]
    if system.planar:
        angle = point[:, planar.TH]
        return Motion(
            _flat(point[:, [planar.PX, planar.PY]]),
            _flat(point[:, [planar.PVX, planar.PVY]]),
            _about_z(angle),
            _along_z(point[:, planar.TW]),
            angle,
        )
    return Motion(
        point[:, spatial.PX : spatial.PX + 3],
        point[:, spatial.PV : spatial.PV + 3],
        point[:, spatial.PR : spatial.PR + 9].reshape(-1, 3, 3),
        point[:, spatial.PW : spatial.PW + 3],
        np.full(len(point), np.nan),
    )


def frame_motion(system: System, samples: Samples, b: int) -> FrameMotion:
    """Motion of the frame of the body in row b of the body table."""
    frame = samples.frames[:, b]
    if system.planar:
        return FrameMotion(
            _flat(frame[:, [planar.X, planar.Y]]),
            _about_z(frame[:, planar.ANGLE]),
            _flat(frame[:, [planar.VX, planar.VY]]),
            _along_z(frame[:, planar.W]),
        )
    return FrameMotion(
        frame[:, spatial.X : spatial.X + 3],
        frame[:, spatial.R : spatial.R + 9].reshape(-1, 3, 3),
        frame[:, spatial.V : spatial.V + 3],
        frame[:, spatial.OMEGA : spatial.OMEGA + 3],
    )


def place(system: System, samples: Samples, m: int) -> Array:
    """Body-resolved position of a marker on its deformed body, (nt, 3)."""
    point = samples.points[:, m]
    if system.planar:
        return _flat(point[:, [planar.DX, planar.DY]])
    return point[:, spatial.D : spatial.D + 3]


def _flat(pair: Array) -> Array:
    return np.column_stack([pair, np.zeros(len(pair))])


def _along_z(rate: Array) -> Array:
    zero = np.zeros_like(rate)
    return np.column_stack([zero, zero, rate])


def _about_z(angle: Array) -> Array:
    R = np.zeros((len(angle), 3, 3))
    R[:, 0, 0] = R[:, 1, 1] = np.cos(angle)
    R[:, 1, 0] = np.sin(angle)
    R[:, 0, 1] = -R[:, 1, 0]
    R[:, 2, 2] = 1.0
    return R
