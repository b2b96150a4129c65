"""Trees with friction in their joints and laws of outputs, said differently.

Each scene is said in some of all ways; `benchmarks/metamorphic.py` says more of them in
all ways. Differences are relative to what `rtol` is.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from sidtool.solver import simulate
from tests.metamorphic.generator.case import Case, Values, compiled, run
from tests.metamorphic.generator.differences import promised
from tests.metamorphic.generator.rubbing import rubbing_scene
from tests.metamorphic.invariants import violations
from tests.metamorphic.ways.transformations import TRANSFORMATIONS, compared

SEEDS = (0, 1)
RTOL = 1e-7
#: Share of the ways in which each scene is said.
TURNS = 8


@cache
def original(seed: int) -> tuple[Case, Values]:
    case = rubbing_scene(seed)
    return case, run(case, rtol=RTOL)


def pairs() -> list[tuple[int, str]]:
    names = list(TRANSFORMATIONS)
    return [(s, n) for s in SEEDS for k, n in enumerate(names) if (s + k) % TURNS == 0]


@pytest.mark.parametrize(("seed", "name"), pairs())
def test_a_tree_that_rubs_moves_the_same_said_differently(seed: int, name: str) -> None:
    case, exact = original(seed)
    found = compared(name, case, exact, seed, RTOL, promised)
    if found is None:
        pytest.skip("the scene has nothing that could be said so")
    error, allowed, where = found
    assert error < allowed, where


@pytest.mark.parametrize("seed", SEEDS)
def test_energy_changes_by_what_rubs_and_what_laws_supply(seed: int) -> None:
    for law, (found, allowed) in violations(original(seed)[0], RTOL).items():
        assert found < allowed, law


@pytest.mark.parametrize(("seed", "rtol"), [(7101, 1e-5), (7277, 1e-6), (7363, 1e-4)])
def test_joints_at_their_friction_limit_slip_at_any_tolerance(
    seed: int, rtol: float
) -> None:
    """Guides and a pin at their limits, and two joints that hold one motion."""
    system = compiled(rubbing_scene(seed), keep_joints=True)
    exact = simulate(system, rtol=1e-8).positions[-1]
    found = simulate(system, rtol=rtol).positions[-1]
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=10.0 * rtol)


def test_a_joint_turns_round_with_a_rate_that_is_rounding() -> None:
    """It turns back 0.22 ms later, with less than the tolerance of its rate.

    Instants of a run with 1e-6; 1e-4 of its largest rate, 3.9 m/s, over the
    acceleration of 1.8 m/s^2 is 0.22 ms.
    """
    result = simulate(compiled(rubbing_scene(7112), keep_joints=True), rtol=1e-4)
    last = [(event.name, event.kind) for event in result.events[-2:]]
    assert last == [("j3", "slip"), ("j3", "stick")]
    times = [event.t for event in result.events[-2:]]
    np.testing.assert_allclose(times, [0.753098, 0.753321], rtol=0.0, atol=2.2e-4)
