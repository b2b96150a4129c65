"""Analyses say that the assembly moved bodies from where the scene puts them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene
from sidtool.solver.analyses.inverse_dynamics import inverse_dynamics
from sidtool.solver.analyses.linearisation import linearise
from sidtool.solver.analyses.static_equilibrium import static_equilibrium
from sidtool.solver.system.system import System
from tests.codes import HasDiagnostics, codes, only
from tests.solver.scenes import polynomial, scene


def driven(x: float, angle: float) -> SceneFile:
    """A bar on a pin at one end, that a drive turns from 0.3 rad on."""
    bar: dict[str, Any] = {
        "mass": 1.0,
        "inertia": 0.1,
        "markers": {"p": {"position": [-0.5, 0.0]}},
        "initial": {"position": [x, 0.5 * 0.29552020666133955], "angle": angle},
    }
    return scene(
        {"a": bar},
        {"j": {"type": "revolute", "markers": ["ground", "a.p"]}},
        {"d": {"joint": "j", "function": polynomial(0.3, 1.0)}},
        record=["a.x", "d.mz"],
    )


ANALYSES: dict[str, Callable[[System], HasDiagnostics]] = {
    "static": static_equilibrium,
    "modes": linearise,
    "inverse": inverse_dynamics,
}


@pytest.mark.parametrize("name", ANALYSES)
def test_a_body_that_the_assembly_moved_is_named(name: str) -> None:
    """From 5 m away and 0.3 rad off; not where it meets the joint and the drive."""
    moved = ANALYSES[name](compile_scene(driven(5.0, 0.0), keep_joints=True))
    data = only(moved, "N221").data
    assert data["bodies"] == ("a",) and data["angular"] == pytest.approx([0.3])
    assert data["linear"] == pytest.approx([5.0 - 0.5 * 0.955336489125606])
    met = ANALYSES[name](
        compile_scene(driven(0.5 * 0.955336489125606, 0.3), keep_joints=True)
    )
    assert "N221" not in codes(met)
