"""What `study` says is true on random pendulums, by integrators it did not use."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.measurement.points import MAX_UNPREDICTABILITY
from sidtool.solver import compile_scene, simulate
from sidtool.study import Study, default_settings, recommend_point, run_study
from tests.codes import with_code
from tests.solver.scenes import scene, slender_rod

WANTED = (1e-2, 1e-4)


def pendulum(seed: int, wild: bool) -> SceneFile:
    """Two rods that swing a little, or are let go above and turn over."""
    random = np.random.default_rng([37, seed])
    angles = random.uniform(0.2, 0.5, 2) - 0.5 * math.pi
    if wild:
        angles = random.uniform(0.6, 1.4, 2)
    first = [math.cos(angles[0]), math.sin(angles[0])]
    bodies = {
        "low": slender_rod(1.0, angle=float(angles[0])),
        "tip": slender_rod(1.0, position=first, angle=float(angles[1])),
        "clock": {"mass": 1.0, "inertia": 1.0, "initial": {"velocity": [1.0, 0.0]}},
    }
    joints = {
        "pin": {"type": "revolute", "markers": ["ground", "low.a"]},
        "elbow": {"type": "revolute", "markers": ["low.b", "tip.a"]},
    }
    return scene(
        bodies,
        joints,
        gravity=[0.0, -9.81],
        end=(8.0, 16.0, 32.0)[seed] if wild else 2.0,
        steps=40,
        record=["low.angle", "tip.angle", "clock.x", "clock.vx"],
    )


def studied(content: SceneFile, *names: str) -> Study:
    return run_study(content, settings=default_settings(names, (1e-2, 1e-4)))


def away(result: Result, exact: Result, name: str) -> float:
    return float(np.abs(result[name] - exact[name]).max() / np.ptp(exact[name]))


@pytest.mark.parametrize("seed", range(3))
def test_what_is_recommended_is_as_good_as_is_told(seed: int) -> None:
    """Against dop853 at a tolerance that no study takes."""
    content = pendulum(seed, wild=False)
    found, system = studied(content, "radau5", "auto"), compile_scene(content)
    exact = simulate(system, integrator="dop853", rtol=1e-12)
    assert not found.reference.unpredictable
    assert found.reference.left_out == ("clock.vx",)
    assert {p.setting.integrator for p in found.points} == {"radau5", "auto"}
    for point in found.points:
        made = simulate(
            system, integrator=point.setting.integrator, rtol=point.setting.rtol
        )
        error = max(away(made, exact, name) for name in found.reference.names)
        assert point.error == pytest.approx(error, rel=0.05, abs=1e-10)
        assert point.error >= found.reference.uncertainty
    for wanted in WANTED:
        best = recommend_point(found.points, wanted)
        assert best is not None and best.error <= wanted


@pytest.mark.parametrize("seed", range(3))
def test_outputs_that_no_integrator_agrees_on_are_called_unpredictable(
    seed: int,
) -> None:
    """And nothing is recommended for them; of the others errors are told as ever."""
    content = pendulum(seed, wild=True)
    found, system = studied(content, "radau9"), compile_scene(content)
    runs: list[Any] = [
        simulate(system, integrator=name, rtol=1e-11) for name in ("dop853", "radau13")
    ]
    loose = simulate(system, integrator="dop853", rtol=1e-6)  # as references are
    apart = {name: away(*runs, name) for name in ("low.angle", "tip.angle")}
    for name, part in apart.items():
        if part > 30.0 * MAX_UNPREDICTABILITY:
            assert name in found.reference.unpredictable
        if name in found.reference.unpredictable:
            assert max(part, away(loose, runs[0], name)) > MAX_UNPREDICTABILITY / 30.0
    assert "clock.x" in found.reference.names
    told = {each.subject for each in with_code(found, "N732")}
    assert told == set(found.reference.unpredictable)
    assert not told & set(found.reference.names)


def test_forces_that_cancel_are_rounding_and_not_unpredictable() -> None:
    """A rod that swings in a plane of space: nothing acts across, nor about the pin."""
    rod = {
        "mass": 1.0,
        "inertia": [1e-3, 0.1, 0.1],
        "centre_of_mass": [0.37, 0.0, 0.0],
        "initial": {"axis_angle": [0.0, 0.7, 0.0]},
    }
    pin = {"type": "revolute", "markers": ["ground", "rod"], "axis": [0.0, 1.0, 0.0]}
    content = scene(
        {"rod": rod},
        {"pin": pin},
        dimension="spatial",
        gravity=[0.0, 0.0, -9.81],
        record=["pin.angle", "pin.fx", "pin.fy", "pin.mx", "pin.my"],
    )
    found = studied(content, "radau9").reference
    assert found.names == ("pin.angle", "pin.fx")
    assert found.left_out == ("pin.fy", "pin.mx", "pin.my")
