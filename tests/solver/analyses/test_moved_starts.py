"""Analyses say that the assembly moved bodies from where the scene puts them."""

from __future__ import annotations

from typing import Any

import pytest

from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene
from sidtool.solver.analyses.inverse_dynamics import inverse_dynamics
from sidtool.solver.analyses.linearisation import linearise
from sidtool.solver.analyses.static_equilibrium import static_equilibrium
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


ANALYSES = {
    "static": lambda system: static_equilibrium(system).notes,
    "modes": lambda system: linearise(system).notes,
    "inverse": lambda system: inverse_dynamics(system).notes,
}


@pytest.mark.parametrize("name", ANALYSES)
def test_a_body_that_the_assembly_moved_is_named(name: str) -> None:
    """From 5 m away and 0.3 rad off; not where it meets the joint and the drive."""
    moved = ANALYSES[name](compile_scene(driven(5.0, 0.0), keep_joints=True))
    found = [note for note in moved if "the assembly moved bodies" in note]
    assert len(found) == 1 and "a by 4.52 m and 0.3 rad" in found[0]
    met = ANALYSES[name](
        compile_scene(driven(0.5 * 0.955336489125606, 0.3), keep_joints=True)
    )
    assert not any("the assembly moved bodies" in note for note in met)
