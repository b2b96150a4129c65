"""The same force said in several ways, and forces of what is measured far away."""

from __future__ import annotations

import itertools
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import SceneFile
from sidtool.solver import Law, compile_scene, simulate
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.solver.system.system import System
from tests.solver.functions.loops import GIVEN, METHODS, expression, pid, run
from tests.solver.scenes import scene, slender_rod


def pendulum(force: dict[str, Any], **more: Any) -> SceneFile:
    return scene(
        {"rod": slender_rod(1.3, 2.1, angle=0.4)},
        {"hinge": {"type": "revolute", "markers": ["ground", "rod.a"]}},
        end=1.5,
        steps=10,
        record=["hinge.angle", "hinge.angle_rate", "motor.mz", "energy.kinetic"],
        forces={"motor": force},
        gravity=[0.0, -9.81],
        **more,
    )


def compilable(t: float, y: Array) -> float:
    return -47.0 * y[0] - 2.7 * y[1]


SPRING = {"type": "spring_damper", "joint": "hinge", "stiffness": 47, "damping": 2.7}
READS = ["hinge.angle", "hinge.angle_rate"]
SAID: dict[str, tuple[Any, Law | None]] = {
    "formula": (expression("-47*hinge.angle - 2.7*hinge.angle_rate"), None),
    "terms": (
        expression(
            "-(m + drag)",
            terms={"drag": "2.7*hinge.angle_rate", "m": "47*a", "a": "hinge.angle"},
        ),
        None,
    ),
    "gains": (pid("hinge.angle", p=47.0, d=2.7), None),
    "compiled": (GIVEN, Law(compilable, READS)),
    "uncompiled": (GIVEN, Law(lambda t, y: float({0: compilable(t, y)}[0]), READS)),
    "derivatives": (GIVEN, Law(compilable, READS, lambda t, y: (-47.0, -2.7))),
    "no derivatives": (GIVEN, Law(compilable, READS, lambda t, y: np.zeros(2))),
}


@cache
def sprung(name: str) -> System:
    """Compiled once, as numba takes long for callables."""
    function, law = SAID[name]
    force = {"type": "actuator", "joint": "hinge", "function": function}
    return compile_scene(pendulum(force), forces={"motor": law} if law else {})


@pytest.mark.parametrize("method", METHODS)
def test_a_spring_is_a_spring_however_it_is_said(method: str) -> None:
    tolerance = 1e-5 if INTEGRATORS[method].order == 2 else 1e-8
    wanted = run(pendulum(SPRING), integrator=method, rtol=tolerance).values
    for name in SAID:
        found = simulate(sprung(name), integrator=method, rtol=tolerance).values
        size = np.abs(wanted).max(axis=0)
        assert (np.abs(found - wanted) / size).max() < 60 * tolerance, name


def test_callables_are_compiled_where_they_can_be() -> None:
    for name, wanted in {"compiled": True, "uncompiled": False}.items():
        natives = sprung(name).natives
        assert [native.compiled_function for native in natives] == [wanted]


def _steps(name: str) -> tuple[int, int]:
    counters = simulate(sprung(name), integrator="radau5", rtol=1e-7).counters
    return int(counters["newton_iterations"]), int(counters["jacobians"])


def test_newtons_matrix_holds_what_a_law_reads() -> None:
    known, _ = _steps("compiled")
    given, _ = _steps("derivatives")
    missing, _ = _steps("no derivatives")
    assert known == given < missing


def three_masses(function: dict[str, Any], spatial: bool, kind: str) -> SceneFile:
    """Masses on one line between springs; a force on the first reads the others."""
    axis = [1.0, 0.0, 0.0][: 3 if spatial else 2]
    names = ("a", "b", "c")
    bodies = {
        name: {
            "mass": mass,
            "initial": {"position": [float(k), *axis[1:]]},
        }
        for k, (name, mass) in enumerate(zip(names, (1.0, 2.0, 0.7), strict=True))
    }
    joints = {
        f"rail_{name}": {
            "type": "prismatic",
            "markers": ["ground", name],
            "axis": axis,
        }
        for name in names
    }
    forces: dict[str, Any] = {
        f"spring_{first}{second}": {
            "type": "spring_damper",
            "markers": [first, second],
            "rest": 1.0,
            "stiffness": 90.0,
            "damping": 0.4,
        }
        for first, second in itertools.pairwise(names)
    }
    forces["motor"] = {"type": "actuator", "joint": "rail_a", "function": function}
    if kind == "force":
        forces["motor"] = {
            "type": "force",
            "marker": "a",
            "force": axis,
            "function": function,
        }
    return scene(
        bodies,
        joints,
        end=2.0,
        steps=16,
        record=["a.x", "b.x", "c.x"],
        forces=forces,
        dimension="spatial" if spatial else "planar",
    )


def three_exact(times: Array, p: float, d: float) -> Array:
    """Positions of a, b, c with u = p (0.3 - (c - 2)) - d b' on the first."""
    m, k, c = np.array([1.0, 2.0, 0.7]), 90.0, 0.4
    laplace = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    K, D = k * laplace, c * laplace
    K[0, 2] += p
    D[0, 1] += d
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-K / m[:, None], -D / m[:, None]]])
    rest = np.linalg.solve(A, -np.array([0, 0, 0, 0.3 * p / m[0], 0, 0]))
    return np.array([(rest - expm(A * t) @ rest)[:3] + [0.0, 1.0, 2.0] for t in times])


@pytest.mark.parametrize("kind", ["actuator", "force"])
@pytest.mark.parametrize("spatial", [False, True])
def test_a_force_of_far_outputs_is_exact(spatial: bool, kind: str) -> None:
    made = three_masses(expression("20*(2.3 - c.x) - 3*b.vx"), spatial, kind)
    for method in ("radau5", "radau9", "dop853"):
        found = run(made, integrator=method, rtol=1e-8)
        wanted = three_exact(found.t, 20.0, 3.0)
        assert np.abs(found.values - wanted).max() < 3e-7, method


@pytest.mark.parametrize(("spatial", "kind"), [(False, "force"), (True, "actuator")])
def test_the_coupling_to_far_bodies_is_in_newtons_matrix(
    spatial: bool, kind: str
) -> None:
    made = three_masses(GIVEN, spatial, kind)
    """The first mass follows the second one stiffly, which does not feel it."""
    reads = ["b.x", "b.vx", "a.x", "a.vx"]

    def stiff(t: float, y: Array) -> float:
        return 3e4 * (y[0] - 0.9 - y[2]) + 3e2 * (y[1] - y[3])

    def nothing(t: float, y: Array) -> tuple[float, float, float, float]:
        return (0.0, 0.0, 0.0, 0.0)

    known = run(made, {"motor": Law(stiff, reads)}, integrator="radau5", rtol=1e-6)
    blind = Law(stiff, reads, nothing)
    unknown = run(made, {"motor": blind}, integrator="radau5", rtol=1e-6)
    size = np.ptp(known.values, axis=0).max()
    assert np.abs(known.values - unknown.values).max() < 3e-4 * size
    steps, iterations = (
        known.counters["steps"],
        known.counters["newton_iterations"],
    )
    assert iterations < 4.0 * steps
    assert unknown.counters["newton_iterations"] > 3.0 * iterations
