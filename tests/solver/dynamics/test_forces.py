"""Forces: what each kind does, what Newton matrices know of it, what is refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array, Taylor
from sidtool.formats.scene import (
    FrequencyDamping,
    ModalDamping,
    RayleighDamping,
    SceneFile,
)
from sidtool.formats.toml.reading import validate_data
from sidtool.solver import compile_scene, simulate
from sidtool.solver.initial_state.assembly import initial_estimate
from sidtool.solver.linear.accelerations import solve_accelerations
from sidtool.solver.linear.newton_matrix import (
    newton_factor,
    newton_solve,
    store_linearisation,
)
from sidtool.solver.spatial.coordinates import retract
from sidtool.solver.system import work_arrays
from sidtool.solver.system.body_data import sid_with_damping
from sidtool.solver.system.system import System
from sidtool.solver.system.work_arrays import new_memory, new_work_arrays
from tests.bodies import particle_body


def scene(
    dimension: str, record: list[str] | None = None, end: float = 1.0, **tables: Any
) -> SceneFile:
    head = {"format": "sidtool scene", "version": 1, "dimension": dimension}
    time = {"end": end, "output_step": end / 20}
    outputs = {"record": record or []}
    return validate_data(
        {**head, "time": time, "outputs": outputs, **tables}, SceneFile
    )


def test_a_driven_damped_oscillator_follows_its_closed_form() -> None:
    m, k, d, amplitude, hertz = 2.0, 50.0, 3.0, 4.0, 0.8
    push = {"type": "harmonic", "amplitude": amplitude, "frequency": hertz}
    spring = {"markers": ["ground", "mass"], "rest": 1.0, "stiffness": k, "damping": d}
    content = scene(
        "planar",
        ["mass.x"],
        end=2.0,
        bodies={"mass": {"mass": m, "initial": {"position": [1.0, 0.0]}}},
        joints={"line": {"type": "point_on_line", "markers": ["ground", "mass"]}},
        forces={
            "spring": {"type": "spring_damper", **spring},
            "push": {
                "type": "force",
                "marker": "mass",
                "force": [1.0, 0.0],
                "function": push,
            },
        },
    )
    result = simulate(compile_scene(content), rtol=1e-9)
    w = 2.0 * np.pi * hertz
    steady = amplitude / (k - m * w * w + 1j * d * w)
    rate = -d / (2 * m) + 1j * np.sqrt(k / m - (d / (2 * m)) ** 2)
    x0, v0 = -steady.imag, -(1j * w * steady).imag
    b = (v0 - rate.real * x0) / rate.imag
    free = np.exp(rate.real * result.t) * (
        x0 * np.cos(rate.imag * result.t) + b * np.sin(rate.imag * result.t)
    )
    exact = free + (steady * np.exp(1j * w * result.t)).imag
    assert result["mass.x"] - 1.0 == pytest.approx(exact, abs=1e-8)


def test_friction_stops_a_slider_after_the_distance_of_coulomb() -> None:
    m, force, speed = 2.0, 4.0, 1e-5
    rail = {"type": "prismatic", "markers": ["ground", "block"]}
    rub = {"type": "friction", "joint": "rail", "force": force, "speed": speed}
    block = {"mass": m, "inertia": 1.0, "initial": {"velocity": [1.0, 0.0]}}
    content = scene(
        "planar",
        ["block.x", "energy.kinetic", "energy.dissipated", "energy.balance"],
        bodies={"block": block},
        joints={"rail": rail},
        forces={"rub": rub},
    )
    result = simulate(compile_scene(content), rtol=1e-8)
    assert result["block.x"][-1] == pytest.approx(m / (2.0 * force), rel=1e-4)
    assert result["energy.dissipated"][-1] == pytest.approx(0.5 * m, rel=1e-5)
    assert np.ptp(result["energy.balance"]) < 1e-5


@pytest.mark.parametrize("stiffness", [1e3, 1e6, 1e9])
def test_a_stiff_bushing_between_two_bodies_is_a_weld(stiffness: float) -> None:
    """The Newton matrix knows forces across bodies: stiffness costs no iterations."""
    bodies: dict[str, Any] = {}
    for name, x, end in (("a", 0.0, 0.5), ("b", 1.0, -0.5)):
        bodies[name] = {
            "mass": 1.0,
            "inertia": [0.1, 0.2, 0.3],
            "markers": {"end": {"position": [end, 0.0, 0.0]}},
            "initial": {"position": [x, 0.0, 0.0], "velocity": [0.0, x, -0.3 * x]},
        }
    bush = {
        "type": "bushing",
        "markers": ["a.end", "b.end"],
        "stiffness": [stiffness] * 6,
        "damping": [0.02 * stiffness] * 6,
    }
    content = scene(
        "spatial",
        ["a.x", "b.x", "a.y", "b.y", "a.z", "b.z"],
        bodies=bodies,
        forces={"bush": bush},
    )
    result = simulate(compile_scene(content), rtol=1e-6)
    gap = [result[f"b.{axis}"] - result[f"a.{axis}"] for axis in "xyz"]
    distance = np.linalg.norm(gap, axis=0)
    assert distance[-1] == pytest.approx(1.0, abs=10.0 / stiffness)
    counters = result.counters
    assert counters["newton_iterations"] < 4 * counters["steps"]


def relaxed_pair(dimension: str, **more: str) -> System:
    """Two flexible bodies at rest under stiff springs, none of which is strained."""
    plane = dimension == "planar"
    rng, axes = np.random.default_rng(4), 2 if plane else 3
    sids = {}
    for k, name in enumerate(("a", "b")):
        sid = particle_body(2, 8, planar=plane, seed=k)
        nodes = tuple(replace(n, AP=Taylor(n.AP.m0)) for n in sid.nodes)
        sids[name] = replace(sid, nodes=nodes)
    p, q = (
        {name: sids[name].node(node).position[:axes] for name in sids}
        for node in ("1", "2")
    )
    place = {"a": np.array([0.3, -0.2, 0.5][:axes])}
    place["b"] = place["a"] + p["a"] - p["b"]
    ends = {name: place[name] + q[name] for name in sids}
    stiff = (1e7 * rng.uniform(1.0, 2.0, 6)).tolist()
    loss = (1e4 * rng.uniform(1.0, 2.0, 6)).tolist()
    count = 3 if plane else 6
    rod = {"type": "spring_damper", "stiffness": 2e7, "damping": 3e4}
    forces = {
        "bush": {
            "type": "bushing",
            "markers": ["a.p", "b.p"],
            "stiffness": stiff[:count],
            "damping": loss[:count],
            **more,
        },
        "rod": {
            **rod,
            "markers": ["a.q", "b.q"],
            "rest": float(np.linalg.norm(ends["b"] - ends["a"])),
        },
        "root": {
            **rod,
            "markers": ["ground", "a.q"],
            "rest": float(np.linalg.norm(ends["a"])),
        },
    }
    bodies = {
        name: {
            "sid": name,
            "markers": {"p": "1", "q": "2"},
            "initial": {"position": place[name].tolist()},
        }
        for name in sids
    }
    return compile_scene(scene(dimension, bodies=bodies, forces=forces), ".", sids)


def newton_product(system: System, mu: float = 2e3) -> Array:
    """(mu - J) (mu - J)^-1 at rest: J by central differences, the inverse by Newton's
    factors."""
    arrays, n = system.arrays, system.n_velocities
    work, memory = new_work_arrays(system), new_memory(system, 0)
    z, v = initial_estimate(system).z, np.zeros(n)
    work_arrays.evaluate(system, work, 0.0, z, v)
    frame = work.frame.copy()

    def acceleration(x: Array, w: Array) -> Array:
        moved = z.copy()
        retract(arrays, frame, moved, x)
        work_arrays.evaluate(system, work, 0.0, moved, w)
        assert solve_accelerations(arrays, work, memory) == 0
        return memory.acceleration.copy()

    def jacobian(delta: float, first: bool) -> Array:
        columns = []
        for e in delta * np.eye(n):
            x, w = (e, v) if first else (v, e)
            difference = acceleration(x, w) - acceleration(-x, -w)
            columns.append(difference / (2.0 * delta))
        return np.column_stack(columns)

    exact = mu * np.eye(n) - jacobian(1e-4, False) - jacobian(1e-7, True) / mu
    acc = acceleration(v, v)
    work_arrays.linearise(system, work, 0.0, z, v, acc, np.zeros(0))
    store_linearisation(arrays, work, memory)
    assert newton_factor(arrays, work, memory, memory.real, 0, mu) == 0
    columns = []
    for e in np.eye(n):
        r, s = np.zeros(system.n_positions), e.copy()
        newton_solve(arrays, work, memory, memory.real, 0, mu, r, s)
        columns.append(s)
    product: Array = exact @ np.column_stack(columns)
    return product


@pytest.mark.parametrize(
    ("dimension", "more"),
    [("planar", {}), ("spatial", {}), ("spatial", {"shaft": "y"})],
)
def test_newton_matrices_know_the_stiffness_of_forces(
    dimension: str, more: dict[str, str]
) -> None:
    """Rows of forces solve with the J that central differences give."""
    system = relaxed_pair(dimension, **more)
    n = system.n_velocities
    assert system.n_rows == 0 and system.n_newton_rows == (5 if n == 10 else 8)
    assert newton_product(system) == pytest.approx(np.eye(n), abs=1e-5)


@pytest.mark.parametrize("rest", [0.5, 2.0], ids=["pulls", "pushes"])
@pytest.mark.parametrize("dimension", ["planar", "spatial"])
def test_newton_matrices_know_how_a_strained_spring_turns(
    dimension: str, rest: float
) -> None:
    """Its force over its length acts across it, also on the arm of its marker."""
    axes = 2 if dimension == "planar" else 3
    body = {
        "mass": 1.3,
        "inertia": 0.2 if axes == 2 else [0.1, 0.2, 0.25],
        "centre_of_mass": [0.1, -0.2, 0.3][:axes],
        "markers": {"arm": {"position": [-0.3, 0.2, 0.4][:axes]}},
        "initial": {"position": [0.9, 0.4, -0.3][:axes]},
    }
    spring = {
        "type": "spring_damper",
        "markers": ["ground", "body.arm"],
        "stiffness": 1e7,
        "rest": rest,
    }
    content = scene(dimension, bodies={"body": body}, forces={"spring": spring})
    product = newton_product(compile_scene(content))
    assert product == pytest.approx(np.eye(len(product)), abs=1e-5)


def test_damping_policies_give_each_mode_its_ratio() -> None:
    sid = particle_body(4, 12, seed=2)
    hertz = np.array([50.0, 90.0, 500.0, 3000.0])
    mix = np.random.default_rng(1).normal(size=(4, 4))
    Me, Ke = mix.T @ mix, mix.T @ np.diag((2 * np.pi * hertz) ** 2) @ mix
    sid = replace(sid, Me=Taylor(Me), Ke=Taylor(Ke))

    def ratios(policy: Any) -> Array:
        modes = np.linalg.inv(mix)
        modal = modes.T @ sid_with_damping(sid, policy, "body").De.m0 @ modes
        assert modal == pytest.approx(np.diag(np.diag(modal)), abs=1e-8 * modal.max())
        return np.diag(modal) / (4.0 * np.pi * hertz)

    assert ratios(FrequencyDamping(type="frequency")) == pytest.approx(
        [0.01, 0.01, 0.1, 1.0]
    )
    assert ratios(ModalDamping(type="modal", ratio=(0.03,))) == pytest.approx(
        [0.03] * 4
    )
    each = (0.01, 0.02, 0.03, 0.04)
    assert ratios(ModalDamping(type="modal", ratio=each)) == pytest.approx(each)
    rayleigh = RayleighDamping(type="rayleigh", alpha=3.0, beta=1e-5)
    w = 2.0 * np.pi * hertz
    assert ratios(rayleigh) == pytest.approx(1.5 / w + 0.5e-5 * w)
    with pytest.raises(InputError, match="has 2 ratios"):
        sid_with_damping(sid, ModalDamping(type="modal", ratio=(0.1, 0.2)), "body")


WRONG: list[tuple[dict[str, Any], str]] = [
    ({"type": "force", "marker": "a"}, "neither force nor torque"),
    ({"type": "force", "marker": "a", "force": [1, 2, 3]}, "3 components"),
    ({"type": "force", "marker": "b", "force": [1, 2]}, "no body 'b'"),
    ({"type": "force", "marker": "a", "torque": [0, 0, 1]}, "does not fit a planar"),
    ({"type": "spring_damper", "stiffness": 1}, "neither is given"),
    ({"type": "spring_damper", "markers": ["ground", "a"]}, "does nothing"),
    ({"type": "spring_damper", "joint": "x", "stiffness": 1}, "no joint 'x'"),
    ({"type": "friction", "joint": "hold", "force": 1, "speed": 1}, "type coincident"),
    ({"type": "bushing", "markers": ["ground", "a"], "stiffness": [1]}, "1 values"),
    ({"type": "bushing", "markers": ["a", "a"], "stiffness": [1, 1, 1]}, "the same"),
]


@pytest.mark.parametrize("force, problem", WRONG)
def test_what_is_no_force_is_refused(force: dict[str, Any], problem: str) -> None:
    body = {"mass": 1.0, "inertia": 1.0}
    joints = {"hold": {"type": "coincident", "markers": ["ground", "a"]}}
    with pytest.raises(InputError, match=problem):
        scene("planar", bodies={"a": body}, joints=joints, forces={"f": force})


def pushed(function: Any, kind: str = "force") -> Any:
    """A block of 2 kg on a rail, pushed by a function of time times 3 N, or by it."""
    push: dict[str, Any] = {"type": "force", "marker": "block.a", "force": [3.0, 0.0]}
    if kind == "actuator":
        push = {"type": "actuator", "joint": "rail"}
    if function is not None:
        push["function"] = function
    joints = {"rail": {"type": "prismatic", "markers": ["ground", "block.a"]}}
    block = {"mass": 2.0, "inertia": 1.0, "markers": {"a": {"position": [0.0, 0.0]}}}
    tables = {"bodies": {"block": block}, "joints": joints, "forces": {"push": push}}
    return scene("planar", ["block.ax"], **tables)


@pytest.mark.parametrize("function", [None, {"type": "callable"}])
def test_a_program_gives_the_size_of_a_force(function: Any) -> None:
    def wave(t: float) -> float:
        return float(np.exp(-t) * np.sin(20.0 * t))

    system = compile_scene(pushed(function), forces={"push": wave})
    result = simulate(system, rtol=1e-9)
    exact = [1.5 * wave(t) for t in result.t]
    assert result["block.ax"] == pytest.approx(exact, abs=1e-10)


def test_a_program_is_an_actuator_and_may_have_kinks() -> None:
    system = compile_scene(
        pushed({"type": "callable"}, "actuator"),
        forces={"push": lambda t: abs(t - 0.37)},
    )
    assert system.breaks == pytest.approx((0.37, 1.0), abs=1e-6)
    result = simulate(system, rtol=1e-9)
    assert result["block.ax"] == pytest.approx(0.5 * abs(result.t - 0.37), abs=1e-9)


def test_programs_need_forces_that_are_functions_of_time() -> None:
    with pytest.raises(InputError, match="no force 'pull' .*expected push"):
        compile_scene(pushed(None), forces={"pull": float})
    with pytest.raises(InputError, match="jumps by 1 .*pieces of a polynomial"):
        compile_scene(pushed(None), forces={"push": lambda t: float(t > 0.3)})
    with pytest.raises(InputError, match="left to a program"):
        compile_scene(pushed({"type": "callable"}))
    spring = {"type": "spring_damper", "markers": ["ground", "a"], "stiffness": 1.0}
    body = {"mass": 1.0, "initial": {"position": [1.0, 0.0]}}
    described = scene("planar", bodies={"a": body}, forces={"spring": spring})
    with pytest.raises(InputError, match="spring_damper, which is no function of time"):
        compile_scene(described, forces={"spring": float})
