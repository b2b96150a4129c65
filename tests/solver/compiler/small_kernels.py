"""A kernel that is quick to compile, for tests of how kernels are compiled and kept."""

from __future__ import annotations

from sidtool.solver.compiler.kernels import Entry, entry, inner
from sidtool.solver.compiler.types import float64


def scaled(factor: float) -> Entry:
    """factor x, by an inner kernel that holds the factor."""

    @inner(float64(float64))
    def times(x):  # type: ignore[no-untyped-def]
        return factor * x

    @entry(float64(float64))
    def kernel(x):  # type: ignore[no-untyped-def]
        return times(x)

    return kernel
