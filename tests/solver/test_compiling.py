"""Kernels on disk: found by other processes, and only while their code is the same."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

from numba import float64

from solver import warmup
from solver.kernels.compiling import entry, inner, stamp

STAMPS = """
from tests.solver.test_compiling import stamps
for name, text in stamps().items():
    print(name, text)
"""


def stamps() -> dict[str, str]:
    """Of all entry kernels, by their names."""
    found = {}
    for name in (name for group in warmup.all_groups() for name in group):
        kernel = warmup._find(name)
        found[name] = stamp(kernel._function, kernel.signatures)
    return found


def test_every_process_finds_the_same_kernels() -> None:
    """Else each run would compile again what is on disk."""
    run = subprocess.run(
        [sys.executable, "-c", STAMPS],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=True,
    )
    there = dict(line.split() for line in run.stdout.splitlines())
    assert there == stamps()
    assert len(set(there.values())) == len(there)


def test_a_kernel_on_disk_is_used() -> None:
    name = "integrators.radau:advance"
    kernel = warmup._find(name)
    for signature in kernel.signatures:
        kernel.compiled(signature)
        assert type(kernel)(kernel._function, kernel.signatures).is_cached(signature)


def _scaled(factor: float) -> Any:
    @inner(float64(float64))
    def times(x):  # type: ignore[no-untyped-def]
        return factor * x

    @entry(float64(float64))
    def kernel(x):  # type: ignore[no-untyped-def]
        return times(x)

    return kernel


def test_another_constant_in_a_kernel_below_is_another_kernel() -> None:
    two, three = _scaled(2.0), _scaled(3.0)
    assert two(1.5) == 3.0 and three(1.5) == 4.5
    ones = [stamp(k._function, k.signatures) for k in (two, three, _scaled(2.0))]
    assert ones[0] == ones[2] != ones[1]
