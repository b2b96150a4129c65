"""A slider-crank whose joints rub, free from its dead point on: no drive decides it."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.solver import compile_scene
from sidtool.solver.simulation import simulate as simulate_module
from sidtool.solver.system.errors import SimulationError
from tests.solver.dynamics.friction import test_driven as driven
from tests.solver.dynamics.friction.rubbed import simulate


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
    system = compile_scene(validate_data(data, SceneFile), ".")
    return simulate_module.simulate(system, integrator="radau9", rtol=1e-8)


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
        assert [each.code for each in error.diagnostics] == ["N502", "N504"]
        assert all(each.data["joints"] == ("guide",) for each in error.diagnostics)
    else:
        assert np.ptp(result["energy.balance"]) < 1e-8


def test_at_rest_in_it_friction_is_not_decided() -> None:
    """The guide cannot move to first order: what it holds is anyone's guess."""
    with pytest.raises(SimulationError) as caught:
        released(0.0, 1.0, driven.MU)
    locked, cause = caught.value.diagnostics
    assert (locked.code, locked.t, cause.code) == ("N501", 0.0, "N504")
    assert cause.data["joints"] == ("guide",)
    assert released(0.0, 0.01, driven.MU, without="guide").completed  # as it says


def bar(mass: float, length: float, middle: np.ndarray, angle: float) -> dict[str, Any]:
    ends = {"in": [-length / 2, 0.0], "out": [length / 2, 0.0]}
    return {
        "mass": mass,
        "inertia": mass * length**2 / 12,
        "markers": {name: {"position": place} for name, place in ends.items()},
        "initial": {"position": middle.tolist(), "angle": angle},
    }


def motored(
    start: float,
    torque: float,
    gravity: list[float],
    laws: dict[str, dict[str, float]],
    piston: dict[str, Any],
) -> Result:
    """A slider-crank at rest, its crank at an angle, that a constant torque turns."""
    crank, rod = 0.2, 0.5
    pin = crank * np.array([np.cos(start), np.sin(start)])
    tilt = -np.arcsin(pin[1] / rod)
    along = rod * np.array([np.cos(tilt), np.sin(tilt)])
    joints: dict[str, dict[str, Any]] = {
        "axle": {"type": "revolute", "markers": ["ground", "crank.in"]},
        "pin": {"type": "revolute", "markers": ["crank.out", "rod.in"]},
        "head": {"type": "revolute", "markers": ["rod.out", "piston"]},
        "guide": {"type": "prismatic", "markers": ["ground", "piston"]},
    }
    for name, law in laws.items():
        joints[name]["friction"] = law
    motor = {"type": "constant", "value": torque}
    return simulate(
        "planar",
        1.0,
        rtol=1e-8,
        gravity=gravity,
        bodies={
            "crank": bar(1.0, crank, pin / 2, start),
            "rod": bar(0.8, rod, pin + along / 2, tilt),
            "piston": {
                "mass": 0.6,
                "inertia": 0.005,
                "initial": {"position": (pin + along).tolist()},
                **piston,
            },
        },
        joints=joints,
        forces={"motor": {"type": "actuator", "joint": "axle", "function": motor}},
        outputs={"record": ["energy.balance", "energy.dissipated", "crank.angle"]},
    )


@cache
def guided(start: float) -> Result:
    """The guide alone rubs."""
    return motored(start, 6.0, [0.0, -9.81], {"guide": {"coefficient": 0.25}}, {})


@pytest.mark.parametrize("start", [0.6, 0.0, np.pi])
def test_the_guide_is_pressed_up_and_down_after_dead_points(start: float) -> None:
    """A motor turns a slider-crank whose guide alone rubs, six times and more over its
    dead points: what the motor gives is motion, height and the work of friction."""
    result = guided(start)
    assert np.ptp(result["crank.angle"]) > 6.0 * np.pi
    lost = result["energy.dissipated"][-1]
    assert np.ptp(result["energy.balance"]) < 1e-7 * lost


@pytest.mark.parametrize("dead_point", [0.0, np.pi])
def test_a_motor_leaves_a_dead_point_at_once(dead_point: float) -> None:
    """The motion depends continuously on the start. From rest at the inner dead point
    the guide stuck for up to 0.1 s, as the sense of its motion is of second order."""
    ends = [guided(start) for start in (dead_point, dead_point + 1e-9)]
    turned = [(r["crank.angle"] - r["crank.angle"][0])[1:] for r in ends]
    assert turned[0] == pytest.approx(turned[1], rel=1e-7)


def test_joints_that_hold_one_motion_let_go_together() -> None:
    """Four joints rub. With the head of the rod stuck alone the guide jams, whatever
    holds it, and the motor was said to meet friction without a solution."""
    laws = {
        "axle": {"coefficient": 0.25, "static": 0.29, "radius": 0.0204},
        "pin": {"coefficient": 0.15, "radius": 0.0125},
        "head": {"coefficient": 0.063, "radius": 0.0068},
        "guide": {"coefficient": 0.196, "static": 0.225, "length": 0.069},
    }
    centre = {"centre_of_mass": [0.02, 0.03]}
    result = motored(1.76, 2.3, [-4.3, -3.7], laws, centre)
    assert result["crank.angle"][-1] > 1.76 + 2.0
    lost = result["energy.dissipated"][-1]
    assert np.ptp(result["energy.balance"]) < 1e-7 * lost
