"""Orientations of frames and markers as quaternion and rotation vector."""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import Array


def orientation_column(R: Array, quantity: str) -> Array:
    """One of `sidtool.formats.scene.ORIENTATIONS` of rotation matrices (nt, 3, 3).

    quaternion_0 is the scalar part and not negative; the rotation vector is at most
    half a turn long [rad].
    """
    from scipy.spatial.transform import Rotation  # a quarter of a second

    column = np.full(len(R), np.nan)
    known = np.isfinite(R).all(axis=(1, 2))
    if known.any():
        rotation = Rotation.from_matrix(R[known])
        if quantity.startswith("quaternion"):
            parts = np.roll(rotation.as_quat(canonical=True), 1, axis=1)
            column[known] = parts[:, int(quantity[-1])]
        else:
            column[known] = rotation.as_rotvec()[:, "xyz".index(quantity[-1])]
    return column
