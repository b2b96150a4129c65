"""Kernels as first-class functions: callers are compiled without their callees."""

from __future__ import annotations

from functools import cache

from ..compiler.compiling import Entry
from ..compiler.views import Pointer
from ..linear import accelerations, newton
from ..linear.memory import KERNELS, Kernels
from ..space.coordinates import rate, retract
from . import equations


@cache
def kernels(planar: bool) -> Kernels:
    """Pointers to the kernels of planar or of spatial scenes; loads or compiles them
    once."""
    in_plane = equations.evaluate_in_plane, equations.linearise_in_plane
    in_space = equations.evaluate_in_space, equations.linearise_in_space
    evaluate, linearise = in_plane if planar else in_space
    complete = equations.complete_in_plane if planar else equations.complete_in_space
    chosen: dict[str, Entry] = {
        "evaluate": evaluate,
        "linearise": linearise,
        "solve_accelerations": accelerations.solve_accelerations,
        "project_once": accelerations.project_once,
        "remember": newton.remember,
        "factor_real": newton.newton_factor,
        "factor_complex": newton.newton_factor,
        "solve_real": newton.newton_solve,
        "solve_complex": newton.newton_solve,
        "rate": rate,
        "retract": retract,
        "complete": complete,
    }
    pointers = {}
    for name, kernel in chosen.items():
        signature = KERNELS.members[name].signature
        pointers[name] = Pointer(kernel.address(signature), signature)
    return Kernels(**pointers)
