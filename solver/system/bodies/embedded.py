"""Vectors and rotations of the plane in three dimensions."""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import Array


def embedded(x: Array) -> Array:
    """Vectors (..., 3), of the plane in x and y; rotations of the plane (..., 1) turn
    about z."""
    count = x.shape[-1]
    found = np.zeros((*x.shape[:-1], 3))
    found[..., slice(2, 3) if count == 1 else slice(count)] = x
    return found


def matrices(R: Array) -> Array:
    """Rotation matrices (..., 3, 3) of what kernels keep: cosine and sine, or nine."""
    if R.shape[-1] == 9:
        return R.reshape(*R.shape[:-1], 3, 3)
    found = np.zeros((*R.shape[:-1], 3, 3))
    found[..., 0, 0] = found[..., 1, 1] = R[..., 0]
    found[..., 1, 0], found[..., 0, 1] = R[..., 1], -R[..., 1]
    found[..., 2, 2] = 1.0
    return found
