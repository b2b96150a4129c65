"""Scenes with laws of outputs, and the closed loops that they make."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.solver import (
    compile_scene,
    simulate,
)
from sidtool.solver.integrators.registry import INTEGRATORS
from tests.solver.scenes import scene

METHODS = tuple(INTEGRATORS)
GIVEN = {"type": "callable"}


def expression(value: str, **more: Any) -> dict[str, Any]:
    return {"type": "expression", "value": value, **more}


def pid(measured: str, **gains: Any) -> dict[str, Any]:
    return {"type": "pid", "measured": measured, **gains}


def run(made: SceneFile, laws: Mapping[str, Any] | None = None, **more: Any) -> Result:
    return simulate(compile_scene(made, forces=laws), **more)


def closed_loop(p: float, i: float, d: float, lag: float, mass: float) -> Array:
    """Of x, v, I, D under the controller of eq. (31) without limits."""
    push = np.array([-p, 0.0, i, d]) / mass
    return np.array([[0, 1, 0, 0], push, [-1, 0, 0, 0], [0, -1 / lag, 0, -1 / lag]])


def cart(function: dict[str, Any], record: list[str], **more: Any) -> SceneFile:
    return scene(
        {"cart": {"mass": 1.7}},
        {"rail": {"type": "prismatic", "markers": ["ground", "cart"], "axis": [1, 0]}},
        end=2.0,
        steps=20,
        record=["cart.x", "cart.vx", *record],
        forces={
            "motor": {"type": "actuator", "joint": "rail", "function": function},
            "load": {"type": "force", "marker": "cart", "force": [2.5, 0.0]},
        },
        **more,
    )


GAINS = {"p": 38.0, "i": 55.0, "d": 11.0}
STATES = ["motor.state.integral", "motor.state.derivative"]
