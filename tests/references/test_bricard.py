"""Bricard's mechanism: five bars and the ground, hinged along the edges of a cube.

Benchmark A04 of the IFToMM library of computational benchmark problems: bars of 1 m and
1 kg, gravity along -y. Six hinges leave no freedom by count, but one by geometry: one
constraint depends on the others in every position.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import Array
from sidtool.solver import simulate
from sidtool.solver.initial_state.assembly import dense_jacobian
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.solver.system import work_arrays
from sidtool.solver.system.characteristic_sizes import constraint_sizes
from sidtool.solver.system.system import System
from sidtool.solver.system.work_arrays import new_work_arrays
from tests.solver.scenes import GRAVITY, compiled, scene

CORNERS = ((0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1))
#: The axis of the hinge at each corner is at right angles to both edges there.
AXES = ("y", "z", "x", "y", "z", "x")
#: Of a round bar with a radius of 1 cm.
ACROSS, ALONG = 1.0 / 12.0, 5e-5


def bricard(end: float = 10.0, **more: Any) -> System:
    """Bar i goes from corner i to the next; its frame is parallel to the inertial."""
    bodies, joints = {}, {}
    for i in range(5):
        first, second = (np.array(CORNERS[k], float) for k in (i, i + 1))
        edge = second - first
        inertia = np.where(np.abs(edge) > 0.5, ALONG, ACROSS)
        bodies[f"bar{i}"] = {
            "mass": 1.0,
            "inertia": inertia.tolist(),
            "centre_of_mass": (0.5 * edge).tolist(),
            "markers": {"tip": {"position": edge.tolist()}},
            "initial": {"position": first.tolist()},
        }
    ends = ["ground", *(f"bar{i}.tip" for i in range(5))]
    starts = [*(f"bar{i}" for i in range(5)), "ground.last"]
    for i, axis in enumerate(AXES):
        direction = [float(axis == name) for name in "xyz"]
        pair = {"markers": [ends[i], starts[i]], "axis": direction}
        joints[f"hinge{i}"] = {"type": "revolute", **pair}
    record = ["bar2.tip.x", "bar2.tip.y", "energy.kinetic", "energy.potential"]
    return compiled(
        scene(
            bodies,
            joints,
            end=end,
            steps=200,
            record=record,
            dimension="spatial",
            gravity=[0.0, -GRAVITY, 0.0],
            ground={"markers": {"last": {"position": [0.0, 0.0, 1.0]}}},
            **more,
        )
    )


@pytest.mark.parametrize(
    ("integrator", "rtol"), [("radau5", 1e-9), ("radau9", 1e-10), ("radau13", 1e-10)]
)
def test_energy_is_kept_for_ten_seconds(integrator: str, rtol: float) -> None:
    result = simulate(bricard(), integrator=integrator, rtol=rtol)
    energy = result["energy.kinetic"] + result["energy.potential"]
    largest = result["energy.kinetic"].max()
    assert largest > 4.0
    assert np.ptp(energy) < 1e-8 * largest
    assert result.drift["position"] < 1e-12


def test_all_integrators_agree_on_the_motion() -> None:
    system = bricard(2.0)
    exact = simulate(system, integrator="radau13", rtol=1e-11)
    for name, method in INTEGRATORS.items():
        rtol, bound = (1e-5, 1e-3) if method.order == 2 else (1e-6, 1e-6)
        result = simulate(system, integrator=name, rtol=rtol)
        for place in ("bar2.tip.x", "bar2.tip.y"):
            assert result[place] == pytest.approx(exact[place], abs=bound), name


def test_one_hinge_is_redundant_and_its_forces_are_the_smallest() -> None:
    """C^T lambda is what the motion needs; no part of lambda lies in its null space."""
    system = bricard(1.0)
    result = simulate(system, rtol=1e-9)
    work, sizes = new_work_arrays(system), constraint_sizes(system)
    for k in (0, 100, 200):
        z, v = result.positions[k].copy(), result.velocities[k].copy()
        work_arrays.evaluate(system, work, float(result.t[k]), z, v)
        C = dense_jacobian(system, work.C)
        null_space = _null_space((C / sizes[:, None]).T)
        assert null_space.shape[1] == 1
        scaled = result.multipliers[k] * sizes
        assert abs(null_space.T @ scaled).max() < 1e-9 * abs(scaled).max()


def _null_space(matrix: Array) -> Array:
    _, sizes, right = np.linalg.svd(matrix)
    return right[int(np.sum(sizes > 1e-9 * sizes[0])) :].T
