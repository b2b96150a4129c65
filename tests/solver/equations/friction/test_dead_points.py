"""A slider-crank whose joints rub, free from its dead point on: no drive decides it."""

from __future__ import annotations

import numpy as np
import pytest

from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validated
from sidtool.solver import compile_scene, run
from sidtool.solver.errors import SimulationError
from tests.solver.equations.friction import test_driven as driven


def released(speed: float, end: float, coefficient: float, without: str = "") -> Result:
    """From the outer dead point, its crank turning at a speed [rad/s]."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(driven, "SPEED", speed)
        made = driven.slider_crank("planar")
    data = made.model_dump(by_alias=True, exclude_none=True)
    del data["drives"]
    for joint in data["joints"].values():
        joint["friction"]["coefficient"] = coefficient
    names = ["energy.balance", "energy.dissipated", "guide.friction"]
    if without:
        del data["joints"][without]["friction"], names[2]
    data["outputs"]["record"] = names
    data["time"]["end"] = end
    system = compile_scene(validated(data, SceneFile), ".")
    return run.simulate(system, integrator="radau9", rtol=1e-8)


@pytest.mark.parametrize("speed", [4.0, 0.5])
def test_it_moves_away_and_comes_to_rest(speed: float) -> None:
    """Its guide moves inwards at once, so that friction points outwards."""
    result = released(speed, 2.0, driven.MU)
    assert result.completed
    assert np.ptp(result["energy.balance"]) < 1e-8
    assert (np.diff(result["energy.dissipated"]) > -1e-12).all()
    assert result["guide.friction"][0] > 0.0
    last = [event.kind for event in result.events[-4:]]
    assert last == ["stick"] * 4


def test_it_ends_where_it_passes_the_dead_point_back_at_once() -> None:
    """Gravity turns it back after 32 us and over the dead point after 64 us, between
    which the guide moves outwards by 1e-17 m. Events one rounding of the time after
    another went on for ever."""
    try:
        result = released(1e-3, 2.0, 0.02)
    except SimulationError as error:
        assert "guide change between stick and slip at once" in str(error)
        assert "dead point of guide" in str(error)
    else:
        assert np.ptp(result["energy.balance"]) < 1e-8


def test_at_rest_in_it_friction_is_not_decided() -> None:
    """The guide cannot move to first order: what it holds is anyone's guess."""
    with pytest.raises(SimulationError, match="friction has no solution") as caught:
        released(0.0, 1.0, driven.MU)
    message = str(caught.value)
    for words in ("stopped at t = 0 s", "dead point of guide", "larger speed", "drive"):
        assert words in message
    assert released(0.0, 0.01, driven.MU, without="guide").completed  # as it says
