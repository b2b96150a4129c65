"""Less of numba's compiler makes the same of a kernel as all of it, and as Python."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sidtool.solver.compiler.arrays import ViewType
from sidtool.solver.compiler.kernels import (
    _python_wrapper,
    inner,
    load_object_code,
)
from sidtool.solver.compiler.lowering import fast_lowering
from sidtool.solver.compiler.lowering.units import compile_kernel
from sidtool.solver.compiler.types import complex128, float64, int64, void

WAYS = pytest.mark.parametrize("is_tried", [True, False], ids=["quick", "plain"])


def numbers(x: float, y: float, n: int, found: Any) -> None:
    """What kernels do with numbers and shapes."""
    found[0, 0] = min(x, y)
    found[0, 1] = max(x, n, y)
    found[0, 2] = min(n, 2)
    found[1, 0] = int(x) + n % 3 + n // 3 + 2 * found.shape[1]
    found[1, 1] = math.sqrt(abs(x * y - n)) if x <= y or n != 4 else -n
    z = complex(x, y) + n
    found[1, 2] = abs(z - 3.0 * (x + z * z))
    found[2, 0] = z.real > 0.0
    found[2, 1] = math.atan2(x, y) ** 3
    found[2, 2] = 0.0
    for i in range(n, 0, -2):
        found[2, 2] += i / y


def extremes(x: float, y: float, found: Any) -> None:
    found[0], found[1], found[2] = min(x, y), max(x, y), max(2.0, x, y)


@inner()
def doubled(x):  # type: ignore[no-untyped-def]
    return 2.0 * x


def totals(x: float, found: Any) -> None:
    found[0], found[1] = sum((x, doubled(1.0), 3.0)), round(-x)


def fails(n: int, z: complex, found: Any) -> None:
    """numba raises an error where it divides by zero."""
    found[n] = 1.0 / z


def called(function: Any, signature: Any) -> Callable[..., Any]:
    """The function, compiled now."""
    return _python_wrapper(
        load_object_code(compile_kernel(function, signature)), signature
    )


@WAYS
def test_kernels_compute_as_python_does(
    is_tried: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fast_lowering, "is_tested_version", lambda: is_tried)
    kernel = called(numbers, void(float64, float64, int64, ViewType(float64, 2)))
    for x, y, n in [(1.5, -2.25, 4), (-3.75, 0.3, 7), (-0.5, 8.0, -5)]:
        found, expected = np.zeros((3, 3)), np.zeros((3, 3))
        kernel(x, y, n, found)
        numbers(x, y, n, expected)
        np.testing.assert_allclose(found, expected, rtol=1e-14)


@WAYS
def test_no_number_is_neither_least_nor_largest(
    is_tried: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in Python: what comes first stays, if it cannot be compared."""
    monkeypatch.setattr(fast_lowering, "is_tested_version", lambda: is_tried)
    kernel = called(extremes, void(float64, float64, ViewType(float64, 1)))
    for x, y in [(math.nan, 1.0), (1.0, math.nan), (math.inf, -math.inf)]:
        found, expected = np.zeros(3), np.zeros(3)
        kernel(x, y, found)
        extremes(x, y, expected)
        np.testing.assert_array_equal(found, expected)


@WAYS
def test_kernels_that_may_fail_are_refused(
    is_tried: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody would be told."""
    monkeypatch.setattr(fast_lowering, "is_tested_version", lambda: is_tried)
    with pytest.raises(TypeError, match="fails needs"):
        compile_kernel(fails, void(int64, complex128, ViewType(complex128, 1)))


def test_what_it_does_not_know_is_compiled_as_numba_compiles_everything() -> None:
    kernel = called(totals, void(float64, ViewType(float64, 1)))
    found = np.zeros(2)
    kernel(1.5, found)
    assert found.tolist() == [6.5, -2.0]
