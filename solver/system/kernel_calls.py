"""Kernels for callers in Python."""

from __future__ import annotations

from sidtool.formats.sid import Array

from ..kernels.layout import Work
from .scene import System


def evaluate(system: System, work: Work, t: float, z: Array, v: Array) -> None:
    """M, f, C and the constraints of eq. (3) at one state, into `work`."""
    if system.planar:
        from ..kernels.planar_forces import evaluate as kernel
    else:
        from ..kernels.spatial_forces import evaluate as kernel
    kernel(system.arrays, work, t, z, v)


def linearise(
    system: System, work: Work, t: float, z: Array, v: Array, acc: Array, lam: Array
) -> None:
    """Derivatives of eq. (3) at the state that was just evaluated, into `work`."""
    if system.planar:
        from ..kernels.planar_forces import linearise as kernel
    else:
        from ..kernels.spatial_forces import linearise as kernel
    kernel(system.arrays, work, t, z, v, acc, lam)
