"""Scenes as a user writes them: a crane, a pendulum that is hit, a yoke, a drive.

Each says its bodies with or without geometric stiffening.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from sidtool.formats.base.sid import SID
from sidtool.formats.scene import SceneFile
from tests.steel_bars import steel_bar

MARKERS = {"root": 1, "tip": 2}


def scene_with(end: float, record: list[str], **tables: Any) -> SceneFile:
    content: dict[str, Any] = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "gravity": [0.0, -9.81],
        "time": {"end": end, "output_step": end / 200},
        "outputs": {"record": record},
    }
    return SceneFile.model_validate(content | tables)


@cache
def bar(stiffened: bool, width: float, height: float, modes: int, beta: float) -> SID:
    tables: dict[str, Any] = {"damping": {"type": "rayleigh", "beta": beta}}
    if stiffened:
        tables["stiffening"] = {}
    return steel_bar(width=width, height=height, modes=modes, **tables)


def crane(stiffened: bool) -> tuple[SceneFile, dict[str, SID]]:
    """A soft boom that starts bent by its load and lifts it on a rope."""
    hook = {"position": [0.0, 0.4]}
    load = {
        "mass": 0.3,
        "inertia": 0.001,
        "markers": {"hook": hook},
        "initial": {"position": [1.0, -0.4]},
    }
    step = {"type": "smooth_step", "from": 0.1, "to": 0.9, "end": 0.8}
    scene = scene_with(
        2.0,
        ["load.x", "load.y", "boom.tip.y", "lift.mz", "boom.q1", "rope.fx"],
        initial={"state": "static"},
        bodies={"boom": {"sid": "boom", "markers": MARKERS}, "load": load},
        joints={
            "slew": {"type": "revolute", "markers": ["ground", "boom.root"]},
            "rope": {"type": "revolute", "markers": ["boom.tip", "load.hook"]},
        },
        drives={"lift": {"joint": "slew", "function": step}},
    )
    return scene, {"boom": bar(stiffened, 0.008, 0.012, 4, 1e-3)}


def pendulum(stiffened: bool) -> tuple[SceneFile, dict[str, SID]]:
    """It hangs at rest and is hit at its tip for 25 ms."""
    times = [0.0, 0.1, 0.11, 0.115, 0.12, 0.13, 1.0]
    values = [0.0, 0.0, 0.5, 1.0, 0.5, 0.0, 0.0]
    pulse = {"type": "table", "times": times, "values": values, "ends": "natural"}
    start = {"angle": -0.5 * np.pi}
    scene = scene_with(
        1.0,
        ["rod.tip.x", "rod.tip.vx", "pin.fy", "rod.q1", "rod.q2"],
        bodies={"rod": {"sid": "rod", "markers": MARKERS, "initial": start}},
        joints={"pin": {"type": "revolute", "markers": ["ground", "rod.root"]}},
        forces={
            "hit": {
                "type": "force",
                "marker": "rod.tip",
                "force": [60.0, 0.0],
                "function": pulse,
            }
        },
    )
    return scene, {"rod": bar(stiffened, 0.02, 0.012, 5, 2e-4)}


def yoke(stiffened: bool) -> tuple[SceneFile, dict[str, SID]]:
    """A scotch yoke that spins up and shakes a mass at the end of its rod."""
    ramp = {"type": "sine_ramp", "of": "rate", "end": 25.0, "from": 0.0, "to": 0.2}
    scene = scene_with(
        0.5,
        ["mass.x", "mass.vx", "motor.mz", "slot.fx", "rod.q1", "rod.root.y"],
        bodies={
            "crank": {
                "mass": 1.0,
                "inertia": 0.01,
                "markers": {"pin": {"position": [0.1, 0.0]}},
            },
            "rod": {
                "sid": "rod",
                "markers": MARKERS,
                "initial": {"position": [0.1, 0.0]},
            },
            "mass": {
                "mass": 2.0,
                "inertia": 0.01,
                "initial": {"position": [1.1, 0.0]},
            },
        },
        joints={
            "main": {"type": "revolute", "markers": ["ground", "crank"]},
            "slot": {
                "type": "point_on_line",
                "markers": ["rod.root", "crank.pin"],
                "axis": [0.0, 1.0],
            },
            "tie": {"type": "fixed", "markers": ["rod.tip", "mass"]},
            "guide": {
                "type": "prismatic",
                "markers": ["ground", "mass"],
                "axis": [1.0, 0.0],
            },
        },
        drives={"motor": {"joint": "main", "function": ramp}},
    )
    return scene, {"rod": bar(stiffened, 0.03, 0.03, 4, 1e-4)}


def drive(stiffened: bool) -> tuple[SceneFile, dict[str, SID]]:
    """Two masses on a shaft, driven to and fro in a bearing that rubs."""
    rubbing = {"coefficient": 0.15, "radius": 0.02}
    torque = {"type": "harmonic", "amplitude": 8.0, "frequency": 6.0}
    scene = scene_with(
        0.17,
        ["motor.wx", "disc.wx", "left.mx", "bearing.fz", "shaft.tip.z"],
        dimension="spatial",
        gravity=[0.0, 0.0, -9.81],
        bodies={
            "motor": {"mass": 3.0, "inertia": [0.01, 0.01, 0.01]},
            "shaft": {"sid": "shaft", "markers": MARKERS},
            "disc": {
                "mass": 1.0,
                "inertia": [0.03, 0.02, 0.02],
                "initial": {"position": [1.0, 0.0, 0.0]},
            },
        },
        joints={
            "bearing": {
                "type": "revolute",
                "markers": ["ground", "motor"],
                "axis": [1.0, 0.0, 0.0],
                "friction": rubbing,
            },
            "left": {"type": "fixed", "markers": ["motor", "shaft.root"]},
            "right": {"type": "fixed", "markers": ["shaft.tip", "disc"]},
        },
        forces={"servo": {"type": "actuator", "joint": "bearing", "function": torque}},
    )
    return scene, {"shaft": bar(stiffened, 0.016, 0.016, 6, 1e-4)}
