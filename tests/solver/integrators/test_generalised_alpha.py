"""Generalised-alpha: its coefficients, and what it does to what it cannot resolve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sidtool.formats.base.sid import Array, Taylor
from sidtool.solver import compile_scene, simulate
from sidtool.solver.integrators.generalised_alpha_step import coefficients
from tests.solver.dynamics.joint_scenes import scene as free_scene
from tests.solver.scenes import compiled, scene, soft_body

RADII = [0.0, 0.5, 0.8, 1.0]


def amplification(rho: float, frequency: float) -> Array:
    """(q, h q', h^2 a) from step to step for q'' = -(frequency / h)^2 q, a lagging.

    Chung and Hulbert, eq. (12).
    """
    w = coefficients(rho)
    alpha_m, alpha_f, beta, gamma = w.alpha_m, w.alpha_f, w.beta, w.gamma
    square = frequency**2
    left = np.array(
        [
            [1.0, 0.0, -beta],
            [0.0, 1.0, -gamma],
            [square * (1.0 - alpha_f), 0.0, 1.0 - alpha_m],
        ]
    )
    right = np.array(
        [
            [1.0, 1.0, 0.5 - beta],
            [0.0, 1.0, 1.0 - gamma],
            [-square * alpha_f, 0.0, -alpha_m],
        ]
    )
    return np.linalg.solve(left, right)


def radius(matrix: Array) -> float:
    return float(abs(np.linalg.eigvals(matrix)).max())


@pytest.mark.parametrize("rho", RADII)
def test_the_spectral_radius_falls_from_one_to_rho(rho: float) -> None:
    assert radius(amplification(rho, 1e-3)) == pytest.approx(1.0, abs=1e-9)
    radii = [radius(amplification(rho, w)) for w in np.geomspace(1e-2, 1e4, 200)]
    assert max(radii) <= 1.0 + 1e-9
    assert radius(amplification(rho, 1e6)) == pytest.approx(rho, abs=1e-2)


@pytest.mark.parametrize("rho", RADII)
def test_the_error_constants_are_those_of_one_step(rho: float) -> None:
    """q = t^3 with a = 6 (t + (alpha_m - alpha_f) h), from t = 0 with h = 1."""
    w = coefficients(rho)
    alpha_m, alpha_f, beta, gamma = w.alpha_m, w.alpha_f, w.beta, w.gamma
    shift = alpha_m - alpha_f
    a0, a1 = 6.0 * shift, 6.0 * (1.0 + shift)
    assert (0.5 - beta) * a0 + beta * a1 - 1.0 == pytest.approx(6.0 * w.position_error)
    assert (1.0 - gamma) * a0 + gamma * a1 == pytest.approx(3.0)
    lag = (1.0 - alpha_m) * a1 + alpha_m * a0 - (1.0 - alpha_f) * 6.0
    assert lag == pytest.approx(0.0, abs=1e-14)
    bend = 12.0 * (0.5 * (1.0 - alpha_f) - (1.0 - alpha_m) * (0.5 + shift))
    quartic = 12.0 * (0.5 + shift) * gamma + bend - 4.0 * 0.5
    assert quartic == pytest.approx(12.0 * w.velocity_error, abs=1e-12)


@pytest.mark.parametrize(("rho", "last"), [(0.8, 100), (0.6, 60)])
def test_a_mode_that_the_step_cannot_resolve_dies_out(rho: float, last: int) -> None:
    """By rho a step in the long run, until nothing but rounding is left."""
    sid = soft_body(1, seed=1, damped=False)
    stiff = replace(sid, Ke=Taylor(np.array([[1e12]])))
    body = {"sid": "-", "initial": {"elastic": [1e-9]}}
    described = scene({"body": body}, end=1.0, steps=100, record=["body.q1"])
    system = compiled(described, body=stiff)
    runs = {
        name: abs(
            simulate(system, integrator=name, step=0.01, spectral_radius=rho)["body.q1"]
        )
        for name in ("generalised_alpha", "trapezoidal")
    }
    assert runs["trapezoidal"][-10:].max() > 0.5e-9
    dying = runs["generalised_alpha"]
    assert (dying[last] / dying[last - 20]) ** (1 / 20) == pytest.approx(rho, abs=0.03)


def test_a_fixed_step_that_does_not_divide_the_time_is_shortened_a_little() -> None:
    body = {"mass": 1.0, "initial": {"velocity": [1.0, 0.0]}}
    system = compiled(scene({"body": body}, record=["body.x"]))
    result = simulate(system, integrator="generalised_alpha", step=0.3)
    assert result.counters["steps"] == 4
    assert result["body.x"] == pytest.approx(result.t, abs=1e-12)


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize("rtol", [1e-3, 1e-5])
def test_a_steady_rotation_is_as_exact_as_asked(dimension: str, rtol: float) -> None:
    """No acceleration in body axes tells of it: the frame lies beside the centre."""
    flat, arm, spin = dimension == "planar", 0.4, 20.0

    def vector(x: float, y: float) -> list[float]:
        return [x, y] if flat else [x, y, 0.0]

    disc = {
        "mass": 2.0,
        "inertia": 0.5 if flat else [0.3, 0.4, 0.5],
        "centre_of_mass": vector(-arm, 0.0),
        "initial": {
            "position": vector(arm, 0.0),
            "velocity": vector(0.0, spin * arm),
            "angular_velocity": spin if flat else [0.0, 0.0, spin],
        },
    }
    outputs = {"record": ["disc.x", "disc.y"]}
    content = free_scene(dimension, 4.0, bodies={"disc": disc}, outputs=outputs)
    system = compile_scene(content)
    result = simulate(system, integrator="generalised_alpha", rtol=rtol)
    angle = spin * result.t
    for name, exact in (("disc.x", np.cos(angle)), ("disc.y", np.sin(angle))):
        assert result[name] == pytest.approx(arm * exact, abs=rtol * arm)
