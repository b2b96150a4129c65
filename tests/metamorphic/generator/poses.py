"""Rotations and poses of random scenes; the plane is z = 0 of space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import Placement, as_3d, orientation_matrix

ORIENTATIONS = ("angle", "axis_angle", "quaternion", "matrix")


def turned(axis: Array, angle: float) -> Array:
    """The (3, 3) rotation by an angle about a unit axis."""
    x, y, z = (angle * np.asarray(axis, float)).tolist()
    return orientation_matrix(Placement(axis_angle=(x, y, z)))


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a frame is: origin (3,) and axes (3, 3), local to parent components."""

    x: Array
    R: Array

    def then(self, inner: Pose) -> Pose:
        """The pose of a frame that is given in this one."""
        return Pose(self.x + self.R @ inner.x, self.R @ inner.R)

    @property
    def inverse(self) -> Pose:
        return Pose(-self.R.T @ self.x, self.R.T)

    @classmethod
    def of(cls, placement: dict[str, Any]) -> Pose:
        """As a table of a scene says it."""
        found = Placement(**{k: placement[k] for k in ORIENTATIONS if k in placement})
        return cls(as_3d(placement.get("position")), orientation_matrix(found))

    def table(self, planar: bool) -> dict[str, Any]:
        """The same as a table of a scene."""
        if planar:
            angle = float(np.arctan2(self.R[1, 0], self.R[0, 0]))
            return {"position": self.x[:2].tolist(), "angle": angle}
        return {"position": self.x.tolist(), "matrix": self.R.tolist()}


IDENTITY = Pose(np.zeros(3), np.eye(3))


def replaced(old: dict[str, Any], pose: Pose, planar: bool) -> dict[str, Any]:
    """A table with another position and orientation; the rest stays.

    An angle in the plane stays on the turn on which it was.
    """
    rest = {k: v for k, v in old.items() if k not in (*ORIENTATIONS, "position")}
    new = pose.table(planar)
    if planar:
        gap = new["angle"] - (old.get("angle") or 0.0)
        new["angle"] -= 2.0 * np.pi * round(gap / (2.0 * np.pi))
    return rest | new
