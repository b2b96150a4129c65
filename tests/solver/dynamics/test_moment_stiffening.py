"""Geometric stiffening by moments at markers: psi m1 in forces and couplings.

What joints do with it is in `test_equations`, beams under moments in
`test_moment_loads`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.sid import SID, Taylor
from sidtool.solver import simulate
from sidtool.solver.diagnostics.body_loads import recorded_loads
from sidtool.solver.initial_state.assembly import assemble
from sidtool.solver.initial_state.constraint_jacobian import dense_jacobian
from sidtool.solver.output.samples import EvaluatedForces, Samples
from sidtool.solver.spatial import system_arrays as at
from sidtool.solver.spatial.coordinates import rate
from sidtool.solver.system.system import System
from sidtool.solver.system.work_arrays import complete_accelerations, linearise
from tests.solver.dynamics.test_equations import STILL, not_turning, random_state
from tests.solver.scenes import Probe, compiled, scene, soft_body

DIMENSIONS = ["planar", "spatial"]
STEP = 1e-5
NO_FORCES = np.zeros((0, at.N_FORCE), np.int64)


def loaded(dimension: str) -> System:
    """A flexible body under forces of every kind, at both ends of each."""
    plane = dimension == "planar"
    space, count = slice(2 if plane else 3), 3 if plane else 6
    torque: Any = 2.5 if plane else [2.5, -1.7, 0.9]
    stiffness = [3.0, 2.0, 4.0, 5.0, 2.5, 3.5]
    damping = [0.7, 0.4, 0.5, 0.9, 0.6, 0.3]
    push = {"type": "force", "force": [1.3, -2.1, 0.8][space], "torque": torque}
    bush = {
        "type": "bushing",
        "stiffness": stiffness[:count],
        "damping": damping[:count],
    }
    spring = {"type": "spring_damper", "stiffness": [2.0, 0.3], "damping": 0.8}
    forces = {
        "given": {**push, "marker": "soft.1"},
        "follower": {**push, "marker": "soft.2", "axes": "marker"},
        "to": {**bush, "markers": ["block", "soft.1"]},
        "from": {**bush, "markers": ["soft.2", "block"]},
        "line": {**spring, "markers": ["ground", "soft.2"], "rest": 0.4},
        "coil": {**spring, "joint": "hinge", "rest": 0.2},
        "uncoil": {**spring, "joint": "reverse", "rest": -0.3},
    }
    inertia: Any = 0.3 if plane else [0.3, 0.4, 0.2]
    described = scene(
        {
            "soft": {"sid": "-"},
            "block": {"mass": 2.0, "inertia": inertia},
        },
        {
            "hinge": {"type": "revolute", "markers": ["soft.1", "block"]},
            "reverse": {"type": "revolute", "markers": ["block", "soft.2"]},
            "teeth": {"type": "gear", "joints": ["hinge", "reverse"], "ratio": -2.0},
        },
        forces=forces,
        dimension=dimension,
    )
    soft = soft_body(3, seed=7, planar=plane, stiffening=True)
    return compiled(described, soft=soft if plane else not_turning(soft))


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_forces_are_linearised(dimension: str) -> None:
    """Stiffness and damping of a flexible body under loads, by central differences.

    In space only by its elastic coordinates, where they begin to turn the markers.
    """
    system = loaded(dimension)
    probe, b = random_state(system, 3), system.index("soft")
    row = system.arrays.body[b]
    first, n = row[at.VEL], row[at.NV]
    rest = np.zeros(system.n_velocities)
    work = probe.work
    linearise(system, work, probe.t, probe.z, probe.v, rest, np.zeros(system.n_rows))
    block = slice(row[at.BLOCK], row[at.BLOCK] + n * n)
    found = [work.Rp[block].reshape(n, n), work.Rv[block].reshape(n, n)]
    entries = system.arrays.n_entries
    for _, owner, offset in system.arrays.newton_subsystem.segment:
        if owner == b and offset >= entries:
            part = slice(offset, offset + n)
            found[0] = found[0] + np.outer(work.C[part], work.Gp[part])
            found[1] = found[1] + np.outer(work.C[part], work.Gv[part])
    kept = slice(0 if system.planar else row[at.RD], n)
    slopes = np.zeros((2, n, n))
    for k in range(n):
        step = STEP * np.eye(system.n_velocities)[first + k]
        for sign in (1.0, -1.0):
            probe.evaluate(probe.moved(sign * step), probe.v)
            slopes[0, :, k] -= sign * work.f[first : first + n] / (2 * STEP)
            probe.evaluate(probe.z, probe.v + sign * step)
            slopes[1, :, k] -= sign * work.f[first : first + n] / (2 * STEP)
    for exact, matrix in zip(slopes, found, strict=True):
        assert matrix[kept, kept] == pytest.approx(
            exact[kept, kept], rel=1e-7, abs=1e-7
        )


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_measured_forces_and_moments_are_those_that_act(dimension: str) -> None:
    """What the stiffening ratio is told of joints, gears and forces makes the
    generalised force."""
    system = loaded(dimension)
    multipliers = np.random.default_rng(8).normal(size=system.n_rows)
    probe, sid = random_state(system, 3), system.bodies[system.index("soft")].sid
    samples = Samples(
        probe.z[None],
        probe.v[None],
        probe.work.frame[None].copy(),
        probe.work.point[None].copy(),
        np.zeros((1, system.n_velocities)),
        multipliers[None],
        probe.work.force_scale[None].copy(),
    )
    loads = recorded_loads(
        EvaluatedForces(system, samples, np.array([probe.t])), "soft"
    )
    found = np.zeros(sid.nq)
    for node in sid.nodes:
        phi, psi = (
            part.m0 + np.einsum("lak,l->ak", part.first_order(sid.nq), STILL)
            for part in (node.phi, node.psi)
        )
        found += loads.forces[node.id][0] @ phi + loads.moments[node.id][0] @ psi
    silent = replace(system, arrays=system.arrays.replaced(force=NO_FORCES))
    row = system.arrays.body[system.index("soft")]
    elastic = slice(row[at.VEL] + row[at.RD], row[at.VEL] + row[at.NV])
    other = Probe(silent, probe.t, probe.z, probe.v)
    acting = probe.work.f[elastic] - other.work.f[elastic]
    acting += (multipliers @ dense_jacobian(system, probe.work.C))[elastic]
    assert found == pytest.approx(acting, rel=1e-9)


def test_a_marker_that_moves_by_second_order_alone_does_not_carry_the_frame() -> None:
    """Its Phi and Psi are zero at rest, their derivatives are not."""
    soft = soft_body(3, seed=5, stiffening=True)
    still = np.zeros((3, 3))
    first, *others = soft.nodes
    described = scene(
        {"soft": {"sid": "-"}},
        {"hold": {"type": "fixed", "markers": ["ground", "soft.1"]}},
    )
    rows = []
    for phi1, psi1 in ((None, None), (first.phi.m1, None), (None, first.psi.m1)):
        held = replace(first, phi=Taylor(still, phi1), psi=Taylor(still, psi1))
        body = replace(soft, nodes=(held, *others))
        rows.append(compiled(described, soft=body).n_rows)
    assert rows == [0, 3, 3]


def geared(dimension: str) -> System:
    """A gear and a screw between joints of a flexible body, at a start that fits."""
    plane = dimension == "planar"
    space = slice(2 if plane else 3)
    soft = soft_body(3, seed=5, planar=plane, stiffening=True, nodes=3)
    nodes = tuple(
        replace(node, psi=Taylor(0.0 * node.psi.m0, node.psi.m1), AP=Taylor(np.eye(3)))
        for node in soft.nodes
    )
    soft = replace(soft, nodes=nodes)
    places = [node.position[space] for node in nodes]
    along = np.array([1.0, 0.0] if plane else [0.0, 0.0, 1.0])
    inertia: Any = 0.2 if plane else [0.2, 0.3, 0.4]
    bodies: dict[str, Any] = {"soft": {"sid": "-"}}
    for name, place in (("wheel", places[1]), ("nut", places[2] + 0.3 * along)):
        bodies[name] = {
            "mass": 1.0,
            "inertia": inertia,
            "initial": {"position": place.tolist()},
        }
    screw = ["slide", "one"] if plane else ["slide", "slide"]
    described = scene(
        bodies,
        {
            "one": {"type": "revolute", "markers": ["ground.m", "soft.1"]},
            "two": {"type": "revolute", "markers": ["soft.2", "wheel"]},
            "slide": {
                "type": "prismatic" if plane else "cylindrical",
                "markers": ["soft.3", "nut"],
            },
            "gear": {"type": "gear", "joints": ["one", "two"], "ratio": -2},
            "screw": {
                "type": "coupling",
                "joints": screw,
                "coordinate": ["displacement", "angle"],
                "weights": [1.0, -0.4],
            },
        },
        dimension=dimension,
        ground={"markers": {"m": {"position": places[0].tolist()}}},
    )
    return compiled(described, soft=soft)


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_couplings_are_linearised(dimension: str) -> None:
    """Rows and forces of couplings by the elastic coordinates of a flexible body."""
    system, start = assemble(geared(dimension))
    rng = np.random.default_rng(2)
    v, acc = rng.normal(size=(2, system.n_velocities))
    lam = np.zeros(system.n_rows)
    rows = [r.first for r in system.rows if r.name in ("gear", "screw")]
    assert len(rows) == 2
    lam[rows] = rng.normal(size=2)
    probe = Probe(system, 0.0, start.z, v)
    row, work = system.arrays.body[system.index("soft")], probe.work
    elastic = np.arange(row[at.VEL] + row[at.RD], row[at.VEL] + row[at.NV])
    linearise(system, work, 0.0, start.z, v, acc, lam)
    Rp, Gp, Gv = probe.blocks(work.Rp), probe.rows(work.Gp), probe.rows(work.Gv)
    linearise(system, work, 0.0, start.z, v, acc, 0.0 * lam)
    Rp = Rp - probe.blocks(work.Rp)
    C = probe.jacobian
    for k in elastic:
        step = STEP * np.eye(system.n_velocities)[k]
        ends = []
        for sign in (1.0, -1.0):
            probe.evaluate(probe.moved(sign * step), v)
            values = work.row[rows, at.C_VALUE].copy()
            second = probe.unbalance(acc, lam)[1][rows]
            pull = -(probe.jacobian.T @ lam)[elastic]
            probe.evaluate(start.z, v + sign * step)
            by_rate = probe.unbalance(acc, lam)[1][rows]
            ends.append((values, second, by_rate, pull))
        slopes = [(a - b) / (2 * STEP) for a, b in zip(*ends, strict=True)]
        assert slopes[0] == pytest.approx(C[rows, k], abs=1e-8)
        assert slopes[1] == pytest.approx(Gp[rows, k], abs=1e-7)
        assert slopes[2] == pytest.approx(Gv[rows, k], abs=1e-7)
        assert slopes[3] == pytest.approx(Rp[elastic, k], abs=1e-8)
    assert np.abs(Rp[np.ix_(elastic, elastic)]).max() > 0.1


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_accelerations_of_markers_are_rates_of_their_velocities(dimension: str) -> None:
    system = loaded(dimension)
    probe = random_state(system, 9)
    acc = np.random.default_rng(1).normal(size=system.n_velocities)
    complete_accelerations(system, probe.work, acc)
    points = system.points(probe.work.point.copy())
    found = np.hstack([points["a"], points["al"]])
    ends = []
    for dt in (STEP, -STEP):
        slope = np.zeros(system.n_positions)
        rate(system.arrays, probe.z, probe.v, slope)
        probe.evaluate(probe.z + dt * slope, probe.v + dt * acc)
        points = system.points(probe.work.point)
        ends.append(np.hstack([points["v"], points["w"]]))
    slopes = (ends[0] - ends[1]) / (2 * STEP)
    assert slopes == pytest.approx(found, abs=2e-8, rel=1e-8)


def bending(sid: SID, seed: int) -> SID:
    """The SID with stiffening at its nodes alone: no work is lost in the body."""
    rng, nodes = np.random.default_rng(seed), []
    for node in sid.nodes:
        terms = []
        for shapes in (node.phi, node.psi):
            m1 = rng.normal(size=(sid.nq, 3, sid.nq))
            m1 = (m1 + np.swapaxes(m1, 0, 2)) * (np.abs(shapes.m0).max(1) > 0)[:, None]
            terms.append(Taylor(shapes.m0, m1))
        nodes.append(replace(node, phi=terms[0], psi=terms[1]))
    return replace(sid, nodes=tuple(nodes))


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_a_chain_of_flexible_bodies_keeps_its_energy(dimension: str) -> None:
    """Joints and springs at markers that stiffen do no work of their own."""
    plane = dimension == "planar"
    soft = {
        name: bending(soft_body(2, seed, plane, damped=False), seed)
        for name, seed in (("a", 2), ("b", 3))
    }
    bodies = {name: {"sid": "-", "quadratic_inertia": True} for name in soft}
    markers = ["a.2", "b.1"]
    coil = {"type": "spring_damper", "joint": "hub", "stiffness": 5.0}
    described = scene(
        bodies,
        {
            "hub": {"type": "revolute", "markers": ["ground", "a.1"]},
            "weld": {"type": "fixed", "markers": markers},
        },
        forces={"coil": coil},
        dimension=dimension,
        gravity=[0.4, -1.0] if plane else [0.4, -1.0, 0.3],
        record=["energy.balance", "energy.kinetic", "energy.elastic"],
        steps=40,
    )
    result = simulate(compiled(described, **soft), rtol=1e-9)
    assert result["energy.kinetic"].max() > 0.1
    assert result["energy.elastic"].max() > 0.1
    assert np.ptp(result["energy.balance"]) < 1e-6
