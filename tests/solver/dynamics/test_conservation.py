"""Free flexible bodies: what no force changes stays, in the exact equations."""

from __future__ import annotations

import numpy as np
import pytest

from sidtool.formats.base.sid import Array
from sidtool.formats.result import Result
from sidtool.solver import simulate
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.solver.system.system import System
from tests.solver.scenes import Probe, compiled, scene, soft_body

NQ = 3


def free_body(end: float = 2.0) -> System:
    initial = {
        "position": [0.5, -0.3],
        "velocity": [1.0, 2.0],
        "angular_velocity": 3.0,
        "elastic": [0.2, -0.1, 0.3],
        "elastic_velocity": [1.0, 0.5, -0.7],
    }
    body = {"sid": "-", "quadratic_inertia": True, "initial": initial}
    sid = soft_body(NQ, seed=2, damped=False)
    return compiled(scene({"body": body}, end=end, steps=20), body=sid)


def invariants(system: System, result: Result) -> Array:
    """Linear momentum x, y, angular momentum about the origin, and energy."""
    found = []
    sid = system.bodies[-1].sid
    for t, z, v in zip(result.t, result.positions, result.velocities, strict=True):
        momentum = Probe(system, t, z, v).mass @ v
        c, s = np.cos(z[2]), np.sin(z[2])
        px, py = c * momentum[0] - s * momentum[1], s * momentum[0] + c * momentum[1]
        q = z[3:]
        energy = 0.5 * v @ momentum + 0.5 * q @ sid.Ke.m0 @ q
        found.append([px, py, momentum[2] + z[0] * py - z[1] * px, energy])
    return np.array(found)


@pytest.mark.parametrize(
    ("integrator", "rtol", "bound"),
    [
        ("radau5", 1e-8, 1e-7),
        ("radau9", 1e-8, 1e-7),
        ("dop853", 1e-8, 1e-7),
        ("trapezoidal", 1e-8, 1e-5),
    ],
)
def test_momentum_and_energy_of_a_free_flexible_body(
    integrator: str, rtol: float, bound: float
) -> None:
    """Large deformations: with q.Me.q in J the planar equations are exact."""
    system = free_body()
    found = invariants(system, simulate(system, integrator=integrator, rtol=rtol))
    scale = abs(found[0]).max()
    assert abs(found - found[0]).max() < bound * scale


@pytest.mark.parametrize(
    "name", sorted(n for n in INTEGRATORS if INTEGRATORS[n].order < 13)
)
def test_what_is_lost_shrinks_with_the_order_of_the_method(name: str) -> None:
    """Order 13 loses nothing but rounding with any step that converges."""
    system = free_body(0.5)
    order = INTEGRATORS[name].order
    coarse = 0.5 / {2: 50, 5: 8, 8: 4, 9: 3}[order]
    lost = []
    for step in (coarse, coarse / 2):
        result = simulate(system, integrator=name, step=step, rtol=1e-10)
        found = invariants(system, result)
        lost.append(abs(found[-1] - found[0]).max())
    assert np.log2(lost[0] / lost[1]) > order - 0.5


def test_without_the_quadratic_term_energy_is_not_kept() -> None:
    """The order-1 SID is an approximation for small deformations: it shows here."""
    system = free_body(0.5)
    described = system.scene.model_copy(deep=True)
    described.bodies["body"] = described.bodies["body"].model_copy(
        update={"quadratic_inertia": False}
    )
    first_order = compiled(described, body=system.bodies[-1].sid)
    found = invariants(first_order, simulate(first_order, rtol=1e-8))
    lost = abs(found - found[0]).max(axis=0)
    assert lost[:3].max() < 1e-6
    assert lost[3] > 1e-2


def test_damping_takes_energy_and_leaves_momentum() -> None:
    system = compiled(free_body().scene, body=soft_body(NQ, seed=2, damped=True))
    found = invariants(system, simulate(system, rtol=1e-8))
    assert (np.diff(found[:, 3]) < 0.0).all()
    assert abs(found[:, :3] - found[0, :3]).max() < 1e-6 * abs(found[0]).max()


@pytest.mark.parametrize("name", sorted(INTEGRATORS))
def test_quaternions_of_a_body_without_joints_keep_unit_length(name: str) -> None:
    """A body that tumbles about its middle axis, with a coarse tolerance."""
    initial = {"angular_velocity": [0.1, 3.0, 0.1]}
    body = {"mass": 1.0, "inertia": [1.0, 2.0, 3.0 - 1e-9], "initial": initial}
    system = compiled(scene({"top": body}, end=5.0, dimension="spatial"))
    result = simulate(system, integrator=name, rtol=1e-3)
    assert abs(np.linalg.norm(result.positions[:, 3:], axis=1) - 1.0).max() < 1e-14
