"""Inverse dynamics of joints that rub, and of bodies that deform under their loads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sidtool.formats.base.sid import Taylor
from sidtool.solver import simulate
from sidtool.solver.analyses.inverse_dynamics import inverse_dynamics
from tests.solver.scenes import compiled, polynomial, scene, soft_body

MU, RADIUS = 0.3, 0.05


@pytest.mark.parametrize("rate", [0.2, -0.3])
def test_a_soft_body_on_a_bearing_that_rubs(rate: float) -> None:
    """Turned steadily. Its drive bears the friction of the load alone, and a driven run
    comes to the same once its vibrations are damped out."""
    sid = soft_body(2, seed=3)
    sid = replace(sid, De=Taylor(3.0 * sid.Ke.m0))  # decays in about 3 s
    record = ["motor.mz", "pin.friction", "pin.normal_force", "body.q1", "body.q2"]
    described = scene(
        {
            "body": {
                "sid": "-",
                "markers": {"pin": 1},
                "initial": {"angular_velocity": rate},
            }
        },
        joints={
            "pin": {
                "type": "revolute",
                "markers": ["ground", "body.pin"],
                "friction": {"coefficient": MU, "radius": RADIUS},
            }
        },
        drives={"motor": {"joint": "pin", "function": polynomial(0.0, rate)}},
        end=100.0,
        record=record,
        gravity=[0.0, 0.0],
    )
    system = compiled(described, body=sid)
    known = inverse_dynamics(system, quasi_static=True)
    friction = -np.sign(rate) * MU * RADIUS * known["pin.normal_force"]
    assert known["pin.normal_force"].min() > 1e-3
    np.testing.assert_allclose(known["pin.friction"], friction, rtol=1e-8)
    np.testing.assert_allclose(known["motor.mz"], -friction, rtol=1e-8)
    result = simulate(system, integrator="radau9", rtol=1e-8)
    for name in record:
        assert abs(result[name][0] - known[name][-1]) > 1e-3 * abs(known[name][-1])
        assert result[name][-1] == pytest.approx(known[name][-1], rel=1e-6)
