"""A rod on a pin that a servo drives, and what its reference model does."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from tests.solver.scenes import GRAVITY, scene, slender_rod

LENGTH, MASS = 0.9, 1.7
W, DAMPING, WANTED = 11.0, 0.35, 0.8
#: Second-order reference model of a servo: x'' = w^2 (wanted - x) - 2 d w x'.
MODEL = {"w": W, "d": DAMPING, "wanted": WANTED}
SERVO: dict[str, Any] = {
    "type": "expression",
    "value": "x",
    "parameters": MODEL,
    "states": {
        "x": {"rate": "v"},
        "v": {"rate": "w**2*(wanted - x) - 2*d*w*v"},
    },
}
RECORD = ["pin.angle", "pin.angle_rate", "servo.mz", "energy.balance"]


def formula(value: str, **more: Any) -> dict[str, Any]:
    return {"type": "expression", "value": value, **more}


def values(result: Result) -> dict[str, Array]:
    return dict(zip(result.names, result.values.T, strict=True))


def step_response(t: Array) -> tuple[Array, Array, Array]:
    """Angle, rate and acceleration of the reference model, from rest at zero."""
    fast = W * math.sqrt(1.0 - DAMPING**2)
    decay = WANTED * np.exp(-DAMPING * W * t)
    x = WANTED - decay * (np.cos(fast * t) + DAMPING * W / fast * np.sin(fast * t))
    v = decay * W * W / fast * np.sin(fast * t)
    return x, v, W * W * (WANTED - x) - 2.0 * DAMPING * W * v


def torque(x: Array, a: Array) -> Array:
    """Inverse dynamics of the uniform rod on its pin, angle from the horizontal."""
    return MASS * LENGTH * (LENGTH * a / 3.0 + 0.5 * GRAVITY * np.cos(x))


def servo(drive: dict[str, Any], space: bool = False, **more: Any) -> SceneFile:
    """A rod that a drive of its pin turns in a vertical plane."""
    rod: dict[str, Any] = slender_rod(LENGTH, MASS)
    pin: dict[str, Any] = {"type": "revolute", "markers": ["ground", "rod.a"]}
    more = {"gravity": [0.0, -GRAVITY], "record": RECORD} | more
    if space:
        more |= {"dimension": "spatial", "gravity": [0.0, -GRAVITY, 0.0]}
        rod["inertia"] = [1e-3, rod["inertia"], rod["inertia"]]
        rod["centre_of_mass"] = [LENGTH / 2, 0.0, 0.0]
        rod["markers"] = {"a": {"position": [0.0, 0.0, 0.0]}}
    drives = {"servo": {"joint": "pin", **drive}}
    return scene({"rod": rod}, {"pin": pin}, drives, **more)
