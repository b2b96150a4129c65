"""The order of every integrator, seen on flexible mechanisms in the plane and in space.

Fixed steps on soft bodies, whose vibrations all steps resolve, with joints: elastic
coordinates and places at the end against a run that is far more accurate. A method
whose order is not in `STEPS` has no test here, and fails.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene, simulate
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.solver.system.system import System
from tests.solver.dynamics.joint_scenes import soft_body
from tests.solver.scenes import GRAVITY, compiled, scene, slender_rod
from tests.solver.test_invariance import arm_in_space

#: Numbers of steps in one second, by order.
STEPS = {2: (100, 400), 5: (25, 100), 8: (20, 60), 9: (24, 48), 13: (8, 12)}
SHAKEN: dict[str, Any] = {"elastic": [0.1, -0.05], "elastic_velocity": [1.0, 1.0]}
#: All velocities are stated, so that joints take a part of each and the motion is calm.
TURNED: dict[str, Any] = {"angle": 0.3, "angular_velocity": -3.0}


def in_the_plane() -> System:
    """A flexible arm on a pivot, and a rod that hangs on it."""
    sid = soft_body(True, seed=2)
    root = -sid.node("1").position[:2]
    tip = (root + sid.node("2").position[:2]).tolist()
    initial = {"position": root.tolist(), "velocity": [0.0, 0.0], **SHAKEN}
    initial["angular_velocity"] = 2.0
    bodies = {
        "arm": {
            "sid": "-",
            "quadratic_inertia": True,
            "markers": {"pivot": "1", "tip": "2"},
            "initial": initial,
        },
        "rod": slender_rod(1.0, position=tip, velocity=[0.0, 0.0], **TURNED),
    }
    joints = {
        "pivot": {"type": "revolute", "markers": ["ground", "arm.pivot"]},
        "tip": {"type": "revolute", "markers": ["arm.tip", "rod.a"]},
    }
    record = ["arm.q1", "arm.q2", "rod.b.x", "rod.b.y"]
    down = [0.0, -GRAVITY]
    return compiled(
        scene(bodies, joints, steps=1, gravity=down, record=record), arm=sid
    )


def in_space() -> System:
    table, sids = arm_in_space()
    table["time"] = {"end": 1.0, "output_step": 1.0}
    table["outputs"] = {"record": ["arm.q1", "arm.q2", "bob.x", "bob.y", "bob.z"]}
    spins = {"arm": [1.0, 2.0, 0.5], "bob": [1.0, -2.0, 0.5]}
    for name, spin in spins.items():
        table["bodies"][name]["initial"] |= {
            "velocity": [0.0, 0.0, 0.0],
            "angular_velocity": spin,
        }
    table["bodies"]["arm"]["initial"].update(SHAKEN)
    return compile_scene(SceneFile.model_validate(table), ".", sids)


SCENES = {"plane": in_the_plane, "space": in_space}


@cache
def exact(name: str) -> Result:
    return simulate(SCENES[name](), integrator="radau13", rtol=1e-13)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_errors_fall_with_the_order(integrator: str, name: str) -> None:
    """The best methods meet rounding before their rate settles: theirs is at least the
    order, less a half."""
    order = INTEGRATORS[integrator].order
    counts = STEPS[order]
    errors = []
    for count in counts:
        result = simulate(
            SCENES[name](), integrator=integrator, step=1.0 / count, rtol=1e-9
        )
        errors.append(np.abs(result.values - exact(name).values)[-1].max())
    rate = math.log(errors[0] / errors[1]) / math.log(counts[1] / counts[0])
    if order <= 5:
        assert rate == pytest.approx(order, abs=0.2)
    else:
        assert rate > order - 0.5
