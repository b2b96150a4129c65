"""Links whose inertia rounding hides are refused, with the joint that replaces them."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import rigid_sid
from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene, simulate
from tests.solver.scenes import compiled, scene, slender_rod

LENGTH = 0.4


def slider_crank(mass: float | None, dimension: str = "planar", **more: Any) -> Any:
    """A torque turns the crank; the rod has a mass, or is a joint of type distance."""
    plane = dimension == "planar"
    flat = (lambda *x: list(x[:2])) if plane else (lambda *x: list(x))
    pin = {"type": "revolute" if plane else "spherical"}
    crank: dict[str, Any] = {"mass": 1.0, "inertia": 0.01 if plane else [0.01] * 3}
    crank["markers"] = {"b": {"position": flat(0.1, 0.0, 0.0)}}
    piston: dict[str, Any] = {"mass": 0.5, "initial": {"position": flat(0.5, 0.0, 0.0)}}
    if not plane:
        piston["inertia"] = [1e-3] * 3
    bodies: dict[str, Any] = {"crank": crank, "piston": piston}
    rail = {"type": "prismatic", "markers": ["ground", "piston"]}
    if plane:
        rail["type"] = "point_on_line"
    joints: dict[str, Any] = {
        "axle": {"type": "revolute", "markers": ["ground", "crank"]},
        "rail": rail if plane else rail | {"axis": [1, 0, 0]},
    }
    if mass is None:
        joints["rod"] = {"type": "distance", "markers": ["crank.b", "piston"]}
        joints["rod"] |= more
    else:
        turning = mass * LENGTH**2 / 12
        bodies["rod"] = {
            "mass": mass,
            "inertia": turning if plane else [0.01 * turning, turning, turning],
            "centre_of_mass": flat(LENGTH / 2, 0.0, 0.0),
            "initial": {"position": flat(0.1, 0.0, 0.0)},
            "markers": {"b": {"position": flat(LENGTH, 0.0, 0.0)}},
        }
        joints["small"] = pin | {"markers": ["rod.b", "piston"]}
        joints["big"] = pin | {"markers": ["crank.b", "rod"]}
        if plane:
            joints["small"]["type"] = "coincident"
    torque = {"type": "force", "marker": "crank", "torque": 1.0 if plane else [0, 0, 1]}
    return scene(
        bodies,
        joints,
        forces={"torque": torque},
        dimension=dimension,
        end=0.3,
        gravity=flat(0.0, -9.81, 0.0),
        record=["piston.x"],
    )


def run(described: SceneFile) -> np.ndarray:
    return np.asarray(simulate(compiled(described), rtol=1e-9)["piston.x"])


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize("mass", [1e-12, 1e-13, 1e-20])
def test_a_link_that_rounding_hides_is_refused_for_a_joint(
    mass: float, dimension: str
) -> None:
    """Of which the motion is that of light links which rounding does not hide."""
    with pytest.raises(InputError) as refused:
        simulate(compiled(slider_crank(mass, dimension)))
    assert refused.value.place == "bodies.rod"
    least = [float(x) for x in re.findall(r"of ([\d.e-]+) kg", str(refused.value))]
    enough = max(least[0], 12 * least[1] / LENGTH**2 if len(least) > 1 else 0.0)
    assert simulate(compiled(slider_crank(1.01 * enough, dimension))).completed
    markers, length = re.search(
        r"type distance, markers = (.*), length = ([\d.]+)", str(refused.value)
    ).groups()
    assert set(re.findall(r'"(.*?)"', markers)) == {"crank.b", "piston"}
    replaced = run(slider_crank(None, dimension, length=float(length)))
    light = run(slider_crank(1e-9, dimension))
    assert np.ptp(light) > 0.05
    assert replaced == pytest.approx(light, abs=1e-7)


def test_light_links_above_that_take_no_more_steps() -> None:
    steps = [
        simulate(compiled(slider_crank(mass))).counters["steps"]
        for mass in (1e-3, 1e-10, 3e-11)
    ]
    assert max(steps) < 1.3 * min(steps)


@pytest.mark.parametrize("held", ["once", "by a spring", "alone", "alike"])
def test_light_bodies_that_pass_no_forces_on_are_taken(held: str) -> None:
    """A flange at the end of an arm, a mass between springs, and a tiny linkage."""
    small = {"mass": 1e-13, "inertia": 1e-16, "initial": {"position": [1.0, 0.0]}}
    small["markers"] = {"b": {"position": [0.0, 0.01]}}
    joints: dict[str, Any] = {
        "axle": {"type": "revolute", "markers": ["ground", "arm.a"]}
    }
    forces: dict[str, Any] = {}
    bodies: dict[str, Any] = {"arm": slender_rod(1.0), "small": small}
    if held == "once":
        joints["weld"] = {"type": "fixed", "markers": ["arm.b", "small"]}
    if held == "by a spring":
        joints["rail"] = {"type": "prismatic", "markers": ["arm.b", "small"]}
        forces["spring"] = {
            "type": "spring_damper",
            "joint": "rail",
            "stiffness": 1e-11,
        }
    if held == "alike":
        for body in bodies.values():
            body["mass"], body["inertia"] = 1e-13, 1e-16
        joints["pin"] = {"type": "revolute", "markers": ["arm.b", "small"]}
        joints["line"] = {"type": "point_on_line", "markers": ["ground.p", "small.b"]}
    ground = {"markers": {"p": {"position": [0.0, 0.01]}}}
    described = scene(bodies, joints, forces=forces, ground=ground, end=0.02)
    assert simulate(compiled(described)).completed


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_a_free_body_of_a_sid_without_nodes_falls(dimension: str) -> None:
    """It has no size by its markers."""
    size = 2 if dimension == "planar" else 3
    described = scene(
        {"stone": {"sid": "-"}},
        dimension=dimension,
        gravity=[0.0, -9.81, 0.0][:size],
        record=["stone.y"],
    )
    stone = rigid_sid(2.0, np.zeros(3), np.diag([0.1, 0.2, 0.25]), ())
    result = simulate(compile_scene(described, sids={"stone": stone}))
    assert result["stone.y"][-1] == pytest.approx(-9.81 / 2, rel=1e-6)
