"""The scenes that are measured."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile, read_model
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.formats.sid_files import read_sid
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import compile_scene
from sidtool.solver.system.system import System

EXAMPLE = Path(__file__).parents[1] / "examples" / "slider_crank"
GRAVITY = 9.81
#: Markers of a uniform rod of 1 m and 1 kg.
ENDS = {"a": {"position": [0.0, 0.0]}, "b": {"position": [1.0, 0.0]}}


def founding(**changes: Any) -> dict[str, Any]:
    """The founding scene as a table, with some of its keys replaced."""
    scene = read_scene(EXAMPLE / "slider_crank.toml")
    return scene.model_dump(mode="json", by_alias=True, exclude_none=True) | changes


def compiled(table: dict[str, Any], **sids: SID) -> System:
    """A table as a compiled scene; bodies without a SID here read their file."""
    return compile_scene(SceneFile.model_validate(table), EXAMPLE, sids)


@cache
def rod(modes: int = 5) -> SID:
    """The founding rod with so many eigenmodes."""
    if modes == 5:
        return read_sid(EXAMPLE / "rod_q4.SID_FEM")
    model = read_model(EXAMPLE / "rod_q4.toml").model_dump(
        mode="json", by_alias=True, exclude_none=True
    )
    model["reduction"]["modes"] = modes
    return _converted(model)


def slider_crank(
    modes: int = 5, quadratic_inertia: bool = False, **changes: Any
) -> System:
    """The founding slider-crank; `quadratic_inertia` as in programs that keep it."""
    table = founding(**changes)
    table["bodies"]["rod"]["quadratic_inertia"] = quadratic_inertia
    table["outputs"] = {"record": ["piston.x", "rod.q1"]}
    return compiled(table, rod=rod(modes))


def spatial_slider_crank() -> System:
    """The same mechanism with six coordinates of each frame."""
    table = founding(dimension="spatial")
    table["outputs"] = {"record": ["piston.x", "rod.q1"]}
    crank = table["bodies"]["crank"]
    crank["inertia"] = [1e-5, crank["inertia"], crank["inertia"]]
    crank["centre_of_mass"] = [0.05, 0.0, 0.0]
    for name, x in (("bearing", 0.0), ("pin", 0.1)):
        crank["markers"][name] = {"position": [x, 0.0, 0.0]}
    table["bodies"]["rod"]["initial"] = {"position": [0.1, 0.0, 0.0]}
    table["bodies"]["piston"]["initial"] = {"position": [1.1, 0.0, 0.0]}
    joints = table["joints"]
    joints["piston_pin"]["type"] = "coincident"
    joints["slider"] = {
        "type": "point_on_plane",
        "markers": ["ground", "piston"],
        "axis": [0.0, 1.0, 0.0],
    }
    return compiled(table, rod=rod())


def four_bars(loops: int = 2, end: float = 10.0) -> System:
    """Benchmark A02 of the IFToMM library: a row of four-bar linkages.

    Links of 1 m and 1 kg, upright at first, with a tip speed of 1 m/s.
    """
    bodies, joints = {}, {}
    pivots = {f"p{i}": {"position": [float(i), 0.0]} for i in range(loops + 1)}
    for i in range(loops + 1):
        bodies[f"post{i}"] = _rod(position=[float(i), 0.0], angle=1.5707963267948966)
        joints[f"pivot{i}"] = _pin(f"ground.p{i}", f"post{i}.a")
    for i in range(loops):
        bodies[f"bar{i}"] = _rod(position=[float(i), 1.0])
        joints[f"left{i}"] = _pin(f"post{i}.b", f"bar{i}.a")
        joints[f"right{i}"] = _pin(f"bar{i}.b", f"post{i + 1}.b")
    for name, body in bodies.items():
        turning = name.startswith("post")
        body["initial"]["velocity"] = [0.0, 0.0] if turning else [1.0, 0.0]
        body["initial"]["angular_velocity"] = -1.0 if turning else 0.0
    return compiled(
        {
            **_head("A02", end, end / 100),
            "gravity": [0.0, -GRAVITY],
            "ground": {"markers": pivots},
            "bodies": bodies,
            "joints": joints,
            "outputs": {"record": ["post0.b.x", "post0.b.y"]},
        }
    )


def _rod(**initial: Any) -> dict[str, Any]:
    return {
        "mass": 1.0,
        "inertia": 1.0 / 12.0,
        "centre_of_mass": [0.5, 0.0],
        "markers": ENDS,
        "initial": initial,
    }


def _pin(first: str, second: str) -> dict[str, Any]:
    return {"type": "revolute", "markers": [first, second]}


def _head(title: str, end: float, every: float) -> dict[str, Any]:
    return {
        "format": "sidtool scene",
        "version": 1,
        "title": title,
        "dimension": "planar",
        "time": {"end": end, "output_step": every},
    }


@cache
def link() -> SID:
    """A flexible strip of 0.2 m with four eigenmodes, its frame at the left end."""
    strip = [[[x, y] for y in (-0.005, 0.005)] for x in (0.0, 0.2)]
    return _converted(
        {
            "format": "sidtool model",
            "version": 1,
            "title": "Link",
            "material": {
                "youngs_modulus": 7e10,
                "poissons_ratio": 0.3,
                "density": 2700.0,
            },
            "geometry": {
                "type": "nurbs",
                "degrees": [1, 1],
                "knots": [[0, 0, 1, 1], [0, 0, 1, 1]],
                "control_points": strip,
                "thickness": 0.01,
            },
            "discretisation": {
                "type": "q4",
                "elements": [40, 4],
                "state": "plane_stress",
            },
            "frame": {"type": "tangent", "marker": "left", "clamp": "left"},
            "markers": {
                "left": {"node": 1, "edge": "left", "at": 0.5},
                "right": {"node": 2, "edge": "right", "at": 0.5},
            },
            "reduction": {"method": "modal", "modes": 4},
            "damping": {"type": "rayleigh", "alpha": 0.0, "beta": 1e-5},
        }
    )


def _converted(model: dict[str, Any]) -> SID:
    return sid_from_model(ModelFile.model_validate_json(json.dumps(model)))


def chain(links: int, end: float) -> System:
    """A chain of flexible links that falls from the horizontal."""
    bodies = {
        f"link{i}": {
            "sid": "given",
            "markers": {"a": 1, "b": 2},
            "initial": {"position": [0.2 * i, 0.0]},
        }
        for i in range(links)
    }
    names = ["ground", *(f"link{i}.b" for i in range(links))]
    joints = {f"pin{i}": _pin(names[i], f"link{i}.a") for i in range(links)}
    table = {
        **_head("Chain", end, end),
        "gravity": [0.0, -GRAVITY],
        "bodies": bodies,
        "joints": joints,
        "outputs": {"record": [f"link{links - 1}.b.y"]},
    }
    return compiled(table, **dict.fromkeys(bodies, link()))
