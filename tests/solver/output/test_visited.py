"""States that a run keeps for its verdicts on flexible bodies."""

from __future__ import annotations

import tracemalloc
from functools import cache

import numpy as np
import pytest

from benchmarks.scenes import chain
from sidtool.solver.output.dense_output import StepEndStates, StepStates, join_steps
from sidtool.solver.system.system import System

STEPS = 12


@cache
def links(count: int) -> System:
    return chain(count, 1.0)


def impact(system: System) -> StepStates:
    """All coordinates are largest at the same time, that of the fifth step."""
    t = np.arange(STEPS, dtype=float)
    course = np.exp(-((t - 5.0) ** 2))
    sizes = system.n_positions, system.n_velocities
    z, v = (np.outer(course, 1.0 + np.arange(n)) for n in sizes)
    return StepStates(t, z, v)


def kept(system: System) -> int:
    """Bytes that stay in use."""
    ends = impact(system)
    visited = StepEndStates(system)
    tracemalloc.start()
    visited.add(ends)
    used, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return used


def test_what_is_kept_grows_with_the_bodies() -> None:
    """Not with their square, as one state for each elastic coordinate would."""
    assert kept(links(64)) < 5.0 * kept(links(16))


@pytest.mark.parametrize("numbers", [1, 10**3, 10**9])
def test_blocks_are_all_states_once_in_the_order_of_time(
    numbers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sidtool.solver.output.dense_output.MAX_NUMBERS", numbers)
    ends = impact(links(16))
    visited = StepEndStates(links(16), times=[2.5, 30.0])
    visited.add(ends)
    found = join_steps(list(visited.states_until(9.0)))
    assert np.array_equal(found.t, ends.t[:10])
    assert np.array_equal(found.z, ends.z[:10])
    assert np.array_equal(found.v, ends.v[:10])
