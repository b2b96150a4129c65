"""No step passes over a pulse of time, or over a zone of a force, that is known."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.interpolate import PchipInterpolator

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import SceneFile
from sidtool.solver import compile_scene, simulate
from sidtool.solver.functions.piecewise import characteristic_features
from sidtool.solver.integrators.registry import INTEGRATORS
from tests.codes import with_code
from tests.solver.scenes import polynomial, scene

MASS = 2.0
LOOSE = {"trapezoidal": 1e-4, "generalised_alpha": 1e-4, "dop853": 1e-6}
METHODS = ["radau5", "radau9", "radau13", *LOOSE]


def flight(
    speed: float, force: dict[str, Any], end: float, vertical: bool = False
) -> Any:
    """A block that slides along a rail without friction, and one force on it."""
    block = {
        "mass": MASS,
        "inertia": 1.0,
        "markers": {"a": {"position": [0.0, 0.0]}},
        "initial": {"velocity": [speed, 0.0]},
    }
    return scene(
        {"block": block},
        {"rail": {"type": "prismatic", "markers": ["ground", "block.a"]}},
        end=end,
        record=["block.x", "block.vx"],
        forces={"f": force},
        gravity=[-5.0 if vertical else 0.0, 0.0],
    )


def gain(
    function: Any, method: str, program: Callable[[float], float] | None = None
) -> float:
    """Speed that an actuator gives in 10 s."""
    actuator = {"type": "actuator", "joint": "rail", "function": function}
    given = {} if program is None else {"f": program}
    system = compile_scene(flight(0.0, actuator, 10.0), forces=given)
    result = simulate(system, integrator=method, rtol=LOOSE.get(method, 1e-6))
    return float(result["block.vx"][-1])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("part", [1e-2, 1e-3])
def test_no_smooth_pulse_is_passed(method: str, part: float) -> None:
    """The block gets its impulse over its mass, wherever the pulse lies."""
    width = 10.0 * part / 6.0
    for middle in np.random.default_rng(int(1 / part)).uniform(0.5, 9.5, 2):

        def push(t: float, middle: float = middle) -> float:
            return 500.0 * math.exp(-0.5 * ((t - middle) / width) ** 2)

        exact = 500.0 * width * math.sqrt(2.0 * math.pi) / MASS
        found = gain({"type": "callable"}, method, push)
        assert found == pytest.approx(exact, rel=1e-3)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("width", [1.0, 0.02])
def test_no_single_value_of_a_table_is_passed(method: str, width: float) -> None:
    """A spline that is zero but at one time."""
    times = np.arange(0.0, 10.0 + 0.5 * width, width)
    times = times if width == 1.0 else np.array([0, 3.3, 3.32, 3.34, 3.36, 3.38, 10.0])
    values = np.where(np.arange(len(times)) == 3, 40.0, 0.0)
    curve = PchipInterpolator(times, values)
    pieces = [
        {"from": a, "to": b, "coefficients": c[::-1].tolist()}
        for (a, b), c in zip(pairwise(times), curve.c.T, strict=True)
    ]
    exact = float(curve.integrate(0.0, 10.0)) / MASS
    found = gain({"type": "polynomial", "pieces": pieces}, method)
    assert found == pytest.approx(exact, rel=1e-3)


def test_a_harmonic_with_the_period_of_the_first_step_is_no_constant() -> None:
    """After whole periods the mean force is left."""
    rtol, phase = 0.1, 0.5 * math.pi
    harmonic = {"type": "harmonic", "offset": 3.0, "amplitude": 3.0, "phase": phase}
    period = 1e-4 * rtol**0.25
    function = {**harmonic, "frequency": 1.0 / period}
    actuator = {"type": "actuator", "joint": "rail", "function": function}
    system = compile_scene(flight(0.0, actuator, 1.0))
    result = simulate(system, integrator="trapezoidal", rtol=rtol)
    assert result["block.vx"][-1] == pytest.approx(3.0 / MASS, rel=1e-3)


def detent(
    at: float, width: float, height: float, interpolation: str = "linear"
) -> tuple[dict[str, Any], float]:
    """A force against the motion between at and at + width, and its work."""
    x = at + width * np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    x = np.concatenate([[at - 5.0], x, [at + 5.0]])
    y = height * np.array([0.0, 0.0, 0.6, 1.0, 0.6, 0.0, 0.0])
    force = {
        "type": "spring_damper",
        "joint": "rail",
        "table": {
            "deflection": x.tolist(),
            "force": y.tolist(),
            "interpolation": interpolation,
        },
    }
    if interpolation == "linear":
        return force, float(trapezoid(y, x))
    return force, float(PchipInterpolator(x, y).integrate(x[0], x[-1]))


@pytest.mark.parametrize("interpolation", ["linear", "smooth"])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("part", "speed"), [(0.05, 1.0), (0.02, -3.0), (2e-3, 2.0)])
def test_no_zone_of_a_spring_is_passed(
    method: str, part: float, speed: float, interpolation: str
) -> None:
    """Flown through, it takes its work from the energy."""
    way = abs(speed) * 10.0
    for at in np.random.default_rng(5).uniform(0.1 * way, 0.8 * way, 2):
        height = math.copysign(0.15 * MASS * speed**2 / (part * way), speed)
        begin = at if speed > 0.0 else -at - part * way
        force, work = detent(begin, part * way, height, interpolation)
        exact = math.sqrt(speed**2 - 2.0 * abs(work) / MASS)
        rtol = LOOSE.get(method, 1e-6)
        system = compile_scene(flight(speed, force, 10.0))
        result = simulate(system, integrator=method, rtol=rtol)
        assert abs(result["block.vx"][-1]) == pytest.approx(exact, rel=2e-3)


@pytest.mark.parametrize("method", ["radau5", "radau9", "dop853"])
def test_no_zone_is_touched_and_left_unseen(method: str) -> None:
    """A throw just reaches a zone whose force is stronger than gravity: it goes on."""
    speed, height = 20.0, 20.0**2 / 10.0
    zone = np.array([height - 9.0, height - 0.04, height - 0.03, height + 1.0])
    push = -9.0 * MASS * np.array([0.0, 0.0, 1.0, 1.0])
    table = {"deflection": zone.tolist(), "force": push.tolist()}
    spring = {"type": "spring_damper", "joint": "rail", "table": table}
    free = flight(speed, {**spring, "table": {**table, "force": [0.0] * 4}}, 10.0, True)
    held = compile_scene(flight(speed, spring, 10.0, True))
    assert simulate(held, integrator=method, rtol=1e-6)["block.vx"][-1] > 0.0
    fallen = simulate(compile_scene(free), integrator=method, rtol=1e-6)
    assert fallen["block.vx"][-1] == pytest.approx(-30.0, rel=1e-9)


@pytest.mark.parametrize(
    ("function", "most"),
    [(np.square, 7), (np.sin, 12), (lambda x: np.where(x < 0.3, 0.0, x - 0.3), 12)],
)
def test_smooth_tables_are_few_pieces(function: Any, most: int) -> None:
    """A spring that is told at many points is no obstacle."""
    x = np.linspace(-1.0, 3.0, 200)
    curve = PchipInterpolator(x, function(x))

    def value(g: Array) -> Array:
        return np.asarray(curve(g))

    assert len(characteristic_features(value, x).starts) <= most + 2


def braked(
    middle: float, depth: float, speed: float, brake: float
) -> tuple[Any, float]:
    """A block under dry friction whose speed dips to zero at about `middle` [s].

    Pushed by brake + 2 k m (t - middle), its speed is k (t - middle)^2 - depth while it
    slides. Once it stands, the push is below the limit of friction until `middle`: it
    goes on from rest then. Returns the scene, and its speed at the end without creep.
    """
    k = 0.05
    forces = {
        "push": {
            "type": "actuator",
            "joint": "rail",
            "function": polynomial(brake - 2.0 * k * MASS * middle, 2.0 * k * MASS),
        },
        "brake": {"type": "friction", "joint": "rail", "force": brake, "speed": speed},
    }
    content = flight(k * middle**2 - depth, forces["push"], 10.0)
    table = content.model_dump(by_alias=True, exclude_none=True)
    return SceneFile.model_validate({**table, "forces": forces}), k * (
        10.0 - middle
    ) ** 2


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("speed", "brake"), [(1e-5, 0.05), (1e-6, 1.0)])
def test_no_zone_of_friction_is_passed(method: str, speed: float, brake: float) -> None:
    """A block that stands for 0.1 to 0.25 s of 10 s has lost nothing later."""
    rng = np.random.default_rng(3)
    for depth in (3e-3, 1e-3):
        for middle in rng.uniform(3.0, 8.0, 2):
            content, exact = braked(middle, depth, speed, brake)
            system = compile_scene(content)
            result = simulate(system, integrator=method, rtol=LOOSE.get(method, 1e-6))
            assert result["block.vx"][-1] == pytest.approx(exact, abs=0.1 * depth)


def passed(content: Any, method: str, step: float, **given: Any) -> dict[str, Any]:
    """Data of what fixed steps may have passed over; empty without such a thing."""
    result = simulate(compile_scene(content, **given), integrator=method, step=step)
    found = with_code(result, "N326")
    assert all(each.data["step"] == step for each in found) and len(found) <= 1
    return dict(found[0].data) if found else {}


@pytest.mark.parametrize("method", METHODS)
def test_fixed_steps_say_what_they_may_have_passed(method: str) -> None:
    """A pulse in time, a zone of a spring and one of friction; short steps see them."""

    def push(t: float) -> float:
        return 500.0 * math.exp(-0.5 * ((t - 3.3333) / 0.01) ** 2)

    actuator = {"type": "actuator", "joint": "rail", "function": {"type": "callable"}}
    pulse = flight(0.0, actuator, 10.0)
    zone = flight(-1.5, detent(-6.1, 0.1, -1.0)[0], 10.0)
    dip, _ = braked(6.21, 3e-5, 1e-6, 0.05)
    found = passed(pulse, method, 0.1, forces={"f": push})
    assert (found["names"], found["quantities"]) == (("f",), ("time",))
    assert found["lengths"] == pytest.approx([10.0 / 1024.0])
    assert found["times"] == (3.28125,)
    found = passed(zone, method, 0.1)
    assert (found["names"], found["quantities"]) == (("f",), ("deflection",))
    assert found["lengths"] == pytest.approx([0.025]) and found["counts"][0] >= 1
    found = passed(dip, method, 0.5)
    if INTEGRATORS[method].order > 2:
        assert (found["names"], found["quantities"]) == (("brake",), ("rate",))
        assert found["lengths"] == pytest.approx([2.67e-6], rel=2e-3)
        assert (found["counts"], found["times"]) == ((1,), (6.0,))
    else:  # a step knows the rates at its ends only
        assert not found
    assert not passed(pulse, method, 2e-3, forces={"f": push})
    assert not passed(zone, method, 2e-3)
    slow, _ = braked(6.05, 1e-3, 0.5, 0.05)
    assert not passed(slow, method, 0.01)
