"""Rigid multibody systems with known motions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sidtool.formats.result import Result
from sidtool.solver import simulate
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.solver.system.system import System
from tests.solver.scenes import GRAVITY, Probe, compiled, scene, slender_rod

DOWN = [0.0, -GRAVITY]


def pendulum(end: float = 10.0) -> System:
    """IFToMM benchmark A01: m = 1 kg on L = 1 m, horizontal at rest at first."""
    bob = {
        "mass": 1.0,
        "inertia": 1e-9,
        "markers": {"pivot": {"position": [1.0, 0.0]}},
        "initial": {"position": [-1.0, 0.0]},
    }
    joints = {"pivot": {"type": "revolute", "markers": ["ground", "bob.pivot"]}}
    record = ["bob.x", "bob.y"]
    return compiled(
        scene({"bob": bob}, joints, end=end, steps=100, record=record, gravity=DOWN)
    )


def massless_rod_pendulum(end: float = 10.0, outputs: int = 100) -> System:
    """The same pendulum as a point mass at a constant distance."""
    bob = {"mass": 1.0, "initial": {"position": [-1.0, 0.0]}}
    joints = {"rod": {"type": "distance", "markers": ["ground", "bob"], "length": 1.0}}
    record = ["bob.x", "bob.y"]
    return compiled(
        scene({"bob": bob}, joints, end=end, steps=outputs, record=record, gravity=DOWN)
    )


@pytest.mark.parametrize("name", ["radau5", "radau9", "radau13"])
def test_the_pendulum_of_the_iftomm_library(name: str) -> None:
    """Exact positions after 10 s by a Taylor series."""
    result = simulate(massless_rod_pendulum(), integrator=name, rtol=1e-11)
    assert result["bob.x"][-1] == pytest.approx(-0.2750874625761169, abs=1e-9)
    assert result["bob.y"][-1] == pytest.approx(-0.9614192050991251, abs=1e-9)


def test_a_revolute_joint_and_a_rod_give_the_same_pendulum() -> None:
    """Up to the moment of inertia of 1e-9 kg m2 that a body which rotates needs."""
    one, other = (
        simulate(s, rtol=1e-10) for s in (pendulum(2.0), massless_rod_pendulum(2.0))
    )
    assert one.values == pytest.approx(other.values, abs=1e-7)


@pytest.mark.parametrize(
    "name", sorted(n for n in INTEGRATORS if INTEGRATORS[n].order < 13)
)
def test_fixed_steps_on_the_pendulum_converge_with_the_order(name: str) -> None:
    """Largest errors at the ends of steps, all of them far above rounding.

    Order 9 is reached from below (8.62, 8.79, 8.84 with 9, 12, 14 steps of the coarse
    run); order 13 meets rounding with the largest steps for which Newton converges.
    """
    order = INTEGRATORS[name].order
    coarse = {2: 160, 5: 20, 8: 8, 9: 12}[order]
    system = massless_rod_pendulum(2.0, coarse)
    exact = simulate(system, integrator="radau13", rtol=1e-13)
    errors = [
        _deviation(simulate(system, integrator=name, step=h, rtol=1e-10), exact)
        for h in (2.0 / coarse, 1.0 / coarse)
    ]
    rate = math.log2(errors[0] / errors[1])
    assert rate > order - (0.15 if order < 9 else 0.25)


def _deviation(result: Result, exact: Result) -> float:
    return float(abs(result.values - exact.values).max())


@pytest.mark.parametrize("name", sorted(INTEGRATORS))
def test_a_projectile_flies_a_parabola(name: str) -> None:
    """Every method of order 2 and more is exact here."""
    ball = {"mass": 3.0, "initial": {"position": [1.0, 2.0], "velocity": [4.0, 5.0]}}
    system = compiled(scene({"ball": ball}, gravity=DOWN, record=["ball.x", "ball.y"]))
    result = simulate(system, integrator=name)
    t = result.t
    assert result["ball.x"] == pytest.approx(1.0 + 4.0 * t, abs=1e-10)
    height = 2.0 + 5.0 * t - 0.5 * GRAVITY * t**2
    assert result["ball.y"] == pytest.approx(height, abs=1e-10)


def test_a_free_rod_turns_at_constant_speed_about_its_centre_of_mass() -> None:
    body = slender_rod(2.0, velocity=[0.0, -3.0], angular_velocity=3.0)
    system = compiled(scene({"rod": body}, record=["rod.x", "rod.y", "rod.angle"]))
    result = simulate(system, rtol=1e-10)
    assert result["rod.angle"] == pytest.approx(3.0 * result.t, abs=1e-9)
    assert result["rod.x"] == pytest.approx(1.0 - np.cos(3.0 * result.t), abs=1e-9)
    assert result["rod.y"] == pytest.approx(-np.sin(3.0 * result.t), abs=1e-9)


def energy(system: System, result: Result) -> np.ndarray:
    """Kinetic, elastic and gravitational energy at the output times [J]."""
    found = []
    for t, z, v in zip(result.t, result.positions, result.velocities, strict=True):
        probe = Probe(system, t, z, v)
        found.append(0.5 * v @ probe.mass @ v + _potential(system, probe))
    return np.array(found)


def _potential(system: System, probe: Probe) -> float:
    """m g times the height of the centres of mass of rigid bodies."""
    total = 0.0
    for body, frame in zip(system.bodies, probe.work.frame, strict=True):
        if body.name == "ground":
            continue
        x, y, c, s = frame[:4]
        mdx, mdy = body.sid.mdCM.m0[:2, 0]
        total += GRAVITY * (body.sid.mass * y + s * mdx + c * mdy)
    return total


def chain(links: int, end: float) -> System:
    bodies: dict[str, Any] = {
        f"rod{i}": slender_rod(1.0, position=[float(i), 0.0], angle=0.0)
        for i in range(links)
    }
    names = ["ground", *(f"rod{i}.b" for i in range(links))]
    joints = {
        f"hinge{i}": {"type": "revolute", "markers": [names[i], f"rod{i}.a"]}
        for i in range(links)
    }
    return compiled(scene(bodies, joints, end=end, steps=50, gravity=DOWN))


@pytest.mark.parametrize("links", [2, 5])
def test_a_chain_of_rods_keeps_its_energy(links: int) -> None:
    system = chain(links, 2.0)
    found = energy(system, simulate(system, integrator="radau9", rtol=1e-10))
    scale = links**2 * GRAVITY
    assert abs(found - found[0]).max() < 1e-8 * scale


def test_the_trapezoidal_rule_loses_energy_with_its_order() -> None:
    system = chain(2, 0.5)
    losses = []
    for step in (2e-3, 1e-3):
        result = simulate(system, integrator="trapezoidal", step=step)
        found = energy(system, result)
        losses.append(abs(found - found[0]).max())
    assert math.log2(losses[0] / losses[1]) == pytest.approx(2.0, abs=0.3)
