"""The one acceleration beyond numba's public side: fewer passes of its compiler.

Kernels need no closures inlined, no dead branches pruned, no generators, no counts of
references, and nobody in Python calls them by numba. Without what serves these numba
takes two thirds of the time. Nothing of it is replaced: it is given options, with a
list of its own passes, in the versions that this was tried with. Others compile kernels
as they compile everything, with equal results.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numba

#: Versions of numba that the passes below were tried with.
FIRST, LAST = (0, 63), (0, 68)


def options() -> dict[str, Any]:
    """Options for numba's `njit`; none where this version has not been tried."""
    version = tuple(int(part) for part in numba.__version__.split(".")[:2])
    if not FIRST <= version <= LAST:
        return {}
    return {"pipeline_class": _pipeline(), "no_cpython_wrapper": True, "_nrt": False}


@cache
def _pipeline() -> Any:
    from numba.core.compiler import CompilerBase
    from numba.core.compiler_machinery import PassManager
    from numba.core.typed_passes import (
        NativeLowering,
        NoPythonBackend,
        NopythonTypeInference,
    )
    from numba.core.untyped_passes import FixupArgs, IRProcessing, TranslateByteCode

    passes = TranslateByteCode, FixupArgs, IRProcessing
    typed = NopythonTypeInference, NativeLowering, NoPythonBackend

    class Pipeline(CompilerBase):  # type: ignore[misc]
        def define_pipelines(self) -> list[Any]:
            manager = PassManager("kernel")
            for kind in (*passes, *typed):
                manager.add_pass(kind, kind.name())
            manager.finalize()
            return [manager]

    return Pipeline
