"""Simeon's flexible slider-crank of the IVP test set, its matrices put into a SID.

Source: Mazzia, Magherini, "Test Set for Initial Value Problem Solvers", problem
"slider crank", after B. Simeon, "Modelling a flexible slider crank mechanism by a
mixed system of DAEs and PDEs". The published end values hold for the source's own
axial mass matrix, which is 15 times the physical one.

The source has a variant in which bending stretches the rod, of which it prints no end
values. Its elastic force is the gradient of
f (q1^2 q4 / 2 + 2 q2^2 q4 - g q1 q2 (2 q4 - 4 q3)) with f = pi^2 E b h / (2 l2^2) and
g = 80 / (9 pi^2): a first-order term of Ke. It is compared with an integration of the
source's own equations, by Dormand and Prince's method of order 8 at 1e-10, which for
the linear rod gives all published numbers: within 1e-12 in positions and 1e-9 in
velocities at 0.1 s. The tests integrate up to 0.01 s.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sidtool import solver
from sidtool.formats.base.sid import SID, Array, Node, Taylor, axis_major, block_shape
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile

PI = 3.1415927  # as in the source
M2, M3 = 0.151104, 0.075552
L1, L2 = 0.15, 0.30
J1, J2 = 0.002727, 0.0045339259
E, B, H, RHO = 2e11, 0.008, 0.008, 7870.0
SPEED = 150.0

F, FK, FB = RHO * B * H * L2, E * B * H / L2, B * H * L2
END = {
    "rod.angle": -0.3311734988256260,
    "piston.x": 0.1697373328427860,
    "rod.q1": 1.893192899613509e-4,
    "rod.q2": 2.375751249879174e-5,
    "rod.q3": -5.323896770569702e-6,
    "rod.q4": -8.363313279112129e-6,
    "rod.vq1": -3.005541400289738e-2,
    "rod.vq2": -5.500431812571696e-3,
    "rod.vq3": 4.974111734266989e-4,
    "rod.vq4": 1.105560003626645e-3,
}
#: The variant in which bending stretches the rod, computed as told above.
STRETCHED = {
    "rod.angle": -0.331173887628,
    "piston.x": 0.1697369739244,
    "rod.q1": -1.18076724219e-4,
    "rod.q2": 2.36514645626e-5,
    "rod.q3": -5.47502587e-6,
    "rod.q4": -8.70253671e-6,
    "rod.vq1": -0.492070786,
    "rod.vq2": -0.00674260577,
    "rod.vq3": -3.67798949e-4,
    "rod.vq4": -1.218730571e-3,
}
LAMBDA = (-62.32935833287916, -163.7920993367306, 25.29857947066878)


def matrices() -> dict[str, Array]:
    """Mq, Kq, Bq and the vectors c1, c2, c12, c21 of the source."""
    Mq = np.zeros((4, 4))
    Mq[:2, :2] = np.diag([0.5, 0.5])
    Mq[2:, 2:] = [[8.0, 1.0], [1.0, 2.0]]
    Kq = np.zeros((4, 4))
    slender = (H / L2) ** 2
    Kq[:2, :2] = np.diag([PI**4 / 24 * slender, 2 * PI**4 / 3 * slender])
    Kq[2:, 2:] = [[16 / 3, -8 / 3], [-8 / 3, 7 / 3]]
    Bq = np.zeros((4, 4))
    Bq[0, 2], Bq[0, 3] = -16 * FB / PI**3, FB * (8 / PI**3 - 1 / PI)
    Bq[1, 3] = FB / (2 * PI)
    return {
        "Mq": F * Mq,
        "Kq": FK * Kq,
        "Bq": Bq - Bq.T,
        "c1": FB * np.array([0.0, 0.0, 2 / 3, 1 / 6]),
        "c2": FB * np.array([2 / PI, 0.0, 0.0, 0.0]),
        "c12": L2 * FB * np.array([0.0, 0.0, 1 / 3, 1 / 6]),
        "c21": L2 * FB * np.array([1 / PI, -1 / (2 * PI), 0.0, 0.0]),
    }


def connecting_rod() -> SID:
    """The rod as a SID: a planar body with its frame at the crank pin."""
    m = matrices()
    nq = 4
    Ct = RHO * np.column_stack([m["c1"], m["c2"], np.zeros(nq)])
    Cr0, Cr1 = np.zeros((nq, 3)), np.zeros((nq, nq, 3))
    Cr0[:, 2] = RHO * m["c21"]
    Cr1[:, :, 2] = RHO * m["Bq"]  # [l, k]: row k of Cr changes with q_l
    J0, J1_ = np.zeros((6, 1)), np.zeros((nq, 6, 1))
    J0[1:3, 0] = J2
    J1_[:, 2, 0] = 2 * RHO * m["c12"]
    Oe0, Oe1 = np.zeros((nq, 6)), np.zeros((nq, nq, 6))
    Oe0[:, 2] = -RHO * m["c12"]
    Oe1[:, :, 2] = -m["Mq"]
    Ge = np.zeros((nq, nq, 3))  # [l, k]
    Ge[:, :, 2] = 2 * RHO * m["Bq"]
    Gr = np.zeros((nq, 3, 3))
    Gr[:, 2, 2] = J1_[:, 2, 0]
    center = M2 * L2 / 2
    blocks = {
        "mdCM": Taylor(np.array([[center], [0.0], [0.0]]), Ct[:, :, None]),
        "J": Taylor(J0, J1_),
        "Ct": Taylor(Ct),
        "Cr": Taylor(Cr0, Cr1),
        "Me": Taylor(m["Mq"]),
        "Gr": Taylor(axis_major(Gr)),
        "Ge": Taylor(axis_major(Ge)),
        "Oe": Taylor(Oe0, Oe1),
        "ksigma": Taylor(np.zeros(block_shape("ksigma", nq))),
        "Ke": Taylor(m["Kq"]),
        "De": Taylor(np.zeros((nq, nq))),
    }
    tip = np.zeros((3, nq))
    tip[0, 3] = 1.0
    nodes = (_node("1", 0.0, np.zeros((3, nq))), _node("2", L2, tip))
    return SID(mass=M2, labels=("bending",) * 2 + ("axial",) * 2, nodes=nodes, **blocks)


def _node(name: str, x: float, phi: Array) -> Node:
    origin = Taylor(np.array([[x], [0.0], [0.0]]), phi.T[:, :, None])
    psi, frame = np.zeros_like(phi), np.eye(3)
    return Node(name, origin, Taylor(phi), Taylor(psi), Taylor(frame))


def scene(quadratic_inertia: bool, until: float = 0.1) -> SceneFile:
    q = (0.0, 0.0, 1.03339863e-5, 1.69327969e-5)
    qd = (
        0.444896112581599,
        4.63433931923867e-3,
        -1.78591076000055e-6,
        -2.68938671997904e-6,
    )
    crank = {
        "mass": 0.36,
        "inertia": J1,
        "markers": {"pin": {"position": [L1, 0.0]}},
    }
    rod = {
        "sid": "given",
        "markers": {"pin": 1, "tip": 2},
        "quadratic_inertia": quadratic_inertia,
        "initial": {
            "position": [L1, 0.0],
            "velocity": [0.0, SPEED * L1],
            "angular_velocity": -74.99576703969453,
            "elastic": q,
            "elastic_velocity": qd,
        },
    }
    piston = {
        "mass": M3,
        "initial": {"position": [0.450016933, 0.0], "velocity": [qd[3], 0.0]},
    }
    steady = {"from": 0.0, "coefficients": [0.0, SPEED]}
    drive = {"type": "polynomial", "pieces": [steady]}
    data = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "time": {"end": until, "output_times": [until]},
        "bodies": {"crank": crank, "rod": rod, "piston": piston},
        "joints": {
            "bearing": {"type": "revolute", "markers": ["ground", "crank"]},
            "pin": {"type": "revolute", "markers": ["crank.pin", "rod.pin"]},
            "tip": {"type": "revolute", "markers": ["piston", "rod.tip"]},
            "guide": {"type": "point_on_line", "markers": ["ground", "piston"]},
        },
        "drives": {"turn": {"joint": "bearing", "function": drive}},
        "outputs": {"record": [*END, "guide.f1", "tip.f1", "turn.f1"]},
    }
    return SceneFile.model_validate(data)


def run(
    quadratic_inertia: bool,
    rtol: float = 1e-11,
    rod: SID | None = None,
    until: float = 0.1,
) -> Result:
    system = solver.compile_scene(
        scene(quadratic_inertia, until),
        ".",
        {"rod": rod or connecting_rod()},
        accept_defects=True,
    )
    return solver.simulate(system, integrator="radau9", rtol=rtol)


@pytest.fixture(scope="module")
def published_model() -> Result:
    return run(quadratic_inertia=True)


def end(result: Result, name: str) -> float:
    return float(result[name][-1])


@pytest.mark.parametrize("name", ["rod.q1", "rod.q2", "rod.q3", "rod.q4"])
def test_elastic_coordinates_as_published(published_model: Result, name: str) -> None:
    assert end(published_model, name) == pytest.approx(END[name], abs=1e-9)
    assert end(published_model, name) == pytest.approx(END[name], rel=1e-6)


def test_place_as_published(published_model: Result) -> None:
    """The published piston carries the rounding of its start, 2e-10 m."""
    angle = end(published_model, "rod.angle")
    assert angle == pytest.approx(END["rod.angle"], abs=1e-9)
    assert end(published_model, "piston.x") == pytest.approx(END["piston.x"], abs=1e-9)


@pytest.mark.parametrize("name", ["rod.vq1", "rod.vq2", "rod.vq3", "rod.vq4"])
def test_elastic_velocities_as_published(published_model: Result, name: str) -> None:
    assert end(published_model, name) == pytest.approx(END[name], abs=1e-7)


def test_multipliers_as_published(published_model: Result) -> None:
    """Forces of the guide (y) and at the tip (x), and the torque of the drive."""
    names = ("guide.f1", "tip.f1", "turn.f1")
    measured = np.abs([end(published_model, name) for name in names])
    assert measured == pytest.approx(np.abs(LAMBDA), rel=1e-8)


def test_inertia_of_first_order_changes_the_final_state() -> None:
    result = run(quadratic_inertia=False)
    assert end(result, "rod.q1") == pytest.approx(1.8931927069550e-4, abs=1e-12)
    lam = np.abs([end(result, name) for name in ("guide.f1", "tip.f1", "turn.f1")])
    expected = (62.329458398, 163.79203010, 25.298561630)
    assert lam == pytest.approx(expected, rel=1e-8)


def stretching_energy() -> Array:
    """(4, 4, 4) K1 with the elastic force K1_kil q_i q_l, the same for all orders."""
    f, g = 0.5 * E * B * H / L2**2 * PI**2, 80.0 / (PI**2 * 9.0)
    energy = {(0, 0, 3): 0.5, (1, 1, 3): 2.0, (0, 1, 3): -2.0 * g, (0, 1, 2): 4.0 * g}
    term = np.zeros((4, 4, 4))
    for indices, weight in energy.items():
        orders = set(permutations(indices))
        for order in orders:
            term[order] = 3.0 * f * weight / len(orders)
    return term


def source_equations(nonlinear: bool, until: float) -> tuple[Array, Array]:
    """Positions (phi1, phi2, x3, q) and velocities by the source's own equations.

    M a + G^T lambda = F with the constraints differentiated twice, by Dormand-Prince.
    """
    m = matrices()
    Mq, Kq, Bq = m["Mq"], m["Kq"], m["Bq"]
    c1, c2, c12, c21 = (RHO * m[name] for name in ("c1", "c2", "c12", "c21"))
    f, g = 0.5 * E * B * H / L2**2 * PI**2, 80.0 / (PI**2 * 9.0)

    def rates(_: float, y: Array) -> Array:
        p, v = y[:7], y[7:]
        q, qd, w1, w2 = p[3:], v[3:], v[0], v[1]
        S, C = np.sin(p[0] - p[1]), np.cos(p[0] - p[1])
        along, across = C * c1 + S * c2, -S * c1 + C * c2
        M, F, G = np.zeros((7, 7)), np.zeros(7), np.zeros((3, 7))
        M[0, 0], M[1, 1] = J1 + M2 * L1**2, J2 + 2 * c12 @ q + q @ Mq @ q
        M[0, 1] = M[1, 0] = 0.5 * L1 * L2 * M2 * C + L1 * (S * c2 + C * c1) @ q
        M[2, 2], M[3:, 3:] = M3, Mq
        M[0, 3:] = M[3:, 0] = L1 * across
        M[1, 3:] = M[3:, 1] = c21 + RHO * Bq.T @ q
        F[0] = -0.5 * L1 * L2 * M2 * w2**2 * S
        F[0] += L1 * w2**2 * across @ q - 2 * L1 * w2 * along @ qd
        F[1] = 0.5 * L1 * L2 * M2 * w1**2 * S - L1 * w1**2 * across @ q
        F[1] -= 2 * w2 * c12 @ qd + 2 * w2 * qd @ Mq @ q
        F[1] -= RHO * qd @ Bq @ qd
        F[3:] = w2**2 * (Mq @ q + c12) + L1 * w1**2 * along
        F[3:] += 2 * RHO * w2 * Bq @ qd - Kq @ q
        if nonlinear:
            stretch = 2 * q[3] - 4 * q[2]
            F[3] -= f * (q[0] * q[3] - g * q[1] * stretch)
            F[4] -= f * (4 * q[1] * q[3] - g * q[0] * stretch)
            F[5] -= f * 4 * g * q[0] * q[1]
            F[6] -= f * (0.5 * q[0] ** 2 + 2 * q[1] ** 2 - 2 * g * q[0] * q[1])
        length, s, c = L2 + q[3], np.sin(p[1]), np.cos(p[1])
        G[0, [0, 1, 6]] = L1 * np.cos(p[0]), length * c, s
        G[1, [0, 1, 2, 6]] = L1 * np.sin(p[0]), length * s, 1.0, -c
        G[2, 0] = 1.0
        bias = np.zeros(3)
        bias[0] = L1 * np.sin(p[0]) * w1**2 + length * s * w2**2 - 2 * c * w2 * qd[3]
        bias[1] = -L1 * np.cos(p[0]) * w1**2 - length * c * w2**2 - 2 * s * w2 * qd[3]
        matrix = np.block([[M, G.T], [G, np.zeros((3, 3))]])
        return np.append(v, np.linalg.solve(matrix, np.append(F, bias))[:7])

    start = np.array([0.0, 0.0, L1 + L2, 0.0, 0.0, 1.03339863e-5, 1.69327969e-5])
    start[2] += start[6]  # the published piston is 2e-10 m beside this
    speeds = [SPEED, -74.99576703969453, -2.68938671997904e-6, 0.444896112581599]
    speeds += [4.63433931923867e-3, -1.78591076000055e-6, -2.68938671997904e-6]
    y = np.append(start, speeds)
    end = solve_ivp(rates, (0.0, until), y, "DOP853", rtol=1e-10, atol=1e-13).y[:, -1]
    return end[:7], end[7:]


NAMES = ["rod.angle", "piston.x", *(f"rod.q{i}" for i in range(1, 5))]


@pytest.fixture(scope="module")
def stretching_rod() -> SID:
    rod = connecting_rod()
    return replace(rod, Ke=Taylor(rod.Ke.m0, stretching_energy()))


@pytest.mark.parametrize("nonlinear", [False, True])
def test_both_variants_follow_the_equations_of_the_source(
    nonlinear: bool, stretching_rod: SID
) -> None:
    rod = stretching_rod if nonlinear else connecting_rod()
    result = run(True, rod=rod, until=0.004)
    positions, speeds = source_equations(nonlinear, until=0.004)
    for value, name in zip(positions[1:], NAMES, strict=True):
        assert end(result, name) == pytest.approx(value, abs=1e-11)
    for i, value in enumerate(speeds[3:], 1):
        assert end(result, f"rod.vq{i}") == pytest.approx(value, abs=1e-7)


def test_bending_that_stretches_the_rod(stretching_rod: SID) -> None:
    """The nonlinear variant at 0.1 s, where q1 has the other sign."""
    result = run(True, rod=stretching_rod)
    for name, value in STRETCHED.items():
        tolerance = 1e-7 if ".v" in name else 1e-10
        assert end(result, name) == pytest.approx(value, abs=tolerance)
    assert abs(STRETCHED["rod.q1"] / END["rod.q1"] + 0.62) < 0.01


def test_m1_may_share_the_force_out_otherwise(stretching_rod: SID) -> None:
    """All that holds q4 in rows 1 and 2 in m1_4, where Ke changes with the stretch."""
    term = np.array(stretching_rod.Ke.m1)
    for row, bending, axial in ((0, 0, 3), (1, 1, 3), (0, 1, 2), (0, 1, 3)):
        term[axial, row, bending] += term[bending, row, axial]
        term[bending, row, axial] = 0.0
    assert np.abs(term - stretching_rod.Ke.m1).max() > 1e6
    other = replace(stretching_rod, Ke=Taylor(stretching_rod.Ke.m0, term))
    ends = [run(True, rod=rod, until=0.01) for rod in (stretching_rod, other)]
    for name in NAMES:
        assert end(ends[1], name) == pytest.approx(end(ends[0], name), abs=1e-11)
