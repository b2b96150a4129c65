"""What goes wrong with a law is named; no pulse of one is passed unseen."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.solver import Law, compile_scene, simulate
from sidtool.solver.system.errors import SimulationError
from tests.codes import codes, only
from tests.solver.functions.loops import GIVEN, METHODS, expression, pid, run
from tests.solver.functions.test_laws import READS, SPRING, pendulum
from tests.solver.scenes import scene, slender_rod


def stopped(law: Law, **more: Any) -> str:
    force = {"type": "actuator", "joint": "hinge", "function": GIVEN}
    with pytest.raises((SimulationError, InputError)) as caught:
        run(pendulum(force), {"motor": law}, **more)
    return str(caught.value)


def test_a_callable_that_fails_is_named_with_its_words() -> None:
    text = stopped(Law(lambda t, y: math.sqrt(0.5 - t), ["hinge.angle"]))
    assert "stopped at t = 0.5 s: N509 the law of motor" in text
    assert "ValueError" in text and "hinge.angle = " in text
    table = {0.0: 1.0}
    text = stopped(Law(lambda t, y: table[t], READS))
    assert "the law of motor fails with KeyError: " in text
    text = stopped(Law(lambda t, y: float("x" in table) / 0.0 * 0.0, READS))
    assert "forces: the law of motor" in text and "at t = 0 s" in text
    assert "hinge.angle = 0.4, hinge.angle_rate = 0" in text


TABLE: dict[str, Any] = {"1": "1.0", "yes": True}


@pytest.mark.parametrize(
    "function",
    [
        lambda t, y: y[0] > 0.0,
        lambda t, y: "1.0",
        lambda t, y: TABLE["1"],
        lambda t, y: TABLE["yes"],
    ],
    ids=["compiled truth", "compiled text", "text", "truth"],
)
def test_texts_and_truth_values_are_no_numbers(function: Any) -> None:
    for sample_time in (None, 0.1):
        text = stopped(Law(function, READS, sample_time=sample_time))
        assert "the law of motor fails with TypeError" in text and "t = 0 s" in text
    made = pendulum({"type": "actuator", "joint": "hinge", "function": GIVEN})
    with pytest.raises(InputError, match="no real number"):
        compile_scene(made, forces={"motor": lambda t: function(t, [1.0])})


@pytest.mark.parametrize("late", ["value", "derivatives"])
def test_an_exception_in_a_rejected_step_is_noted(late: str) -> None:
    """The motion is that of the law without it."""
    raised: list[float] = []

    def damping(t: float, y: Array) -> float:
        if late == "value" and t > 0.5 and not raised and y[0] != 1.0:
            raised.append(t)
            raise KeyError("lost")
        return float(-0.1 * y[1])

    def slopes(t: float, y: Array) -> list[float]:
        if late == "derivatives":
            raised.append(t)
            raise KeyError("lost")
        return [0.0, -0.1]

    force = {"type": "actuator", "joint": "hinge", "function": GIVEN}
    found = run(pendulum(force), {"motor": Law(damping, READS, slopes)}, rtol=1e-9)
    known = run(pendulum(SPRING | {"stiffness": 0.0, "damping": 0.1}), rtol=1e-9)
    assert raised and found.completed
    reason = str(only(found, "N510").data["reason"])
    assert all(word in reason for word in ("motor", "KeyError", "lost"))
    assert "N510" not in codes(known)
    np.testing.assert_allclose(found.values[-1], known.values[-1], atol=1e-7)


@pytest.mark.parametrize("method", METHODS)
def test_a_formula_that_gives_no_number_is_named(method: str) -> None:
    force = {
        "type": "actuator",
        "joint": "hinge",
        "function": expression("log(hinge.angle + 0.2)"),
    }
    with pytest.raises(SimulationError, match="N509 the law of motor"):
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


def nothing(t: float, y: Array) -> float:
    return 0.0


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (Law(nothing, "hinge.angle"), "no sequence of names; expected reads="),
        (Law(nothing, ["hinge.angle"] * 2), "a law reads an output twice"),
        (
            Law(nothing, ["rod.q*"]),
            "'rod.q.', which is all of them; expected one",
        ),
        (Law(nothing, READS, limits=(1.0, 1.0)), "found limits"),
        (Law(nothing, READS, limits=("0", "1")), "found limits"),  # type: ignore
        (Law(nothing, READS, sample_time=True), "found a sample time of True"),
        (Law(nothing, READS, states={"s": (True, nothing)}), "an initial number"),
        (Law(nothing, READS, states={"s": ("1.0", nothing)}), "an initial number"),  # type: ignore
        (Law(nothing, READS, sample_time=0.0), "found a sample time of 0"),
        (
            Law(nothing, READS, states={"slow": (0.0, 1.0)}),
            "found 1.0; expected a call",
        ),
        (Law(nothing, READS, states={"slow": nothing}), "slow: found .*an initial"),
    ],
)
def test_laws_of_a_program_that_are_not_sound_are_refused(law: Law, words: str) -> None:
    force = {"type": "actuator", "joint": "hinge", "function": GIVEN}
    with pytest.raises(InputError, match=words):
        compile_scene(pendulum(force), forces={"motor": law})


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
    system = compile_scene(made, forces=laws)
    for method in ("radau9", "dop853"):
        found = simulate(system, integrator=method, rtol=1e-7)
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
