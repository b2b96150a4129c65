"""Is a matrix the orientation of a node?"""

from __future__ import annotations

import numpy as np

from .sid import Array


def fault(AP: Array) -> str:
    """In words why a matrix (3, 3) is no rotation; empty for one."""
    if not AP.any():
        return "is zero"
    if deviation(AP) > 1e-3:
        return "is no rotation"
    return "is reflected (left-handed)" if np.linalg.det(AP) < 0.0 else ""


def deviation(AP: Array) -> float:
    """Largest entry of AP^T AP - I."""
    return float(np.abs(AP.T @ AP - np.eye(3)).max())
