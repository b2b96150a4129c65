"""Bounds of errors in prescribed frames, against motions of all shape functions."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.formats.base.sid import SID
from sidtool.formats.scene import SceneFile
from sidtool.measurement import cache
from tests.bodies import particle_body

from .arms import cantilever, spun, swinging

TIGHT = {"integrator": "radau13", "rtol": 1e-12}
RECORD = ["arm.tip.uy", "arm.tip.y", "arm.q1", "arm.q3", "arm.vq2"]


@pytest.fixture(autouse=True)
def _own_cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "cache_path", lambda: tmp_path)


def struck() -> SceneFile:
    """A clamped arm on which a force across its tip sets in at once."""
    push = {"type": "force", "marker": "arm.tip", "force": [0.0, 0.02]}
    joints = {"clamp": {"type": "fixed", "markers": ["ground", "arm.root"]}}
    outputs = {"record": RECORD}
    return swinging(
        8.0, gravity=None, joints=joints, forces={"push": push}, outputs=outputs
    )


def shaken() -> SceneFile:
    """An arm on a slide that is driven to and fro, off its own axis."""
    slide = {"type": "prismatic", "markers": ["ground", "arm.root"], "axis": [0.3, 1.0]}
    shake = {"type": "harmonic", "amplitude": 0.004, "angular_frequency": 4.9}
    return swinging(
        6.0,
        gravity=[0.0, -0.05],
        joints={"slide": slide},
        drives={"shake": {"joint": "slide", "function": shake}},
        outputs={"record": RECORD},
    )


def tumbling() -> SceneFile:
    """In space, about an axis that lies askew to the arm: gyroscopic forces."""
    ramp = {"type": "sine_ramp", "of": "rate", "end": 0.4, "from": 0.0, "to": 8.0}
    joints = {
        "hub": {
            "type": "revolute",
            "markers": ["ground", "arm.root"],
            "axis": [0.4, -0.2, 1.0],
        }
    }
    return spun(
        0.3,
        8.0,
        dimension="spatial",
        joints=joints,
        drives={"spin": {"joint": "hub", "function": ramp}},
        outputs={"record": RECORD},
    )


def ramped() -> SceneFile:
    """Spun up across the plane: a stiffness that gets less."""
    return spun(0.3, 8.0, outputs={"record": RECORD})


@functools.cache
def exact_motion(make: Callable[[], SceneFile]) -> sidtool.Result:
    return sidtool.simulate(make(), sids={"arm": cantilever(4)}, **TIGHT)


def exact_and_found(
    make: Callable[[], SceneFile], accuracy: Any
) -> tuple[sidtool.Result, sidtool.Result]:
    result = sidtool.simulate(make(), sids={"arm": cantilever(4)}, accuracy=accuracy)
    return exact_motion(make), result


@pytest.mark.parametrize(
    ("make", "wanted"),
    [
        (struck, 0.05),
        (struck, 1e-3),
        (shaken, 1e-3),
        (tumbling, 0.05),
        (tumbling, 1e-3),
        (ramped, 0.05),
    ],
)
def test_no_error_exceeds_its_bound_and_bounds_are_near(
    make: Callable[[], SceneFile], wanted: float
) -> None:
    wanted_of = {"arm.tip.uy": wanted, "arm.tip.y": wanted}
    exact, found = exact_and_found(make, wanted_of)
    assert len(found.accuracy.outputs) == 2
    for output in found.accuracy.outputs:
        error = np.abs(found[output.name] - exact[output.name]).max()
        assert error <= output.bound <= 30.0 * error


def test_rates_and_coordinates_have_bounds_as_well() -> None:
    exact, found = exact_and_found(struck, {"arm.q1": 0.02, "arm.vq2": 0.02})
    for output in found.accuracy.outputs:
        error = np.abs(found[output.name] - exact[output.name]).max()
        assert error <= output.bound < 0.5 * output.variation


@pytest.mark.parametrize(
    ("scene", "sid"),
    [
        (swinging(0.4), cantilever(2)),
        (spun(0.3, 8.0), cantilever(2, stiffened=True)),
        (struck(), particle_body(3, 9, planar=True, seed=2)),
    ],
)
def test_where_frames_are_free_or_masses_change_there_are_estimates_alone(
    scene: SceneFile, sid: SID
) -> None:
    record = scene.outputs.model_copy(update={"record": ("arm.tip.uy", "arm.tip.x")})
    content = scene.model_copy(update={"outputs": record})
    result = sidtool.simulate(content, sids={"arm": sid}, accuracy=1e-2)
    assert all(o.bound is None for o in result.accuracy.outputs)
