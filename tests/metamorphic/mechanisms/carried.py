"""Robots whose bodies are carried by joints that prescribe their motion.

A flexible arm hangs on the ground and carries rigid bodies, in the plane and in space.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.sidtool.bodies import beam_data
from tests.solver.scenes import polynomial, scene

LENGTH, HEIGHT, WIDTH = 1.0, 0.02, 0.05
AREA, SECOND_MOMENT = HEIGHT * WIDTH, WIDTH * HEIGHT**3 / 12
MODULUS, DENSITY = 2.1e11, 7850.0

#: How the first body may be carried: the drive of the joint, or none.
CARRIED: dict[str, list[float] | None] = {
    "fixed": None,
    "revolute": [0.2, 0.0, 3.0, -2.0],
    "prismatic": [0.05, 0.0, 0.4],
}


@cache
def arm(modes: int = 6) -> SID:
    """A uniform cantilever of steel along x, clamped at its node 1."""
    data = beam_data({"type": "beam", "elements": 30}, modes)
    section = {"shape": "rectangle", "height": HEIGHT, "width": WIDTH}
    data["geometry"] |= {"end": [LENGTH, 0.0, 0.0], "section": section}
    data["frame"] = {"type": "tangent", "marker": "root", "clamp": "start"}
    data["markers"] = {
        "root": {"node": 1, "parameters": [0.0]},
        "tip": {"node": 2, "parameters": [1.0]},
    }
    del data["damping"]
    return sid_from_model(validate_data(data, ModelFile))


def rigid(dimension: str, mass: float, length: float = 0.3) -> dict[str, Any]:
    """A slender body from its marker near to far, whose centre lies between them."""
    axes = 2 if dimension == "planar" else 3
    near, far, middle = ([x, 0.0, 0.0][:axes] for x in (0.0, length, length / 2))
    across = mass * length**2 / 12
    inertia = across if dimension == "planar" else [0.1 * across, across, across]
    return {
        "mass": mass,
        "inertia": inertia,
        "centre_of_mass": middle,
        "markers": {"near": {"position": near}, "far": {"position": far}},
    }


def joint(
    name: str, kind: str, ends: list[str], motion: list[float] | None
) -> tuple[dict[str, Any], dict[str, Any]]:
    """A joint, and the drive that prescribes it."""
    drives = {}
    if motion is not None:
        drives[f"{name}_drive"] = {"joint": name, "function": polynomial(*motion)}
    return {name: {"type": kind, "markers": ends}}, drives


def robot(
    dimension: str,
    shoulder: str,
    wrist: str,
    base: str = "tip",
    chain: int = 1,
    **more: Any,
) -> SceneFile:
    """A flexible arm on a shoulder, with bodies on its marker `base`, wrist by wrist.

    shoulder, wrist : kinds of joints, of `CARRIED`
    chain : bodies that carry each other
    """
    motion = CARRIED[shoulder]
    joints, drives = joint("shoulder", shoulder, ["ground", "arm.root"], motion)
    markers = {"root": 1, "tip": 2}
    bodies: dict[str, Any] = {"arm": {"sid": "arm.SID_FEM", "markers": markers}}
    carrier = f"arm.{base}"
    for k in range(chain):
        bodies[f"tool{k}"] = rigid(dimension, 4.0 / (k + 1))
        ends = [carrier, f"tool{k}.near"]
        found, driven = joint(f"wrist{k}", wrist, ends, CARRIED[wrist])
        joints, drives = joints | found, drives | driven
        carrier = f"tool{k}.far"
    gravity = [0.0, -9.81] if dimension == "planar" else [1.0, -9.0, 4.0]
    settings = {"dimension": dimension, "gravity": gravity, "end": 0.1} | more
    settings.setdefault("record", ["arm.q*", f"{carrier}.x", f"{carrier}.y"])
    return scene(bodies, joints, drives, **settings)
