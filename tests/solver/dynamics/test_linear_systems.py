"""Elimination of the bodies against dense linear algebra, real and complex."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import Array
from sidtool.solver.linear.accelerations import solve_accelerations as solve
from sidtool.solver.linear.block_factors import LARGE_BLOCK
from sidtool.solver.linear.factor_storage import (
    FACTOR_COMPLEX,
    FACTOR_REAL,
    SOLVE_COMPLEX,
    SOLVE_REAL,
)
from sidtool.solver.linear.newton_matrix import (
    newton_factor,
    newton_solve,
    store_linearisation,
)
from sidtool.solver.spatial import system_arrays as at
from sidtool.solver.spatial.coordinates import rate
from sidtool.solver.system.system import System
from sidtool.solver.system.work_arrays import linearise, new_memory
from tests.solver.scenes import Probe, compiled, scene, soft_body


def mechanism(dimension: str, links: int, modes: int = 1) -> System:
    """A closed chain of rigid and flexible links with a point mass hung to it."""
    planar = dimension == "planar"
    names = [f"link{i}" for i in range(links)]
    bodies: dict[str, Any] = {name: {"sid": "-"} for name in names}
    bodies["point"] = {"mass": 0.5}
    pairs = [["ground", "link0.1"], [f"{names[-1]}.2", "ground"], ["link1.3", "point"]]
    pairs += [[f"{names[i]}.2", f"{names[i + 1]}.1"] for i in range(links - 1)]
    joints = {
        f"joint{i}": {"type": "coincident", "markers": pair}
        for i, pair in enumerate(pairs)
    }
    gravity = [0.0, -9.81] if planar else [0.0, 0.0, -9.81]
    described = scene(bodies, joints, gravity=gravity, dimension=dimension)
    sids = {
        name: soft_body(i % 3 * modes, seed=i, planar=planar, nodes=3)
        for i, name in enumerate(names)
    }
    return compiled(described, **sids)


def random_complex(rng: np.random.Generator, shape: Any, kind: type) -> Array:
    values = rng.normal(size=shape)
    return values + 1j * rng.normal(size=shape) if kind is complex else values


def newton_step(
    system: System, probe: Probe, memory: Any, mu: complex, r: Array, s: Array
) -> tuple[Array, Array]:
    """(mu - J)^-1 (r, s) by the kernels."""
    kind = complex if isinstance(mu, complex) else float
    factors = memory.complex if kind is complex else memory.real
    arrays, work = system.arrays, probe.work
    real = kind is float
    factor = newton_factor.python_callable(FACTOR_REAL if real else FACTOR_COMPLEX)
    solve = newton_solve.python_callable(SOLVE_REAL if real else SOLVE_COMPLEX)
    assert factor(arrays, work, memory, factors, 0, mu) == 0
    r, s = r.astype(kind), s.astype(kind)
    solve(arrays, work, memory, factors, 0, mu, r, s)
    return r, s


@pytest.mark.parametrize("mu", [0.7, 0.6 + 1.3j])
@pytest.mark.parametrize("links, modes", [(2, 1), (3, 1), (7, 1), (3, LARGE_BLOCK)])
def test_saddle_point_solution_is_that_of_the_dense_matrix(
    links: int, modes: int, mu: complex
) -> None:
    """[mu M + Rv, -C^T; mu C + Gv, 0] with blocks and segments of random numbers."""
    _compare_with_dense(mechanism("planar", links, modes), links, mu, apart=False)


@pytest.mark.parametrize("mu", [0.7, 0.6 + 1.3j])
@pytest.mark.parametrize("dimension", ["planar", "spatial"])
@pytest.mark.parametrize("modes", [10, 30])
def test_elastic_coordinates_that_do_not_couple_are_solved_alone(
    modes: int, dimension: str, mu: complex
) -> None:
    """The elastic block is its diagonal, but for the first six coordinates."""
    _compare_with_dense(mechanism(dimension, 3, modes), 5, mu, apart=True)


def _compare_with_dense(system: System, seed: int, mu: complex, apart: bool) -> None:
    rng = np.random.default_rng(seed)
    probe, memory = _moving(system, seed), new_memory(system, 1)
    work = probe.work
    for array in (memory.M, memory.C, work.Rv, work.Gv):
        array[:] = rng.normal(size=array.shape)
    for array in (work.Rp, work.Gp):
        array[:] = 0.0
    for row in system.arrays.body:
        nv, start, rd = row[at.NV], row[at.BLOCK], row[at.RD]
        for array, diagonal in ((memory.M, rd), (work.Rv, rd + 6 if apart else nv)):
            if array is memory.M and not (row[at.FLAGS] & at.DIAGONAL_ME or apart):
                continue
            elastic = array[start : start + nv * nv].reshape(nv, nv)
            elastic = elastic[diagonal:, diagonal:]
            elastic[...] = np.diag(np.diag(elastic))
    M, Rv = probe.blocks(memory.M), probe.blocks(work.Rv)
    C, Gv = probe.rows(memory.C), probe.rows(work.Gv)
    m = system.n_rows
    dense = np.block([[mu * M + Rv, -C.T], [mu * C + Gv, np.zeros((m, m))]])
    kind = complex if isinstance(mu, complex) else float
    s = random_complex(rng, system.n_velocities, kind)
    expected = np.linalg.solve(dense, np.concatenate([M @ s, C @ s]))
    r = np.zeros(system.n_positions)
    _, found = newton_step(system, probe, memory, mu, r, s)
    assert found == pytest.approx(expected[: len(s)], rel=1e-9, abs=1e-9)
    factors = memory.complex if kind is complex else memory.real
    whole = factors.pivots[0, system.n_velocities :]
    assert (whole < system.arrays.body[:, at.NV]).any() == apart


@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_accelerations_and_multipliers_solve_the_index_1_equations(
    dimension: str,
) -> None:
    system = mechanism(dimension, 5)
    probe, memory = _moving(system, 1), new_memory(system, 0)
    assert solve(system.arrays, probe.work, memory) == 0
    force, second = probe.unbalance(memory.acceleration, memory.multiplier)
    assert abs(force).max() < 1e-9
    assert abs(second).max() < 1e-9


def _moving(system: System, seed: int) -> Probe:
    """A random state, quaternions of unit length."""
    rng = np.random.default_rng(seed)
    z, v = rng.normal(size=system.n_positions), rng.normal(size=system.n_velocities)
    for row in system.arrays.body:
        if row[at.NP] - row[at.NQ] == 7:
            turn = slice(row[at.POS] + 3, row[at.POS] + 7)
            z[turn] /= np.linalg.norm(z[turn])
    return Probe(system, 0.1, z, v)


@pytest.mark.parametrize("mu", [3.0, 2.0 + 5.0j])
@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_newton_matrix_is_that_of_the_differential_equation(
    dimension: str, mu: complex
) -> None:
    """(mu - J) (dz, dv) = (r, s), J the Jacobian of (z_I', z_II') by differences.

    Point joints, whose Jacobian leaves nothing out.
    """
    system = mechanism(dimension, 4)
    probe, memory = _moving(system, 2), new_memory(system, 1)
    arrays, z, v = system.arrays, probe.z, probe.v
    solve(arrays, probe.work, memory)
    linearise(system, probe.work, probe.t, z, v, memory.acceleration, memory.multiplier)
    store_linearisation(arrays, probe.work, memory)
    rng = np.random.default_rng(3)
    r = rng.normal(size=system.n_positions)
    s = rng.normal(size=system.n_velocities)
    dz, dv = newton_step(system, probe, memory, mu, r, s)

    def slope(dz: Array, dv: Array) -> tuple[Array, Array]:
        """Directional derivative of (z_I', z_II')."""
        step, sides = 1e-6, []
        for sign in (1.0, -1.0):
            there, speed = z + sign * step * dz, v + sign * step * dv
            probe.evaluate(there, speed)
            solve(arrays, probe.work, memory)
            turn = np.zeros(system.n_positions)
            rate(arrays, there, speed, turn)
            sides.append(np.concatenate([turn, memory.acceleration]))
        ahead, behind = sides
        both = (ahead - behind) / (2 * step)
        return both[: len(z)], both[len(z) :]

    parts = [slope(dz.real, dv.real)]
    if isinstance(mu, complex):
        parts.append(slope(dz.imag, dv.imag))
    Jz = sum(p[0] * f for p, f in zip(parts, (1.0, 1j), strict=False))
    Jv = sum(p[1] * f for p, f in zip(parts, (1.0, 1j), strict=False))
    scale = abs(Jv).max()
    assert mu * dz - Jz == pytest.approx(r, abs=1e-7)
    assert mu * dv - Jv == pytest.approx(s, abs=1e-8 * scale + 1e-7)
