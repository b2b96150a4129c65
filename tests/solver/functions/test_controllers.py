"""Controllers against the matrices of their closed loops, and at their limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import SceneFile
from sidtool.solver import (
    Law,
    compile_scene,
    linearise,
    static_equilibrium,
)
from sidtool.solver.integrators.registry import INTEGRATORS
from tests.solver.functions.loops import (
    GAINS,
    GIVEN,
    METHODS,
    STATES,
    cart,
    closed_loop,
    expression,
    pid,
    run,
)
from tests.solver.functions.test_laws import three_masses
from tests.solver.scenes import scene


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
        found = linearise(system, about, frozen=about == "start").eigenvalues
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
