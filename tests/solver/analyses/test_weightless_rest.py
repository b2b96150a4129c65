"""Equilibria without gravity, found from starts that are at rest already.

Nothing is left of the sum of the forces there, so that it is no scale: single forces
are. References are equilibria by hand.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene
from sidtool.solver.analyses.static_equilibrium import static_equilibrium

from ..scenes import scene


def pushed_mass(stiffness: float, load: float, planar: bool, start: float) -> SceneFile:
    """A mass on a spring, at a share `start` of its deflection under a load."""
    size = 2 if planar else 3
    at_rest = [start * load / stiffness, 0.0, 0.0]
    body = {
        "mass": 1.3,
        "inertia": 0.1 if planar else [0.1, 0.1, 0.1],
        "initial": {"position": at_rest[:size]},
    }
    rail: dict[str, Any] = {"type": "prismatic", "markers": ["ground", "m"]}
    return scene(
        {"m": body},
        {"rail": rail if planar else rail | {"axis": [1.0, 0.0, 0.0]}},
        forces={
            "spring": {
                "type": "spring_damper",
                "joint": "rail",
                "stiffness": stiffness,
            },
            "push": {
                "type": "force",
                "marker": "m",
                "force": [load, 0.0, 0.0][:size],
            },
        },
        dimension="planar" if planar else "spatial",
        gravity=[0.0, 0.0, 0.0][:size],
        record=["m.x"],
    )


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("start", [0.0, 1.0, 1.0 + 1e-13])
def test_a_mass_on_a_spring_rests_where_load_and_spring_balance(
    planar: bool, start: float
) -> None:
    random = np.random.default_rng(5)
    for _ in range(12):
        stiffness, deflection = 10.0 ** random.uniform([-3.0, -7.0], [9.0, 0.0])
        load = stiffness * deflection
        described = pushed_mass(stiffness, load, planar, start)
        found = static_equilibrium(compile_scene(described, keep_joints=True))
        (x,) = found.result()["m.x"]
        assert x == pytest.approx(load / stiffness, rel=1e-9)
        assert found.residual < 1e-10


def test_two_opposed_forces_leave_nothing_of_their_sum() -> None:
    """A body between two stretched springs, where they balance: k1 d1 = k2 d2."""
    random = np.random.default_rng(2)
    for _ in range(6):
        first, second = random.uniform(1e2, 1e6, 2)
        at_rest = 3.0 * second / (first + second)
        ends = {"a": {"position": [0.0, 0.0]}, "b": {"position": [5.0, 0.0]}}
        springs = {
            name: {
                "type": "spring_damper",
                "markers": ["ground." + end, "m"],
                "rest": 1.0,
                "stiffness": stiffness,
            }
            for name, end, stiffness in (("p", "a", first), ("q", "b", second))
        }
        described = scene(
            {
                "m": {
                    "mass": 2.0,
                    "inertia": 0.1,
                    "initial": {"position": [1.0 + at_rest, 0.0]},
                }
            },
            {"rail": {"type": "prismatic", "markers": ["ground", "m"]}},
            forces=springs,
            ground={"markers": ends},
            gravity=[0.0, 0.0],
        )
        found = static_equilibrium(compile_scene(described, keep_joints=True))
        assert found.iterations <= 1
        assert found.z[0] == pytest.approx(1.0 + at_rest, rel=1e-9)


def test_a_result_that_started_at_rest_answers_all_that_is_asked(
    tmp_path: Path,
) -> None:
    """The start of the scene in the result is the equilibrium itself."""
    described = pushed_mass(3e5, 1000.0, True, 0.0).with_({"initial.state": "static"})
    described = described.with_({"time.end": 0.1, "time.output_step": 0.05})
    result = sidtool.simulate(described)
    stored = tmp_path / "rest.h5"
    sidtool.write(stored, result)
    again = sidtool.read(stored)
    assert again["m.vx"] == pytest.approx(np.zeros(3), abs=1e-12)
    assert again["m.ax"] == pytest.approx(np.zeros(3), abs=1e-9)
    assert again["spring.fx"] == pytest.approx(np.full(3, -1000.0), rel=1e-9)
