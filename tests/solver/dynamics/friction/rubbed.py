"""Scenes with dry friction: run, and judged by when they stick and slip."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import SID
from sidtool.formats.result import Result
from sidtool.solver import compile_scene
from sidtool.solver.simulation import simulate as simulate_module
from tests.solver.dynamics.joint_scenes import scene

G = 9.81
RTOL = 1e-9
MASS, MU, REST = 2.0, 0.3, 0.4
INDEX_1 = ("radau5", "radau9", "radau13", "dop853", "auto")


def simulate(
    dimension: str,
    end: float,
    sids: dict[str, SID] | None = None,
    method: str = "radau9",
    rtol: float = RTOL,
    step: float | None = None,
    **tables: Any,
) -> Result:
    system = compile_scene(scene(dimension, end, **tables), ".", sids or {})
    return simulate_module.simulate(system, integrator=method, rtol=rtol, step=step)


def vector(dimension: str, x: float, y: float) -> list[float]:
    return [x, y] if dimension == "planar" else [x, y, 0.0]


def changes(result: Result, joint: str) -> list[tuple[str, float]]:
    return [(e.kind, e.t) for e in result.events if e.name == joint]


def assert_changes(
    result: Result, joint: str, known: list[tuple[str, float, float]], tol: float
) -> None:
    """The same changes at the same times, at places that the first output tells."""
    found = [e for e in result.events if e.name == joint]
    assert [e.kind for e in found] == [kind for kind, _, _ in known]
    for event, (_, t, x) in zip(found, known, strict=True):
        assert event.t == pytest.approx(t, abs=tol)
        assert event.values[0] == pytest.approx(x, abs=tol)


def assert_balanced(result: Result, tol: float) -> None:
    balance = result.values[:, result.names.index("energy.balance")]
    lost = result.values[:, result.names.index("energy.dissipated")]
    assert lost[-1] > 0.0
    assert np.ptp(balance) < tol * lost[-1]
    assert np.all(np.diff(lost) > -tol * lost[-1])


ENERGIES = ["energy.balance", "energy.dissipated"]
