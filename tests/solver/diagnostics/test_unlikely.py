"""What is hardly meant is asked about, and what means nothing is not said."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.solver import simulate
from sidtool.solver.diagnostics.implausible_values import (
    frequency_warnings,
    implausible_friction_warnings,
    implausible_value_warnings,
)
from sidtool.solver.system.system import System
from tests.solver.scenes import compiled, scene, slender_rod


def asked(gain: float, measured: str, coefficient: float, radius: float) -> list[str]:
    """Of a pendulum on a pin that rubs, with a controller."""
    law = {"type": "pid", "measured": measured, "reference": 0.3, "p": gain}
    motor = {"type": "actuator", "joint": "pin", "function": law}
    pin: dict[str, Any] = {"type": "revolute", "markers": ["ground", "rod.a"]}
    pin["friction"] = {"coefficient": coefficient, "radius": radius}
    described = scene({"rod": slender_rod(1.0)}, {"pin": pin}, forces={"motor": motor})
    found = implausible_friction_warnings(compiled(described))
    return [f"{each.code} {each.subject}" for each in found]


@pytest.mark.parametrize(
    ("gain", "measured", "coefficient", "radius", "wanted"),
    [
        (9.0, "pin.angle", 0.3, 0.02, []),
        (9.0, "pin.angle", 1.5, 0.4, []),
        (-9.0, "rod.angle", 0.3, 0.02, []),  # what it drives may turn it either way
        (-2.0, "pin.angle", 0.3, 0.02, ["N216 motor"]),
        (9.0, "pin.angle", 30.0, 0.02, ["N213 pin"]),
        (9.0, "pin.angle", 0.3, 20.0, ["N214 pin"]),
    ],
)
def test_only_what_is_hardly_meant_is_asked_about(
    gain: float, measured: str, coefficient: float, radius: float, wanted: list[str]
) -> None:
    assert asked(gain, measured, coefficient, radius) == wanted


@pytest.mark.parametrize(
    ("stiffness", "damping", "turns"),
    [(2e12, 0.0, 1), (2e6, 0.0, 0), (2e12, 1e3, 0), (8e12, 1.0, 1)],
)
def test_a_spring_that_would_make_a_run_long_is_told(
    stiffness: float, damping: float, turns: int
) -> None:
    """Of 2 kg on it; the run takes about as many steps for a period as it says."""
    spring = {
        "type": "spring_damper",
        "joint": "rail",
        "stiffness": stiffness,
        "damping": damping,
    }
    body = {"mass": 2.0, "inertia": 0.1, "initial": {"position": [1e-3, 0.0]}}
    rail = {"type": "prismatic", "markers": ["ground", "block"]}
    parts: tuple[Any, ...] = ({"block": body}, {"rail": rail})
    system = compiled(scene(*parts, forces={"spring": spring}, end=1.0))
    found = list(frequency_warnings(system))
    assert len(found) == turns
    if turns:
        frequency = np.sqrt(stiffness / 2.0) / (2.0 * np.pi)
        assert found[0].code == "N212" and found[0].data["mass"] == 2.0
        assert found[0].data["frequency"] == pytest.approx(frequency)
        short = scene(*parts, forces={"spring": spring}, end=40.0 / frequency)
        steps = simulate(compiled(short)).counters["steps"]
        assert 200 < steps < 2000


def rotor_on_pin(offset: float, mass: float, radius: float, inertia: float) -> System:
    """A disc with its centre of mass beside its pin, which is fixed to a shaft."""
    shaft = slender_rod(0.8)
    disc = {"mass": mass, "inertia": inertia, "centre_of_mass": [0.0, offset]}
    joints = {
        "bearing": {"type": "revolute", "markers": ["ground", "shaft.a"]},
        "shrink": {"type": "revolute", "markers": ["shaft.a", "disc"]},
    }
    joints["bearing"]["friction"] = {"coefficient": 0.1, "radius": radius / 10.0}
    ring = {"type": "spring_damper", "markers": ["ground", "disc"], "stiffness": 1e5}
    ring["rest"] = radius
    return compiled(
        scene({"shaft": shaft, "disc": disc}, joints, forces={"ring": ring})
    )


@pytest.mark.parametrize("seed", range(10))
def test_nothing_is_asked_about_eccentric_discs(seed: int) -> None:
    """From a balance wheel to a flywheel, eccentric by 1e-6 to 0.1 of a radius."""
    random = np.random.default_rng(seed)
    radius, thin = 10.0 ** random.uniform(-2.0, 0.0), random.uniform(0.01, 0.5)
    mass = 7850.0 * np.pi * radius**2 * (thin * radius)
    offset = radius * 10.0 ** random.uniform(-6.0, -1.0)
    inertia = mass * (radius**2 / 2.0 + offset**2)
    assert not list(
        implausible_value_warnings(rotor_on_pin(offset, mass, radius, inertia))
    )


@pytest.mark.parametrize(("masses", "inertias"), [(1.0, 1e6), (1.0, 1e9), (1e-3, 1.0)])
def test_inertia_in_other_units_is_asked_about(masses: float, inertias: float) -> None:
    """Of an eccentric disc, in kg mm2 or g mm2, or with its mass in tonnes."""
    system = rotor_on_pin(1e-4, 2.0 * masses, 0.05, 2.0 * 0.05**2 / 2.0 * inertias)
    found = implausible_value_warnings(system)
    assert ("N205", "disc") in [(each.code, each.subject) for each in found]


@pytest.mark.parametrize(("spin", "count"), [(1900.0, 0), (2100.0, 1)])
@pytest.mark.parametrize("along", [False, True])
def test_ends_of_a_body_that_starts_at_the_speed_of_waves_are_asked_about(
    spin: float, count: int, along: bool
) -> None:
    """A bar of 1 m about its end, at 2000 m/s; about its own axis nothing moves."""
    rod: dict[str, Any] = {"mass": 1.0, "inertia": [0.01, 0.1, 0.1]}
    rod["markers"] = {"tip": {"position": [1.0, 0.0, 0.0]}}
    rod["initial"] = {"angular_velocity": [spin, 0, 0] if along else [0, 0, spin]}
    described = scene({"rod": rod}, dimension="spatial")
    found = [*implausible_value_warnings(compiled(described))]
    assert [d.code for d in found].count("N209") == count * (not along)
