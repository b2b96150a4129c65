"""The kernels against themselves: rates are rates, Jacobians are Jacobians.

Scenes hold every joint four times: on a prescribed frame, between two bodies, on a
point mass, and on the ground; one body is flexible with every optional term, and forces
and moments at its markers stiffen it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from sidtool.formats.base.sid import SID, Array, Taylor
from sidtool.solver.spatial import system_arrays as at
from sidtool.solver.spatial.coordinates import rate
from sidtool.solver.system.joints import PLANAR, SPATIAL, JointPrimitives, Primitive
from sidtool.solver.system.system import System
from sidtool.solver.system.work_arrays import linearise
from tests.solver.scenes import (
    Probe,
    compiled,
    polynomial,
    scene,
    soft_body,
    with_cubic_energy,
)

#: Joints whose constraint force on one body does not turn with another body.
FORCES_OF_ONE_BODY = {
    "planar": ("revolute", "coincident", "fixed"),
    "spatial": ("coincident", "spherical"),
}
#: Spatial joints that do not take a direction from a flexible marker.
NOT_TURNING = ("coincident", "spherical", "distance")
#: Without the screw: coupled angles have a derivative only where their axis is held.
JOINTS = {"planar": sorted(PLANAR), "spatial": sorted({*SPATIAL} - {"screw"})}
#: Primitives that no joint is made of, with their numbers.
ALONE: dict[str, Primitive] = {}
STEP = 1e-5
#: Elastic coordinates at which the markers of `not_turning` stand still.
STILL = np.array([0.3, -0.2, 0.25])
#: Joints that hold angles, which a point mass has not; drives hold those of the others.
HOLDING_ANGLES = {
    "planar": ("prismatic",),
    "spatial": ("prismatic", "revolute", "cylindrical", "universal", "planar"),
}


def network(
    dimension: str, kind: str, driven: bool = False, linear: bool = False
) -> System:
    """The scene; `linear` leaves out what spatial Jacobians are not made for."""
    planar = dimension == "planar"
    space = slice(2 if planar else 3)
    turned = {"angle": 0.4} if planar else {"axis_angle": [0.4, -0.3, 0.2]}
    markers = {
        "m": {"position": [0.3, -0.2, 0.1][space], **turned},
        "n": {"position": [-0.5, 0.1, 0.2][space]},
    }
    bodies: dict[str, Any] = {
        "crank": {
            "mass": 1.0,
            "inertia": 0.1 if planar else [0.1, 0.1, 0.1],
            "markers": markers,
        },
        "soft": {"sid": "-", "quadratic_inertia": True},
        "block": {
            "mass": 2.0,
            "inertia": 0.3 if planar else [0.3, 0.4, 0.2],
            "centre_of_mass": [0.2, 0.4, -0.1][space],
            "markers": markers,
        },
        "point": {"mass": 0.7},
    }
    if kind in HOLDING_ANGLES[dimension][: 1 if driven else None]:
        bodies["point"]["inertia"] = 0.2 if planar else [0.2, 0.3, 0.1]
    ends = [
        ["crank.m", "soft.1"],
        ["soft.2", "block.m"],
        ["block.n", "point"],
        ["ground.m", "soft.2"],
    ]
    shape: dict[str, Any] = {"type": "coincident" if kind in ALONE else kind}
    if kind in ("prismatic", "point_on_line"):
        shape["axis"] = [0.6, -0.8, 0.3][space]
    joints = {f"joint{i}": {**shape, "markers": m} for i, m in enumerate(ends)}
    joints["bearing"] = {"type": "revolute", "markers": ["ground", "crank"]}
    drives = {"turn": {"joint": "bearing", "function": polynomial(0.3, 2.0, 1.5)}}
    if driven:
        function = polynomial(1.0, 0.7, -0.4, 0.9)
        drives |= {
            f"drive{i}": {"joint": f"joint{i}", "function": function}
            for i in range(len(ends))
            if kind == "prismatic" or ends[i][1] != "point"
        }
    described = scene(
        bodies,
        joints,
        drives,
        dimension=dimension,
        gravity=[1.0, -9.81, 2.0][space],
        ground={"markers": {"m": {"position": [1.0, 0.5, 0.2][space], **turned}}},
    )
    soft = soft_body(3, seed=4, planar=planar, stiffening=True)
    soft = with_cubic_energy(soft, seed=6)
    if linear and not planar and kind not in NOT_TURNING:
        soft = not_turning(soft)
    table, own = PLANAR if planar else SPATIAL, {}
    if kind in ALONE:
        own["coincident"] = lambda joint, axis: JointPrimitives([ALONE[kind]])
    with patch.dict(table, own):
        return compiled(described, soft=soft)


def not_turning(sid: SID) -> SID:
    """Markers that are turned at q = STILL; Psi is zero there, its derivative not."""
    nodes = []
    for node in sid.nodes:
        slope = np.einsum("lak,l->ak", node.psi.first_order(sid.nq), STILL)
        nodes.append(replace(node, psi=Taylor(-slope, node.psi.m1)))
    return replace(sid, nodes=tuple(nodes))


def random_state(system: System, seed: int) -> Probe:
    rng = np.random.default_rng(seed)
    z = rng.normal(size=system.n_positions)
    for row in system.arrays.body:
        if row[at.NQ]:
            z[row[at.POS] + row[at.NP] - row[at.NQ] : row[at.POS] + row[at.NP]] = STILL
        if row[at.NP] - row[at.NQ] == 7:
            turn = slice(row[at.POS] + 3, row[at.POS] + 7)
            z[turn] /= np.linalg.norm(z[turn])
    v = rng.normal(size=system.n_velocities)
    return Probe(system, 0.4, z, v)


CASES = [(d, kind, False) for d, kinds in JOINTS.items() for kind in kinds]
CASES += [(d, kind, False) for d in JOINTS for kind in ALONE]
CASES += [(d, kind, True) for d in JOINTS for kind in ("revolute", "prismatic")]


@pytest.mark.parametrize(("dimension", "kind", "driven"), CASES)
def test_constraints_are_differentiated_twice(
    dimension: str, kind: str, driven: bool
) -> None:
    """dc/dt and C z_II' - gamma are the time derivatives of c along a motion."""
    system = network(dimension, kind, driven)
    probe = random_state(system, 1)
    acceleration = np.random.default_rng(2).normal(size=system.n_velocities)
    rates = probe.work.row[:, at.C_RATE].copy()
    _, second = probe.unbalance(acceleration, np.zeros(system.n_rows))
    turn = np.zeros(system.n_positions)
    rate(system.arrays, probe.z, probe.v, turn)
    found = []
    for sign in (-1.0, 1.0):
        probe.t = 0.4 + sign * STEP
        z = _along_motion(system, probe, sign * STEP, acceleration)
        probe.evaluate(z, probe.v + sign * STEP * acceleration)
        found.append(probe.work.row[:, [at.C_VALUE, at.C_RATE]].copy())
    slopes = (found[1] - found[0]) / (2 * STEP)
    assert slopes[:, 0] == pytest.approx(rates, abs=2e-8)
    assert slopes[:, 1] == pytest.approx(second, abs=2e-7)


def _along_motion(
    system: System, probe: Probe, dt: float, acceleration: Array
) -> Array:
    """z_I after dt, to second order, by the midpoint rule."""
    half, whole = np.zeros((2, system.n_positions))
    rate(system.arrays, probe.z, probe.v, half)
    middle = probe.z + 0.5 * dt * half
    rate(system.arrays, middle, probe.v + 0.5 * dt * acceleration, whole)
    return probe.z + dt * whole


@pytest.mark.parametrize(("dimension", "kind", "driven"), CASES)
def test_constraint_jacobian_is_the_derivative_of_the_constraints(
    dimension: str, kind: str, driven: bool
) -> None:
    system = network(dimension, kind, driven)
    probe = random_state(system, 3)
    expected = probe.jacobian
    for k in range(system.n_velocities):
        step = np.zeros(system.n_velocities)
        step[k] = STEP
        values = []
        for sign in (1.0, -1.0):
            probe.evaluate(probe.moved(sign * step), probe.v)
            values.append(probe.work.row[:, at.C_VALUE].copy())
        assert (values[0] - values[1]) / (2 * STEP) == pytest.approx(
            expected[:, k], abs=1e-8
        )


@pytest.mark.parametrize(("dimension", "kind", "driven"), CASES)
def test_linearisation_is_the_derivative_of_the_equations(
    dimension: str, kind: str, driven: bool
) -> None:
    """Gp, Gv, Rv in full; Rp but for what a body changes in the force on another.

    In space, but for markers that turn with their body's deformation, whence the state
    where it only begins to turn them.
    """
    system = network(dimension, kind, driven, linear=True)
    probe = random_state(system, 5)
    rng = np.random.default_rng(6)
    acceleration = rng.normal(size=system.n_velocities)
    multipliers = rng.normal(size=system.n_rows)
    linearise(system, probe.work, probe.t, probe.z, probe.v, acceleration, multipliers)
    work = probe.work
    Rp, Rv = probe.blocks(work.Rp), probe.blocks(work.Rv)
    Gp, Gv = probe.rows(work.Gp), probe.rows(work.Gv)
    dp, dv = _differences(system, probe, acceleration, multipliers)
    own = probe.same_body
    assert dv[1] == pytest.approx(Gv, rel=1e-8, abs=1e-7)
    assert dp[1] == pytest.approx(Gp, rel=1e-8, abs=1e-7)
    assert dv[0] == pytest.approx(Rv, rel=1e-8, abs=1e-7)
    assert dp[0][own] == pytest.approx(Rp[own], rel=1e-8, abs=1e-7)
    if kind in FORCES_OF_ONE_BODY[dimension]:
        assert dp[0] == pytest.approx(Rp, rel=1e-8, abs=1e-7)


def _differences(
    system: System, probe: Probe, acceleration: Array, multipliers: Array
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Central differences of both equations by positions and by velocities."""
    n, m = system.n_velocities, system.n_rows
    by_position = np.zeros((n, n)), np.zeros((m, n))
    by_velocity = np.zeros((n, n)), np.zeros((m, n))
    for k in range(n):
        step = np.zeros(n)
        step[k] = STEP
        for sign in (1.0, -1.0):
            probe.evaluate(probe.moved(sign * step), probe.v)
            for total, part in zip(
                by_position, probe.unbalance(acceleration, multipliers), strict=True
            ):
                total[:, k] += sign * part / (2 * STEP)
            probe.evaluate(probe.z, probe.v + sign * step)
            for total, part in zip(
                by_velocity, probe.unbalance(acceleration, multipliers), strict=True
            ):
                total[:, k] += sign * part / (2 * STEP)
    return by_position, by_velocity
