"""`[initial] state = "static"`: runs that start in equilibrium."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.scene import SceneFile
from sidtool.pipeline.extra_outputs import outputs
from sidtool.solver import compile_scene
from sidtool.solver.simulation.replay import scene_of
from sidtool.solver.simulation.simulate import simulate
from tests.places import SLIDER_CRANK

ROD = "rod_q4.SID_FEM"
G = 9.81


def scene(dimension: str = "planar", **more: Any) -> SceneFile:
    down = [0.0, -G] if dimension == "planar" else [0.0, 0.0, -G]
    table: dict[str, Any] = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": dimension,
        "gravity": down,
        "time": {"start": 0.0, "end": 0.5, "output_step": 0.01},
        "initial": {"state": "static"},
    }
    return SceneFile.model_validate(table | more)


def test_a_mass_hangs_in_its_spring() -> None:
    """It sags by m g / k, whatever height the scene gives it."""
    hung = scene(
        "spatial",
        bodies={
            "box": {
                "mass": 3.0,
                "inertia": [0.1, 0.2, 0.3],
                "initial": {"position": [0.0, 0.0, -0.4]},
            }
        },
        joints={"guide": {"type": "prismatic", "axis": [0, 0, 1], "markers": PAIR}},
        forces={
            "spring": {
                "type": "spring_damper",
                "markers": ["ground.hook", "box"],
                "stiffness": [700.0],
                "rest": 1.0,
            }
        },
        ground={"markers": {"hook": {"position": [0.0, 0.0, 1.0]}}},
        outputs={"record": ["box.z", "box.vz"]},
    )
    result = simulate(compile_scene(hung))
    assert result["box.z"] == pytest.approx(-3.0 * G / 700.0, rel=1e-8)
    assert result["box.vz"] == pytest.approx(0.0, abs=1e-9)


PAIR = ["ground", "box"]


def arm(angle: float) -> dict[str, Any]:
    """The founding rod on a driven hinge, with a tool of 2 kg fixed to its tip."""
    return {
        "bodies": {
            "rod": {"sid": ROD, "initial": {"angle": angle}},
            "tool": {
                "mass": 2.0,
                "inertia": 0.01,
                "initial": {"position": [np.cos(angle), np.sin(angle)], "angle": angle},
            },
        },
        "joints": {
            "hinge": {"type": "revolute", "markers": ["ground", "rod.1"]},
            "grip": {"type": "fixed", "markers": ["rod.2", "tool"]},
        },
        "drives": {
            "motor": {
                "joint": "hinge",
                "function": {"type": "constant", "value": angle},
            }
        },
        "outputs": {"record": ["rod.q*", "rod.vq*", "tool.y", "rod.2.uy"]},
    }


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_an_arm_rests_under_its_weight_and_its_tool(angle: float) -> None:
    result = simulate(compile_scene(scene(**arm(angle)), SLIDER_CRANK))
    start = result.values[0]
    assert result.values == pytest.approx(np.tile(start, (len(result.t), 1)), abs=1e-9)
    # a bar of 1 m and 3.14 kg, 31.70 Hz clamped: its bending stiffness from that
    mass, length = 3.140069778, 1.0
    stiffness = mass * length**3 * (2 * np.pi * 31.7011 / 1.8751**2) ** 2
    weight = mass * G * length**3 / 8.0 + 2.0 * G * length**3 / 3.0
    sag = -np.cos(angle) * weight / stiffness
    assert result["rod.2.uy"][0] == pytest.approx(sag, rel=2e-2)


def test_without_it_the_arm_falls_into_its_sag() -> None:
    stated = scene(**arm(0.0), initial={"state": "stated"})
    swinging = simulate(compile_scene(stated, SLIDER_CRANK))["rod.2.uy"]
    resting = simulate(compile_scene(scene(**arm(0.0)), SLIDER_CRANK))["rod.2.uy"][0]
    assert swinging[0] == 0.0
    assert swinging.min() == pytest.approx(2.0 * resting, rel=0.1)


def test_stated_velocities_stay() -> None:
    pendulum = scene(
        bodies={
            "bob": {
                "mass": 1.0,
                "inertia": 0.1,
                "markers": {"pin": {"position": [0.0, 0.5]}},
                "initial": {
                    "position": [0.2, -0.45],
                    "angle": 0.4,
                    "velocity": [0.15, 0.0],
                    "angular_velocity": 0.3,
                },
            }
        },
        joints={"pin": {"type": "revolute", "markers": ["ground", "bob.pin"]}},
        outputs={"record": ["bob.angle", "bob.wz"]},
    )
    result = simulate(compile_scene(pendulum), rtol=1e-9)
    assert result["bob.angle"][0] == pytest.approx(0.0, abs=1e-9)
    assert result["bob.wz"][0] == pytest.approx(0.3, rel=1e-6)
    # energy: from the lowest point with 0.3 rad/s
    largest = np.arccos(1.0 - 0.5 * (0.1 + 0.25) * 0.3**2 / (G * 0.5))
    assert np.abs(result["bob.angle"]).max() == pytest.approx(largest, rel=1e-2)


def test_what_cannot_rest_is_refused() -> None:
    falling = scene(bodies={"box": {"mass": 1.0, "inertia": 0.1}})
    with pytest.raises(InputError, match="equilibrium") as error:
        compile_scene(falling)
    assert "initial.state" in str(error.value)


@pytest.mark.parametrize(
    ("laws", "code"),
    [
        (["1/(box.x - 0.5)"], "N509"),  # at its pole
        (["1.5e308*cos(box.x)", "1.5e308*cos(box.x)"], "N301"),  # their sum
        (["1 - 1.5e308*sin(1e9*(box.x - 0.5))"], "N301"),  # its derivative
    ],
)
def test_forces_without_a_number_at_the_start_are_refused(
    laws: list[str], code: str
) -> None:
    """By the search for the equilibrium, and by that for a steady rotation before."""
    forces = {
        f"push_{k}": {
            "type": "force",
            "marker": "box",
            "force": [1.0, 0.0],
            "function": {"type": "expression", "value": law},
        }
        for k, law in enumerate(laws)
    }
    start = {"position": [0.5, 0.0], "angular_velocity": 3.0}
    box = {"mass": 1.0, "inertia": 0.1, "initial": start}
    pushed = scene(bodies={"box": box}, forces=forces, gravity=[0.0, 0.0])
    with pytest.raises(InputError, match=code) as error:
        compile_scene(pushed)
    assert "initial.state" in str(error.value)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize("twist", [4.0, -9.0])
def test_a_spring_rests_wound_by_more_than_half_a_turn(
    dimension: str, twist: float
) -> None:
    """A torque T winds it by T / k, and the run begins with these turns."""
    stiffness = 10.0
    spring = {"type": "spring_damper", "joint": "hinge", "stiffness": stiffness}
    winding = {"type": "constant", "value": stiffness * twist}
    inertia = 0.3 if dimension == "planar" else [0.1, 0.2, 0.3]
    wound = scene(
        dimension,
        bodies={"box": {"mass": 1.0, "inertia": inertia}},
        joints={"hinge": {"type": "revolute", "markers": PAIR}},
        forces={
            "spring": spring | {"damping": 0.1},
            "motor": {"type": "actuator", "joint": "hinge", "function": winding},
        },
        outputs={"record": ["hinge.angle"]},
    )
    result = simulate(compile_scene(wound))
    assert result["hinge.angle"] == pytest.approx(twist, abs=1e-8)
    torque = outputs(result, ["spring.torque"])["spring.torque"]
    assert torque == pytest.approx(-stiffness * twist, abs=1e-6)
    again = simulate(compile_scene(scene_of(result)))
    assert again["hinge.angle"] == pytest.approx(twist, abs=1e-8)
