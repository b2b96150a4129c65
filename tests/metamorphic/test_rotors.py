"""Modes of random rotors are all that small motions of their runs contain."""

from __future__ import annotations

import pytest

from tests.metamorphic.rotors import missing

#: Rigid ones are even; of (seed // 2) % 3 zero is round on round bearings, one has
#: bearings of two stiffnesses, two is not round.
SEEDS = (0, 1, 2, 4, 5, 11)
#: A flexible shaft on bearings of two stiffnesses.
REFUSED = 3


@pytest.mark.parametrize("seed", SEEDS)
def test_a_small_motion_of_a_rotor_has_its_modes_and_no_others(seed: int) -> None:
    found = missing(seed)
    assert found is not None
    assert len(found) >= 2
    for name, left in found.items():
        assert left < 1e-5, name


def test_no_modes_are_given_where_no_axes_make_the_equations_constant() -> None:
    assert missing(REFUSED) is None
