"""How long a run may last does not change how it begins."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.formats.result import Result
from sidtool.solver import compile_scene, simulate
from tests.places import SLIDER_CRANK
from tests.solver.scenes import polynomial, scene


def founding(end: float) -> Result:
    """The slider-crank until its crank has turned back to where it was, after 3.2 s."""
    changes: dict[str, Any] = {
        "time.end": end,
        "time.output_step": end,
        "outputs.record": ["piston.x", "rod.q1"],
        "events": {"there": {"quantity": "rod.q1", "action": "stop", "count": 24}},
    }
    loaded = sidtool.Scene.load(SLIDER_CRANK / "slider_crank.toml", changes)
    return loaded.simulate(sids={"rod": sidtool.read(SLIDER_CRANK / "rod_q4.SID_FEM")})


@pytest.mark.filterwarnings("ignore")
def test_a_prescribed_mechanism_steps_alike_in_runs_of_seconds_and_of_days() -> None:
    """A run of 60 000 s asked for rates of constraints below rounding and stopped after
    1.25 s. Nothing accumulates where a drive prescribes all rigid motions."""
    short, long = founding(3.2), founding(60_000.0)
    assert short.events and long.events
    assert long.t[-1] == pytest.approx(short.t[-1], rel=1e-6)
    assert long["piston.x"][-1] == pytest.approx(short["piston.x"][-1], rel=1e-6)
    assert long.counters["steps"] < 1.2 * short.counters["steps"]


@pytest.mark.parametrize("method", ["radau9", "dop853", "generalised_alpha"])
def test_the_time_resolution_is_that_of_the_time_reached(method: str) -> None:
    """A pulse of a microsecond at the begin of a run of 1e6 s."""
    pulse = {
        "type": "force",
        "marker": "block",
        "force": [2e6, 0.0],
        "function": polynomial(1.0),
    }
    pulse["function"]["pieces"][0]["to"] = 1e-6
    pulse["function"]["pieces"].append({"from": 1e-6, "coefficients": [0.0]})
    block = {"mass": 1.0, "inertia": 1.0}
    described = scene(
        {"block": block}, end=1e6, steps=1, record=["block.vx"], forces={"pulse": pulse}
    )
    result = simulate(compile_scene(described), integrator=method, rtol=1e-6)
    assert result["block.vx"][-1] == pytest.approx(2.0, rel=1e-5)
    assert np.isfinite(result.values).all()
