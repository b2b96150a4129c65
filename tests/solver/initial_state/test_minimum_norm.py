"""Redundant constraints share their forces as the smallest ones that do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.solver import simulate, static_equilibrium
from sidtool.solver.system.system import System
from tests.solver.scenes import GRAVITY, compiled, scene

HEIGHTS = {"low": 0.2, "middle": 1.0, "high": 1.8}
COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")


def door(hinges: dict[str, float], scale: float = 1.0, **more: Any) -> System:
    """A door that turns freely on hinges along z; lengths times `scale`."""
    places = {name: {"position": [0.0, 0.0, scale * z]} for name, z in hinges.items()}
    body = {
        "mass": 20.0,
        "inertia": [6.0 * scale**2, 7.0 * scale**2, 1.5 * scale**2],
        "centre_of_mass": [0.4 * scale, 0.0, scale],
        "markers": places,
        "initial": {"angular_velocity": [0.0, 0.0, 1.0]},
    }
    joints = {
        name: {
            "type": "revolute",
            "markers": [f"ground.{name}", f"door.{name}"],
            "axis": [0.0, 0.0, 1.0],
        }
        for name in hinges
    }
    return compiled(
        scene(
            {"door": body},
            joints,
            dimension="spatial",
            ground={"markers": places},
            gravity=[0.0, 1.0 * scale, -GRAVITY * scale],
            record=[f"{name}.{part}" for name in hinges for part in COMPONENTS],
            **more,
        )
    )


def wrench(result: Any, hinges: dict[str, float], scale: float = 1.0) -> np.ndarray:
    """Force and torque of all hinges on the door, about the origin, (nt, 6)."""
    total = np.zeros((len(result.t), 6))
    for name, z in hinges.items():
        parts = np.column_stack([result[f"{name}.{part}"] for part in COMPONENTS])
        total += parts
        total[:, 3:] += np.cross([0.0, 0.0, scale * z], parts[:, :3])
    return total


def test_three_hinges_carry_the_weight_in_equal_parts() -> None:
    result = simulate(door(HEIGHTS), rtol=1e-9)
    for name in HEIGHTS:
        assert result[f"{name}.fz"] == pytest.approx(20.0 * GRAVITY / 3.0, rel=1e-9)


def test_three_hinges_hold_the_door_as_one_does() -> None:
    """What depends on the motion alone: force and torque of all of them together."""
    single = {"low": 0.2}
    one, three = simulate(door(single), rtol=1e-9), simulate(door(HEIGHTS), rtol=1e-9)
    expected = wrench(one, single)
    size = abs(expected).max()
    assert wrench(three, HEIGHTS) == pytest.approx(expected, abs=1e-8 * size)


def test_shares_do_not_depend_on_the_unit_of_length() -> None:
    """Forces against torques are weighed with the size of the mechanism."""
    metres = simulate(door(HEIGHTS), rtol=1e-9)
    millimetres = simulate(door(HEIGHTS, scale=1e3), rtol=1e-9)
    for name in HEIGHTS:
        for part in COMPONENTS:
            found = millimetres[f"{name}.{part}"] / (1e3 if part[0] == "f" else 1e6)
            assert found == pytest.approx(metres[f"{name}.{part}"], abs=1e-6)


def test_statics_share_alike() -> None:
    result = static_equilibrium(door(HEIGHTS)).result()
    for name in HEIGHTS:
        assert result[f"{name}.fz"] == pytest.approx(20.0 * GRAVITY / 3.0, rel=1e-9)


def test_two_pins_at_one_place_carry_half_each() -> None:
    bar = {
        "mass": 2.0,
        "inertia": 0.3,
        "centre_of_mass": [0.5, 0.0],
        "initial": {"angular_velocity": 2.0},
    }
    pin = {"type": "revolute", "markers": ["ground", "bar"]}
    record = [f"{name}.{part}" for name in ("one", "two") for part in ("fx", "fy")]
    down = [0.0, -GRAVITY]
    twice = scene({"bar": bar}, {"one": pin, "two": pin}, gravity=down, record=record)
    once = scene({"bar": bar}, {"one": pin}, gravity=down, record=record[:2])
    expected = simulate(compiled(once), rtol=1e-10)
    found = simulate(compiled(twice), rtol=1e-10)
    for part in ("fx", "fy"):
        for name in ("one", "two"):
            half = 0.5 * expected[f"one.{part}"]
            assert found[f"{name}.{part}"] == pytest.approx(half, abs=1e-7)
