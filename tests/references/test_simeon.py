"""Simeon's flexible slider-crank of the IVP test set, its matrices put into a SID.

Source: Mazzia, Magherini, "Test Set for Initial Value Problem Solvers", problem
"slider crank", after B. Simeon, "Modelling a flexible slider crank mechanism by a
mixed system of DAEs and PDEs". The published end values hold for the source's own
axial mass matrix, which is 15 times the physical one.
"""

from __future__ import annotations

import numpy as np
import pytest

import solver
from formats.result import Result
from formats.scene import SceneFile
from formats.sid import SID, Array, Node, Taylor, axis_major, block_shape

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


def scene(quadratic_inertia: bool) -> SceneFile:
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
        "time": {"end": 0.1, "output_times": [0.1]},
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


def run(quadratic_inertia: bool, rtol: float = 1e-11) -> Result:
    system = solver.compile_scene(
        scene(quadratic_inertia), ".", {"rod": connecting_rod()}, accept_defects=True
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


def test_inertia_of_first_order_ends_elsewhere() -> None:
    result = run(quadratic_inertia=False)
    assert end(result, "rod.q1") == pytest.approx(1.8931927069550e-4, abs=1e-12)
    lam = np.abs([end(result, name) for name in ("guide.f1", "tip.f1", "turn.f1")])
    expected = (62.329458398, 163.79203010, 25.298561630)
    assert lam == pytest.approx(expected, rel=1e-8)
