"""Bodies without joints: what mechanics conserves, and Euler's exact solution."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipj

from sidtool import solver
from sidtool.formats.base.sid import SID, Array
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.solver.spatial import system_arrays as at
from sidtool.solver.system import work_arrays
from sidtool.solver.system.system import System
from sidtool.solver.system.work_arrays import new_work_arrays
from tests.bodies import particle_body


def free_scene(body: dict[str, object], planar: bool, rtol: float) -> SceneFile:
    return SceneFile.model_validate(
        {
            "format": "sidtool scene",
            "version": 1,
            "dimension": "planar" if planar else "spatial",
            "time": {"end": 2.0, "output_step": 0.1},
            "accuracy": {"rtol": rtol, "integrator": "radau9"},
            "bodies": {"body": body},
            "outputs": {"record": ["body.x", "body.wz"]},
        }
    )


def flexible(sid: SID, planar: bool) -> tuple[System, Result]:
    """A free flexible body that spins, moves and vibrates, without damping."""
    from dataclasses import replace

    from sidtool.formats.base.sid import Taylor

    undamped = replace(sid, De=Taylor(np.zeros((sid.nq, sid.nq))))
    axes = 2 if planar else 3
    initial = {
        "velocity": [0.3, -0.2, 0.1][:axes],
        "angular_velocity": 0.8 if planar else [0.5, 0.8, -0.6],
        "elastic": list(0.01 / np.arange(1, sid.nq + 1)),
        "elastic_velocity": [0.02] * sid.nq,
    }
    body = {"sid": "given", "quadratic_inertia": True, "initial": initial}
    scene = free_scene(body, planar, 1e-9)
    system = solver.compile_scene(scene, ".", {"body": undamped})
    return system, solver.simulate(system)


def conserved(system: System, result: Result) -> tuple[Array, Array, Array]:
    """Energy (nt,), linear (nt, 3) and angular momentum about the origin (nt, 3)."""
    work = new_work_arrays(system)
    work.interval_time[0] = 1.0
    row, sid = system.arrays.body[1], system.bodies[1].sid
    n, rigid = int(row[at.NV]), int(row[at.RD])
    energies, linear, angular = [], [], []
    for t, z, v in zip(result.t, result.positions, result.velocities, strict=True):
        work_arrays.evaluate(system, work, t, z.copy(), v.copy())
        M = work.M.reshape(n, n)
        q = z[-sid.nq :]
        energies.append(0.5 * v @ M @ v + 0.5 * q @ sid.Ke.m0 @ q)
        momentum = M[:rigid] @ v
        R, r = _pose(system, z)
        p = np.zeros(3)
        p[: 2 if system.planar else 3] = momentum[: 2 if system.planar else 3]
        spin = np.array([0.0, 0.0, momentum[2]]) if system.planar else momentum[3:]
        linear.append(R @ p)
        angular.append(R @ spin + np.cross(r, R @ p))
    return np.array(energies), np.array(linear), np.array(angular)


def _pose(system: System, z: Array) -> tuple[Array, Array]:
    from sidtool.formats.scene import Placement, orientation_matrix

    if system.planar:
        return orientation_matrix(Placement(angle=float(z[2]))), np.array(
            [z[0], z[1], 0.0]
        )
    return orientation_matrix(Placement(quaternion=tuple(map(float, z[3:7])))), z[:3]


@pytest.mark.parametrize("planar", [True, False])
def test_a_free_flexible_body_conserves_everything(planar: bool) -> None:
    """With the quadratic inertia the SID is exact for its displacement field."""
    sid = particle_body(3, 12, planar=planar, seed=4)
    energy, linear, angular = conserved(*flexible(sid, planar))
    assert np.ptp(energy) < 1e-7 * abs(energy).max()
    assert np.ptp(linear, axis=0).max() < 1e-7 * abs(linear).max()
    assert np.ptp(angular, axis=0).max() < 1e-7 * abs(angular).max()


def test_a_free_asymmetric_top_follows_euler() -> None:
    """Torque-free rotation in Jacobi's elliptic functions (Landau, Lifshitz I, 37)."""
    inertia = np.array([1.0, 2.0, 3.0])
    start = np.array([0.8, 0.0, 1.0])
    body = {
        "mass": 1.0,
        "inertia": list(inertia),
        "initial": {"angular_velocity": list(start)},
    }
    system = solver.compile_scene(free_scene(body, planar=False, rtol=1e-10))
    result = solver.simulate(system)
    exact = _euler(inertia, start, result.t)
    assert result.velocities[:, 3:6] == pytest.approx(exact, abs=1e-8)


def _euler(inertia: Array, start: Array, t: Array) -> Array:
    """Body-resolved angular velocity for I1 < I2 < I3, w2(0) = 0 and L^2 > 2 E I2."""
    i1, i2, i3 = inertia
    energy = float(start**2 @ inertia)
    momentum = float(((start * inertia) ** 2).sum())
    assert momentum > energy * i2
    tau = t * np.sqrt((i3 - i2) * (momentum - energy * i1) / (i1 * i2 * i3))
    k2 = (i2 - i1) * (energy * i3 - momentum) / ((i3 - i2) * (momentum - energy * i1))
    sn, cn, dn, _ = ellipj(tau, k2)
    w1 = np.sqrt((energy * i3 - momentum) / (i1 * (i3 - i1))) * cn
    w2 = np.sqrt((energy * i3 - momentum) / (i2 * (i3 - i2))) * sn
    w3 = np.sqrt((momentum - energy * i1) / (i3 * (i3 - i1))) * dn
    return np.column_stack([w1, w2, w3])
