"""Runs of one system: what depends on the system alone is found once."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import Taylor
from sidtool.formats.result import Result
from sidtool.solver import simulate
from sidtool.solver.diagnostics import run_summary
from sidtool.solver.system.system import System

from .diagnostics.test_body_measures import cantilever
from .scenes import compiled, scene

#: What differs between runs: how long they take.
CLOCKS = ("seconds", "seconds_assembly")


def beam() -> System:
    """A cantilever under gravity with a point mass pinned to its tip; the assembly has
    to move the mass, and the run has something to tell."""
    sid = replace(cantilever(), De=Taylor(np.zeros((3, 3))))
    return compiled(
        scene(
            {
                "beam": {"sid": "b", "markers": {"root": 1, "tip": 2}},
                "tool": {"mass": 2e-3, "initial": {"position": [0.9, 0.1]}},
            },
            {
                "hub": {"type": "fixed", "markers": ["ground", "beam.root"]},
                "pin": {"type": "coincident", "markers": ["beam.tip", "tool"]},
            },
            gravity=[0.0, -2.0],
            end=0.1,
            record=["beam.q*", "tool.y", "pin.f*"],
        ),
        beam=sid,
    )


def told(result: Result) -> dict[str, Any]:
    """All but what the clock says."""
    content = asdict(result)
    for name in CLOCKS:
        content["counters"].pop(name)
    return content


def assert_same(one: Any, other: Any) -> None:
    np.testing.assert_equal(told(one), told(other))


def test_runs_of_one_system_are_those_of_new_ones(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Bit for bit, with all sentences; nothing of a run is left in the system."""
    system, count, find = beam(), [0], run_summary.assembly.assemble

    def assemble(wanted: System) -> Any:
        count[0] += 1
        return find(wanted)

    monkeypatch.setattr(run_summary.assembly, "assemble", assemble)
    first = simulate(system, rtol=1e-5)
    rough = simulate(system, rtol=1e-3)
    again = simulate(system, rtol=1e-5)
    assert count == [1]
    new_first = simulate(beam(), rtol=1e-5)
    new_rough = simulate(beam(), rtol=1e-3)
    assert count == [3]  # before notes are read: some try another start
    assert (
        first.diagnostics
        and len(rough.diagnostics)
        and rough.counters != first.counters
    )
    assert_same(again, first)
    assert_same(new_first, first)
    assert_same(new_rough, rough)


def test_diagnostics_leave_the_start_of_a_system() -> None:
    """Samples project states in place; those of the next run are none of them."""
    system = beam()
    result = simulate(system)
    start = system.cached(run_summary.initialise).start
    start.z[:] += 1e-9  # the pin is open, and a projection closes it
    z, v = start.z.copy(), start.v.copy()
    assert result.diagnostics
    np.testing.assert_array_equal(start.z, z)
    np.testing.assert_array_equal(start.v, v)
