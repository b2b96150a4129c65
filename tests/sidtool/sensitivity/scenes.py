"""Scenes whose motions have closed solutions."""

from __future__ import annotations

from typing import Any

import sidtool

G = 9.81


def scene(**tables: Any) -> sidtool.Scene:
    """A planar scene of 2 s without gravity, with other tables."""
    content: dict[str, Any] = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "gravity": [0.0, 0.0],
        "time": {"end": 2.0, "output_step": 0.1},
        "accuracy": {"rtol": 1e-8},
    }
    return sidtool.Scene.checked(content | tables, "scene")


def block(position: float, velocity: float, mass: float = 2.0) -> dict[str, Any]:
    """A point mass on the x axis."""
    initial = {"position": [position, 0.0], "velocity": [velocity, 0.0]}
    return {"mass": mass, "initial": initial}


GUIDE = {"type": "point_on_line", "markers": ["ground", "block"]}


def oscillator(damping: float = 0.4) -> sidtool.Scene:
    """A mass of 2 kg with a spring of 50 N/m and a damper."""
    spring = {
        "type": "spring_damper",
        "markers": ["ground", "block"],
        "stiffness": 50.0,
        "damping": damping,
        "rest": 0.4,
    }
    return scene(
        bodies={"block": block(0.5, 0.3)},
        joints={"guide": GUIDE},
        forces={"spring": spring},
    )


def pendulum() -> sidtool.Scene:
    """A point on a string that starts horizontally and stops at its lowest point."""
    bottom = {"quantity": "bob.x", "value": 0.0, "action": "stop"}
    return scene(
        gravity=[0.0, -G],
        parameters={"length": 1.0},
        bodies={"bob": {"mass": 1.0, "initial": {"position": ["length", 0.0]}}},
        joints={"string": {"type": "distance", "markers": ["ground", "bob"]}},
        events={"bottom": bottom},
    )


def sliding_block(friction: float = 0.3) -> sidtool.Scene:
    """A block that slides on a guide until friction holds it."""
    guide = {
        "type": "prismatic",
        "markers": ["ground", "block"],
        "axis": [1.0, 0.0],
        "friction": {"coefficient": friction},
    }
    body = block(0.0, 3.0) | {"inertia": 0.1}
    return scene(gravity=[0.0, -G], bodies={"block": body}, joints={"guide": guide})


def bumper(**accuracy: Any) -> sidtool.Scene:
    """A block that meets a spring at x = 0.3 m and is thrown back."""
    table = {"deflection": [-1.0, 0.0, 1.0], "force": [-200.0, 0.0, 0.0]}
    spring = {
        "type": "spring_damper",
        "markers": ["ground", "block"],
        "rest": 0.3,
        "table": table,
    }
    return scene(
        accuracy={"rtol": 1e-8} | accuracy,
        bodies={"block": block(1.0, -1.0)},
        joints={"guide": GUIDE},
        forces={"bumper": spring},
    )


def folding_crank() -> sidtool.Scene:
    """Crank and rod of 1 m: the piston moves as 2 cos(w t), past a singular
    configuration.
    """
    inertia, rod = 0.3 / 12.0, {"a": [-0.5, 0.0], "b": [0.5, 0.0]}
    markers = {name: {"position": place} for name, place in rod.items()}
    bodies = {
        "crank": {"initial": {"position": [0.5, 0.0], "velocity": [0.0, "0.5*w"]}},
        "rod": {"initial": {"position": [1.5, 0.0], "velocity": [0.0, "0.5*w"]}},
    }
    bodies["crank"]["initial"]["angular_velocity"] = "w"  # type: ignore[assignment]
    bodies["rod"]["initial"]["angular_velocity"] = "-w"  # type: ignore[assignment]
    parts = {"mass": 0.3, "inertia": inertia, "markers": markers}
    piston = {"mass": 1.0, "initial": {"position": [2.0, 0.0]}}
    turn = {"type": "polynomial", "pieces": [{"from": 0.0, "coefficients": [0, "w"]}]}
    return scene(
        parameters={"w": 1.0},
        bodies={n: parts | body for n, body in bodies.items()} | {"piston": piston},
        joints={
            "bearing": {"type": "revolute", "markers": ["ground", "crank.a"]},
            "pin": {"type": "revolute", "markers": ["crank.b", "rod.a"]},
            "tip": {"type": "revolute", "markers": ["rod.b", "piston"]},
            "guide": {"type": "point_on_line", "markers": ["ground", "piston"]},
        },
        drives={"drive": {"joint": "bearing", "function": turn}},
    )
