"""Energies: kept, lost and supplied ones add up, for any kind of force and joint."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import SID
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.solver import compile_scene, simulate
from tests.solver.dynamics.joint_scenes import soft_body

ENERGIES = [
    f"energy.{name}"
    for name in ("kinetic", "elastic", "potential", "dissipated", "supplied", "balance")
]


def scene(dimension: str, end: float, record: list[str], **tables: Any) -> SceneFile:
    head = {"format": "sidtool scene", "version": 1, "dimension": dimension}
    time = {"end": end, "output_step": end / 40}
    outputs = {"record": record}
    return validate_data(
        {**head, "time": time, "outputs": outputs, **tables}, SceneFile
    )


def run(content: SceneFile, sids: dict[str, SID], rtol: float = 1e-9) -> Result:
    return simulate(compile_scene(content, ".", sids), rtol=rtol)


def vector(dimension: str, *values: float) -> list[float]:
    return list(values[: 2 if dimension == "planar" else 3])


def mechanism(dimension: str) -> tuple[SceneFile, dict[str, SID]]:
    """A driven rigid arm, a flexible link on it, and every kind of force."""
    plane = dimension == "planar"
    count = 3 if plane else 6
    bodies = {
        "arm": {
            "mass": 0.8,
            "inertia": 0.1 if plane else [0.1, 0.15, 0.2],
            "centre_of_mass": vector(dimension, 0.2, 0.1, 0.0),
            "markers": {
                "root": {"position": vector(dimension, 0.0, 0.0, 0.0)},
                "tip": {"position": vector(dimension, 0.5, 0.0, 0.1)},
            },
        },
        "link": {
            "sid": "link",
            "markers": {"a": "1", "b": "2"},
            "quadratic_inertia": True,
            "damping": {"type": "modal", "ratio": [0.02, 0.05]},
            "initial": {"position": vector(dimension, 1.0, 0.4, 0.2)},
        },
        "load": {
            "mass": 0.5,
            "inertia": 0.1 if plane else [0.1, 0.15, 0.2],
            "initial": {"position": vector(dimension, 1.5, -0.5, 0.4)},
            "markers": {"eye": {"position": vector(dimension, 0.1, 0.0, 0.0)}},
        },
    }
    joints = {
        "root": {"type": "revolute", "markers": ["ground", "arm.root"]},
        "elbow": {"type": "revolute", "markers": ["arm.tip", "link.a"]},
    }
    drives = {
        "turn": {
            "joint": "root",
            "function": {"type": "harmonic", "amplitude": 0.7, "frequency": 0.5},
        }
    }
    push = {"type": "harmonic", "amplitude": 1.0, "frequency": 1.5, "phase": 0.3}
    forces = {
        "coil": {
            "type": "spring_damper",
            "markers": ["link.b", "load.eye"],
            "rest": 1.0,
            "stiffness": [30.0, 5.0, 10.0],
            "damping": [0.3, 0.0, 0.05],
        },
        "hinge": {
            "type": "spring_damper",
            "joint": "elbow",
            "rest": 0.2,
            "table": {"deflection": [-3, -1, 0, 1, 3], "force": [-40, -9, 0, 5, 30]},
        },
        "rub": {"type": "friction", "joint": "elbow", "force": 0.5, "speed": 0.5},
        "motor": {"type": "actuator", "joint": "elbow", "function": push},
        "mount": {
            "type": "bushing",
            "markers": ["ground", "load"],
            "stiffness": [20.0, 30.0, 40.0, 3.0, 4.0, 5.0][:count],
            "damping": [0.1, 0.2, 0.1, 0.02, 0.03, 0.01][:count],
        },
        "wind": {
            "type": "force",
            "marker": "link.b",
            "force": vector(dimension, 1.0, -2.0, 0.5),
            "torque": 0.3 if plane else [0.1, 0.2, 0.3],
            "function": push,
        },
        "jet": {
            "type": "force",
            "marker": "load.eye",
            "axes": "marker",
            "force": vector(dimension, 0.5, 1.0, -0.3),
        },
    }
    content = scene(
        dimension,
        1.0,
        [*ENERGIES, "constraint.position", "constraint.velocity"],
        bodies=bodies,
        joints=joints,
        drives=drives,
        forces=forces,
        gravity=vector(dimension, 1.0, -9.81, -2.0),
    )
    return content, {"link": soft_body(plane, seed=3)}


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_the_energy_balance_of_a_mechanism_closes(dimension: str) -> None:
    result = run(*mechanism(dimension))
    assert np.max(np.abs(result["energy.dissipated"])) > 0.05
    assert np.max(np.abs(result["energy.supplied"])) > 0.5
    balance = result["energy.balance"]
    size = np.ptp(result["energy.kinetic"]) + np.ptp(result["energy.supplied"])
    assert np.max(np.abs(balance - balance[0])) < 2e-8 * size
    assert np.all(np.diff(result["energy.dissipated"]) >= 0.0)
    assert np.max(result["constraint.position"]) < 1e-10
