"""Modes of random rotors are all that small motions of their runs contain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sidtool.solver import linearise
from sidtool.solver.system.errors import SimulationError
from tests.metamorphic.rotors import compiled, missing, random_rotor, shaft

#: Rigid ones are even; of (seed // 2) % 3 zero is round on round bearings, one has
#: bearings of two stiffnesses, two is not round.
SEEDS = (0, 1, 2, 3, 4, 5, 11)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_small_motion_of_a_rotor_has_its_modes_and_no_others(seed: int) -> None:
    found = missing(random_rotor(seed), seed)
    assert len(found) >= 2
    for name, left in found.items():
        assert left < 1e-5, name


def test_no_modes_are_given_where_no_axes_make_the_equations_constant() -> None:
    """A shaft that is not round on bearings of two stiffnesses."""
    rotor = random_rotor(3)
    flat = replace(rotor, sids={"shaft": shaft(0.02, 0.014)})
    with pytest.raises(SimulationError, match="N713"):
        missing(flat, 3)


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_weight_does_not_change_the_modes_of_a_round_rotor(seed: int) -> None:
    """Springs and shaft are linear; the sag stands still while the shaft turns."""
    rotor = random_rotor(seed)
    found = []
    for gravity in (0.0, -9.81):
        table = rotor.table | {"gravity": [0.0, gravity, 0.0]}
        modes = linearise(compiled(rotor, table), "start")
        found.append(np.sort(modes.inertial_frequencies))
        assert modes.rigid.sum() == 1  # the rotation
    assert found[1] == pytest.approx(found[0], rel=1e-6, abs=1e-6)
