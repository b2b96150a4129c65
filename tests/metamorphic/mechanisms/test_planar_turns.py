"""Angles of planar scenes that say the same with other whole turns.

The angles of markers and bodies count turns alike, so that turning all of them leaves
every relative angle; and what joints hold is held without turning a body round.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import Array
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene, simulate
from tests.solver.scenes import polynomial, scene, slender_rod

TURN = 2.0 * np.pi
RECORD = ["hinge.angle", "rod.b.x", "rod.b.y", "arm.b.x", "arm.b.y", "free.x", "free.y"]


def run(content: SceneFile, keep: bool = False) -> Result:
    return simulate(compile_scene(content, keep_joints=keep), rtol=1e-8)


def pendulum(angle: float, forces: dict[str, Any]) -> SceneFile:
    """A rod on a turned marker of the ground, unstressed where it starts."""
    marker = {"mount": {"position": [0.0, 0.0], "angle": angle}}
    return scene(
        {"rod": slender_rod(1.0, angle=angle)},
        {"hinge": {"type": "revolute", "markers": ["ground.mount", "rod.a"]}},
        ground={"markers": marker},
        forces=forces,
        record=["hinge.angle", "spring.mz", "rod.b.x"],
    )


SPRINGS: dict[str, dict[str, Any]] = {
    "spring_damper": {"joint": "hinge", "stiffness": [1.0]},
    "bushing": {"markers": ["ground.mount", "rod.a"], "stiffness": [1.0, 1.0, 1.0]},
}


@pytest.mark.parametrize("kind", SPRINGS)
@pytest.mark.parametrize("angle", [1.5 * np.pi, -1.5 * np.pi, 0.4, 4.0, -11.0])
def test_a_spring_between_turned_markers_is_unstressed(kind: str, angle: float) -> None:
    """Marker and body at 270 degrees: the angle between them is zero."""
    found = run(pendulum(angle, {"spring": {"type": kind, **SPRINGS[kind]}}))
    assert np.abs(found["hinge.angle"]).max() < 1e-12
    assert np.abs(found["spring.mz"]).max() < 1e-12
    assert found["rod.b.x"] == pytest.approx(np.cos(angle), abs=1e-12)


def wound(turns: float) -> SceneFile:
    """The same with the rod wound up against its spring."""
    coil = {"type": "spring_damper", "joint": "hinge", "stiffness": [2.0]}
    table = pendulum(0.3, {"spring": coil}).model_dump(by_alias=True, exclude_none=True)
    table["bodies"]["rod"]["initial"]["angle"] = 0.3 + turns
    return SceneFile.model_validate(table)


@pytest.mark.parametrize("turns", [4.0, 7.0, -20.0])
def test_a_wound_spring_stays_wound(turns: float) -> None:
    """A run may be continued from its end, however far that is turned."""
    assert run(wound(turns))["spring.mz"][0] == pytest.approx(-2.0 * turns, rel=1e-12)


def mechanism(
    kind: str, mount: float, rod: float, swapped: bool = False, start: float = 0.0
) -> SceneFile:
    """A rod that a joint holds or drives carries an arm with a spring, and a free
    body hangs on the arm by a spring."""
    ends = ["ground.mount", "rod.a"]
    function = polynomial(start if kind == "revolute" else 0.1, 0.5, 1.0)
    sign = 1.0
    if swapped:
        ends, sign = ends[::-1], -1.0
        scaled = [sign * c for c in (start if kind == "revolute" else 0.1, 0.5, 1.0)]
        function = polynomial(*scaled)
    drives = {"motor": {"joint": "base", "function": function}}
    return scene(
        {
            "rod": slender_rod(1.0, angle=rod),
            "arm": slender_rod(1.0, position=[0.8, 0.1], angle=0.2),
            "free": {"mass": 1.0, "initial": {"position": [1.5, 1.0]}},
        },
        {
            "base": {"type": kind, "markers": ends},
            "hinge": {"type": "revolute", "markers": ["rod.b", "arm.a"]},
        },
        {} if kind == "fixed" else drives,
        ground={"markers": {"mount": {"position": [0.0, 0.0], "angle": mount}}},
        forces={
            "coil": {"type": "spring_damper", "joint": "hinge", "stiffness": [3.0]},
            "pull": {
                "type": "spring_damper",
                "markers": ["arm.b", "free"],
                "stiffness": [5.0],
                "rest": 1.0,
            },
        },
        gravity=[0.0, -9.81],
        record=RECORD,
    )


@cache
def plain_motion(kind: str) -> Array:
    return run(mechanism(kind, 0.1, 0.1)).values


@pytest.mark.parametrize("kind", ["fixed", "revolute", "prismatic"])
@pytest.mark.parametrize("keep", [False, True])
@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("mount, rod", [(TURN, 0.0), (0.0, 3 * TURN), (TURN, -TURN)])
def test_whole_turns_move_nothing(
    kind: str, keep: bool, swapped: bool, mount: float, rod: float
) -> None:
    """The joint holds the same orientation; a coil counts the rod's own turns."""
    expected = plain_motion(kind)
    turned = mechanism(kind, 0.1 + mount, 0.1 + rod, swapped)
    table = turned.model_dump(by_alias=True, exclude_none=True)
    table["forces"]["coil"]["rest"] = -rod
    found = run(SceneFile.model_validate(table), keep).values
    found[:, 0] += rod
    assert np.abs(found - expected).max() < 1e-5


@pytest.mark.parametrize("keep", [False, True])
@pytest.mark.parametrize("swapped", [False, True])
def test_a_drive_may_begin_after_whole_turns(keep: bool, swapped: bool) -> None:
    expected = plain_motion("revolute")
    later = mechanism("revolute", 0.1, 0.1, swapped, start=2 * TURN)
    assert np.abs(run(later, keep).values - expected).max() < 1e-5


@pytest.mark.parametrize("keep", [False, True])
def test_what_is_recorded_of_a_turned_joint(keep: bool) -> None:
    """The angle of a driven joint is that of its drive; its body keeps its turns."""
    later = mechanism("revolute", 0.1, 0.1, start=2 * TURN)
    record = ["base.angle", "rod.angle", "base.fx", "motor.mz"]
    outputs = later.outputs.model_copy(update={"record": tuple(record)})
    found = run(later.model_copy(update={"outputs": outputs}), keep)
    expected = 2 * TURN + 0.5 * found.t + found.t**2
    assert found["base.angle"] == pytest.approx(expected, abs=1e-9)
    assert found["rod.angle"] == pytest.approx(expected - 2 * TURN + 0.1, abs=1e-9)
