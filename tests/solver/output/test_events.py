"""Events: when they happen, in closed form, and what they leave alone."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import ellipk

from sidtool.formats.base.errors import InputError
from sidtool.formats.result import Event, Result, read_result, write_result
from sidtool.solver import simulate
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.solver.system.errors import SimulationError
from sidtool.solver.system.system import System
from tests.solver.scenes import GRAVITY, compiled, polynomial, scene, soft_body

DOWN = [0.0, -GRAVITY]
HEIGHT, SPEED = 2.0, 3.0
#: Of a ball thrown upwards.
APEX = SPEED / GRAVITY
LANDING = (SPEED + math.sqrt(SPEED**2 + 2.0 * GRAVITY * HEIGHT)) / GRAVITY


def ball(end: float = 2.0, **events: Any) -> System:
    body = {"mass": 1.0, "initial": {"position": [0.0, HEIGHT], "velocity": [1.0, 3.0]}}
    record = ["ball.x", "ball.y"]
    described = scene(
        {"ball": body}, end=end, record=record, gravity=DOWN, events=events
    )
    return compiled(described)


def of(result: Result, name: str) -> list[Event]:
    return [event for event in result.events if event.name == name]


@pytest.mark.parametrize("integrator", sorted(INTEGRATORS))
def test_a_falling_ball_passes_heights_and_lands(integrator: str) -> None:
    """Methods of order 2 and more are exact here: to rounding of the dense output."""
    system = ball(
        apex={"quantity": "ball.vy"},
        height={"quantity": "ball.y", "value": 2.2},
        landing={"quantity": "ball.y", "action": "stop"},
    )
    result = simulate(system, integrator=integrator)
    root = math.sqrt(SPEED**2 - 2.0 * GRAVITY * 0.2)
    heights = [(SPEED - root) / GRAVITY, (SPEED + root) / GRAVITY]
    assert [e.t for e in of(result, "height")] == pytest.approx(heights, abs=1e-12)
    assert [e.kind for e in of(result, "height")] == ["rising", "falling"]
    assert [e.t for e in of(result, "apex")] == pytest.approx([APEX], abs=1e-12)
    assert of(result, "landing")[0].t == pytest.approx(LANDING, abs=1e-12)
    assert [e.t for e in result.events] == sorted(e.t for e in result.events)


def test_a_stop_ends_the_run_with_the_state_there() -> None:
    stop = {"quantity": "ball.y", "action": "stop"}
    result = simulate(ball(landing=stop))
    assert result.completed
    assert "landing ended the run" in result.message
    assert result.t[-1] == of(result, "landing")[0].t
    assert result.t[:-1] == pytest.approx(0.2 * np.arange(6), abs=1e-12)
    assert abs(result["ball.y"][-1]) < 1e-14
    assert result["ball.x"][-1] == pytest.approx(LANDING, abs=1e-12)
    assert result.positions.shape[0] == len(result.t)
    event = of(result, "landing")[0]
    assert event.values == pytest.approx(result.values[-1], abs=1e-14)
    assert event.positions == pytest.approx(result.positions[-1], abs=1e-14)


def oscillator(end: float = 10.0, **events: Any) -> System:
    """A mass of 1 kg on a spring of pi^2 N/m: y = cos(pi t)."""
    mass = {"mass": 1.0, "initial": {"position": [3.0, 0.0]}}
    spring = {
        "type": "spring_damper",
        "markers": ["ground", "mass"],
        "stiffness": math.pi**2,
        "rest": 2.0,
    }
    described = scene(
        {"mass": mass},
        end=end,
        record=["mass.x"],
        forces={"spring": spring},
        events=events,
    )
    return compiled(described)


@pytest.mark.parametrize("integrator", ["radau5", "radau13", "dop853"])
def test_directions_and_counts(integrator: str) -> None:
    """Crossings of the rest length at 0.5, 1.5, ... by turns."""
    middle = {"quantity": "mass.x", "value": 2.0}
    system = oscillator(
        all=middle,
        rising=middle | {"direction": "rising"},
        falling=middle | {"direction": "falling", "count": 2},
        fourth=middle | {"action": "stop", "count": 4},
    )
    result = simulate(system, integrator=integrator, rtol=1e-11)
    times = {
        "all": [0.5, 1.5, 2.5, 3.5],
        "rising": [1.5, 3.5],
        "falling": [0.5, 2.5],
        "fourth": [0.5, 1.5, 2.5, 3.5],
    }
    for name, expected in times.items():
        assert [e.t for e in of(result, name)] == pytest.approx(expected, abs=1e-9)
    assert result.t[-1] == pytest.approx(3.5, abs=1e-9)


def test_a_start_on_the_value_and_a_touch_are_no_crossings() -> None:
    """The mass starts at 3 and comes back there, without passing it."""
    system = oscillator(start={"quantity": "mass.x", "value": 3.0})
    assert simulate(system, rtol=1e-10).events == ()


@pytest.mark.parametrize("integrator", ["radau5", "radau9", "dop853"])
def test_the_quarter_period_of_a_large_pendulum(integrator: str) -> None:
    """From rest in the horizontal to the lowest point: K(sin 45) / omega."""
    rod = {"type": "distance", "markers": ["ground", "bob"], "length": 1.0}
    bob = {"mass": 1.0, "initial": {"position": [-1.0, 0.0]}}
    lowest = {"quantity": "bob.x", "direction": "rising"}
    described = scene(
        {"bob": bob}, {"rod": rod}, end=2.0, gravity=DOWN, events={"lowest": lowest}
    )
    quarter = ellipk(0.5) / math.sqrt(GRAVITY)
    result = simulate(compiled(described), integrator=integrator, rtol=1e-12)
    assert [e.t for e in result.events] == pytest.approx([quarter], abs=1e-9)


def test_events_of_elastic_coordinates_joint_forces_and_energies() -> None:
    """A body in free flight turns in space while it vibrates."""
    initial = {"elastic": [0.05], "angular_velocity": [0.0, 0.0, 0.1]}
    events = {
        "middle": {"quantity": "body.q1"},
        "strain": {"quantity": "energy.elastic", "value": 1e-3},
    }
    described = scene(
        {"body": {"sid": "-", "initial": initial}},
        end=5.0,
        dimension="spatial",
        record=["body.q1"],
        events=events,
    )
    sid = soft_body(1, seed=1, planar=False, damped=False)
    result = simulate(compiled(described, body=sid), rtol=1e-9)
    middles, strains = of(result, "middle"), of(result, "strain")
    assert len(middles) > 2
    assert max(abs(e.values[0]) for e in middles) < 1e-9
    assert len(strains) in (2 * len(middles) - 1, 2 * len(middles))
    stiffness = float(sid.Ke.m0[0, 0])
    amplitudes = [abs(e.values[0]) for e in strains]
    assert amplitudes == pytest.approx(
        [math.sqrt(2e-3 / stiffness)] * len(strains), rel=1e-9
    )


@pytest.mark.parametrize("integrator", sorted(INTEGRATORS))
def test_events_change_no_digit_of_the_motion(integrator: str) -> None:
    rtol = 1e-6 if INTEGRATORS[integrator].order > 2 else 1e-4
    plain, watched = (
        simulate(oscillator(**events), integrator=integrator, rtol=rtol)
        for events in ({}, {"middle": {"quantity": "mass.x", "value": 2.0}})
    )
    assert np.array_equal(plain.values, watched.values)
    assert np.array_equal(plain.positions, watched.positions)
    assert plain.counters["steps"] == watched.counters["steps"]


def test_what_lies_behind_a_stop_does_no_harm() -> None:
    """A point between a rod of 1.2 m and one that grows until both are stretched."""
    more: dict[str, Any] = {"ground": {"markers": {"p": {"position": [1.5, 0.0]}}}}
    bodies = {"a": {"mass": 1.0, "initial": {"position": [0.35, 0.35]}}}
    joints = {
        "rod": {"type": "distance", "markers": ["ground.p", "a"], "length": 1.2},
        "growing": {"type": "distance", "markers": ["ground", "a"]},
    }
    drives = {"growth": {"joint": "growing", "function": polynomial(0.5, 1.0)}}
    with pytest.raises(SimulationError, match="t = 2.2"):
        simulate(compiled(scene(bodies, joints, drives, end=5.0, **more)))
    for x in (1.0, 2.699):
        stop = {"far": {"quantity": "a.x", "value": x, "action": "stop"}}
        described = scene(bodies, joints, drives, end=5.0, **more, events=stop)
        result = simulate(compiled(described))
        assert result.completed
        radius = math.sqrt(1.2**2 - (x - 1.5) ** 2 + x**2)
        assert result.t[-1] == pytest.approx(radius - 0.5, abs=1e-6)


def test_breaks_are_events_with_the_name_of_their_drive() -> None:
    body = {"mass": 1.0, "initial": {"position": [0.0, 0.0]}}
    pieces = [
        {"from": 0.0, "to": 0.25, "coefficients": [1.0]},
        {"from": 0.25, "coefficients": [-1.0]},
    ]
    push = {
        "type": "force",
        "marker": "body",
        "force": [1.0, 0.0],
        "function": {"type": "polynomial", "pieces": pieces},
    }
    described = scene({"body": body}, forces={"push": push}, record=["body.vx"])
    (event,) = simulate(compiled(described)).events
    assert (event.name, event.kind, event.t) == ("push", "break", 0.25)
    assert event.values == pytest.approx([0.25], abs=1e-12)


def test_events_are_kept_in_files(tmp_path: Path) -> None:
    result = simulate(ball(apex={"quantity": "ball.vy"}))
    write_result(tmp_path / "r.h5", result)
    (back,) = read_result(tmp_path / "r.h5").events
    (event,) = result.events
    assert (back.name, back.kind, back.t) == (event.name, event.kind, event.t)
    for key in ("values", "positions", "velocities"):
        assert np.array_equal(getattr(back, key), getattr(event, key))


@pytest.mark.parametrize(
    ("quantity", "problem"),
    [
        ("ball.speed", "found 'ball.speed'"),
        ("bal.x", "there is no body 'bal'"),
        ("energy.dissipated", "nothing that an event can look at"),
        ("constraint.position", "nothing that an event can look at"),
        ("ball.q*", "rigid"),
    ],
)
def test_what_an_event_cannot_look_at_is_refused(quantity: str, problem: str) -> None:
    with pytest.raises(InputError, match=problem) as caught:
        ball(wrong={"quantity": quantity})
    assert caught.value.place == "events.wrong.quantity"


def test_events_at_the_instant_of_a_stop_are_kept() -> None:
    """In whatever order they are named; what comes later is not."""
    for names in (("a", "b", "c"), ("c", "b", "a")):
        table = {
            "a": {"quantity": "ball.x", "value": 1.0, "action": "stop"},
            "b": {"quantity": "ball.x", "value": 1.0},
            "c": {"quantity": "ball.x", "value": 1.001},
        }
        ball = {"mass": 1.0, "initial": {"velocity": [2.0, 0.0]}}
        events = {name: table[name] for name in names}
        result = simulate(compiled(scene({"ball": ball}, events=events)))
        assert sorted(e.name for e in result.events) == ["a", "b"]
        assert result.t[-1] == pytest.approx(0.5)
