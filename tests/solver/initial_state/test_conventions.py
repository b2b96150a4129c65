"""Axes of velocities, and what the assembly says of bodies that it moves."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sidtool.formats.result import Result
from sidtool.solver import compile_scene, describe, simulate
from tests.solver.scenes import scene, slender_rod

AXES = "xyz"


def tumbling(turned: list[float], spin: list[float]) -> Result:
    """A free body, for an instant; all of its velocities and its state."""
    record = [f"top.{a}{b}{c}" for c in ("", "_body") for a in "vw" for b in AXES]
    top = {
        "mass": 1.0,
        "inertia": [1.0, 2.0, 2.5],
        "initial": {
            "axis_angle": turned,
            "angular_velocity": spin,
            "velocity": [3.0, -1.0, 0.5],
        },
    }
    content = scene({"top": top}, dimension="spatial", end=0.5, record=record)
    return simulate(compile_scene(content), rtol=1e-9)


def columns(result: Result, names: str) -> np.ndarray:
    return np.transpose([result[f"top.{name}"] for name in names.split()])


@pytest.mark.parametrize("turned", [[0.0, 0.0, 0.5 * np.pi], [0.4, -1.0, 0.7]])
def test_velocities_are_inertial_and_those_in_body_axes_say_so(
    turned: list[float],
) -> None:
    """w_body = R^T w; a quarter turn about z takes the x axis of space to -y."""
    spin = [1.0, 0.0, 2.0]
    found = tumbling(turned, spin)
    assert columns(found, "wx wy wz")[0] == pytest.approx(spin)
    back = Rotation.from_rotvec(turned).inv()
    for inertial, body in (
        ("vx vy vz", "vx_body vy_body vz_body"),
        ("wx wy wz", "wx_body wy_body wz_body"),
    ):
        expected = back.apply(columns(found, inertial)[0])
        assert columns(found, body)[0] == pytest.approx(expected, abs=1e-12)
    w, J = columns(found, "wx_body wy_body wz_body"), np.array([1.0, 2.0, 2.5])
    assert 0.5 * w**2 @ J == pytest.approx(0.5 * w[0] ** 2 @ J, rel=1e-8)
    assert np.ptp(w, axis=0).max() > 0.1


def test_states_are_those_in_body_axes() -> None:
    found = tumbling([0.4, -1.0, 0.7], [1.0, 0.5, 2.0])
    names = [name.removeprefix("top.") for name in found.velocity_names]
    assert names == ["vx_body", "vy_body", "vz_body", "wx_body", "wy_body", "wz_body"]
    assert np.array_equal(columns(found, " ".join(names)), found.velocities)


def test_a_planar_frame_has_body_axes_too() -> None:
    """At rest in its frame: 2 m/s along x are -2 m/s along the y axis of a body that
    is turned by 90 degrees."""
    rod = slender_rod(1.0, angle=0.5 * np.pi, velocity=[2.0, 0.0])
    record = ["rod.vx", "rod.vy", "rod.vx_body", "rod.vy_body", "rod.wz_body"]
    found = simulate(compile_scene(scene({"rod": rod}, record=record)))
    assert found.values[-1] == pytest.approx([2.0, 0.0, 0.0, -2.0, 0.0], abs=1e-12)
    assert found.velocity_names == ("rod.vx_body", "rod.vy_body", "rod.wz_body")


@pytest.mark.parametrize("kind", ["fixed", "revolute"])
@pytest.mark.parametrize("keep", [False, True])
@pytest.mark.parametrize("size", [1e-5, 0.36])
def test_the_assembly_says_what_it_moved(kind: str, keep: bool, size: float) -> None:
    rod = slender_rod(1.0, position=[0.0, -size], angle=0.0)
    content = scene(
        {"rod": rod}, {"base": {"type": kind, "markers": ["ground", "rod.a"]}}
    )
    system = compile_scene(content, keep_joints=keep)
    (found,) = simulate(system, rtol=1e-6).diagnostics
    assert found.code == "N221" and found.data["bodies"] == ("rod",)
    if kind == "fixed":
        assert found.data["linear"] == pytest.approx([size])
        assert found.data["angular"] == pytest.approx([0.0], abs=1e-12)
    assert found.line in describe(system)


def test_a_start_that_fits_is_not_told() -> None:
    rod = slender_rod(1.0, position=[0.0, -1e-8], angle=0.5)
    content = scene(
        {"rod": rod}, {"base": {"type": "revolute", "markers": ["ground", "rod.a"]}}
    )
    assert not simulate(compile_scene(content), rtol=1e-6).diagnostics
