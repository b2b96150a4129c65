"""Elastic forces of a first-order Ke: closed forms, energy, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import quad, trapezoid

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.formats.toml.reading import validate_data
from sidtool.solver import compile_scene, simulate
from sidtool.solver.analyses.linearisation import linearise
from sidtool.solver.analyses.static_equilibrium import static_equilibrium
from tests.bodies import particle_body

from ..scenes import soft_body, with_cubic_energy

DIMENSIONS = ["planar", "spatial"]
MASS, STIFFNESS, CUBIC = 1.7, 40.0, 55.0


def one_coordinate(dimension: str) -> SID:
    """One elastic coordinate: energy k q^2 / 2 + c q^3 / 3."""
    body = particle_body(1, 8, dimension == "planar", seed=3)
    change = np.sqrt(MASS)
    node = tuple(
        replace(n, phi=Taylor(n.phi.m0 * change), psi=Taylor(0 * n.psi.m0))
        for n in body.nodes
    )
    node = tuple(
        replace(n, origin=Taylor(n.origin.m0, n.phi.m0.T[:, :, None])) for n in node
    )
    return replace(
        body,
        nodes=node,
        Me=Taylor(MASS * body.Me.m0),
        Ke=Taylor(np.array([[STIFFNESS]]), np.array([[[CUBIC]]])),
        De=Taylor(np.zeros((1, 1))),
    )


def still_frame(sid: SID) -> SID:
    """With a node "0" at the frame, where nothing deforms."""
    origin = replace(
        sid.nodes[0],
        id="0",
        origin=Taylor(np.zeros((3, 1))),
        phi=Taylor(np.zeros((3, sid.nq))),
        psi=Taylor(np.zeros((3, sid.nq))),
        AP=Taylor(np.eye(3)),
    )
    return replace(sid, nodes=(origin, *sid.nodes))


def fixed(dimension: str, sid: SID, record: list[str], **more: Any) -> Any:
    """A compiled scene in which the frame of the body is fixed to the ground."""
    keep_joints = more.pop("keep_joints", False)
    joint = {"type": "fixed", "markers": ["ground", "soft.root"]}
    markers = {"root": "0", "a": "1", "b": "2"}
    body = {"sid": "-", "markers": markers, **more.pop("body", {})}
    data = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": dimension,
        "time": {"end": 3.0, "output_step": 0.05},
        "outputs": {"record": record},
        "bodies": {"soft": body},
        "joints": {"root": joint},
        **more,
    }
    scene, sids = validate_data(data, SceneFile), {"soft": still_frame(sid)}
    return compile_scene(scene, ".", sids, keep_joints=keep_joints)


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_a_static_load_bends_by_the_root_of_a_quadratic(dimension: str) -> None:
    """k q + c q^2 = phi . F, and about that omega^2 = (k + 2 c q) / m."""
    sid = one_coordinate(dimension)
    axes = 2 if dimension == "planar" else 3
    force = np.array([3.0, -4.0, 2.0])[:axes]
    work = float(sid.node(2).phi.m0[:axes, 0] @ force)
    push = {"type": "force", "marker": "soft.b", "force": list(force)}
    system = fixed(dimension, sid, ["soft.q1"], forces={"push": push}, keep_joints=True)
    rest = static_equilibrium(system).result()["soft.q1"][0]
    root = np.sqrt(STIFFNESS**2 + 4 * CUBIC * work)
    assert rest == pytest.approx((root - STIFFNESS) / (2 * CUBIC), rel=1e-8)
    assert abs(work * CUBIC / STIFFNESS**2) > 0.01
    omega = np.sqrt(root / MASS)
    assert linearise(system).frequencies[0] == pytest.approx(
        omega / (2 * np.pi), rel=1e-7
    )


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize("integrator", ["radau9", "generalised_alpha", "dop853"])
def test_the_period_of_a_free_vibration(dimension: str, integrator: str) -> None:
    """Half a period: int sqrt(m / (2 E - k q^2 - 2 c q^3 / 3)) dq between the ends."""
    start = 0.2
    energy = STIFFNESS * start**2 / 2 + CUBIC * start**3 / 3
    roots = np.roots([-2 * CUBIC / 3, -STIFFNESS, 0.0, 2 * energy]).real
    other, beyond = sorted(roots[np.abs(roots - start) > 1e-9], key=abs)
    middle, half = (start + other) / 2, (start - other) / 2

    def slowness(angle: float) -> float:
        q = middle + half * np.sin(angle)
        return float(np.sqrt(MASS / (2 * CUBIC / 3 * (q - beyond))))

    period = 2 * quad(slowness, -np.pi / 2, np.pi / 2, epsabs=1e-13)[0]
    linear = 2 * np.pi * np.sqrt(MASS / STIFFNESS)
    assert abs(period / linear - 1) > 0.01
    sid = one_coordinate(dimension)
    time = {"end": 4 * period, "output_times": [2.5 * period, 4 * period]}
    begin = {"initial": {"elastic": [start]}}
    system = fixed(dimension, sid, ["soft.q1"], body=begin, time=time)
    fine = {"generalised_alpha": 1e-7}.get(integrator, 1e-10)
    result = simulate(system, integrator=integrator, rtol=fine)
    tolerance = 2e-4 if integrator == "generalised_alpha" else 1e-7
    assert_allclose(result["soft.q1"], [other, start], atol=tolerance)


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_energy_of_a_free_body_is_kept(dimension: str) -> None:
    """Several coordinates, spinning; the elastic energy is the work of the force."""
    planar = dimension == "planar"
    plain = soft_body(3, seed=5, planar=planar, damped=False)
    sid = with_cubic_energy(plain, seed=2, size=4.0)
    start = {
        "elastic": [0.3, -0.2, 0.25],
        "velocity": [1.0, 0.0, 0.0][: 2 + (not planar)],
    }
    start["angular_velocity"] = 0.2 if planar else [0.2, -0.1, 0.15]
    data = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": dimension,
        "time": {"end": 2.0, "output_step": 0.1},
        "outputs": {"record": ["energy.kinetic", "energy.elastic", "soft.q*"]},
        "bodies": {"soft": {"sid": "-", "initial": start, "quadratic_inertia": True}},
    }
    scene = validate_data(data, SceneFile)
    ends = {}
    for name, body in (("cubic", sid), ("linear", plain)):
        system = compile_scene(scene, ".", {"soft": body})
        ends[name] = simulate(system, integrator="radau9", rtol=1e-10)
    total = ends["cubic"]["energy.kinetic"] + ends["cubic"]["energy.elastic"]
    assert_allclose(total, total[0], rtol=1e-7)
    q = np.stack([ends["cubic"][f"soft.q{i}"] for i in (1, 2, 3)], axis=1)
    work = [force_work(sid, row) for row in q]
    assert_allclose(ends["cubic"]["energy.elastic"], work, rtol=1e-9)
    last = [ends[name]["soft.q1"][-1] for name in ("cubic", "linear")]
    assert abs(last[0] - last[1]) > 1e-2


def force_work(sid: SID, q: np.ndarray) -> float:
    """Work of Ke(s q) s q on the way s = 0 to 1, by Gauss's rule, exact."""
    points, weights = np.polynomial.legendre.leggauss(3)
    ways = (points + 1) / 2
    return float(
        sum(
            w / 2 * q @ sid.Ke.at(s * q) @ (s * q)
            for s, w in zip(ways, weights, strict=True)
        )
    )


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_only_the_force_counts_not_how_m1_shares_it_out(dimension: str) -> None:
    """q_1 q_2 may stand in m1_1 or in m1_2: the same motion."""
    sid = with_cubic_energy(soft_body(3, 7, dimension == "planar"), seed=4, size=3.0)
    term = sid.Ke.m1
    moved = np.triu(np.ones((3, 3)), 1)[:, None, :] * np.swapaxes(term, 0, 2)
    shared = term + moved - np.swapaxes(moved, 0, 2)
    assert np.abs(shared - term).max() > 0.1
    other = replace(sid, Ke=Taylor(sid.Ke.m0, shared))
    begin = {"initial": {"elastic": [0.2, -0.3, 0.1]}}
    ends = [
        simulate(fixed(dimension, s, ["soft.q*"], body=begin), rtol=1e-9)["soft.q3"]
        for s in (sid, other)
    ]
    assert_allclose(ends[1], ends[0], atol=1e-9)


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_shares_of_the_energy_are_those_of_the_whole_energy(dimension: str) -> None:
    """Two coordinates apart, k q^2 / 2 + c q^3 / 3 each, that creep back to rest."""
    stiffness, cubic = np.array([40.0, 90.0]), np.array([55.0, -70.0])
    term = np.zeros((2, 2, 2))
    term[[0, 1], [0, 1], [0, 1]] = cubic
    sid = replace(
        particle_body(2, 8, dimension == "planar", seed=3),
        Ke=Taylor(np.diag(stiffness), term),
        De=Taylor(np.diag([40.0, 90.0])),
    )
    begin = {"initial": {"elastic": [0.4, 0.3]}}
    result = simulate(fixed(dimension, sid, ["soft.q*"], body=begin), rtol=1e-8)
    q = result.values
    energies = stiffness * q**2 / 2 + cubic * q**3 / 3
    whole = trapezoid(energies, result.t, axis=0)
    shares = result.bodies["soft"].energy_shares
    assert_allclose(shares, whole / whole.sum(), atol=2e-3)
    plain = trapezoid(stiffness * q**2, result.t, axis=0)
    assert np.abs(plain / plain.sum() - shares).max() > 0.05


@pytest.mark.parametrize("name", ["soft.SID_FEM", "soft.h5"])
def test_the_term_survives_a_file(tmp_path: Path, name: str) -> None:
    sid = with_cubic_energy(soft_body(3, 7), seed=4)
    write_sid(tmp_path / name, sid)
    term = read_sid(tmp_path / name).Ke.m1
    assert term is not None
    assert_allclose(term, sid.Ke.m1, rtol=1e-10)


def test_a_force_without_energy_is_refused() -> None:
    sid = soft_body(2, 1)
    term = np.zeros((2, 2, 2))
    term[1, 0, 0] = 1.0
    bad = replace(sid, Ke=Taylor(sid.Ke.m0, term))
    with pytest.raises(InputError, match=r"bodies\.soft\.sid: .*has no energy"):
        fixed("planar", bad, [])


@pytest.mark.parametrize("block", ["Me", "De", "ksigma"])
def test_terms_that_the_equations_lack_are_refused_by_name(block: str) -> None:
    sid = soft_body(2, 1)
    m0 = getattr(sid, block).m0
    there = replace(sid, **{block: Taylor(m0, np.zeros((2, *m0.shape)))})
    fixed("planar", there, [])
    bad = replace(sid, **{block: Taylor(m0, np.full((2, *m0.shape), 1e-3))})
    with pytest.raises(InputError, match=rf"{block} in - has a first-order term"):
        fixed("planar", bad, [])
    higher = replace(sid, **{block: Taylor(m0, None, np.full((1, *m0.shape), 1e-3))})
    with pytest.raises(InputError, match=rf"{block} in - has terms above the first"):
        fixed("planar", higher, [])
