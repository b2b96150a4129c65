"""Bodies with geometric stiffening: one kinetic energy, from which all terms follow."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import Array
from sidtool.formats.result import Result
from sidtool.solver import simulate
from sidtool.solver.system.errors import SimulationError
from sidtool.solver.system.system import System
from tests.bodies import particle_cloud
from tests.solver.dynamics.lagrangian import Lagrangian
from tests.solver.scenes import Probe, compiled, scene, soft_body

DIMENSIONS = ["planar", "spatial"]
GRAVITY = [1.3, -9.81, 2.1]


def body(dimension: str, seed: int, nq: int = 3) -> System:
    planar = dimension == "planar"
    described = scene(
        {"soft": {"sid": "-"}},
        dimension=dimension,
        gravity=GRAVITY[: 2 if planar else 3],
    )
    return compiled(described, soft=soft_body(nq, seed, planar, stiffening=True))


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_equations_are_those_of_lagrange(dimension: str, seed: int) -> None:
    system = body(dimension, seed)
    sid, rng = system.bodies[-1].sid, np.random.default_rng(seed)
    z, n = rng.normal(size=system.n_positions), system.n_velocities
    z[-3:] *= 0.1
    if dimension == "spatial":
        z[3:7] /= np.linalg.norm(z[3:7])
    v, rate = rng.normal(size=(2, n))
    probe = Probe(system, 0.0, z, v)
    found, _ = probe.unbalance(rate, np.zeros(0))
    planar = dimension == "planar"
    frame = probe.frame[-1]
    if planar:
        c, s = np.cos(z[2]), np.sin(z[2])
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    else:
        turn = frame[3:12].reshape(3, 3)
    gravity = turn.T @ np.array([*GRAVITY[:2], 0.0 if planar else GRAVITY[2]])
    cloud, _ = particle_cloud(3, 8, planar, seed, True)
    exact = Lagrangian(sid, cloud, planar)
    expected = exact.unbalance(z[-3:], v, rate, gravity)
    assert found == pytest.approx(expected, rel=1e-10, abs=1e-10)
    assert probe.mass == pytest.approx(exact.mass(z[-3:]), rel=1e-11, abs=1e-12)


def moving(dimension: str, seed: int, **body: Any) -> System:
    """A free body that is thrown, turns and vibrates, without damping."""
    planar = dimension == "planar"
    rng = np.random.default_rng(seed)
    space, turns = 2 if planar else 3, 1 if planar else 3
    spin = rng.normal(size=turns)
    initial = {
        "velocity": rng.normal(size=space).tolist(),
        "angular_velocity": float(spin[0]) if planar else spin.tolist(),
        "elastic": (0.06 * rng.normal(size=3)).tolist(),
        "elastic_velocity": (0.3 * rng.normal(size=3)).tolist(),
    }
    described = scene(
        {"soft": {"sid": "-", "initial": initial, **body}},
        end=4.0,
        steps=40,
        dimension=dimension,
        record=["energy.kinetic", "energy.elastic"],
    )
    sid = soft_body(3, seed, planar, stiffening=True, damped=False)
    return compiled(described, soft=sid)


@pytest.mark.parametrize("seed", [5, 6])
@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_a_free_body_keeps_energy_and_both_momenta(dimension: str, seed: int) -> None:
    """They came to 0.1 of themselves while the terms stood in the mass matrix alone."""
    system = moving(dimension, seed)
    result = simulate(system, integrator="radau9", rtol=1e-11)
    energy = result["energy.kinetic"] + result["energy.elastic"]
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-8
    assert np.ptp(result["energy.elastic"]) > 0.01 * energy[0]
    momenta = np.array(
        [momentum(system, t, z, v) for t, z, v in states(result)],
    )
    assert np.abs(momenta - momenta[0]).max() < 1e-8 * np.abs(momenta[0]).max()


def states(result: Result) -> Iterator[tuple[float, Array, Array]]:
    return zip(result.t, result.positions, result.velocities, strict=True)


def momentum(system: System, t: float, z: Array, v: Array) -> Array:
    """Momentum and angular momentum about the inertial origin."""
    probe = Probe(system, t, z, v)
    rows = probe.mass @ v
    if system.planar:
        c, s = np.cos(z[2]), np.sin(z[2])
        x, y = c * rows[0] - s * rows[1], s * rows[0] + c * rows[1]
        return np.array([x, y, rows[2] + z[0] * y - z[1] * x])
    turn = probe.frame[-1, 3:12].reshape(3, 3)
    push = turn @ rows[:3]
    return np.array([*push, *(turn @ rows[3:6] + np.cross(z[:3], push))])


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_inertia_stays_positive_where_that_of_the_frame_does(dimension: str) -> None:
    """Also for shape functions that nearly move the body as a whole."""
    planar = dimension == "planar"
    sid = soft_body(9 if planar else 14, 3, planar, stiffening=True)
    system = compiled(scene({"soft": {"sid": "-"}}, dimension=dimension), soft=sid)
    rng, rigid = np.random.default_rng(1), 3 if planar else 6
    constant = 0.0
    for _ in range(50):
        z = np.zeros(system.n_positions)
        z[0 if planar else 3] = 1.0
        z[-sid.nq :] = 0.05 * rng.normal(size=sid.nq)
        M = Probe(system, 0.0, z, np.zeros(system.n_velocities)).mass
        if np.linalg.eigvalsh(M[:rigid, :rigid])[0] > 0.0:
            assert np.linalg.eigvalsh(M)[0] > 0.0
            constant += 1
    assert constant > 40


def test_a_body_that_loses_the_inertia_of_its_frame_is_named() -> None:
    sid = soft_body(3, 4, planar=False, stiffening=True)
    body = {"sid": "-", "initial": {"elastic": [0.7, -0.4, 0.5]}}
    system = compiled(scene({"soft": body}, dimension="spatial"), soft=sid)
    with pytest.raises(SimulationError, match="N307 soft"):
        simulate(system)
