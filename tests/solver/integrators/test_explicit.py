"""The explicit method: its figures, its orders, and what it does with stiff scenes."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from sidtool.formats.base.sid import Taylor
from sidtool.formats.result import Result
from sidtool.solver import simulate
from sidtool.solver.integrators.dop853_tableau import END_STAGE, N_STAGES, tableau
from sidtool.solver.system.errors import SimulationError
from sidtool.solver.system.system import System
from tests.solver.scenes import GRAVITY, compiled, scene, soft_body


@cache
def flexible(planar: bool) -> System:
    """A soft pendulum that falls and vibrates, in the plane or as a top in space."""
    sid = soft_body(3, seed=4, planar=planar, damped=True)
    down = [0.0, -GRAVITY] if planar else [0.0, 0.0, -GRAVITY]
    spin = 1.0 if planar else [0.5, 1.0, -0.5]
    body = {
        "sid": "-",
        "quadratic_inertia": True,
        "markers": {"end": 1},
        "initial": {"angular_velocity": spin, "elastic": [0.05, -0.02, 0.03]},
    }
    joints = {"pivot": {"type": "coincident", "markers": ["ground", "body.end"]}}
    described = scene(
        {"body": body},
        joints,
        end=1.0,
        steps=40,
        gravity=down,
        dimension="planar" if planar else "spatial",
        record=["body.x", "body.y", "body.q*"],
    )
    return compiled(described, body=sid)


@cache
def exact(planar: bool) -> Result:
    return simulate(flexible(planar), integrator="radau13", rtol=1e-13)


def error(result: Result, planar: bool) -> float:
    scale = abs(exact(planar).values).max(axis=0)
    return float((abs(result.values - exact(planar).values) / scale).max())


@pytest.mark.parametrize("order", range(1, 9))
def test_the_tableau_integrates_powers_and_its_estimates_see_them(order: int) -> None:
    """Order 8 of the step, and of the estimates 5, three of them, and 3."""
    method = tableau()
    power = method.c[:END_STAGE] ** (order - 1)
    assert method.A[END_STAGE, :END_STAGE] @ power == pytest.approx(
        1.0 / order, abs=1e-15
    )
    fifth = [(weights, 5) for weights in method.fifth]
    for weights, kept in (*fifth, (method.third, 3)):
        seen = abs(weights[:END_STAGE] @ power)
        assert (seen < 1e-14) == (order <= kept)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.7, 1.0])
def test_the_dense_output_integrates_powers_up_to_its_order(share: float) -> None:
    method = tableau()
    x, u = share, 1.0 - share
    last = method.A[END_STAGE]
    weights = (x - x * u + 2.0 * x * x * u) * last
    weights = (
        weights
        + x * u * u * np.eye(N_STAGES)[0]
        - x * x * u * np.eye(N_STAGES)[END_STAGE]
    )
    terms = x * x * u * u * np.array([1.0, x, x * u, x * x * u])
    weights = weights + terms @ method.dense
    for order in range(1, 8):
        found = weights @ method.c ** (order - 1)
        assert found == pytest.approx(share**order / order, abs=1e-14)


@pytest.mark.parametrize("planar", [True, False])
def test_fixed_steps_converge_with_order_seven_between_them(planar: bool) -> None:
    """Outputs lie inside the steps, where the dense output has order 7."""
    errors = [
        error(simulate(flexible(planar), integrator="dop853", step=1.0 / n), planar)
        for n in (7, 14)
    ]
    assert np.log2(errors[0] / errors[1]) > 6.8


@pytest.mark.parametrize("planar", [True, False])
def test_fixed_steps_converge_with_order_eight_at_their_ends(planar: bool) -> None:
    truth = exact(planar)
    errors = []
    for n in (5, 10):
        result = simulate(flexible(planar), integrator="dop853", step=1.0 / n)
        errors.append(abs(result.values[-1] - truth.values[-1]).max())
    assert np.log2(errors[0] / errors[1]) > 7.7


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("rtol", [1e-3, 1e-6, 1e-9])
def test_what_is_asked_for_is_what_comes_out(planar: bool, rtol: float) -> None:
    result = simulate(flexible(planar), integrator="dop853", rtol=rtol)
    assert error(result, planar) < 10.0 * rtol


def stiff(stiffness: float) -> System:
    """A strongly damped, fast mode on a body that flies slowly."""
    sid = soft_body(1, seed=1)
    sid = replace(
        sid,
        Ke=Taylor(np.array([[stiffness]])),
        De=Taylor(np.array([[np.sqrt(stiffness)]])),
    )
    body = {"sid": "-", "initial": {"angular_velocity": 0.1, "elastic": [1e-6]}}
    return compiled(scene({"body": body}, record=["body.x"]), body=sid)


def test_a_stiff_scene_ends_in_advice_and_not_in_hours() -> None:
    with pytest.raises(SimulationError) as stop:
        simulate(stiff(1e14), integrator="dop853")
    assert (stop.value.code, stop.value.data["method"]) == ("N305", "dop853")
    assert simulate(stiff(1e14), integrator="radau5").completed


def test_a_stiff_scene_that_takes_moments_is_computed_all_the_same() -> None:
    result = simulate(stiff(1e7), integrator="dop853")
    assert result.completed
    assert 4 * result.counters["stiff_steps"] > result.counters["steps"]
    assert simulate(flexible(True), integrator="dop853").counters["stiff_steps"] == 0


def springs(stiffness: float) -> System:
    """Two masses in a row, the first on a damped spring, the second on a soft one."""
    bodies = {
        name: {"mass": 1.0, "initial": {"position": [x, 0.0]}}
        for name, x in (("near", 1.0), ("far", 2.0))
    }
    first = {"stiffness": stiffness, "damping": np.sqrt(stiffness)}
    forces = {
        "first": {"markers": ["ground", "near"], **first},
        "second": {"markers": ["near", "far"], "stiffness": 50.0},
    }
    kind = {"type": "spring_damper", "rest": 1.0}
    return compiled(
        scene(
            bodies,
            end=2.0,
            gravity=[-GRAVITY, 0.0],
            forces={name: kind | force for name, force in forces.items()},
            record=["near.x", "far.x"],
        )
    )


def test_auto_takes_the_explicit_method_for_rigid_bodies() -> None:
    found, other = (simulate(springs(1e2), integrator=n) for n in ("auto", "radau9"))
    assert found.settings["integrator"] == "dop853"
    assert found.values == pytest.approx(other.values, abs=1e-5)


def test_auto_goes_on_with_radau_where_rigid_bodies_are_stiff() -> None:
    """The steps before the change are kept, and no output is lost."""
    result = simulate(springs(1e10), integrator="auto")
    truth = simulate(springs(1e10), integrator="radau13", rtol=1e-10)
    assert "dop853, then radau9 from t = " in str(result.settings["integrator"])
    assert result.values == pytest.approx(truth.values, abs=1e-5)
    assert 500 < result.counters["steps"] < 1000


@pytest.mark.parametrize(("rtol", "chosen"), [(1e-2, "radau5"), (1e-6, "radau9")])
def test_auto_takes_radau_for_flexible_bodies(rtol: float, chosen: str) -> None:
    result = simulate(flexible(True), integrator="auto", rtol=rtol)
    assert result.settings["integrator"] == chosen
