"""Threads that compile at once: kernels here, functions of the user's own there."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import float64, njit
from numba.core.extending import intrinsic

from sidtool.solver.kernels.compiling import Entry, entry


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))


def shifted(number: float) -> Entry:
    @entry(float64(float64))
    def kernel(x):  # type: ignore[no-untyped-def]
        return x + number

    return kernel


def pausing(begun: threading.Event, over: threading.Event) -> Any:
    """What stops the compiler in the midst of a function; 0 when it runs."""

    @intrinsic
    def pause(context):  # type: ignore[no-untyped-def]
        def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
            begun.set()
            over.wait(0.5)
            return context.get_constant(float64, 0.0)

        return float64(), generate

    return pause


def test_a_function_compiled_while_a_kernel_waits_counts_from_the_end() -> None:
    """Kernels index plainly; everybody else's arrays have a last entry at -1."""
    begun, never = threading.Event(), threading.Event()
    pause = pausing(begun, never)

    @njit
    def last(numbers, k):  # type: ignore[no-untyped-def]
        return pause() + numbers[k]

    numbers = np.arange(1000.0)[500:600]
    with ThreadPoolExecutor(2) as pool:
        found = pool.submit(last, numbers, -1)
        assert begun.wait(30.0)
        assert pool.submit(shifted(2.5), 1.0).result() == 3.5
    assert found.result() == 599.0


def test_after_kernels_of_many_threads_numba_is_as_before() -> None:
    """Whoever comes second must not take the first one's substitutes for numba's."""
    numbers = np.arange(20.0)[5:15]
    kernels = [shifted(k + 0.25) for k in range(12)]

    def own(k: int) -> float:
        @njit
        def entry_of(numbers, place):  # type: ignore[no-untyped-def]
            return numbers[place] + k

        return float(entry_of(numbers, -1 - k))

    with ThreadPoolExecutor(6) as pool:
        values = [pool.submit(kernel, 1.0) for kernel in kernels]
        owns = [pool.submit(own, k) for k in range(6)]
        assert [v.result() for v in values] == [k + 1.25 for k in range(12)]
        assert [v.result() for v in owns] == [14.0] * 6
    assert own(0) == 14.0


def test_threads_may_ask_for_the_same_kernel() -> None:
    for number in (0.5, 1.5, 2.5):
        kernel, start = shifted(number), threading.Barrier(4)

        def call(kernel: Entry = kernel, start: threading.Barrier = start) -> float:
            start.wait()
            kernel.compiled(kernel.signatures[0])
            return float(kernel(1.0))

        with ThreadPoolExecutor(4) as pool:
            values = [pool.submit(call) for _ in range(4)]
            assert [v.result() for v in values] == [number + 1.0] * 4
