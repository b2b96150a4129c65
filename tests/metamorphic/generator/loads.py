"""Forces of a random scene."""

from __future__ import annotations

import numpy as np

from tests.metamorphic.generator.case import Table
from tests.metamorphic.generator.ingredients import Random, function, unit
from tests.metamorphic.generator.poses import Pose, turned
from tests.metamorphic.generator.sketch import END, Sketch


def add_forces(sketch: Sketch) -> None:
    rng, planar, forces = sketch.rng, sketch.planar, sketch.table["forces"]
    bodies = list(sketch.table["bodies"])

    def other(name: str) -> str:
        return str(rng.choice([n for n in sketch.poses if n != name]))

    for _ in range(int(rng.integers(0, 4))):
        kind = str(rng.choice(["force", "spring", "actuator", "bushing", "joint"]))
        name, label = str(rng.choice(bodies)), sketch.name("forces")
        if kind == "joint":
            found = _joint_force(sketch)
            if found:
                forces[label] = found
            continue
        b, at = sketch.marker(name)
        if kind == "force":
            forces[label] = _point_force(rng, b, planar)
            continue
        first = other(name)
        a, there = sketch.marker(first)
        ends = [sketch.poses[first].then(there), sketch.poses[name].then(at)]
        length = float(np.linalg.norm(ends[1].x - ends[0].x))
        if kind == "bushing":
            forces[label] = _bushing(rng, sketch, a, ends[0], name)
        elif length > 0.2:
            forces[label] = {**_pair_force(rng, kind, length), "markers": [a, b]}


def _point_force(rng: Random, marker: str, planar: bool) -> Table:
    force, torque = 3.0 * rng.normal(size=3), 0.3 * rng.normal(size=3)
    return {
        "type": "force",
        "marker": marker,
        "axes": str(rng.choice(["inertial", "marker"])),
        "force": force[: 2 if planar else 3].tolist(),
        "torque": float(torque[2]) if planar else torque.tolist(),
        "function": function(rng, 1.0, 0.5, END),
    }


def _pair_force(rng: Random, kind: str, length: float) -> Table:
    if kind == "actuator":
        push = function(rng, 2.0, 3.0, END)
        if push["type"] == "table" and push["values"][1] > push["values"][0]:
            push["interpolation"] = "linear"
        return {"type": "actuator", "function": push}
    spring: Table = {"type": "spring_damper", "rest": 0.9 * length}
    if rng.random() < 0.3:
        ways = 0.2 * np.arange(-5.0, 6.0)
        spring["table"] = {
            "deflection": ways.tolist(),
            "force": (40.0 * ways + 10.0 * np.tanh(3.0 * ways)).tolist(),
        }
    else:
        spring["stiffness"] = [float(rng.uniform(20.0, 100.0)), 5.0, 10.0]
    spring["damping"] = float(rng.choice([0.0, 1.0]))
    return spring


def _joint_force(sketch: Sketch) -> Table | None:
    rng, free = sketch.rng, [k for k in sketch.undriven() if k[1] != "length"]
    if not free:
        return None
    name, coordinate = free[int(rng.integers(len(free)))]
    rest = sketch.coordinates[name, coordinate]
    where = {"joint": name, "coordinate": coordinate}
    kind = str(rng.choice(["spring_damper", "actuator", "friction"]))
    if kind == "actuator":
        return {"type": kind, "function": function(rng, 0.5, 0.5, END), **where}
    if kind == "friction":
        return {"type": kind, "force": 0.4, "speed": 0.5, "viscous": 0.1, **where}
    spring = {"rest": rest + 0.2, "stiffness": [8.0], "damping": 0.1}
    return {"type": kind, **spring, **where}


def _bushing(rng: Random, sketch: Sketch, a: str, at: Pose, name: str) -> Table:
    """The second marker lies nearly on the first: bushings take small rotations."""
    if name in sketch.sids:
        b, _ = sketch.marker(name)
    else:
        axis = np.array([0.0, 0.0, 1.0]) if sketch.planar else unit(rng)
        shift = 0.05 * rng.normal(size=3) * ([1, 1, 0] if sketch.planar else 1)
        away = Pose(shift, turned(axis, 0.3))
        b, _ = sketch.marker(name, sketch.poses[name].inverse.then(at.then(away)))
    stiffness = (
        [60.0, 80.0, 4.0] if sketch.planar else [60.0, 80.0, 50.0, 4.0, 3.0, 5.0]
    )
    return {
        "type": "bushing",
        "markers": [a, b],
        "stiffness": stiffness,
        "damping": [0.02 * k for k in stiffness],
    }
