"""Threads that compile at once: kernels here, functions of the user's own there."""

from __future__ import annotations

import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numba import njit, types
from numba.extending import intrinsic

from sidtool.formats.result import Result
from sidtool.solver import simulate
from sidtool.solver.compiler.kernels import Entry, entry
from sidtool.solver.compiler.types import float64
from tests.solver.scenes import compiled, scene, slender_rod


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
            return context.get_constant(types.float64, 0.0)

        return types.float64(), generate

    return pause


def everything_in_numba() -> dict[str, Any]:
    """Functions of its modules and of the classes there."""
    found = {}
    for place, module in list(sys.modules.items()):
        if place.partition(".")[0] != "numba":
            continue
        for name, value in list(vars(module).items()):
            if callable(value):
                found[f"{place}.{name}"] = value
            if isinstance(value, type):
                members = dict(vars(value)).items()
                found |= {f"{place}.{name}.{k}": v for k, v in members if callable(v)}
    return found


@pytest.mark.usefixtures("empty_cache")
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


@pytest.mark.usefixtures("empty_cache")
def test_after_kernels_of_many_threads_numba_is_as_before() -> None:
    """Nothing of it is replaced, neither meanwhile nor for good."""
    before = everything_in_numba()
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
    after = everything_in_numba()
    assert [name for name in before if before[name] is not after[name]] == []


@pytest.mark.usefixtures("empty_cache")
def test_numba_is_itself_while_a_kernel_is_compiled() -> None:
    before, meanwhile = everything_in_numba(), {}

    @intrinsic
    def look(context):  # type: ignore[no-untyped-def]
        def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
            meanwhile.update(everything_in_numba())
            return context.get_constant(types.float64, 1.0)

        return types.float64(), generate

    @entry(float64(float64))
    def kernel(x):  # type: ignore[no-untyped-def]
        return x + look()

    assert kernel(2.0) == 3.0
    assert meanwhile
    assert [name for name in before if before[name] is not meanwhile[name]] == []


def pendulum() -> Result:
    """A double pendulum, which forgives no difference of a bit."""
    described = scene(
        {"upper": slender_rod(1.0), "lower": slender_rod(0.7)},
        {
            "j0": {"type": "revolute", "markers": ["ground", "upper.a"]},
            "j1": {"type": "revolute", "markers": ["upper.b", "lower.a"]},
        },
        end=3.0,
        gravity=[0.0, -9.81],
        record=["lower.b.x", "lower.b.y"],
    )
    return simulate(compiled(described), rtol=1e-8)


def test_threads_that_simulate_while_another_compiles_agree_to_the_last_bit() -> None:
    alone = pendulum()
    over = threading.Event()

    def compile_own_functions() -> int:
        count = 0
        while not over.is_set() or count == 0:
            count += 1

            @njit
            def last(numbers, k, count=count):  # type: ignore[no-untyped-def]
                return numbers[k] * count

            assert last(np.arange(5.0), -1) == 4.0 * count
        return count

    with ThreadPoolExecutor(9) as pool:
        own = pool.submit(compile_own_functions)
        runs = [pool.submit(pendulum) for _ in range(8)]
        results = [run.result() for run in runs]
        over.set()
        assert own.result() > 0
    for result in results:
        for name in ("positions", "velocities", "multipliers", "values"):
            assert np.array_equal(getattr(result, name), getattr(alone, name))


@pytest.mark.usefixtures("empty_cache")
def test_threads_may_ask_for_the_same_kernel() -> None:
    for number in (0.5, 1.5, 2.5):
        kernel, start = shifted(number), threading.Barrier(4)

        def call(kernel: Entry = kernel, start: threading.Barrier = start) -> float:
            start.wait()
            kernel.address(kernel.signatures[0])
            return float(kernel(1.0))

        with ThreadPoolExecutor(4) as pool:
            values = [pool.submit(call) for _ in range(4)]
            assert [v.result() for v in values] == [number + 1.0] * 4
