"""Kernels as first-class functions: callers are compiled without their callees."""

from __future__ import annotations

from functools import cache
from typing import Any

from numba import types

from . import newton
from .compiling import Entry
from .coordinates import rate, retract


class Pointer(types.WrapperAddressProtocol):
    """The address of one compiled signature of a kernel."""

    def __init__(self, kernel: Entry, signature: Any) -> None:
        compiled = kernel.compiled(signature)
        self._kernel = kernel
        self._signature = signature
        self._address = compiled.library.get_pointer_to_function(
            compiled.fndesc.llvm_cfunc_wrapper_name
        )

    def __wrapper_address__(self) -> int:
        return self._address

    def signature(self) -> Any:
        return self._signature


def entries(planar: bool) -> tuple[Entry, ...]:
    """The kernels of planar or of spatial scenes, in the order of `newton.Kernels`."""
    if planar:
        from .planar_forces import evaluate, linearise
    else:
        from .spatial_forces import evaluate, linearise
    return (
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


@cache
def kernels(planar: bool) -> newton.Kernels:
    """Pointers to the kernels; loads or compiles them once."""
    pairs = zip(entries(planar), newton.SIGNATURES, strict=True)
    return newton.Kernels(*(Pointer(kernel, signature) for kernel, signature in pairs))
