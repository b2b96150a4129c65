"""Trees with friction in their joints and laws of outputs, said differently.

Each scene is said in some of all ways; `benchmarks/metamorphic.py` says more of them in
all ways. Differences are relative to what `rtol` is.
"""

from __future__ import annotations

from functools import cache

import pytest

from tests.metamorphic.generator.case import Case, Values, run
from tests.metamorphic.generator.differences import promised
from tests.metamorphic.generator.rubbing import rubbing_scene
from tests.metamorphic.invariants import violations
from tests.metamorphic.ways.transformations import TRANSFORMATIONS, compared

SEEDS = (0, 1, 3)
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
