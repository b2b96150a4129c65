"""Directions to look at a mechanism from."""

from __future__ import annotations

import numpy as np

from sidtool.formats.scene import SceneFile, as_3d
from sidtool.formats.sid import Array


def upward(scene: SceneFile) -> Array:
    """Against gravity; without it y of planar scenes and z of others."""
    gravity = as_3d(scene.gravity)
    size = float(np.linalg.norm(gravity))
    if size > 0:
        axis = int(np.abs(gravity).argmax())
        if abs(gravity[axis]) > 0.99 * size and not _across(scene, axis):
            return np.eye(3)[axis] * -np.sign(gravity[axis])
    return np.eye(3)[1 if scene.dimension == "planar" else 2]


def _across(scene: SceneFile, axis: int) -> bool:
    return scene.dimension == "planar" and axis == 2


def views(scene: SceneFile) -> dict[str, Array]:
    """From where to look, by name: unit vectors from the mechanism to the eye."""
    up = upward(scene)
    if scene.dimension == "planar":
        front = np.array([0.0, 0.0, 1.0])
        side = np.cross(up, front)
    else:
        side = np.eye(3)[0 if abs(up[0]) < 0.5 else 1]
        front = np.cross(side, up)
    top = up + 1e-4 * front
    iso = front + 0.6 * side + 0.5 * up
    return {"iso": iso, "front": front, "top": top, "side": side}
