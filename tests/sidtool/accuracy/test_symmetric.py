"""Outputs that are zero by symmetry hold rounding, whatever the size of a machine."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.formats.scene import SceneFile
from sidtool.study import run_study
from tests.sidtool.study.parts import ONE

from .arms import cantilever, simulated, swinging


def pendulum(length: float) -> SceneFile:
    """Turns about y, pushed along z as well as by its weight."""
    mass, period = 3.0 * length**3, float(np.sqrt(length))
    arm = {
        "mass": mass,
        "inertia": [0.01 * mass * length**2] * 3,
        "centre_of_mass": [0.5 * length, 0.0, 0.0],
        "markers": {
            "pin": {"position": [0.0] * 3},
            "tip": {"position": [length, 0, 0]},
        },
    }
    return swinging(
        period,
        dimension="spatial",
        gravity=[0.0, 0.0, -9.81],
        bodies={"arm": arm},
        joints={"pin": {"type": "spherical", "markers": ["ground", "arm.pin"]}},
        outputs={"record": [*MOVING, *RESTING]},
    )


def test_the_place_of_a_pinned_arm_is_not_judged() -> None:
    """It stays at the origin but for rounding, 1e-28 m."""
    arm: dict[str, Any] = {"sid": "arm", "markers": {"root": 1, "tip": 2}}
    arm["initial"] = {"angular_velocity": 1.0}
    outputs = {"record": ["arm.angle", "arm.x"]}
    scene = swinging(1.0, bodies={"arm": arm}, outputs=outputs)
    result = simulated(scene, cantilever(), accuracy=1e-3)
    assert set(result.error) == {"arm.angle"}


MOVING = ("arm.tip.x", "arm.tip.vz", "arm.wy", "pin.fx", "momentum.z")
RESTING = ("arm.tip.y", "arm.tip.vy", "arm.x", "arm.wx", "pin.fy", "momentum.y")


@pytest.mark.parametrize("length", [1e-3, 1.0, 100.0])
def test_outputs_that_are_zero_by_symmetry_are_not_assessed(length: float) -> None:
    scene = pendulum(length)
    assert set(sidtool.simulate(scene, accuracy=1e-3).error) == set(MOVING)
    assert set(run_study(scene, settings=ONE).reference.left_out) == set(RESTING)


def test_the_force_across_all_loads_of_a_clamped_arm(tmp_path: Path) -> None:
    """Its joint prescribes the motion, so no multiplier shows the size of forces."""
    harmonic = {"type": "harmonic", "amplitude": 0.01, "frequency": 0.3}
    push = {"type": "force", "marker": "arm.tip", "force": [0.0, 1.0]}
    scene = swinging(
        1.0,
        gravity=None,
        joints={"clamp": {"type": "fixed", "markers": ["ground", "arm.root"]}},
        forces={"push": push | {"function": harmonic}},
        outputs={"record": ["arm.tip.y", "clamp.fx"]},
    )
    more: dict[str, Any] = {"settings": ONE, "keep": tmp_path}
    more["sids"] = {"arm": cantilever()}
    for _ in range(2):  # the second one reads what the first one kept
        assert run_study(scene, **more).reference.left_out == ("clamp.fx",)
