"""Analyses of random scenes against runs, and against themselves said differently.

The forces of an equilibrium are balanced to 1e-10, so that places along soft directions
are known to 1e-6 m.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from sidtool.formats.base.sid import Array
from tests.metamorphic import analyses
from tests.metamorphic.generator.case import Case, Values, run
from tests.metamorphic.generator.differences import WITHIN, difference
from tests.metamorphic.generator.scenes import driven_scene, random_scene, with_measures
from tests.metamorphic.ways.transformations import TRANSFORMATIONS, said

SEEDS = (0, 1, 3, 4, 5)
RTOL = 1e-8
#: Of scenes that come to rest soon, with springs in place of weight.
WEIGHTLESS = (4, 7, 11, 12, 20)
#: Ways that leave the equilibrium and the eigenvalues as they are.
STILL = sorted(
    set(TRANSFORMATIONS)
    - {"units", "boosted and falling", "continued", "functions as callables"}
    - {"SIDs re-referenced, at the start", "SIDs re-referenced, small motion"}
    - {"energy balance recorded", "joints kept", "optional keys left out"}
    - {"signals from files and formulas"}
)


@cache
def rested(seed: int) -> tuple[Case, tuple[Case, Values] | None]:
    case = random_scene(seed)
    return case, analyses.equilibrium(case)


def test_most_scenes_have_an_equilibrium() -> None:
    assert sum(rested(seed)[1] is not None for seed in SEEDS) > 0.6 * len(SEEDS)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_small_motion_has_the_natural_modes_and_no_others(seed: int) -> None:
    left = analyses.small_motion(rested(seed)[0], np.random.default_rng(seed))
    assert left is None or left < 1e-3


@pytest.mark.parametrize("seed", SEEDS)
def test_a_damped_run_stays_in_the_equilibrium_and_comes_back_to_it(seed: int) -> None:
    case, _ = rested(seed)
    moved = analyses.rest(case)
    assert moved is None or moved < 1e-7
    gap = analyses.settles(case, np.random.default_rng(seed))
    assert gap is None or gap < 1e-4


@pytest.mark.parametrize("seed", WEIGHTLESS)
def test_loaded_springs_without_weight_come_to_rest_in_the_equilibrium(
    seed: int,
) -> None:
    """Also where nothing moves at the start and the sum of all forces is small."""
    case = analyses.weightless(random_scene(seed), np.random.default_rng([23, seed]))
    gap = analyses.settles(case, np.random.default_rng(seed))
    assert gap is not None and gap < 1e-7
    moved = analyses.rest(case)
    assert moved is not None and moved < 1e-9


@pytest.mark.parametrize("seed", SEEDS)
def test_inverse_dynamics_tells_the_forces_of_the_driven_run(seed: int) -> None:
    """The run keeps all joints, then none that a drive prescribes."""
    case = analyses.with_drive_forces(driven_scene(seed))
    exact = analyses.inverse(case)
    for other in (case, with_measures(case, forces=False)):
        error, where = difference(run(other, rtol=RTOL), exact)
        assert error < WITHIN * RTOL, where


@pytest.mark.parametrize("seed", SEEDS)
def test_equilibrium_and_modes_are_those_of_the_scene_said_differently(
    seed: int,
) -> None:
    case, found = rested(seed)
    if found is None:
        pytest.skip("the scene has no equilibrium")
    exact = analyses.eigenvalues(found[0])
    for name in STILL[seed % 3 :: 3]:
        other = said(name, case, seed)
        if other is None:
            continue
        again = analyses.equilibrium(other.case)
        assert again is not None, name
        places = other.back({k: again[1][k] for k in other.case.measures})
        for key in places:
            if key.endswith((".x", ".q")):
                assert places[key] == pytest.approx(found[1][key], abs=1e-6), (
                    name,
                    key,
                )
        squares = [_squares(v) for v in (exact, analyses.eigenvalues(again[0]))]
        assert squares[1] == pytest.approx(squares[0], rel=1e-5, abs=1e-4), name


def _squares(eigenvalues: Array) -> Array:
    """Of what is no free motion: rounding takes a double zero for a pair."""
    squares = eigenvalues**2
    return np.sort_complex(squares[np.abs(squares) > 1e-2])
