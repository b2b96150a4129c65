"""Rigid-body displacements of a model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rigid_body_modes(positions: Array) -> Array:
    """Unit translations and small rotations about the origin.

    Parameters
    ----------
    positions : (n, d) with d = 2 or 3 [m]

    Returns
    -------
    (d n, 3) for d = 2, (d n, 6) for d = 3: translations along the axes, then
    rotations (about z alone in the plane)
    """
    n, d = positions.shape
    planes = [(0, 1)] if d == 2 else [(1, 2), (2, 0), (0, 1)]
    modes = np.zeros((n, d, d + len(planes)))
    modes[:, range(d), range(d)] = 1
    for column, (a, b) in enumerate(planes, start=d):
        modes[:, a, column] = -positions[:, b]
        modes[:, b, column] = positions[:, a]
    return modes.reshape(n * d, -1)
