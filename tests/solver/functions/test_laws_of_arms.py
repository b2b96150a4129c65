"""Laws of flexible bodies and of arms: damping, energy, whole turns."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from sidtool.formats.scene import SceneFile
from sidtool.solver import (
    compile_scene,
    linearise,
    simulate,
)
from tests.solver.functions.loops import expression, pid, run
from tests.solver.scenes import scene, soft_body


@pytest.mark.parametrize("planar", [True, False])
def test_active_damping_of_elastic_coordinates(planar: bool) -> None:
    """A held body whose modes are damped by a force at one of its nodes."""
    nq, gain, push = 4, 30.0, 0.7
    sid = soft_body(nq, 5, planar, damped=False)
    node = sid.nodes[0]
    direction = np.array([0.6, 0.8, 0.0])
    force = list(direction if not planar else direction[:2])
    made = scene(
        {"arm": {"sid": "arm.sid", "frame": "held", "markers": {"tip": node.id}}},
        end=1.0,
        steps=10,
        record=["arm.q1", "arm.vq3", "energy.balance", "energy.elastic"],
        forces={
            "motor": {
                "type": "force",
                "marker": "arm.tip",
                "force": force,
                "function": expression(f"{push} - {gain}*arm.vq3 - 3*arm.q1"),
            }
        },
        dimension="planar" if planar else "spatial",
    )
    shape = direction @ node.phi.m0
    M, K = sid.Me.m0, sid.Ke.m0
    by_q, by_v = np.zeros(nq), np.zeros(nq)
    by_q[0], by_v[2] = -3.0, -gain
    inverse = np.linalg.inv(M)
    A = np.block(
        [
            [np.zeros((nq, nq)), np.eye(nq)],
            [
                inverse @ (np.outer(shape, by_q) - K),
                inverse @ np.outer(shape, by_v),
            ],
        ]
    )
    rest = np.linalg.solve(A, -np.concatenate([np.zeros(nq), push * inverse @ shape]))
    system = compile_scene(made, sids={"arm": sid})
    for method in ("radau5", "dop853"):
        found = simulate(system, integrator=method, rtol=1e-8)
        wanted = np.array([rest - expm(A * t) @ rest for t in found.t])[:, [0, nq + 2]]
        size = np.abs(wanted).max(axis=0)
        assert (np.abs(found.values[:, :2] - wanted) / size).max() < 1e-6
        assert np.ptp(found["energy.balance"]) < 1e-8 * found["energy.elastic"].max()
    kept = compile_scene(made, sids={"arm": sid}, keep_joints=True)
    eigenvalues = np.linalg.eigvals(A)
    eigenvalues = sorted(eigenvalues[eigenvalues.imag >= 0.0], key=abs)
    modes = linearise(kept).eigenvalues
    assert np.abs(modes - eigenvalues).max() < 1e-6 * np.abs(eigenvalues).max()


def double_pendulum(elbow: dict[str, Any], **more: Any) -> SceneFile:
    """Two links in space with a payload, driven in both joints."""

    def link(name: str, length: float, **initial: Any) -> dict[str, Any]:
        return {
            "mass": 1.0,
            "inertia": [0.02, 0.1, 0.1],
            "centre_of_mass": [0.5 * length, 0.0, 0.0],
            "markers": {"b": {"position": [length, 0.0, 0.0]}},
            "initial": initial,
        }

    return scene(
        {
            "upper": link("upper", 0.8),
            "lower": link("lower", 0.6, position=[0.8, 0.0, 0.0]),
            "payload": {
                "mass": 2.0,
                "inertia": [0.01, 0.01, 0.01],
                "initial": {"position": [1.4, 0.0, 0.0]},
            },
        },
        {
            "shoulder": {
                "type": "revolute",
                "markers": ["ground", "upper"],
                "axis": [0.0, 0.0, 1.0],
            },
            "elbow": {
                "type": "revolute",
                "markers": ["upper.b", "lower"],
                "axis": [0.0, 0.6, 0.8],
            },
            "grip": {"type": "fixed", "markers": ["lower.b", "payload"]},
        },
        end=1.0,
        steps=10,
        record=["payload.x", "payload.y", "payload.z", "energy.balance"],
        forces={
            "shoulder_motor": {
                "type": "actuator",
                "joint": "shoulder",
                "function": pid("shoulder.angle", reference=0.7, p=60.0, d=9.0),
            },
            "elbow_motor": elbow,
        },
        gravity=[0.0, -9.81, 0.0],
        dimension="spatial",
        **more,
    )


def test_an_arm_with_payload_under_pd_balances_its_energy() -> None:
    spring = {
        "type": "spring_damper",
        "joint": "elbow",
        "rest": -0.4,
        "stiffness": 80.0,
        "damping": 6.0,
    }
    motor = {
        "type": "actuator",
        "joint": "elbow",
        "function": expression("80*(-0.4 - elbow.angle) - 6*elbow.angle_rate"),
    }
    wanted = run(double_pendulum(spring), rtol=1e-9).values
    for method in ("radau9", "dop853"):
        found = run(double_pendulum(motor), integrator=method, rtol=1e-9).values
        assert np.abs(found[:, :3] - wanted[:, :3]).max() < 1e-7
        assert np.ptp(found[:, 3]) < 1e-5
    state = {"initial": {"state": "static"}}
    held = run(double_pendulum(motor, **state)).values
    same = run(double_pendulum(spring, **state)).values
    assert np.ptp(held[:, :3], axis=0).max() < 1e-7
    assert np.abs(held[0, :3] - same[0, :3]).max() < 1e-7
    modes = [
        linearise(compile_scene(double_pendulum(force), keep_joints=True)).eigenvalues
        for force in (spring, motor)
    ]
    assert np.abs(modes[0] - modes[1]).max() < 1e-5 * np.abs(modes[0]).max()


def test_angles_that_a_law_reads_go_on_over_many_turns() -> None:
    made = scene(
        {"wheel": {"mass": 1.0, "inertia": [0.3, 0.3, 0.3]}},
        {
            "axle": {
                "type": "revolute",
                "markers": ["ground", "wheel"],
                "axis": [0.0, 0.6, 0.8],
            }
        },
        end=3.0,
        steps=10,
        record=["axle.angle"],
        forces={
            "motor": {
                "type": "actuator",
                "joint": "axle",
                "function": expression("4*(40 - axle.angle) - 1.1*axle.angle_rate"),
            }
        },
        dimension="spatial",
    )
    A = np.array([[0.0, 1.0], [-4.0 / 0.3, -1.1 / 0.3]])
    found = run(made, rtol=1e-8)
    wanted = [40.0 - 40.0 * expm(A * t)[0, 0] for t in found.t]
    assert found.values[:, 0].max() > 6.0 * math.pi
    assert np.abs(found.values[:, 0] - wanted).max() < 1e-5
