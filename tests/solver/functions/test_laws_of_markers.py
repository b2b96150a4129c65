"""Laws that read how markers of flexible bodies are turned."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.result import Result
from sidtool.solver import compile_scene, simulate

from ..dynamics.joint_scenes import scene, soft_body

K, D = 7.0, 0.4
TURNING = {
    "planar": ["angle", "wz"],
    "spatial": [f"rotation_{axis}" for axis in "xyz"] + ["wx", "wy", "wz"],
}


def run(dimension: str, forces: dict[str, Any], record: list[str]) -> Result:
    """A free body with two slow modes and turning nodes, which spins and vibrates."""
    plane = dimension == "planar"
    sid = soft_body(plane, seed=0)
    spin = 1.5 if plane else [0.7, -0.4, 1.5]
    start = {"angular_velocity": spin, "elastic": [0.05, -0.03]}
    marker = sid.nodes[0].id
    content = scene(
        dimension,
        0.5,
        bodies={"p": {"sid": "p.sid", "markers": {"a": marker}, "initial": start}},
        forces=forces,
        outputs={"record": record},
    )
    system = compile_scene(content, sids={"p": sid})
    return simulate(system, rtol=1e-8)


@pytest.mark.parametrize("dimension", TURNING)
def test_a_law_reads_what_the_output_tells(dimension: str) -> None:
    axes = [0.0, 0.0] if dimension == "planar" else [0.0, 0.0, 0.0]
    forces = {
        f"read_{name}": {
            "type": "force",
            "marker": "p.a",
            "force": axes,
            "function": {"type": "expression", "value": f"p.a.{name}"},
        }
        for name in TURNING[dimension]
    }
    names = TURNING[dimension]
    record = [f"p.a.{name}" for name in names] + [f"read_{n}.value" for n in names]
    record += ["p.angle" if dimension == "planar" else "p.rotation_z"]
    result = run(dimension, forces, record)
    for name in names:
        told = result[f"p.a.{name}"]
        assert result[f"read_{name}.value"] == pytest.approx(told, abs=1e-12), name
        assert np.ptp(told) > 1e-3
    body, last = result[record[-1]], "angle" if dimension == "planar" else "rotation_z"
    assert np.ptp(result[f"p.a.{last}"] - body) > 1e-4  # the deformation turns it


def test_a_torque_by_the_angle_of_a_marker_is_a_spring() -> None:
    """A controller at a flexible marker, beside the bushing that it replaces."""
    law = {"type": "expression", "value": f"-{K}*p.a.angle - {D}*p.a.wz"}
    torque = {"type": "force", "marker": "p.a", "torque": 1.0, "function": law}
    bushing = {
        "type": "bushing",
        "markers": ["ground", "p.a"],
        "stiffness": [0.0, 0.0, K],
        "damping": [0.0, 0.0, D],
    }
    record = ["p.angle", "p.q1", "p.q2"]
    one, two = (run("planar", {"hold": force}, record) for force in (torque, bushing))
    assert one.values == pytest.approx(two.values, abs=1e-6)
    for counter in ("newton_iterations", "steps"):
        assert one.counters[counter] == two.counters[counter]
