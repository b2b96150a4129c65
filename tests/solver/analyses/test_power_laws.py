"""Slopes of forces like x^(3/2), which bend without a curvature where they begin."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import sidtool
from sidtool.solver.analyses.power_laws import limits
from tests.codes import codes

K = 100.0


def slider(law: str, **inputs: Any) -> sidtool.Scene:
    """1 kg on a rail, on a spring of 100 N/m and under a law."""
    function = {"type": "expression", "value": law}
    data = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "time": {"end": 1.0, "output_step": 0.1},
        "bodies": {"m": {"mass": 1.0}},
        "joints": {"rail": {"type": "prismatic", "markers": ["ground", "m"]}},
        "forces": {
            "spring": {"type": "spring_damper", "joint": "rail", "stiffness": K},
            "law": {"type": "actuator", "joint": "rail", "function": function},
        },
        "outputs": {"record": ["m.ax", "law.force"]},
    }
    if inputs:
        data["inputs"] = {name: {"initial": value} for name, value in inputs.items()}
    return sidtool.Scene.checked(data, "test")


X, RATE = "rail.displacement", "rail.displacement_rate"


@pytest.mark.parametrize(
    "law",
    [
        f"-1e9*max({X}, 0)**1.5",  # Hertz: two balls of steel that just touch
        f"-1e6*max({X}, 0)**1.5",
        f"-1e7*max({X}, 0)**1.2",
        f"-1e9*max({X}, 0)**2",
        f"-1e6*abs({X})**1.5*sign({X})",
        f"-1e7*abs({X})**1.6",
        f"-1e3*abs({RATE})**1.5*sign({RATE})",
    ],
)
def test_a_contact_that_just_touches_adds_no_stiffness(law: str) -> None:
    """Its slope at the state is zero: 10 rad/s without damping."""
    modes = sidtool.linearise(slider(law), about="start")
    assert_allclose(modes.eigenvalues, [10j], atol=1e-4)
    assert "N745" not in codes(modes)


def test_a_power_law_adds_to_linear_and_smooth_forces() -> None:
    """k x + c x^1.5 + 500 sin(x): that of the sum of the two others."""
    law = f"-1e8*max({X}, 0)**1.5 - 500*sin({X})"
    modes = sidtool.linearise(slider(law), about="start")
    assert_allclose(modes.eigenvalues, [1j * np.sqrt(600.0)], rtol=1e-6)


@pytest.mark.parametrize(
    "law",
    [
        f"-1e3*abs({X}) - 1e9*max({X}, 0)**1.5",
        f"-3e9*max({X}, 0)**1.5 - 2e7*max({X}, 0)**1.2",
        f"-5*sqrt(abs({X}))*sign({X})",
    ],
)
def test_what_has_no_single_power_is_named(law: str) -> None:
    modes = sidtool.linearise(slider(law), about="start")
    assert "N745" in codes(modes)


@pytest.mark.parametrize(
    ("law", "slope"),
    [
        ("1e4*max(u, 0)**1.5", 0.0),
        ("100*u + 1e5*max(u, 0)**1.5 + 3*sin(u)", 103.0),
        ("exp(u)*50 - 50", 50.0),
        ("1e4*u**2", 0.0),
    ],
)
def test_inputs_have_the_slope_of_their_law(law: str, slope: float) -> None:
    space = sidtool.state_space(
        slider(law, u=0.0), inputs=["u"], outputs=["m.ax", "law.force"]
    )
    assert_allclose(space.B.ravel(), [0.0, slope], atol=1e-7)
    assert_allclose(space.D.ravel(), [slope, slope], atol=1e-6)
    assert "N745" not in codes(space)


@pytest.mark.parametrize(
    ("law", "slope"), [("1e3 + {s}*u", 1e-6), ("1e3 + {s}*u", 1e-9), ("1e3+{s}*u", 0.1)]
)
def test_an_input_beside_a_preload_has_its_slope(law: str, slope: float) -> None:
    """However small its gain is."""
    scene = slider(law.format(s=slope), u=0.0)
    space = sidtool.state_space(scene, inputs=["u"], outputs=["m.ax"])
    assert_allclose(space.B.ravel(), [0.0, slope], rtol=1e-5)
    assert "N745" not in codes(space)


@pytest.mark.parametrize("law", ["100*abs(u)", "5*sign(u)", "100*max(u, 0) + 3*u"])
def test_corners_and_jumps_of_inputs_are_named(law: str) -> None:
    space = sidtool.state_space(slider(law, u=0.0), inputs=["u"], outputs=["m.ax"])
    named = [d.subject for d in space.diagnostics if d.code == "N745"]
    assert named == ["inputs.u"]


def test_limits_of_power_laws() -> None:
    """D + c r^k has the limit D for any r below one; a constant stays."""
    steps = 0.125 ** np.arange(6)
    powers = np.array([0.2, 0.5, 1.0, 2.0])
    found, error = limits(3.0 + 7.0 * steps[:, None] ** powers)
    assert_allclose(found, 3.0, atol=1e-12)
    assert error.max() < 1e-12
    same, _ = limits(np.full((5, 2), 4.0))
    assert_allclose(same, 4.0)
    kept, change = limits((1.0 / steps)[:, None])
    assert (kept, change) == (8.0**3, 8.0**3 - 8.0**2)


def test_linear_inputs_have_no_corner() -> None:
    """Two forces on a rotor that spins on a spring, zero at the state."""
    force = {"type": "force", "marker": "disc"}
    signal = {name: {"type": "input", "name": name} for name in ("fy", "fz")}
    disc = {"mass": 45.0, "inertia": [0.9, 0.5, 0.5]}
    scene = sidtool.Scene.checked(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "spatial",
            "gravity": [0.0, 0.0, 0.0],
            "time": {"end": 1.0, "output_step": 0.1},
            "bodies": {"disc": disc | {"initial": {"angular_velocity": [200.0, 0, 0]}}},
            "forces": {
                "film": {
                    "type": "bushing",
                    "markers": ["ground", "disc"],
                    "shaft": "x",
                    "stiffness": [1e6, 2e6, 3e6, 0.0, 1e5, 1e5],
                },
                "y": force | {"force": [0, 1.0, 0], "function": signal["fy"]},
                "z": force | {"force": [0, 0, 1.0], "function": signal["fz"]},
            },
            "inputs": {"fy": {"initial": 0.0}, "fz": {"initial": 0.0}},
            "outputs": {"record": ["disc.y", "disc.z"]},
        },
        "test",
    )
    space = scene.state_space(about="start")
    assert "N745" not in codes(space)
