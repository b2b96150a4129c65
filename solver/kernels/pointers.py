"""Kernels as first-class functions: callers are compiled without their callees."""

from __future__ import annotations

from functools import cache
from typing import Any

from numba import types

from . import newton
from .coordinates import rate, retract


class Pointer(types.WrapperAddressProtocol):
    """The address of one compiled signature of a kernel."""

    def __init__(self, kernel: Any, signature: Any) -> None:
        compiled = kernel.overloads[tuple(signature.args)]
        self._kernel = kernel
        self._signature = signature
        self._address = compiled.library.get_pointer_to_function(
            compiled.fndesc.llvm_cfunc_wrapper_name
        )

    def __wrapper_address__(self) -> int:
        return self._address

    def signature(self) -> Any:
        return self._signature


@cache
def kernels(planar: bool) -> newton.Kernels:
    """The kernels of planar or of spatial scenes; loads or compiles them once."""
    if planar:
        from .planar_forces import evaluate, linearise
    else:
        from .spatial_forces import evaluate, linearise
    functions = (
        evaluate,
        linearise,
        newton.solve_accelerations,
        newton.project_once,
        newton.remember,
        newton.newton_factor,
        newton.newton_factor,
        newton.newton_solve,
        newton.newton_solve,
        rate,
        retract,
    )
    return newton.Kernels(
        *(Pointer(f, s) for f, s in zip(functions, newton.SIGNATURES, strict=True))
    )
