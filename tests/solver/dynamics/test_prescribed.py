"""Frames that drives prescribe, and what excites a scene: against the kernels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.solver import compile_scene, simulate
from sidtool.solver.diagnostics.excitation import (
    DriveHistory,
    drive_history,
    excitation,
    fastest_rotation,
    prescribed_frames,
)

from ..scenes import polynomial, scene, slender_rod

BOX = {
    "mass": 2.0,
    "inertia": [0.1, 0.2, 0.3],
    "markers": {
        "in": {"position": [-0.3, 0.1, 0.2], "axis_angle": [0.3, 0.0, 0.4]},
        "out": {"position": [0.4, -0.1, 0.0], "axis_angle": [0.0, -0.5, 0.2]},
    },
}


def harmonic(amplitude: float, hertz: float) -> dict[str, Any]:
    return {"type": "harmonic", "amplitude": amplitude, "frequency": hertz}


def arm(back: bool) -> Any:
    """A driven turntable, slide and wrist; `back`: joints the other way round."""
    pairs = {
        "table": ["ground", "a.in"],
        "slide": ["a.out", "b.in"],
        "wrist": ["b.out", "c.in"],
    }
    kinds = {"table": "revolute", "slide": "prismatic", "wrist": "revolute"}
    axes = {"table": [0.0, 0.6, 0.8], "slide": [1.0, 1.0, 0.0], "wrist": [1.0, 0, 0]}
    drives = {
        "table": polynomial(0.0, 1.0, 2.0),
        "slide": polynomial(0.0, 0.5, -0.3, 0.2),
        "wrist": harmonic(0.7, 1.3),
    }
    return scene(
        {name: {**BOX, "initial": {}} for name in "abc"},
        {
            name: {
                "type": kinds[name],
                "axis": axes[name],
                "markers": pair[::-1] if back else pair,
            }
            for name, pair in pairs.items()
        },
        {f"d_{n}": {"joint": n, "function": f} for n, f in drives.items()},
        steps=400,
        dimension="spatial",
        record=[f"c.{q}{x}" for q in "aw" for x in "xyz"],
    )


@pytest.mark.parametrize("back", [False, True])
def test_a_driven_chain_moves_as_the_kernels_say(back: bool) -> None:
    """Angular velocity and the acceleration of the third body, in inertial axes."""
    system = compile_scene(arm(back))
    result = simulate(system, rtol=1e-9)
    whole = drive_history(system)
    chosen = {name: at(whole, name, result.t) for name in whole.values}
    frame = prescribed_frames(system, DriveHistory(result.t, chosen))["c"]
    for name, history in (("a", frame.a), ("w", frame.w)):
        found = np.einsum("tij,tj->ti", frame.R, history)
        kernel = np.column_stack([result[f"c.{name}{x}"] for x in "xyz"])
        assert_allclose(found, kernel, atol=1e-7, err_msg=name)
    slopes = (frame.w[2:] - frame.w[:-2]) / (2 * result.t[1])
    error = np.abs(slopes - frame.alpha[1:-1]).max()
    assert error < 1e-3 * np.abs(frame.alpha).max()


def at(history: DriveHistory, name: str, times: np.ndarray) -> np.ndarray:
    """Value and derivatives at other times, by the function itself."""
    t = times
    if name == "d_table":
        return np.array([t + 2 * t**2, 1 + 4 * t, 4 + 0 * t])
    if name == "d_slide":
        rates = 0.5 - 0.6 * t + 0.6 * t**2, -0.6 + 1.2 * t
        return np.array([0.5 * t - 0.3 * t**2 + 0.2 * t**3, *rates])
    w = 2 * math.pi * 1.3
    s, c = np.sin(w * t), np.cos(w * t)
    return 0.7 * np.array([s, w * c, -w * w * s])


def hinged(function: dict[str, Any], **more: Any) -> Any:
    return compile_scene(
        scene(
            {"rod": slender_rod(1.0)},
            {"pin": {"type": "revolute", "markers": ["ground", "rod.a"]}},
            {"turn": {"joint": "pin", "function": function}},
            **more,
        )
    )


def test_the_history_of_a_drive_is_that_of_its_function() -> None:
    history = drive_history(hinged(polynomial(0.0, 1.0, 2.0, -1.0)))
    t = history.times
    assert t[0] == 0 and t[-1] == 1 and (np.diff(t) > 0).all()
    value, rate, second = history.values["turn"]
    assert_allclose(value, t + 2 * t**2 - t**3, atol=1e-14)
    assert_allclose(rate, 1 + 4 * t - 3 * t**2, atol=1e-14)
    assert_allclose(second, 4 - 6 * t, atol=1e-13)


def test_a_harmonic_drive_excites_with_its_frequency() -> None:
    system = hinged(harmonic(3.0, 7.0))
    found = excitation(system, drive_history(system))
    assert (found.frequency, found.by) == (7.0, "turn")


def test_a_turning_drive_excites_once_a_turn() -> None:
    system = hinged(polynomial(0.0, 0.0, 6 * math.pi))
    found = excitation(system, drive_history(system))
    assert found.frequency == pytest.approx(6.0)
    assert found.by == "turn turns at up to 37.7 rad/s"
    assert fastest_rotation(system, drive_history(system))[1] == "turn"


def test_the_driven_orientation_of_a_marker_excites_once_a_turn() -> None:
    drive = {
        "marker": "box.out",
        "coordinate": "rotation",
        "axis": [1.0, 2.0, -2.0],
        "function": polynomial(0.0, 0.0, -4 * math.pi),
    }
    system = compile_scene(
        scene({"box": BOX}, drives={"whirl": drive}, dimension="spatial")
    )
    history = drive_history(system)
    found = excitation(system, history)
    assert found.frequency == pytest.approx(4.0)
    assert found.by == "whirl turns at up to 25.13 rad/s"
    assert fastest_rotation(system, history)[1] == "whirl"


def test_the_fastest_of_drives_and_forces_counts() -> None:
    push = {
        "type": "force",
        "marker": "rod.b",
        "force": [1.0, 0.0],
        "function": {**harmonic(1.0, 1.0), "frequency": None, "angular_frequency": 80},
    }
    del push["function"]["frequency"]
    system = hinged(polynomial(0.0, 1.0), forces={"push": push})
    found = excitation(system, drive_history(system))
    assert found.frequency == pytest.approx(80 / (2 * math.pi))
    assert found.by == "push"


def test_without_drives_nothing_is_known() -> None:
    system = compile_scene(scene({"rod": slender_rod(1.0)}))
    assert excitation(system, drive_history(system)).frequency == 0
