"""Motion of frames and markers at recorded states, in three dimensions.

Planar scenes are embedded in z = 0, so that what is made of a motion is written once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sidtool.formats.sid import Array

from ..system.bodies.embedded import embedded, matrices
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
    point = system.points(samples.points[:, m])
    if system.planar:
        angle = point["angle"]
        R = np.column_stack([np.cos(angle), np.sin(angle)])
    else:
        angle, R = np.full(len(point), np.nan), point["R"]
    x, v, w = (embedded(point[part]) for part in "xvw")
    return Motion(x, v, matrices(R), w, angle)


def frame_motion(system: System, samples: Samples, b: int) -> FrameMotion:
    """Motion of the frame of the body in row b of the body table."""
    frame = system.frames(samples.frames[:, b])
    x, v, w = (embedded(frame[part]) for part in "xvw")
    return FrameMotion(x, matrices(frame["R"]), v, w)


def place(system: System, samples: Samples, m: int) -> Array:
    """Body-resolved position of a marker on its deformed body, (nt, 3)."""
    return embedded(system.points(samples.points[:, m])["d"])
