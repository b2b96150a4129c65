"""Static means at rest: drives hold their values, and nothing of their rates is left.

The reference is the same mechanism with its drives held by constants; besides that
equilibrium by hand.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sidtool.formats.scene import SceneFile, read_scene
from sidtool.formats.toml.reading import validate_data
from sidtool.solver import compile_scene
from sidtool.solver.analyses.linearisation import linearise
from sidtool.solver.analyses.static_equilibrium import static_equilibrium
from tests.places import SLIDER_CRANK
from tests.solver.scenes import polynomial, scene, slender_rod

G = 9.81
FUNCTIONS: dict[str, dict[str, Any]] = {
    "ramp": polynomial(0.3, 4.0, -7.0),
    "harmonic": {
        "type": "harmonic",
        "amplitude": 0.5,
        "offset": 0.3,
        "angular_frequency": 9.0,
        "phase": 0.0,
    },
    "table": {
        "type": "table",
        "times": [0.0, 0.2, 0.5, 1.0],
        "values": [0.3, 1.0, 0.2, 0.4],
    },
    "pieces": {
        "type": "polynomial",
        "pieces": [
            {"from": 0.0, "to": 0.5, "coefficients": [0.3, 2.0, 5.0]},
            {"from": 0.5, "coefficients": [2.55, 7.0]},
        ],
    },
}


def cart(function: dict[str, Any]) -> SceneFile:
    """A pendulum of 2 kg on a driven cart of 3 kg, hanging askew at the start."""
    bodies = {
        "cart": {"mass": 3.0, "inertia": 0.2},
        "bob": {
            "mass": 2.0,
            "inertia": 0.01,
            "markers": {"top": {"position": [0.0, 1.0]}},
            "initial": {"position": [0.1, -1.0], "velocity": [1.0, 0.0]},
        },
    }
    joints = {
        "slide": {"type": "prismatic", "markers": ["ground", "cart"]},
        "r": {"type": "revolute", "markers": ["cart", "bob.top"]},
    }
    record = ["r.fx", "r.fy", "bob.x", "bob.vx", "bob.ax", "cart.vx", "cart.ax"]
    record += ["push.f1", "slide.f1", "energy.kinetic", "r.angle_rate", "r.angle"]
    return scene(
        bodies,
        joints,
        {"push": {"joint": "slide", "function": function}},
        record=record,
        gravity=[0.0, -G],
    )


@pytest.mark.parametrize("kind", sorted(FUNCTIONS))
def test_a_pendulum_on_a_driven_cart_hangs_at_rest(kind: str) -> None:
    system = compile_scene(cart(FUNCTIONS[kind]), keep_joints=True)
    result = static_equilibrium(system).result()
    still = ["bob.vx", "bob.ax", "cart.vx", "cart.ax", "r.fx", "push.f1"]
    for name in [*still, "energy.kinetic", "r.angle_rate", "r.angle"]:
        assert result[name][0] == pytest.approx(0.0, abs=1e-8), name
    assert not result.velocities.any()
    assert result["bob.x"][0] == pytest.approx(0.3, abs=1e-9)
    assert result["r.fy"][0] == pytest.approx(2.0 * G, rel=1e-9)
    assert result["slide.f1"][0] == pytest.approx(5.0 * G, rel=1e-9)
    modes = linearise(system)
    pendulum = math.sqrt(2.0 * G / 2.01) / (2.0 * math.pi)
    assert modes.frequencies == pytest.approx([pendulum], rel=1e-7)


@pytest.mark.parametrize("speed", [0.0, 37.7, -120.0])
def test_a_driven_slider_crank_with_gravity_weighs_what_it_weighs(speed: float) -> None:
    """Forces in the bearing and under the piston carry the weight, whatever the speed
    that the drive begins with."""
    content = read_scene(SLIDER_CRANK / "slider_crank.toml").model_dump(
        by_alias=True, exclude_none=True, mode="json"
    )
    angle = 0.7
    content["gravity"] = [0.0, -G]
    content["drives"]["crank_angle"]["function"] = polynomial(angle, speed, 2.0)
    content["outputs"] = {"record": ["bearing.fy", "slider.fy", "piston.vx"]}
    system = compile_scene(
        validate_data(content, SceneFile), SLIDER_CRANK, keep_joints=True
    )
    result = static_equilibrium(system).result()
    masses = [body.sid.mass for body in system.bodies[1:]]
    carried = result["bearing.fy"][0] + result["slider.fy"][0]
    assert carried == pytest.approx(sum(masses) * G, rel=1e-8)
    assert result["piston.vx"][0] == 0.0
    held = content | {"drives": dict(content["drives"])}
    held["drives"]["crank_angle"]["function"] = {"type": "constant", "value": angle}
    other = compile_scene(
        validate_data(held, SceneFile), SLIDER_CRANK, keep_joints=True
    )
    same = static_equilibrium(other).result()
    assert result.values == pytest.approx(same.values, rel=1e-8, abs=1e-9)
    assert result.multipliers == pytest.approx(same.multipliers, rel=1e-8, abs=1e-8)


def test_a_force_that_grows_holds_its_value_at_the_start() -> None:
    """A pendulum on a torsion spring, pushed by a table that begins at 3 N m."""
    table = {"type": "table", "times": [0.0, 0.5, 1.0], "values": [3.0, 50.0, -20.0]}
    content = scene(
        {"rod": slender_rod(1.0, 2.0)},
        {"hinge": {"type": "revolute", "markers": ["ground", "rod.a"]}},
        record=["rod.angle", "push.mz", "hinge.fy"],
        forces={
            "spring": {"type": "spring_damper", "joint": "hinge", "stiffness": 40.0},
            "push": {
                "type": "force",
                "marker": "rod.b",
                "torque": 1.0,
                "function": table,
            },
        },
    )
    result = static_equilibrium(compile_scene(content, keep_joints=True)).result()
    assert result["push.mz"][0] == pytest.approx(3.0)
    assert result["rod.angle"][0] == pytest.approx(3.0 / 40.0, rel=1e-9)
    assert np.abs(result["hinge.fy"][0]) < 1e-9
