"""Controllers with a sample time: values are held from one sample to the next."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.scene import Time
from sidtool.solver import (
    Law,
    compile_scene,
    linearise,
    simulate,
    static_equilibrium,
)
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.solver.system.errors import SimulationError
from tests.codes import with_code
from tests.solver.functions.loops import GIVEN, expression, pid
from tests.solver.scenes import scene

MASS, STIFFNESS, LOAD = 1.4, 30.0, 2.2
P, KI, D, WANTED = 55.0, 80.0, 9.0, 0.25
PERIOD, LAG = 0.04, 0.03
RECORD = ["cart.x", "cart.vx", "motor.value"]


def cart(function: dict[str, Any], end: float = 1.0, **more: Any) -> Any:
    """A mass on a spring and a motor, under a constant load."""
    return scene(
        {"cart": {"mass": MASS}},
        {"rail": {"type": "prismatic", "markers": ["ground", "cart"], "axis": [1, 0]}},
        end=end,
        steps=round(end / (0.5 * PERIOD)),
        record=more.pop("record", RECORD),
        forces={
            "motor": {"type": "actuator", "joint": "rail", "function": function},
            "spring": {
                "type": "spring_damper",
                "joint": "rail",
                "stiffness": STIFFNESS,
            },
            "load": {"type": "force", "marker": "cart", "force": [LOAD, 0.0]},
        },
        **more,
    )


def held(u: float, x: Array, t: float) -> Array:
    """The state after a time under a constant force of the motor, exact."""
    A = np.array([[0.0, 1.0], [-STIFFNESS / MASS, 0.0]])
    rest = np.array([(u + LOAD) / STIFFNESS, 0.0])
    return np.asarray(rest + expm(A * t) @ (x - rest))


class Controller:
    """A PID controller of textbooks, in discrete time."""

    def __init__(self, limits: tuple[float, float] | None = None) -> None:
        self.sum = self.lagged = 0.0
        self.limits, self.track = limits, math.sqrt(D / KI)

    def __call__(self, x: Array) -> float:
        e, slope = WANTED - x[0], -x[1]
        self.lagged += (1.0 - math.exp(-PERIOD / LAG)) * (slope - self.lagged)
        raw = P * e + KI * self.sum + D * self.lagged
        u = (
            raw
            if self.limits is None
            else min(max(raw, self.limits[0]), self.limits[1])
        )
        self.sum += PERIOD * (e + (u - raw) / (KI * self.track))
        return u


def exact(controller: Any, end: float) -> Array:
    """States and forces in the middle and at the end of each time that is held."""
    x, found = np.zeros(2), []
    for _ in range(round(end / PERIOD)):
        u = controller(x)
        found.append([*held(u, x, 0.5 * PERIOD), u])
        x = held(u, x, PERIOD)
        found.append([*x, u])
    return np.array(found)


@pytest.mark.parametrize("limits", [None, (-6.0, 8.0)])
def test_a_sampled_pid_is_that_of_discrete_time(limits: Any) -> None:
    law = pid(
        "cart.x",
        reference=WANTED,
        p=P,
        i=KI,
        d=D,
        filter=LAG,
        sample_time=PERIOD,
        **({} if limits is None else {"limits": list(limits)}),
    )
    wanted = exact(Controller(limits), 1.0)
    for method in INTEGRATORS:
        tolerance = 1e-5 if INTEGRATORS[method].order == 2 else 1e-8
        found = simulate(compile_scene(cart(law)), integrator=method, rtol=tolerance)
        size = np.abs(wanted).max(axis=0)
        off = np.abs(found.values[1:] - wanted) / size
        assert off.max() < 60 * tolerance, method


def test_a_sampled_callable_is_asked_once_a_sample_and_only_of_the_past() -> None:
    asked: list[tuple[float, float]] = []

    def law(t: float, y: Array) -> float:
        asked.append((t, float(y[0])))
        return P * (WANTED - y[0]) - D * y[1]

    made = Law(law, ["cart.x", "cart.vx"], sample_time=PERIOD)
    system = compile_scene(cart(GIVEN), forces={"motor": made})
    found = simulate(system, rtol=1e-9)
    assert [t for t, _ in asked] == pytest.approx(PERIOD * np.arange(25), abs=1e-12)
    wanted = exact(lambda x: P * (WANTED - x[0]) - D * x[1], 1.0)
    assert np.abs(found.values[1:] - wanted).max() < 1e-6
    seen = [0.0, *wanted[1:-1:2, 0]]
    assert np.abs(np.array([x for _, x in asked]) - seen).max() < 1e-7


def test_states_of_a_sampled_law_become_their_next_value() -> None:
    """A delay of one sample, and a count of samples."""
    record = ["cart.x", "motor.value", "motor.state.before", "motor.state.count"]
    law = expression(
        "50*(0.25 - before)",
        states={
            "before": {"next": "cart.x", "initial": 0.25},
            "count": {"next": "count + 1"},
        },
        sample_time=PERIOD,
    )
    found = simulate(compile_scene(cart(law, record=record)), rtol=1e-9)
    x, before, rows = np.zeros(2), 0.25, []
    for k in range(25):
        u, before = 50.0 * (0.25 - before), x[0]
        for part in (0.5, 1.0):
            rows.append([held(u, x, part * PERIOD)[0], u, before, k + 1.0])
        x = held(u, x, PERIOD)
    assert np.abs(found.values[1:] - np.array(rows)).max() < 1e-6


def test_two_sample_times_beside_a_function_that_breaks() -> None:
    """The same scene, sampled at twice the rate, where nothing but that changes."""
    steps = {
        "type": "polynomial",
        "pieces": [
            {"from": 0.0, "to": 0.26, "coefficients": [0.1]},
            {"from": 0.26, "coefficients": [0.3]},
        ],
    }
    fine = pid("cart.x", reference=steps, p=20.0, sample_time=PERIOD)
    system = compile_scene(cart(fine))
    assert 0.26 in system.breaks and len(system.breaks) == 26
    found = simulate(system, rtol=1e-9).values
    x, rows = np.zeros(2), []
    for k in range(25):
        u = 20.0 * ((0.1 if k * PERIOD < 0.26 else 0.3) - x[0])
        rows += [[*held(u, x, part * PERIOD), u] for part in (0.5, 1.0)]
        x = held(u, x, PERIOD)
    assert np.abs(found[1:] - np.array(rows)).max() < 1e-6


def test_analyses_take_sampled_laws_as_continuous_and_say_so() -> None:
    gains = {"reference": WANTED, "p": P, "i": KI, "d": D, "filter": LAG}
    found = []
    for more in ({}, {"sample_time": PERIOD}):
        system = compile_scene(cart(pid("cart.x", **gains, **more)), keep_joints=True)
        modes, rest = linearise(system), static_equilibrium(system)
        for analysis in (modes, rest):
            subjects = [each.subject for each in with_code(analysis, "N513")]
            assert subjects == (["motor"] if more else [])
        found.append((modes.eigenvalues, rest.result().values))
    assert np.abs(found[0][0] - found[1][0]).max() < 1e-9
    assert np.abs(found[0][1] - found[1][1]).max() < 1e-9
    law = expression(
        "before", states={"before": {"next": "cart.x"}}, sample_time=PERIOD
    )
    system = compile_scene(cart(law), keep_joints=True)
    with pytest.raises(InputError, match="before.*are known at samples only"):
        linearise(system)


def test_a_run_may_start_at_rest_under_a_sampled_controller() -> None:
    law = pid("cart.x", reference=WANTED, p=P, i=KI, sample_time=PERIOD)
    made = cart(law, initial={"state": "static"})
    found = simulate(compile_scene(made), rtol=1e-9).values
    assert np.abs(found[:, 0] - WANTED).max() < 1e-7


def test_a_sample_that_gives_no_number_ends_the_run() -> None:
    law = expression("sqrt(0.1 - cart.x)*0 + 20", sample_time=PERIOD)
    with pytest.raises(SimulationError, match="N509 the law of motor"):
        simulate(compile_scene(cart(law)))


def test_too_many_samples_are_refused() -> None:
    law = expression("1", sample_time=1e-7)
    with pytest.raises(InputError, match="more than 1000000 samples"):
        compile_scene(cart(law))


@pytest.mark.parametrize("kind", ["step", "own step", "times"])
@pytest.mark.parametrize("seed", range(4))
def test_rows_at_a_sample_hold_just_before_it(kind: str, seed: int) -> None:
    """However times are rounded in the file; a law that counts its samples.

    The acceleration is that of the value, so that a row is of one instant.
    """
    random = np.random.default_rng(seed)
    n, digits = int(random.integers(7, 60)), int(random.integers(8, 14))
    start = float(random.choice([0.0, 0.1, -2.7, 100.0]))
    period = float(f"{1.0 / n:.{digits}g}")
    other = float(f"{1.0 / n:.{digits + 1}g}")
    own = [float(f"{start + k * period:.{digits + 3}g}") for k in range(1, n)]
    time = {
        "step": {"output_step": period},
        "own step": {"output_step": other},
        "times": {"output_times": [start, *own]},
    }[kind]
    count = {"count": {"next": "count + 1"}}
    law = expression("count", states=count, sample_time=period)
    described = cart(law, record=["motor.value", "cart.ax", "cart.x"])
    span = Time(start=start, end=start + 1.0, **time)
    system = compile_scene(described.model_copy(update={"time": span}))
    methods = list(INTEGRATORS)
    for method in {methods[seed % len(methods)], "radau9", "dop853"}:
        found = simulate(system, integrator=method, rtol=1e-4)
        samples = (found.t - start) / period
        k = np.round(samples)
        assert (np.abs(samples - k) < 1e-6).all()
        assert found["motor.value"] == pytest.approx(np.maximum(k - 1, 0), abs=1e-9)
        force = found["motor.value"] + LOAD - STIFFNESS * found["cart.x"]
        assert found["cart.ax"] == pytest.approx(force / MASS, abs=1e-9)
