"""Forces in joints that leave no coordinate: a turntable, an arm and a ball on it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.solver import compile_scene, simulate
from sidtool.solver.system import work_arrays

TABLE, ARM, BALL = 0.3, 0.02, 0.0  # kg m^2 about their centres of mass
ARM_MASS, BALL_MASS, ARM_AT, BALL_AT = 2.0, 0.7, 0.5, 0.9  # kg, m from the axis
SPIN_UP = 6.0  # rad/s^2
RECORD = [
    *(f"{joint}.{f}" for joint in ("grip", "clamp", "motor") for f in ("fx", "fy")),
    *(f"{joint}.mz" for joint in ("grip", "clamp", "motor")),
    *(f"energy.{e}" for e in ("supplied", "balance", "kinetic")),
]


def turntable(dimension: str, count: int, **joints: Any) -> Result:
    """Spun up from rest by a motor; the ball is a point mass, which does not turn."""
    plane = dimension == "planar"

    def vector(x: float) -> list[float]:
        return [x, 0.0] if plane else [x, 0.0, 0.0]

    def inertia(about: float) -> Any:
        return about if plane else [0.5, 0.7, about]

    grip = {"type": "fixed", "markers": ["table.rim", "arm.root"]}
    clamp = {"type": "fixed", "markers": ["arm.tip", "ball"]}
    axis = {"type": "revolute", "markers": ["ground", "table"]}
    function = {
        "type": "polynomial",
        "pieces": [{"from": 0.0, "coefficients": [0.0, 0.0, 0.5 * SPIN_UP]}],
    }
    content = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": dimension,
        "gravity": vector(0.0),
        "time": {"end": 0.5, "output_times": np.linspace(0.0, 0.5, count).tolist()},
        "bodies": {
            "table": {
                "mass": 4.0,
                "inertia": inertia(TABLE),
                "markers": {"rim": {"position": vector(0.4)}},
            },
            "arm": {
                "mass": ARM_MASS,
                "inertia": inertia(ARM),
                "markers": {
                    "root": {"position": vector(-0.1)},
                    "tip": {"position": vector(0.4)},
                },
            },
            "ball": {"mass": BALL_MASS},
        },
        "joints": {"axis": axis, "grip": grip, "clamp": clamp, **joints},
        "drives": {"motor": {"joint": "axis", "function": function}},
        "outputs": {"record": RECORD},
    }
    return simulate(compile_scene(validate_data(content, SceneFile)), rtol=1e-9)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_joints_carry_what_is_behind_them(dimension: str) -> None:
    result = turntable(dimension, 6)
    t = result.t
    rate, angle = SPIN_UP * t, 0.5 * SPIN_UP * t**2
    out = np.stack([np.cos(angle), np.sin(angle)])
    on = np.stack([-np.sin(angle), np.cos(angle)])

    def force(*bodies: tuple[float, float]) -> np.ndarray:
        arm = sum(mass * radius for mass, radius in bodies)
        return np.asarray(arm * (SPIN_UP * on - rate**2 * out))

    ball, arm = (BALL_MASS, BALL_AT), (ARM_MASS, ARM_AT)
    about = TABLE + ARM + sum(mass * radius**2 for mass, radius in (arm, ball))
    for joint, bodies in (("clamp", [ball]), ("grip", [ball, arm])):
        for axis, told in enumerate(("fx", "fy")):
            expected = force(*bodies)[axis]
            assert result[f"{joint}.{told}"] == pytest.approx(expected, abs=1e-11)
    in_grip = ARM + ARM_MASS * ARM_AT * 0.1 + BALL_MASS * BALL_AT * 0.5
    assert result["grip.mz"] == pytest.approx(SPIN_UP * in_grip, abs=1e-11)
    assert result["clamp.mz"] == pytest.approx(0.0, abs=1e-11)
    assert result["motor.mz"] == pytest.approx(SPIN_UP * about, abs=1e-11)
    assert result["energy.supplied"] == pytest.approx(0.5 * about * rate**2, abs=1e-10)
    assert result["energy.kinetic"] == pytest.approx(0.5 * about * rate**2, abs=1e-10)


def test_python_looks_at_no_state_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is recorded costs no call from Python for each output time."""
    calls, evaluate = [0], work_arrays.evaluate

    def counted(*arguments: Any) -> None:
        calls[0] += 1
        evaluate(*arguments)

    monkeypatch.setattr(work_arrays, "evaluate", counted)
    held = {"guide": {"type": "planar", "markers": ["ground", "table"]}}
    found = []
    for count in (6, 60):
        calls[0] = 0
        result = turntable("spatial", count, **held)
        assert len(result.t) == count
        found.append(calls[0])
    assert found[0] == found[1]
