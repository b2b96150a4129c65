"""Analyses take the laws and callables of programs, as `simulate` does."""

from __future__ import annotations

import math

import numpy as np
import pytest

import sidtool
from tests.solver.scenes import scene

MASS, GAIN, DAMPING, LOAD = 1.6, 70.0, 4.0, 3.5


def test_one_law_for_run_equilibrium_and_modes() -> None:
    created = scene(
        {"cart": {"mass": MASS}},
        {"rail": {"type": "prismatic", "markers": ["ground", "cart"], "axis": [1, 0]}},
        record=["cart.x", "motor.value"],
        forces={
            "motor": {
                "type": "actuator",
                "joint": "rail",
                "function": {"type": "callable"},
            },
            "load": {
                "type": "force",
                "marker": "cart",
                "force": [1.0, 0.0],
                "function": {"type": "callable"},
            },
        },
    )
    law = sidtool.Law(lambda t, y: -GAIN * y[0] - DAMPING * y[1], ["cart.x", "cart.vx"])
    programs = {"motor": law, "load": lambda t: LOAD}
    rest = sidtool.static_equilibrium(created, forces=programs).result()
    assert rest.values[0] == pytest.approx([LOAD / GAIN, -LOAD], rel=1e-9)
    value = sidtool.linearise(created, forces=programs).eigenvalues[0]
    decay = DAMPING / (2.0 * MASS)
    assert value.real == pytest.approx(-decay, rel=1e-6)
    assert value.imag == pytest.approx(math.sqrt(GAIN / MASS - decay**2), rel=1e-6)
    run = sidtool.simulate(created, forces=programs, rtol=1e-8)
    t, omega = run.t, math.sqrt(GAIN / MASS - decay**2)
    swing = np.cos(omega * t) + decay / omega * np.sin(omega * t)
    expected = LOAD / GAIN * (1.0 - np.exp(-decay * t) * swing)
    assert np.abs(run.values[:, 0] - expected).max() < 1e-7 * expected.max()
