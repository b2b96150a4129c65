"""Simulations of a bar with the sections s1 to s5, and their section forces."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import sidtool
from sidtool.formats.base.sid import Array
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data

TURN_ABOUT_Z = {
    "hub": {
        "type": "revolute",
        "markers": ["ground", "bar.root"],
        "axis": [0.0, 0.0, 1.0],
    }
}


def simulated(sid: sidtool.SID, **scene: Any) -> Result:
    data: dict[str, Any] = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "spatial",
        "time": {"end": 0.5, "output_step": 0.05},
        "bodies": {"bar": {"sid": "bar.h5", "markers": {"root": 1, "tip": 2}}},
    }
    content = validate_data(data | scene, SceneFile)
    return sidtool.simulate(content, sids={"bar": sid})


def vectors(result: Result, owner: str, kind: str) -> Array:
    return np.stack([result[f"{owner}.{kind}{axis}"] for axis in "xyz"], axis=1)


def section(result: Result, name: str, quantities: str) -> Array:
    return np.stack([result[f"bar.{name}.{q}"] for q in quantities.split()], axis=1)


def assert_ends_have_the_forces_of_joints(sid: sidtool.SID, tip: list[float]) -> None:
    """Of a bar in space that turns about z and carries a mass at its tip.

    Parameters
    ----------
    tip : position of the mass at the start [m]
    """
    turned = [f"bar.{m}.rotation_{axis}" for m in ("root", "tip") for axis in "xyz"]
    result = simulated(
        sid,
        gravity=[0.0, 0.0, -9.81],
        bodies={
            "bar": {"sid": "bar.h5", "markers": {"root": 1, "tip": 2}},
            "load": {
                "mass": 5.0,
                "inertia": [0.1, 0.2, 0.3],
                "centre_of_mass": [0.2, 0.1, 0.0],
                "initial": {"position": tip},
            },
        },
        joints=TURN_ABOUT_Z
        | {"flange": {"type": "fixed", "markers": ["bar.tip", "load"]}},
        drives={
            "motor": {
                "joint": "hub",
                "function": {
                    "type": "sine_ramp",
                    "of": "rate",
                    "from": 0.0,
                    "to": 0.5,
                    "end": 3.0,
                },
            }
        },
        outputs={"record": ["bar.s*.*", "hub.*", "motor.*", "flange.*", *turned]},
    )
    for end, name, joints in (
        ("root", "s1", ("hub", "motor")),
        ("tip", "s5", ("flange",)),
    ):
        turn = Rotation.from_rotvec(vectors(result, f"bar.{end}", "rotation_"))
        axes = sid.section(name).node.AP.m0
        for kind, quantities in (("f", "N Vy Vz"), ("m", "T My Mz")):
            joint = sum(vectors(result, each, kind) for each in joints)
            expected = -turn.inv().apply(joint) @ axes
            found = section(result, name, quantities)
            assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
