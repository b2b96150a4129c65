"""Motions of bodies with geometric stiffening, in all frames and far beyond the start.

With the terms of Ct and Cr in the mass matrix alone every one of these stopped in a
tangent frame for want of positive inertia, or gained energy.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh

from sidtool.conversion.frame_change import change_frame
from sidtool.formats.base.sid import SID, Array, Taylor
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_mass import coupled_mass_matrix
from sidtool.formats.toml.reading import read_data, validate_data
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import compile_scene, simulate
from sidtool.solver.system.characteristic_sizes import coordinate_sizes
from tests.places import SLIDER_CRANK
from tests.sidtool.models import rod
from tests.solver.dynamics.test_second_order import momentum, states
from tests.solver.scenes import compiled, scene
from tests.solver.stiffened_bars import LENGTH, hinged, on_a_hub, run, struck, ways
from tests.steel_bars import CHORD, FRAMES, MEAN, TANGENT, slender_bar

ENERGIES = ("energy.kinetic", "energy.elastic")


def planar(table: dict[str, Any]) -> dict[str, Any]:
    cut = {key: table[key][:2] for key in ("position", "velocity")}
    return table | cut | {"angular_velocity": table["angular_velocity"][2]}


@pytest.mark.parametrize("stiffened", [False, True])
@pytest.mark.parametrize(
    ("frame", "dimension"),
    [*((frame, "spatial") for frame in FRAMES), (TANGENT, "planar")],
)
def test_energy_and_momenta_of_a_free_bar_are_constant_over_100_periods(
    frame: str, stiffened: bool, dimension: str
) -> None:
    """100 of its slowest vibration. Without stiffening by the quadratic inertia."""
    sid, end = slender_bar(2, frame, stiffened), 1.0
    assert end * slowest(sid) > 100.0
    hit = [0.1, 0.6, 0.4 if dimension == "spatial" else 0.0]
    start = struck(sid, hit, [0.0, 0.0, 3.0])
    if dimension == "planar":
        start = planar(start)
    scene = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": dimension,
        "time": {"end": end, "output_step": 0.2},
        "bodies": {
            "bar": {
                "sid": "-",
                "markers": {"b": 2},
                "initial": start,
                "quadratic_inertia": not stiffened,
            }
        },
        "outputs": {"record": ["energy.kinetic", "energy.elastic"]},
        "accuracy": {"rtol": 1e-9, "integrator": "radau13"},
    }
    system = compile_scene(validate_data(scene, SceneFile), ".", {"bar": sid})
    result = simulate(system)
    energy = result["energy.kinetic"] + result["energy.elastic"]
    assert np.abs(energy / energy[0] - 1.0).max() < 2.5e-9
    momenta = np.array([momentum(system, t, z, v) for t, z, v in states(result)])
    linear = 2 if dimension == "planar" else 3
    for part in np.split(momenta, [linear], axis=1):
        size = np.linalg.norm(part[0])
        assert np.linalg.norm(part - part[0], axis=1).max() < 2.5e-9 * size


def slowest(sid: SID) -> float:
    """The lowest frequency of the free body [Hz]."""
    K = np.pad(sid.Ke.m0, ((6, 0), (6, 0)))
    return float(np.sqrt(eigh(K, coupled_mass_matrix(sid))[0][6])) / (2.0 * np.pi)


@pytest.mark.parametrize("frame", [CHORD, MEAN])
def test_a_struck_bar_moves_the_same_in_all_frames(frame: str) -> None:
    """In space, without damping. With the terms in the mass matrix alone the tangent
    frame stopped and the chord frame gained energy."""
    moved = []
    for seen in (TANGENT, frame):
        sid = slender_bar(6, seen)
        start = struck(sid, [0.05, 0.3, 0.2], [0.0, 0.0, 0.0])
        body = {"sid": "-", "markers": {"b": 2}, "initial": start}
        names = [*(f"bar.b.{axis}" for axis in "xyz"), *ENERGIES]
        outputs = {"record": names}
        result = run(sid, "spatial", 0.05, 1e-8, bodies={"bar": body}, outputs=outputs)
        energy = sum(result[name] for name in ENERGIES)
        assert np.abs(energy / energy[0] - 1.0).max() < 1e-8
        moved.append(ways(result))
    assert np.abs(moved[1] - moved[0]).max() < 2e-7


def test_a_hinged_bar_moves_the_same_in_all_frames() -> None:
    """Up to terms of third order in the deformation."""
    left = {}
    for load in (20.0, 60.0):
        moved = [hinged(6, frame, load)[0] for frame in FRAMES]
        bent = np.abs(moved[0][2]).max()
        left[load] = max(np.abs(way - moved[0]).max() for way in moved[1:])
        assert left[load] < 3.0 * bent**3 / LENGTH**2
    assert left[60.0] == pytest.approx(27.0 * left[20.0], rel=0.5)


@pytest.mark.parametrize("part", ["bar on a hinge", "satellite with panel"])
def test_more_shape_functions_converge_to_one_motion_in_all_frames(part: str) -> None:
    """Distances from the motion with the most of them in another frame. What is left
    is that of the frames, of third order; benchmarks/body_frames.py goes to sixty."""

    @cache
    def moved(modes: int, frame: str) -> Array:
        if part == "bar on a hinge":
            return hinged(modes, frame, 20.0)[0]
        return on_a_hub(frame, 60.0, False, modes)[0]

    for frame in FRAMES:
        richest = moved(12, MEAN if frame == TANGENT else TANGENT)
        few, more, most = (
            np.abs(moved(modes, frame) - richest).max() for modes in (3, 6, 12)
        )
        assert more < 0.25 * few
        assert most < 0.2 * more


def test_thirty_shape_functions_of_the_rod_run_in_all_frames() -> None:
    """They stopped at 1.62 s (Q4) and 1.52 s (IGA)."""
    data = read_data(SLIDER_CRANK / "slider_crank.toml")
    data["time"]["end"] = 2.0
    data["outputs"]["record"] = ["piston.x", "rod.q1"]
    reduction = {"method": "modal", "modes": 30, "fix": "left"}
    tangent = {"type": "tangent", "marker": "crank_pin"}
    moved = []
    for mesh in (
        {"type": "q4", "elements": [30, 4]},
        {"type": "iga", "degrees": [3, 2], "elements": [10, 2]},
    ):
        model = rod(mesh, frame=tangent, reduction=reduction, stiffening={})
        sid = sid_from_model(model)
        for frame in (TANGENT, MEAN):
            seen = change_frame(sid, frame)
            place = [0.1 - seen.node(1).position[0], 0.0]
            data["bodies"]["rod"]["initial"]["position"] = place
            system = compile_scene(
                validate_data(data, SceneFile), SLIDER_CRANK, {"rod": seen}
            )
            result = simulate(system, integrator="radau9", rtol=1e-6)
            assert result.completed
            moved.append(result["piston.x"])
        assert np.abs(moved[-1] - moved[-2]).max() < 1e-9


@pytest.mark.parametrize("planar_scene", [True, False])
def test_a_hub_that_spins_up_with_a_panel_moves_the_same_in_all_frames(
    planar_scene: bool,
) -> None:
    """A hub stopped at a deflection of 2.8 %, a satellite with its panel likewise."""
    left = []
    for torque in (600.0, 200.0):
        runs = [on_a_hub(frame, torque, planar_scene) for frame in FRAMES]
        bend = runs[0][1]
        left.append(max(np.abs(way - runs[0][0]).max() for way, _ in runs[1:]))
        assert left[-1] < 3.0 * bend**3 * LENGTH
    assert left[1] < 0.1 * left[0]


def test_a_bar_that_a_gear_turns_moves_as_one_on_a_drive() -> None:
    """A gear leaves it its coordinates: it stopped where the driven one went on."""
    law = {"type": "harmonic", "frequency": 3.0, "phase": -0.5 * np.pi}
    law |= {"offset": 0.8, "amplitude": 0.8}
    wheel = {
        "mass": 1.0,
        "inertia": 0.01,
        "markers": {"axle": {"position": [0.0, 0.0]}},
    }
    found = []
    for geared in (True, False):
        part = {"sid": "-", "markers": {"a": 1, "b": 2}}
        bearing = {"type": "revolute", "markers": ["ground", "bar.a"]}
        tables: dict[str, Any] = {
            "bodies": {"bar": part},
            "joints": {"hinge": bearing},
            "drives": {"turn": {"joint": "hinge", "function": law}},
        }
        if geared:
            axle = {"type": "revolute", "markers": ["ground", "wheel.axle"]}
            mesh = {"type": "gear", "joints": ["axle", "hinge"], "ratio": 2.0}
            tables["bodies"] = {"wheel": wheel, "bar": part}
            tables["joints"] = {"axle": axle, "hinge": bearing, "mesh": mesh}
            half = law | {"offset": 0.4, "amplitude": 0.4}
            tables["drives"] = {"turn": {"joint": "axle", "function": half}}
        result = run(slender_bar(6, TANGENT), "planar", 0.2, 1e-9, **tables)
        found.append(np.array([result["bar.b.x"], result["bar.b.y"]]))
        assert result.bodies["bar"].deflection > 0.01
    assert np.abs(found[1] - found[0]).max() < 1e-8


def test_nodes_that_hardly_move_make_no_coordinate_look_harmless() -> None:
    """An elastic coordinate of the size of the mechanism moves the body as far on the
    mean over its mass: the assembly tried states that bent an arm by a hundred lengths,
    as both of its nodes lay on the chord, and found no numbers there."""
    sid = slender_bar(3, TANGENT)
    still = [
        replace(node, phi=Taylor(1e-3 * node.phi.m0, node.phi.m1)) for node in sid.nodes
    ]
    body = {"bar": {"sid": "-", "markers": {"a": 1, "b": 2}}}
    for seen in (sid, replace(sid, nodes=tuple(still))):
        system = compiled(scene(body, {}, dimension="spatial"), bar=seen)
        elastic = coordinate_sizes(system)[-sid.nq :] / system.length
        mean = np.sqrt(np.diag(sid.Me.m0) / sid.mass)
        assert (elastic * mean <= 1.0 + 1e-12).all()
