"""Generalised-alpha: its coefficients, and what it does to what it cannot resolve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from formats.sid import Array, Taylor
from solver import simulate
from solver.integrators.generalised_alpha import coefficients
from tests.solver.scenes import compiled, scene, soft_body

RADII = [0.0, 0.5, 0.8, 1.0]


def amplification(rho: float, frequency: float) -> Array:
    """(q, h q', h^2 a) from step to step for q'' = -(frequency / h)^2 q, a lagging.

    Chung and Hulbert, eq. (12).
    """
    alpha_m, alpha_f, beta, gamma = coefficients(rho)[:4]
    w = frequency**2
    left = np.array(
        [
            [1.0, 0.0, -beta],
            [0.0, 1.0, -gamma],
            [w * (1.0 - alpha_f), 0.0, 1.0 - alpha_m],
        ]
    )
    right = np.array(
        [
            [1.0, 1.0, 0.5 - beta],
            [0.0, 1.0, 1.0 - gamma],
            [-w * alpha_f, 0.0, -alpha_m],
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
    alpha_m, alpha_f, beta, gamma, position, velocity = coefficients(rho)
    shift = alpha_m - alpha_f
    a0, a1 = 6.0 * shift, 6.0 * (1.0 + shift)
    assert (0.5 - beta) * a0 + beta * a1 - 1.0 == pytest.approx(6.0 * position)
    assert (1.0 - gamma) * a0 + gamma * a1 == pytest.approx(3.0)
    lag = (1.0 - alpha_m) * a1 + alpha_m * a0 - (1.0 - alpha_f) * 6.0
    assert lag == pytest.approx(0.0, abs=1e-14)
    bend = 12.0 * (0.5 * (1.0 - alpha_f) - (1.0 - alpha_m) * (0.5 + shift))
    quartic = 12.0 * (0.5 + shift) * gamma + bend - 4.0 * 0.5
    assert quartic == pytest.approx(12.0 * velocity, abs=1e-12)


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
