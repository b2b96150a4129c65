"""Kernels on disk: found by other processes, and only while their code is the same."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from sidtool.formats.diagnostics.record import DiagnosticWarning
from sidtool.solver.compiler import kernel_cache, precompile
from sidtool.solver.compiler.inner_kernels import Intrinsic, inner
from sidtool.solver.compiler.kernels import Entry, entry
from sidtool.solver.compiler.types import float64
from sidtool.solver.compiler.vectors import formula
from sidtool.solver.integrators.registry import all_step_loops
from tests.codes import only_warning
from tests.places import ROOT
from tests.solver.compiler.small_kernels import scaled

STAMPS = """
from tests.solver.compiler.test_compiling import stamps
for name, text in stamps().items():
    print(name, text)
"""


def stamps() -> dict[str, str]:
    """Of all entry kernels, by their names."""
    found = {}
    for name in (
        name for group in precompile.all_groups(all_step_loops()) for name in group
    ):
        found[name] = precompile.find_kernel(name).code_digest
    return found


def test_every_process_finds_the_same_kernels() -> None:
    """Else each run would compile again what is on disk."""
    run = subprocess.run(
        [sys.executable, "-c", STAMPS],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        encoding="utf-8",
    )
    there = dict(line.split() for line in run.stdout.splitlines())
    assert there == stamps()
    assert len(set(there.values())) == len(there)


def test_a_kernel_on_disk_is_used() -> None:
    name = "integrators.radau:advance"
    kernel = precompile.find_kernel(name)
    for signature in kernel.signatures:
        kernel.address(signature)
        assert kernel.cached_code(signature) is not None


def test_every_kernel_has_a_file_of_its_own() -> None:
    """Else two kernels would push each other out of the cache at every run."""
    names = [
        name for group in precompile.all_groups(all_step_loops()) for name in group
    ]
    kernels = [precompile.find_kernel(name) for name in names]
    files = [
        kernel.cache_location(signature)[0]
        for kernel in kernels
        for signature in kernel.signatures
    ]
    assert len(set(files)) == len(files) > len(names)


def test_processes_help_only_where_kernels_can_be_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They hand over what they compile on disk; without one they would be in vain."""
    here: list[str] = []
    numbers: list[int] = []

    @contextmanager
    def helpers(queue: Any, number: int, *_: Any) -> Iterator[None]:
        numbers.append(number)
        yield

    monkeypatch.setattr(kernel_cache, "_warned", set())
    monkeypatch.setattr(precompile, "_helpers", helpers)
    monkeypatch.setattr(precompile, "_compile_here", here.append)
    monkeypatch.setattr(precompile, "processors", lambda: 3)
    groups = [("a:a", "a:b"), ("b:a",), ("c:a",)]
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    precompile._compile(groups, None)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(Path(__file__) / "cache"))
    with pytest.warns(DiagnosticWarning) as told:
        precompile._compile(groups, None)
    assert only_warning(told).code == "N810"
    assert numbers == [3, 0] and here == 2 * ["a:a", "a:b", "b:a", "c:a"]


def test_another_constant_in_a_kernel_below_is_another_kernel() -> None:
    two, three = scaled(2.0), scaled(3.0)
    assert two(1.5) == 3.0 and three(1.5) == 4.5
    ones = [kernel.code_digest for kernel in (two, three, scaled(2.0))]
    assert ones[0] == ones[2] != ones[1]


def weighted(factors: tuple[float, float], table: dict[str, float]) -> Entry:
    """Two inner kernels of one factory, and a formula that reads a dictionary."""

    def times(factor: float) -> Any:
        return inner()(lambda x: factor * x)

    def entry_of_table() -> float:
        return table["entry"]

    offset = formula(lambda x: x + entry_of_table())
    first, second = map(times, factors)
    return entry(float64(float64))(lambda x: first(x) + second(offset(x)))


def test_all_that_a_kernel_refers_to_is_part_of_its_digest() -> None:
    """Kernels of one factory have the same code; one of them alone was looked at."""
    cases = [((2.0, 3.0), 1.0), ((2.0, 4.0), 1.0), ((3.0, 2.0), 1.0), ((2.0, 3.0), 5.0)]
    kernels = [weighted(factors, {"entry": number}) for factors, number in cases]
    assert len({kernel.code_digest for kernel in kernels}) == len(cases)
    same = weighted(cases[0][0], {"entry": 1.0})
    assert same.code_digest == kernels[0].code_digest


def test_a_kernel_may_use_what_was_registered_after_another_was_compiled() -> None:
    """As functions of numba may; the number is another one in every process, so that no
    kernel is on disk.
    """
    number = float(os.getpid())
    assert scaled(number)(2.0) == 2 * number

    @Intrinsic
    def half(x):  # type: ignore[no-untyped-def]
        def generate(builder, arguments):  # type: ignore[no-untyped-def]
            return builder.fmul(arguments[0], arguments[0].type(0.5))

        return float64(float64), generate

    @entry(float64(float64))
    def kernel(x):  # type: ignore[no-untyped-def]
        return number * half(x)

    assert kernel(3.0) == 1.5 * number
