"""Forces that a motion does not determine are named; those that it does are not."""

from __future__ import annotations

from typing import Any

import pytest

from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene, simulate
from sidtool.solver.analyses.inverse_dynamics import inverse_dynamics
from sidtool.solver.analyses.static_equilibrium import static_equilibrium
from tests.codes import codes, only, with_code
from tests.solver.scenes import polynomial, scene, slender_rod

G = 9.81


def door(
    record: list[str], upper: str = "revolute", swapped: bool = False
) -> SceneFile:
    """A door of 20 kg on two hinges above each other, and a bell on its handle."""
    places = {"low": [0.0, 0.0, 0.2], "high": [0.0, 0.0, 1.8]}
    markers = {name: {"position": at} for name, at in places.items()}
    handle = [0.9, 0.0, 1.0]
    bodies = {
        "door": {
            "mass": 20.0,
            "inertia": [4.0, 6.0, 2.0],
            "centre_of_mass": [0.5, 0.0, 1.0],
            "markers": {**markers, "handle": {"position": handle}},
            "initial": {"angular_velocity": [0.0, 0.0, 1.0]},
        },
        "bell": {
            "mass": 0.5,
            "inertia": [1e-3, 1e-3, 1e-3],
            "centre_of_mass": [0.0, 0.0, -0.1],
            "initial": {"position": handle},
        },
    }
    joints: dict[str, Any] = {
        "lower": {"type": "revolute", "markers": ["ground.low", "door.low"]},
        "upper": {"type": upper, "markers": ["ground.high", "door.high"]},
        "eye": {"type": "spherical", "markers": ["door.handle", "bell"]},
    }
    if swapped:
        joints = dict(reversed(joints.items()))
    return scene(
        bodies,
        joints,
        dimension="spatial",
        gravity=[0.0, 0.0, -G],
        ground={"markers": markers},
        record=record,
        end=0.2,
    )


def told(result: Result) -> set[str]:
    """Joints and drives whose forces are not determined."""
    subjects = [each.subject for each in with_code(result, "N233")]
    return {name for subject in subjects for name in subject.split(", ")}


@pytest.mark.parametrize("swapped", [False, True])
def test_two_hinges_share_a_load_in_a_way_that_nobody_knows(swapped: bool) -> None:
    record = ["lower.fx", "upper.f*", "eye.fz"]
    result = simulate(compile_scene(door(record, swapped=swapped)))
    assert told(result) == {"lower", "upper"}
    assert only(result, "N233").data["redundant"] == 5
    static = static_equilibrium(
        compile_scene(door(record, swapped=swapped), keep_joints=True)
    ).result()
    assert told(static) == {"lower", "upper"}


def test_one_recorded_force_is_told_with_those_that_share_it() -> None:
    result = simulate(compile_scene(door(["upper.mx"])))
    assert told(result) == {"upper"}
    assert only(result, "N233").data["shared_with"] == ("lower",)


@pytest.mark.parametrize("record", [["eye.fz", "door.angle"], ["bell.x"]])
def test_determined_forces_are_not_spoken_of(record: list[str]) -> None:
    assert "N233" not in codes(simulate(compile_scene(door(record))))


def test_a_hinge_that_only_guides_leaves_one_force_open_or_none() -> None:
    """A cylindrical second hinge carries no weight, a point on a line no moments."""
    record = ["lower.fz", "upper.f*", "lower.mx"]
    result = simulate(compile_scene(door(record, "cylindrical")))
    assert told(result) == {"lower", "upper"}
    content = door(["lower.fz", "upper.fx", "lower.mz"], "point_on_line")
    text = content.model_dump(by_alias=True, exclude_none=True, mode="json")
    text["joints"]["lower"] = {
        "type": "spherical",
        "markers": ["ground.low", "door.low"],
    }
    text["joints"]["upper"]["axis"] = [0.0, 0.0, 1.0]
    result = simulate(compile_scene(SceneFile.model_validate(text)))
    assert "N233" not in codes(result)
    assert result["lower.fz"][0] == pytest.approx(20.5 * G, rel=0.1)


def test_a_joint_that_a_cut_scene_drops_is_told_as_well() -> None:
    """A plate welded to the ground at two places: its frame has no coordinates."""
    plate = slender_rod(1.0, 4.0)
    ends = {"b": {"position": [1.0, 0.0]}}
    joints = {
        "left": {"type": "fixed", "markers": ["ground", "plate.a"]},
        "right": {"type": "fixed", "markers": ["ground.b", "plate.b"]},
    }
    content = scene(
        {"plate": plate},
        joints,
        record=["left.fy", "right.mz"],
        gravity=[0.0, -G],
        ground={"markers": ends},
    )
    assert told(simulate(compile_scene(content))) == {"left", "right"}
    assert told(simulate(compile_scene(content, keep_joints=True))) == {"left", "right"}


@pytest.mark.parametrize("redundant", [True, False])
def test_inverse_dynamics_names_a_third_support(redundant: bool) -> None:
    """A beam on two supports and, if it is redundant, on a third in between."""
    markers = {"m": {"position": [0.4, 0.0]}}
    beam = slender_rod(1.0, 3.0)
    beam["markers"] |= markers
    ground = {"b": {"position": [1.0, 0.0]}, **markers}
    joints: dict[str, Any] = {
        "left": {"type": "revolute", "markers": ["ground", "beam.a"]},
        "right": {"type": "point_on_line", "markers": ["ground.b", "beam.b"]},
    }
    if redundant:
        joints["middle"] = {"type": "point_on_line", "markers": ["ground.m", "beam.m"]}
    content = scene(
        {"beam": beam, "car": {"mass": 1.0, "inertia": 0.1}},
        joints | {"road": {"type": "prismatic", "markers": ["beam.m", "car"]}},
        {"go": {"joint": "road", "function": polynomial(0.1, 0.3)}},
        record=["left.fy", "left.fx", "right.fy"],
        gravity=[0.0, -G],
        ground={"markers": ground},
    )
    result = inverse_dynamics(compile_scene(content, keep_joints=True))
    assert told(result) == ({"left", "middle", "right"} if redundant else set())
    if not redundant:
        car = 0.4 + 0.1 + 0.3 * result.t
        assert result["right.fy"] == pytest.approx(G * (1.5 + car), rel=1e-9)
