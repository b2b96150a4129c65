"""Axes of joints stand in both bodies as the scene places them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.solver import compile_scene, simulate
from sidtool.solver.initial_state.assembly import assemble
from sidtool.solver.initial_state.displacement_report import displacements
from sidtool.solver.system import work_arrays
from sidtool.solver.system.system import System
from sidtool.solver.system.work_arrays import new_work_arrays

G, LEVER, INERTIA = 9.81, 0.2, 0.01 + 1.0 * 0.2**2


def arm(joint: dict[str, Any], **initial: Any) -> SceneFile:
    """A bar of 1 kg on a joint to the ground, its centre 0.2 m along its x."""
    body = {
        "mass": 1.0,
        "inertia": [0.001, 0.01, 0.01],
        "centre_of_mass": [LEVER, 0.0, 0.0],
        "initial": initial,
    }
    return validate_data(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "spatial",
            "gravity": [0.0, 0.0, -G],
            "time": {"end": 2.0, "output_step": 0.01},
            "bodies": {"arm": body},
            "joints": {"hinge": {"markers": ["ground", "arm"], **joint}},
            "outputs": {"record": ["arm.y", "hinge.angle"]},
        },
        SceneFile,
    )


def moved(system: System) -> dict[str, tuple[float, float]]:
    """How far the assembly moves and turns each body."""
    system, start = assemble(system)
    work = new_work_arrays(system)
    work_arrays.evaluate(system, work, 0.0, start.z, start.v)
    return displacements(system, work)


def across(heading: float) -> list[float]:
    """The horizontal axis across an arm that points to a heading."""
    return [-float(np.sin(heading)), float(np.cos(heading)), 0.0]


@pytest.mark.parametrize("heading", [1.0, -2.0, 3.1])
def test_a_placed_arm_swings_about_the_axis_as_it_stands(heading: float) -> None:
    """The period of a pendulum from the horizontal, 4 sqrt(J / (m g l)) K(1/2)."""
    joint = {"type": "revolute", "axis": across(heading)}
    system = compile_scene(arm(joint, axis_angle=[0.0, 0.0, heading]))
    assert moved(system)["arm"][1] < 1e-12
    result = simulate(system, rtol=1e-9)
    half, _ = quad(lambda a: 1.0 / np.sqrt(np.sin(a)), 0.0, np.pi)
    speed = np.sqrt(2.0 * 1.0 * G * LEVER / INERTIA)
    turned = np.interp(half / speed, result.t, result["hinge.angle"])
    assert turned == pytest.approx(np.pi, abs=1e-3)


def test_an_axis_of_the_second_marker_turns_the_body_to_it() -> None:
    joint = {"type": "revolute", "axis": across(1.0), "second_axis": [0.0, 1.0, 0.0]}
    for stated in ({}, {"axis_angle": [0.3, 0.2, -0.4]}):
        system = compile_scene(arm(joint, **stated))
        _, start = assemble(system)
        R = Rotation.from_quat(start.z[[4, 5, 6, 3]])
        assert R.apply([0.0, 1.0, 0.0]) == pytest.approx(across(1.0), abs=1e-9)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize("carried", [False, True], ids=["free", "carried"])
@pytest.mark.parametrize(
    "joint", ["fixed", "prismatic", "revolute", "cylindrical", "screw", "planar"]
)
def test_a_start_that_closes_is_never_moved(
    joint: str, carried: bool, dimension: str
) -> None:
    """Bodies at random orientations: rotations of 1.1 and 2 rad to each other."""
    planar = dimension == "planar"
    if planar and joint in ("cylindrical", "screw", "planar"):
        pytest.skip("a joint of spatial scenes")
    place = [0.3, -0.2] if planar else [0.3, -0.2, 0.5]
    turns = [{"angle": a} for a in (0.7, 1.8)]
    if not planar:
        turns = [{"axis_angle": v} for v in ([0.7, -0.4, 0.2], [-0.9, 1.1, 1.4])]
    inertia: Any = 0.1 if planar else [0.1, 0.2, 0.15]
    base, tip = (
        {"mass": 1.0, "inertia": inertia, "initial": {"position": place, **turn}}
        for turn in turns
    )
    own = {"screw": {"pitch": 0.01}}.get(joint, {})
    if joint != "fixed" and not (planar and joint == "revolute"):
        own["axis"] = [0.6, 0.8] if planar else [0.6, 0.0, 0.8]
    markers = ["ground.stand" if carried else "base", "tip"]
    content = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": dimension,
        "time": {"end": 1.0, "output_step": 0.5},
        "ground": {"markers": {"stand": {"position": place}}},
        "bodies": {"base": base, "tip": tip},
        "joints": {
            "hold": {"type": "fixed", "markers": ["ground.stand", "base"]},
            "joint": {"type": joint, "markers": markers, **own},
        },
    }
    system = compile_scene(validate_data(content, SceneFile))
    for way, turn in moved(system).values():
        assert way < 1e-12
        assert turn < 1e-12


def test_rounded_orientations_leave_parallel_axes_parallel() -> None:
    """A four-bar linkage in space, its places and angles rounded to two digits: its
    axes stay parallel, and the linkage moves."""
    angle, tilt = 1.0, [0.004, -0.003]
    x, y = round(0.3 * np.cos(angle), 2), round(0.3 * np.sin(angle), 2)
    bodies = {
        name: {
            "mass": 1.0,
            "inertia": [0.1, 0.1, 0.1],
            "markers": {"end": {"position": [length, 0.0, 0.0]}},
            "initial": {"position": place, "axis_angle": [*tilt, turn]},
        }
        for name, length, place, turn in (
            ("crank", 0.3, [0.0, 0.0, 0.0], angle),
            ("coupler", 1.0, [x, y, 0.0], 0.0),
            ("rocker", 0.3, [1.0, 0.0, 0.0], angle),
        )
    }
    pairs = {
        "a": ["ground", "crank"],
        "b": ["crank.end", "coupler"],
        "c": ["coupler.end", "rocker.end"],
        "d": ["ground.pivot", "rocker"],
    }
    joints = {n: {"type": "revolute", "markers": pair} for n, pair in pairs.items()}
    content = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "spatial",
        "gravity": [0.0, -G, 0.0],
        "time": {"end": 0.2, "output_step": 0.1},
        "ground": {"markers": {"pivot": {"position": [1.0, 0.0, 0.0]}}},
        "bodies": bodies,
        "joints": joints,
        "outputs": {"record": ["a.angle_rate"]},
    }
    result = simulate(compile_scene(validate_data(content, SceneFile)))
    assert abs(result["a.angle_rate"][-1]) > 0.1
