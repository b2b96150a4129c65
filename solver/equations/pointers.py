"""Kernels as first-class functions: callers are compiled without their callees."""

from __future__ import annotations

from functools import cache
from typing import Any

from ..compiler.compiling import Entry
from ..compiler.views import Pointer
from ..linear import accelerations, newton
from ..linear.memory import SIGNATURES, Kernels
from ..space.coordinates import rate, retract
from . import equations


def pointer(kernel: Entry, signature: Any) -> Pointer:
    """To one compiled signature of a kernel."""
    return Pointer(kernel.address(signature), signature)


def entries(planar: bool) -> tuple[Entry, ...]:
    """The kernels of planar or of spatial scenes, in the order of `Kernels`."""
    return (
        equations.evaluate_in_plane if planar else equations.evaluate_in_space,
        equations.linearise_in_plane if planar else equations.linearise_in_space,
        accelerations.solve_accelerations,
        accelerations.project_once,
        newton.remember,
        newton.newton_factor,
        newton.newton_factor,
        newton.newton_solve,
        newton.newton_solve,
        rate,
        retract,
        equations.complete_in_plane if planar else equations.complete_in_space,
    )


@cache
def kernels(planar: bool) -> Kernels:
    """Pointers to the kernels; loads or compiles them once."""
    pairs = zip(entries(planar), SIGNATURES, strict=True)
    return Kernels(*(pointer(kernel, signature) for kernel, signature in pairs))
