"""Forces that see the motion: formulas, controllers and callables of a program."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from sidtool.formats.errors import InputError
from sidtool.formats.result import Result
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import Array
from sidtool.solver import (
    Law,
    compile_scene,
    linearise,
    simulate,
    static_equilibrium,
)
from sidtool.solver.errors import SimulationError
from sidtool.solver.integrators import INTEGRATORS
from tests.solver.scenes import scene, slender_rod, soft_body

METHODS = tuple(INTEGRATORS)
GIVEN = {"type": "callable"}


def expression(value: str, **more: Any) -> dict[str, Any]:
    return {"type": "expression", "value": value, **more}


def pid(measured: str, **gains: Any) -> dict[str, Any]:
    return {"type": "pid", "measured": measured, **gains}


def run(made: SceneFile, laws: Mapping[str, Any] | None = None, **more: Any) -> Result:
    return simulate(compile_scene(made, forces=laws), **more)


def values(result: Result) -> dict[str, Array]:
    return dict(zip(result.names, result.values.T, strict=True))


# --- the same spring said in five ways ---------------------------------------------


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
    "gains": (pid("hinge.angle", p=47.0, d=2.7), None),
    "compiled": (GIVEN, Law(compilable, READS)),
    "uncompiled": (GIVEN, Law(lambda t, y: float({0: compilable(t, y)}[0]), READS)),
    "derivatives": (GIVEN, Law(compilable, READS, lambda t, y: (-47.0, -2.7))),
    "no derivatives": (GIVEN, Law(compilable, READS, lambda t, y: (0.0, 0.0))),
}


@pytest.mark.parametrize("method", METHODS)
def test_a_spring_is_a_spring_however_it_is_said(method: str) -> None:
    tolerance = 1e-5 if INTEGRATORS[method].order == 2 else 1e-8
    wanted = run(pendulum(SPRING), integrator=method, rtol=tolerance).values
    for name, (function, law) in SAID.items():
        if law and name != "uncompiled" and method != "radau5":
            continue
        force = {"type": "actuator", "joint": "hinge", "function": function}
        laws = {"motor": law} if law else {}
        found = run(pendulum(force), laws, integrator=method, rtol=tolerance).values
        size = np.abs(wanted).max(axis=0)
        assert (np.abs(found - wanted) / size).max() < 60 * tolerance, name


def test_callables_are_compiled_where_they_can_be() -> None:
    force = {"type": "actuator", "joint": "hinge", "function": GIVEN}
    for name, wanted in {"compiled": True, "uncompiled": False}.items():
        law = SAID[name][1]
        system = compile_scene(pendulum(force), forces={"motor": law})  # type: ignore[dict-item]
        assert [native.compiled for native in system.natives] == [wanted]


def _steps(law: Law) -> tuple[int, int]:
    force = {"type": "actuator", "joint": "hinge", "function": GIVEN}
    result = run(pendulum(force), {"motor": law}, integrator="radau5", rtol=1e-7)
    counters = result.counters
    return int(counters["newton_iterations"]), int(counters["jacobians"])


def test_newtons_matrix_holds_what_a_law_reads() -> None:
    known, _ = _steps(Law(compilable, READS))
    given, _ = _steps(Law(compilable, READS, lambda t, y: np.array([-47.0, -2.7])))
    missing, _ = _steps(Law(compilable, READS, lambda t, y: np.array([0.0, 0.0])))
    assert known == given < missing


# --- far outputs: a force here of what is measured there -----------------------------


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


# --- closed loops against their matrices --------------------------------------------


def closed_loop(p: float, i: float, d: float, lag: float, mass: float) -> Array:
    """Of x, v, I, D under the controller of eq. (31) without limits."""
    push = np.array([-p, 0.0, i, d]) / mass
    return np.array([[0, 1, 0, 0], push, [-1, 0, 0, 0], [0, -1 / lag, 0, -1 / lag]])


def cart(function: dict[str, Any], record: list[str], **more: Any) -> SceneFile:
    return scene(
        {"cart": {"mass": 1.7}},
        {"rail": {"type": "prismatic", "markers": ["ground", "cart"], "axis": [1, 0]}},
        end=2.0,
        steps=20,
        record=["cart.x", "cart.vx", *record],
        forces={
            "motor": {"type": "actuator", "joint": "rail", "function": function},
            "load": {"type": "force", "marker": "cart", "force": [2.5, 0.0]},
        },
        **more,
    )


GAINS = {"p": 38.0, "i": 55.0, "d": 11.0}
STATES = ["motor.state.integral", "motor.state.derivative"]


@pytest.mark.parametrize("method", METHODS)
def test_pid_moves_as_the_linear_loop(method: str) -> None:
    law = pid("cart.x", reference=0.6, filter=0.03, **GAINS)
    tolerance = 1e-5 if INTEGRATORS[method].order == 2 else 1e-8
    found = run(cart(law, STATES), integrator=method, rtol=tolerance)
    A = closed_loop(38.0, 55.0, 11.0, 0.03, 1.7)
    rest = np.linalg.solve(A, -np.array([0, (38.0 * 0.6 + 2.5) / 1.7, 0.6, 0]))
    wanted = np.array([rest - expm(A * t) @ rest for t in found.t])
    assert (np.abs(found.values - wanted) / np.ptp(wanted, axis=0)).max() < (
        60 * tolerance
    )


def test_pid_written_as_formula_and_as_callable() -> None:
    record = ["motor.value"]
    wanted = run(cart(pid("cart.x", reference=0.6, **GAINS), record), rtol=1e-9).values
    formula = expression(
        "p*(0.6 - cart.x) + 55*sum - 11*cart.vx",
        parameters={"p": 38.0},
        states={"sum": {"rate": "0.6 - cart.x"}},
    )
    law = Law(
        lambda t, y: 38.0 * (0.6 - y[0]) - 11.0 * y[1] + 55.0 * y[2],
        ["cart.x", "cart.vx"],
        states={"sum": (0.0, lambda t, y: 0.6 - y[0])},
    )
    for found in (
        run(cart(formula, record), rtol=1e-9),
        run(cart(GIVEN, record), {"motor": law}, rtol=1e-9),
    ):
        assert np.abs(found.values - wanted).max() < 1e-7 * np.abs(wanted).max()


def test_a_reference_may_be_a_function_of_time_or_an_output() -> None:
    wave = {"type": "harmonic", "amplitude": 0.2, "frequency": 1.5}
    timed = pid("cart.x", reference=wave, p=300.0, d=20.0)
    said = expression(
        "300*(0.2*sin(3*pi*t) - cart.x) + 20*(0.2*3*pi*cos(3*pi*t) - cart.vx)"
    )
    one, other = (run(cart(law, []), rtol=1e-9) for law in (timed, said))
    assert np.abs(one.values - other.values).max() < 1e-7
    two = three_masses(pid("a.x", reference="c.x", p=7.0, d=2.0), False, "actuator")
    same = three_masses(
        expression("7*(c.x - a.x) + 2*(c.vx - a.vx)"), False, "actuator"
    )
    one, other = (run(made, rtol=1e-9) for made in (two, same))
    assert np.abs(one.values - other.values).max() < 1e-7


def test_modes_are_those_of_the_closed_loop() -> None:
    law = pid("cart.x", reference=0.6, filter=0.03, **GAINS)
    wanted = np.linalg.eigvals(closed_loop(38.0, 55.0, 11.0, 0.03, 1.7))
    wanted = sorted(wanted[wanted.imag >= 0.0], key=abs)
    for about in ("static", "start"):
        system = compile_scene(cart(law, []), keep_joints=True)
        found = linearise(system, about).eigenvalues
        assert np.abs(found - wanted).max() < 1e-6 * np.abs(wanted).max()


def test_an_integrator_carries_the_load_in_equilibrium() -> None:
    law = pid("cart.x", reference=0.6, filter=0.03, **GAINS)
    record = ["motor.value", "motor.state.integral"]
    system = compile_scene(cart(law, record), keep_joints=True)
    found = dict(
        zip(
            [*("x", "vx"), *record],
            static_equilibrium(system).result().values[0],
            strict=True,
        )
    )
    assert found["x"] == pytest.approx(0.6, rel=1e-9)
    assert found["motor.value"] == pytest.approx(-2.5, rel=1e-9)
    assert found["motor.state.integral"] == pytest.approx(-2.5 / 55.0, rel=1e-9)
    started = run(cart(law, record, initial={"state": "static"}))
    assert np.ptp(started.values, axis=0).max() < 1e-7


# --- saturation ----------------------------------------------------------------------


def test_saturation_against_two_parabolas_and_an_oscillation() -> None:
    """A mass under clip(-k x, -F, F) from rest beyond the limit."""
    k, force, mass, start = 50.0, 10.0, 2.0, 0.5
    made = scene(
        {"cart": {"mass": mass, "initial": {"position": [start, 0.0]}}},
        {"rail": {"type": "prismatic", "markers": ["ground", "cart"], "axis": [1, 0]}},
        end=0.45,
        steps=30,
        record=["cart.x", "motor.value"],
        forces={
            "motor": {
                "type": "actuator",
                "joint": "rail",
                "function": expression("-k*rail.displacement", parameters={"k": k}),
            }
        },
    )
    content = made.model_dump(by_alias=True)
    content["forces"]["motor"]["function"]["limits"] = [-force, force]
    made = SceneFile.model_validate(content)
    edge, omega = force / k, math.sqrt(k / mass)
    when = math.sqrt(2.0 * (start - edge) * mass / force)
    speed = force / mass * when

    def exact(t: float) -> float:
        if t < when:
            return start - 0.5 * force / mass * t * t
        phase = omega * (t - when)
        return edge * math.cos(phase) - speed / omega * math.sin(phase)

    assert -edge < exact(0.45)
    for method in ("radau5", "radau9", "dop853", "trapezoidal"):
        found = run(made, integrator=method, rtol=1e-7)
        wanted = np.array([exact(t) for t in found.t])
        assert np.abs(found.values[:, 0] - wanted).max() < 3e-6, method
        assert np.abs(found.values[:, 1]).max() <= force


def test_the_integral_does_not_wind_up() -> None:
    """Against the equations of eq. (31), integrated by scipy."""
    from scipy.integrate import solve_ivp

    low, high, track = -6.0, 4.0, 0.2
    law = pid("cart.x", reference=0.6, limits=[low, high], anti_windup=track, **GAINS)
    found = run(cart(law, ["motor.state.integral", "motor.value"]), rtol=1e-9)

    def rates(t: float, y: Array) -> list[float]:
        e = 0.6 - y[0]
        raw = 38.0 * e + 55.0 * y[2] - 11.0 * y[1]
        u = min(max(raw, low), high)
        return [y[1], (u + 2.5) / 1.7, e + (u - raw) / (55.0 * track)]

    known = solve_ivp(
        rates,
        (0.0, 2.0),
        np.zeros(3),
        t_eval=found.t,
        rtol=1e-11,
        atol=1e-13,
        max_step=0.002,
    )
    assert np.abs(found.values[:, :3] - known.y.T).max() < 1e-6
    assert (found.values[:, 3].min(), found.values[:, 3].max()) == (
        pytest.approx(-6.0, abs=7.0),
        4.0,
    )


# --- flexible bodies, energy, space ---------------------------------------------------


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


# --- what goes wrong ------------------------------------------------------------------


def stopped(law: Law, **more: Any) -> str:
    force = {"type": "actuator", "joint": "hinge", "function": GIVEN}
    with pytest.raises((SimulationError, InputError)) as caught:
        run(pendulum(force), {"motor": law}, **more)
    return str(caught.value)


def test_a_callable_that_fails_is_named_with_its_words() -> None:
    text = stopped(Law(lambda t, y: math.sqrt(0.5 - t), ["hinge.angle"]))
    assert "stopped at t = 0.5 s: the law of motor" in text
    assert "ValueError" in text and "hinge.angle = " in text
    table = {0.0: 1.0}
    text = stopped(Law(lambda t, y: table[t], READS))
    assert "the law of motor fails with KeyError: " in text
    text = stopped(Law(lambda t, y: float("x" in table) / 0.0 * 0.0, READS))
    assert "forces: the law of motor" in text and "at t = 0 s" in text
    assert "hinge.angle = 0.4, hinge.angle_rate = 0" in text


@pytest.mark.parametrize("method", METHODS)
def test_a_formula_that_gives_no_number_is_named(method: str) -> None:
    force = {
        "type": "actuator",
        "joint": "hinge",
        "function": expression("log(hinge.angle + 0.2)"),
    }
    with pytest.raises(SimulationError, match="the law of motor gives no finite"):
        run(pendulum(force), integrator=method, rtol=1e-4)


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit])
def test_what_stops_a_program_goes_through_a_callable(error: Any) -> None:
    seen = {"calls": 0}

    def interrupted(t: float, y: Array) -> float:
        seen["calls"] += 1
        if t > 0.7:
            raise error
        return 0.0

    force = {"type": "actuator", "joint": "hinge", "function": GIVEN}
    with pytest.raises(error):
        run(pendulum(force), {"motor": Law(interrupted, READS)})
    assert seen["calls"] > 10


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (expression("hinge.angle +"), "motor.function.value: the formula"),
        (expression("hinge.angel"), "a law cannot read 'hinge.angel'|nothing to read"),
        (expression("rod.ax"), "'rod.ax': it is an acceleration, which follows from"),
        (expression("hinge.angle_acceleration"), "it is an acceleration.*a velocity"),
        (expression("hinge.angle_rate_rate"), "it is an acceleration.*0.01 s late"),
        (expression("hinge.mz"), "'hinge.mz': it is a force, which follows from all"),
        (expression("hinge.f1"), "'hinge.f1': it is a force"),
        (expression("hinge.friction"), "'hinge.friction': it is a force"),
        (expression("rod.q1"), "rod has 0 elastic coordinates"),
        (expression("rod.c.x"), "there is no node|no marker|'c'"),
        (expression("hinge.displacement"), "hinge has no coordinate displacement"),
        (expression("k", states={"k": {}}), "states.k.rate: rate is missing"),
        (expression("1", states={"t": {"rate": "1"}}), "a state has the name 't'"),
        (expression("1", limits=[1, 1]), "limits: found"),
        (pid("hinge.angle"), "does nothing; expected p, i or d"),
        (pid("hinge.angle_rate", d=1.0), "rate of hinge.angle_rate is an acceleration"),
        (pid("hinge.angle", i=1.0, limits=[-1, 1]), "anti_windup: is missing"),
        (pid("hinge.angle", p=1.0, filter=0.1), "filter: stands without d"),
    ],
)
def test_laws_that_are_not_sound_are_refused(
    function: dict[str, Any], words: str
) -> None:
    force = {"type": "actuator", "joint": "hinge", "function": function}
    with pytest.raises(InputError, match=words):
        compile_scene(pendulum(force))


PULSE = "1000*exp(-((t - 0.613)/0.002)**2) * (1 + 0*cart.x)"


@pytest.mark.parametrize("said", ["formula", "callable", "product"])
def test_no_step_passes_a_pulse_of_a_law_unseen(said: str) -> None:
    """At rest until a pulse of 4 ms, whose momentum is known."""
    function: dict[str, Any] = expression(PULSE)
    laws = {}
    if said == "callable":
        function = GIVEN
        laws["motor"] = Law(
            lambda t, y: 1000.0 * math.exp(-(((t - 0.613) / 0.002) ** 2)), ["cart.x"]
        )
    if said == "product":
        function = expression("(cart.x + 1)*" + PULSE)
    made = scene(
        {"cart": {"mass": 4.0, "initial": {"position": [0.0, 0.0]}}},
        {"rail": {"type": "prismatic", "markers": ["ground", "cart"], "axis": [1, 0]}},
        end=2.0,
        steps=4,
        record=["cart.vx"],
        forces={"motor": {"type": "actuator", "joint": "rail", "function": function}},
    )
    momentum = 1000.0 * 0.002 * math.sqrt(math.pi)
    tolerance = 2e-3 if said == "product" else 1e-6
    for method in ("radau9", "dop853"):
        found = run(made, laws, integrator=method, rtol=1e-7)
        assert found.values[-1, 0] == pytest.approx(momentum / 4.0, rel=tolerance)


def test_the_state_that_a_message_advises_follows_the_acceleration() -> None:
    """What is said where a law would read an acceleration: it is that, with a lag."""
    lag, size, omega, mass, length = 0.01, 1.5, 4.0, 1.3, 2.1
    law = expression(
        f"{size}*sin({omega}*t)",
        states={"slow": {"rate": f"(hinge.angle_rate - slow)/{lag}"}},
    )
    made = scene(
        {"rod": slender_rod(length, mass)},
        {"hinge": {"type": "revolute", "markers": ["ground", "rod.a"]}},
        end=1.5,
        steps=30,
        record=["hinge.angle_rate", "motor.state.slow"],
        forces={"motor": {"type": "actuator", "joint": "hinge", "function": law}},
    )
    result = run(made, rtol=1e-9)
    speed, slow = result.values.T
    t, w = result.t, omega * lag
    known = np.sin(omega * t) - w * np.cos(omega * t) + w * np.exp(-t / lag)
    known *= size / (mass * length**2 / 3.0) / (1.0 + w**2)
    np.testing.assert_allclose((speed - slow) / lag, known, atol=1e-6)
