"""What a run says that stops because a body has bent beyond its SID."""

from __future__ import annotations

import pytest

from sidtool.solver.errors import SimulationError
from tests.solver.stiffened_bars import run, struck
from tests.steel_bars import TANGENT, slender_bar


def test_a_bar_struck_hard_names_the_remedy_and_it_helps() -> None:
    """A free bar in space, bent by 2 % (docs/howto/stiffening)."""
    sid = slender_bar(2, TANGENT, False)
    start = struck(sid, [0.5, 3.0, 2.0], [0.0, 0.0, 3.0])
    bar = {"sid": "-", "markers": {"b": 2}, "initial": start}
    with pytest.raises(SimulationError, match="quadratic_inertia = true of the body"):
        run(sid, "spatial", 0.15, 1e-7, bodies={"bar": bar})
    run(sid, "spatial", 0.15, 1e-7, bodies={"bar": bar | {"quadratic_inertia": True}})
