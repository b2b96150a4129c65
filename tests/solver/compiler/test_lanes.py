"""Scalar products of rows: whole numbers leave no rounding, so they are exact."""

from __future__ import annotations

import numpy as np
import pytest

from sidtool.solver.compiler.inner_kernels import LANES, row_dot
from sidtool.solver.compiler.kernels import entry
from sidtool.solver.compiler.types import int64, void
from sidtool.solver.spatial.system_arrays import C1, F1

SIGNATURES = {
    kind: void(F1, int64, view, int64, int64, view)
    for kind, view in ((float, F1), (complex, C1))
}


@entry(*SIGNATURES.values())
def product(a, i, x, k, n, out):  # type: ignore[no-untyped-def]
    out[0] = row_dot(a, i, x, k, n)


@pytest.mark.parametrize("kind", [float, complex])
def test_every_term_counts_once(kind: type) -> None:
    rng, times = np.random.default_rng(3), product.python_callable(SIGNATURES[kind])
    for n in (1, 2, LANES - 1, LANES, LANES + 1, 2 * LANES, 5 * LANES + 3):
        for i, k in ((0, 0), (1, 2), (5, 3)):
            a = rng.integers(-99, 99, i + n + 1).astype(float)
            x = rng.integers(-99, 99, k + n + 1).astype(kind)
            if kind is complex:
                x = x + 1j * rng.integers(-99, 99, k + n + 1)
            out = np.zeros(1, kind)
            times(a, i, x, k, n, out)
            assert out[0] == a[i : i + n] @ x[k : k + n]
