"""Unstable equilibria, growing modes and replaced velocities are told."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.scene.bodies import ModalDamping
from sidtool.formats.toml.reading import validate_data
from sidtool.solver import linearise, simulate, static_equilibrium
from sidtool.solver.system.system import System
from tests.codes import codes, only

from ..scenes import compiled, scene, slender_rod

DOWN = [0.0, -9.81]


def pendulum(angle: float, stiffness: float = 0.0, **initial: Any) -> System:
    rod = slender_rod(1.0, angle=angle, **initial)
    forces = {}
    if stiffness:
        forces["spring"] = {
            "type": "spring_damper",
            "joint": "pin",
            "coordinate": "angle",
            "stiffness": stiffness,
            "rest": angle,
        }
    joints = {"pin": {"type": "revolute", "markers": ["ground", "rod.a"]}}
    return compiled(scene({"rod": rod}, joints, gravity=DOWN, forces=forces))


@pytest.mark.parametrize(("share", "stable"), [(0.9, False), (1.1, True)])
def test_an_upright_rod_is_stable_with_a_stiff_enough_spring(
    share: float, stable: bool
) -> None:
    """The spring has to be stiffer than m g L / 2."""
    up = pendulum(np.pi / 2, share * 9.81 * 0.5)
    found = static_equilibrium(up)
    modes = linearise(up)
    assert codes(found) == ([] if stable else ["N704"])
    assert codes(modes) == ([] if stable else ["N704", "N714"])
    if not stable:
        assert str(only(found, "N704").data["coordinate"]).startswith("rod.wz")
        growth = np.sqrt((1.0 - share) * 9.81 * 0.5 * 3.0)
        assert only(modes, "N714").data["rate"] == pytest.approx(growth, rel=1e-6)


def test_a_hanging_rod_is_stable() -> None:
    assert static_equilibrium(pendulum(-np.pi / 2)).diagnostics == ()


def test_a_modal_ratio_is_not_negative() -> None:
    with pytest.raises(InputError, match=r"ratio.*found -0.01; expected a number"):
        validate_data({"type": "modal", "ratio": [0.01, -0.01]}, ModalDamping)


def test_a_velocity_that_a_joint_forbids_is_told() -> None:
    """The rod turns with 3 rad/s about its pin: 0.5 m away, 1.5 m/s, and not 2 m/s."""
    good = {"velocity": [0.0, 0.0], "angular_velocity": 3.0}
    assert simulate(pendulum(0.0, **good)).diagnostics == ()
    forbidden = pendulum(0.0, velocity=[2.0, 0.0], angular_velocity=3.0)
    (found,) = simulate(forbidden).diagnostics
    assert found.code == "N223" and found.data["bodies"] == ("rod",)
    assert found.data["linear"] == pytest.approx([2.0])
    assert found.data["angular"] == pytest.approx([0.0], abs=1e-9)
