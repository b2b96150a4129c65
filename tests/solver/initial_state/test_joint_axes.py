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
from tests.steel_bars import steel_bar

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


@pytest.mark.parametrize("joint", ["fixed", "prismatic", "revolute"])
def test_a_static_start_keeps_the_orientation_of_the_scene(joint: str) -> None:
    """A bar at 2 rad about z sags as one at 0 under gravity at -2 rad.

    Its marker is rotated for the joint, and the static start builds the scene again.
    """
    own = {} if joint == "fixed" else {"axis": [0.0, 0.0, 1.0]}
    angle, found = 2.0, []
    for turn in (angle, 0.0):
        gravity = Rotation.from_rotvec([0, 0, turn - angle]).apply([3.0, -G, -2.0])
        bar: dict[str, Any] = {"sid": "-", "markers": {"root": 1, "tip": 2}}
        bar["initial"] = {"axis_angle": [0.0, 0.0, turn]}
        stand: dict[str, Any] = {"mass": 1.0, "inertia": [0.1, 0.1, 0.1]}
        stand["initial"] = {"axis_angle": [0.0, 0.0, 0.0]}
        content: dict[str, Any] = {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "spatial",
            "gravity": gravity.tolist(),
            "time": {"end": 1.0, "output_step": 0.5},
            "initial": {"state": "static"},
            "bodies": {"stand": stand, "bar": bar},
            "joints": {
                "hold": {"type": "fixed", "markers": ["ground", "stand"]},
                "joint": {"type": joint, "markers": ["stand", "bar.root"], **own},
            },
            "forces": {
                "springs": {
                    "type": "bushing",
                    "markers": ["ground", "stand"],
                    "stiffness": [1e4] * 6,
                }
            },
            "outputs": {"record": ["bar.tip.uy", "bar.tip.uz"]},
        }
        if joint != "fixed":
            value = turn if joint == "revolute" else 0.0
            lock = {"joint": "joint", "function": {"type": "constant", "value": value}}
            content["drives"] = {"lock": lock}
        scene = validate_data(content, SceneFile)
        system = compile_scene(
            scene, sids={"bar": steel_bar(modes=8)}, keep_joints=True
        )
        assert moved(system)["bar"][1] < 1e-12
        result = simulate(system)
        found.append([result["bar.tip.uy"][0], result["bar.tip.uz"][0]])
    assert found[0] == pytest.approx(found[1], rel=1e-9)
    load = 7850.0 * 4e-4 * 2.0  # N/m along z: q L^4 / 8 E I
    sag = load / (8.0 * 2.1e11 * 0.02**4 / 12)
    assert found[0][1] == pytest.approx(-sag, rel=1e-2)


@pytest.mark.parametrize("motion", ["rest", "driven", "on springs"])
def test_a_static_start_names_bodies_that_the_assembly_moved(motion: str) -> None:
    """The scene puts a body 0.1 m away from where its joint holds it."""
    hub: dict[str, Any] = {"mass": 2.0, "inertia": [0.1, 0.1, 0.2]}
    disc: dict[str, Any] = {"mass": 1.0, "inertia": [0.1, 0.1, 0.2]}
    if motion == "driven":
        disc = {"sid": "-"}
    disc["initial"] = {"position": [0.1, 0.0, 0.0]}
    if motion != "rest":
        for body in (hub, disc):
            body.setdefault("initial", {})["angular_velocity"] = [0.0, 0.0, 5.0]
    joints: dict[str, Any] = {"key": {"type": "fixed", "markers": ["hub", "disc"]}}
    if motion == "driven":
        joints["key"]["markers"] = ["hub", "disc.1"]
    content: dict[str, Any] = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "spatial",
        "time": {"end": 0.1, "output_step": 0.1},
        "initial": {"state": "static"},
        "bodies": {"hub": hub, "disc": disc},
        "joints": joints,
        "outputs": {"record": ["disc.x"]},
    }
    if motion == "on springs":
        spring = {"type": "bushing", "markers": ["ground", "hub"], "shaft": "z"}
        spring["stiffness"] = [1e4] * 5 + [0.0]
        content["forces"] = {"bearing": spring}
    else:
        axle = {"type": "revolute", "markers": ["ground", "hub"], "axis": [0, 0, 1]}
        joints["axle"] = axle
        rate = 0.0 if motion == "rest" else 5.0
        pieces = [{"from": 0.0, "to": 0.1, "coefficients": [0.0, rate]}]
        function = {"type": "polynomial", "pieces": pieces}
        content["drives"] = {"motor": {"joint": "axle", "function": function}}
    sids = {"disc": steel_bar()} if motion == "driven" else {}
    result = simulate(compile_scene(validate_data(content, SceneFile), sids=sids))
    (note,) = [text for text in result.notes if "moved" in text]
    assert "disc" in note or "hub" in note
