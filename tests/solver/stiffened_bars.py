"""A steel bar with geometric stiffening on a hinge and on a hub, in any body frame."""

from __future__ import annotations

from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID, Array
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_mass import coupled_mass_matrix
from sidtool.formats.toml.reading import validate_data
from sidtool.solver import compile_scene, simulate
from tests.steel_bars import slender_bar

LENGTH = 1.0


def run(sid: SID, dimension: str, end: float, rtol: float, **tables: Any) -> Result:
    scene = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": dimension,
        "time": {"end": end, "output_step": end / 50},
        "outputs": {"record": ["bar.b.x", "bar.b.y", "bar.b.z"]},
        "accuracy": {"rtol": rtol, "integrator": "radau9"},
        **tables,
    }
    if dimension == "planar":
        scene["outputs"] = {"record": ["bar.b.x", "bar.b.y"]}
    system = compile_scene(validate_data(scene, SceneFile), ".", {"bar": sid})
    result = simulate(system)
    assert result.completed
    return result


def ways(result: Result) -> Array:
    """Of the end of the bar, (2 or 3, nt)."""
    return np.array([result[n] for n in result.names if n.startswith("bar.b.")])


def swelling(time: float) -> dict[str, Any]:
    """A load that rises so smoothly that it leaves the fastest vibrations at rest."""
    return {"type": "smooth_step", "from": 0.0, "to": time, "end": 1.0, "continuity": 3}


def struck(sid: SID, blow: list[float], spin: list[float]) -> dict[str, Any]:
    """Initial motion of the bar at x = 0 in space that an impulse at its end makes,
    and a rotation before."""
    node = sid.node("2")
    push = [*blow, *np.cross(node.position, blow), *(node.phi.m0.T @ np.array(blow))]
    v = np.linalg.solve(coupled_mass_matrix(sid), push)
    return {
        "position": [-sid.node("1").position[0], 0.0, 0.0],
        "velocity": v[:3].tolist(),
        "angular_velocity": (v[3:6] + spin).tolist(),
        "elastic_velocity": v[6:].tolist(),
    }


def hinged(modes: int, frame: str, load: float) -> tuple[Array, float]:
    """Way of the end of a bar on a hinge about z, pushed across, (3, nt), and how far
    it bends. The push swells within 10 ms."""
    sid = slender_bar(modes, frame)
    marker = {"a": 1, "b": 2}
    start = {"position": [-sid.node("1").position[0], 0.0, 0.0]}
    push = {"type": "force", "marker": "bar.b", "function": swelling(0.01)}
    result = run(
        sid,
        "spatial",
        0.02,
        1e-9,
        bodies={"bar": {"sid": "-", "markers": marker, "initial": start}},
        joints={"hinge": {"type": "revolute", "markers": ["ground", "bar.a"]}},
        forces={"push": push | {"force": [0.0, 2.0 * load, load]}},
    )
    return ways(result), result.bodies["bar"].deflection


def on_a_hub(
    frame: str, torque: float, planar_scene: bool, modes: int = 6
) -> tuple[Array, float]:
    """Way of the end of a bar on a hub that a torque turns, and how far it bends.

    In the plane the hub has a bearing, in space it floats with the bar as its panel.
    The torque swells within 30 ms.
    """
    sid = slender_bar(modes, frame)
    place = [0.1 - sid.node("1").position[0], 0.0, 0.0]
    hub: dict[str, Any] = {"mass": 20.0, "inertia": [0.5, 0.7, 0.6]}
    hub["markers"] = {"centre": {"position": [0.0, 0.0]}, "rim": {"position": [0.1, 0]}}
    moment: Any = [0.1 * torque, 0.6 * torque, torque]
    joints: dict[str, Any] = {
        "seat": {"type": "fixed", "markers": ["hub.rim", "bar.a"]}
    }
    if planar_scene:
        hub["inertia"], place, moment = 0.6, place[:2], torque
        markers = ["ground", "hub.centre"]
        joints["bearing"] = {"type": "revolute", "markers": markers}
    else:
        for name in hub["markers"]:
            hub["markers"][name] = {
                "position": [*hub["markers"][name]["position"], 0.0][:3]
            }
    part = {"sid": "-", "markers": {"a": 1, "b": 2}, "initial": {"position": place}}
    turn = {"type": "force", "marker": "hub.centre", "function": swelling(0.03)}
    result = run(
        sid,
        "planar" if planar_scene else "spatial",
        0.06,
        1e-9,
        bodies={"hub": hub, "bar": part},
        joints=joints,
        forces={"turn": turn | {"torque": moment}},
    )
    return ways(result), result.bodies["bar"].deflection
