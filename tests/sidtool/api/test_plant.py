"""Plants: scenes that a program advances, beside one run of the same motion."""

import pickle
import runpy
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

import sidtool
from sidtool.formats.base.sid import Array
from sidtool.solver.output.events import EventDetector
from tests.places import EXAMPLES

FOUNDING = Path("examples/slider_crank/slider_crank.toml")
TIMES = np.arange(1, 11) * 0.1
ARM_HANGING = {
    "mass": 2.0,
    "inertia": 0.05,
    "initial": {"position": [0.0, -0.4], "angle": -np.pi / 2},
    "markers": {"pivot": {"position": [-0.4, 0.0]}},
}
VALUES = 3.0 * np.sin(7.0 * TIMES)
INPUT_COMMAND = {"type": "input", "name": "command"}
#: Of the outputs of a plant and of a run with the same steps.
ROUNDING = 1e-12


def pendulum(**parts: Any) -> sidtool.Scene:
    """An arm on a motor, whose torque is the input `torque`."""
    content = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "gravity": [0.0, -9.81],
        "time": {"end": 1.0, "output_step": 0.1},
        "bodies": {
            "arm": {
                "mass": 2.0,
                "inertia": 0.05,
                "initial": {"position": [0.4, 0.0]},
                "markers": {"pivot": {"position": [-0.4, 0.0]}},
            }
        },
        "joints": {"pivot": {"type": "revolute", "markers": ["ground", "arm.pivot"]}},
        "inputs": {"torque": {}},
        "forces": {
            "motor": {
                "type": "actuator",
                "joint": "pivot",
                "function": {"type": "input", "name": "torque"},
            }
        },
        "accuracy": {"rtol": 1e-9},
        "outputs": {"record": ["pivot.angle", "pivot.angle_rate", "pivot.fy"]},
    }
    return sidtool.Scene.model_validate(content | parts)


def pendulum_with_friction() -> sidtool.Scene:
    """The same with dry friction, under which it comes to rest, and with an event."""
    joint = {"type": "revolute", "markers": ["ground", "arm.pivot"]}
    friction = {"coefficient": 0.3, "radius": 0.05, "static": 0.4}
    return pendulum(
        time={"end": 3.0, "output_step": 0.05},
        joints={"pivot": joint | {"friction": friction}},
        events={"level": {"quantity": "pivot.angle", "value": -0.3}},
    )


def run_in(plant: sidtool.Plant, times: Array) -> Array:
    rows = []
    for t in times:
        plant.advance_to(t)
        rows.append(plant.read(*plant.outputs))
    return np.array(rows)


@pytest.mark.parametrize("count", [7, 100, 1000])
def test_calls_of_any_length_make_the_steps_of_a_run(count: int) -> None:
    compiled = sidtool.Scene.load(FOUNDING).with_({"time.end": 0.3}).compile()
    expected = compiled.run({"time.output_step": 0.3 / count})
    found = run_in(compiled.plant(), expected.t[1:])
    scale = np.abs(expected.values).max(axis=0)
    assert np.abs(found - expected.values[1:]).max() < ROUNDING * scale.max()
    assert np.all(np.abs(found - expected.values[1:]).max(axis=0) < 1e-9 * scale)


def follow(plant: sidtool.Plant, values: Array) -> Array:
    """Angles after each tenth of a second, for values that an input reaches then."""
    rows = []
    for value in values:
        plant.set(torque=value)
        plant.advance(0.1)
        rows.append(plant["pivot.angle"])
    return np.array(rows)


@pytest.mark.parametrize("kind", ["hold", "linear"])
def test_an_input_acts_as_its_table_in_a_run(kind: str) -> None:
    """Steps end at the jumps and corners in both, so that they are the same."""
    scene = pendulum(inputs={"torque": {"interpolation": kind}})
    if kind == "hold":
        table = np.append(0.0, TIMES[:-1]), VALUES
    else:
        table = np.append(0.0, TIMES), np.append(0.0, VALUES)
    expected = scene.simulate(inputs={"torque": table})["pivot.angle"][1:]
    found = follow(scene.compile().plant(), VALUES)
    assert np.abs(found - expected).max() < ROUNDING


def test_a_table_of_the_scene_is_for_runs() -> None:
    table = {"times": [0.0, 0.5], "values": [1.0, 5.0], "initial": 2.0}
    plant = pendulum(inputs={"torque": table}).compile().plant()
    plant.advance(0.7)
    assert plant.inputs == {"torque": 2.0} and plant["inputs.torque"] == 2.0
    plant.set(torque=3.0)
    plant.advance(0.1)
    assert plant["motor.torque"] == pytest.approx(3.0)


def test_a_smooth_input_follows_a_ramp_without_a_lag() -> None:
    """Its value and its rate are continuous."""
    scene = pendulum(inputs={"torque": {"interpolation": "smooth"}})
    plant = scene.compile().plant()
    ramp = 2.0 * TIMES
    found = follow(plant, ramp)
    table = np.append(0.0, TIMES), np.append(0.0, ramp)
    linear = pendulum(inputs={"torque": {"interpolation": "linear"}})
    expected = linear.simulate(inputs={"torque": table})["pivot.angle"][1:]
    # in the first step the rate of the input rises from zero
    assert np.abs(found - expected)[0] > 1e-6
    plant.reset()
    plant.set(torque=0.2)
    plant.advance(0.1)
    before = plant.inputs["torque"]
    plant.set(torque=0.4)
    plant.advance(0.05)
    assert before == pytest.approx(0.2, abs=ROUNDING)


@pytest.mark.parametrize("length", [0.02, 0.01])
def test_a_smooth_position_accelerates_as_its_signal(length: float) -> None:
    """A mass follows A (1 - cos(w t)): the force of the drive is m A w^2 cos(w t).

    The values of steps of length h determine it to 2 h m A w^3.
    """
    amplitude, omega, mass = 0.1, 6.0, 2.0
    scene = sidtool.Scene(
        dimension="planar",
        time={"end": 1.0, "output_step": 0.1},
        accuracy={"rtol": 1e-9},
        inputs={"command": {"interpolation": "smooth"}},
        bodies={"cart": {"mass": mass, "inertia": 0.1}},
        joints={"rail": {"type": "prismatic", "markers": ["ground", "cart"]}},
        drives={"servo": {"joint": "rail", "function": INPUT_COMMAND}},
    )
    plant = scene.compile().plant(outputs=["servo.force", "cart.x", "cart.vx"])
    for k in range(1, round(1.0 / length) + 1):
        angle = omega * k * length
        command = amplitude * (1.0 - np.cos(angle))
        plant.set(command=float(command))
        plant.advance(length)
        third = mass * amplitude * omega**3
        force = mass * amplitude * omega**2 * np.cos(angle)
        rate = amplitude * omega * np.sin(angle)
        assert plant["servo.force"] == pytest.approx(force, abs=2.01 * length * third)
        assert plant["cart.vx"] == pytest.approx(rate, abs=length**2 * third / mass)
        assert plant["cart.x"] == pytest.approx(command, abs=ROUNDING)


def test_inputs_that_jump_between_steps_act_at_their_time() -> None:
    """A constant torque alone: the motion is that of closed form to the tolerance."""
    scene = pendulum(gravity=[0.0, 0.0])
    plant = scene.compile().plant()
    inertia, angle, rate = 0.05 + 2.0 * 0.4**2, 0.0, 0.0
    rng = np.random.default_rng(1)
    for _ in range(40):
        torque, span = float(rng.uniform(-5.0, 5.0)), float(rng.uniform(0.001, 0.04))
        if rng.uniform() < 0.5:  # else it stays, and steps go over the time
            plant.set({"torque": torque})
        acceleration = plant.inputs["torque"] / inertia
        if plant.time + span > plant.end:
            break
        plant.advance(span)
        angle += rate * span + 0.5 * acceleration * span**2
        rate += acceleration * span
        assert plant["pivot.angle"] == pytest.approx(angle, abs=1e-8)
        assert plant["pivot.angle_rate"] == pytest.approx(rate, abs=1e-8)


def flexible_rod() -> sidtool.Scene:
    return sidtool.Scene.load(FOUNDING).with_({"time.end": 0.2})


def _moved(plant: sidtool.Plant, spans: Array, torques: Array) -> tuple[Array, Any]:
    """Outputs after each of some time spans, and the events so far."""
    rows = []
    for span, torque in zip(spans, torques, strict=True):
        if "torque" in plant.inputs and torque > 0.0:
            plant.set(torque=torque)
        plant.advance(span)
        rows.append(plant.read(*plant.outputs))
    return np.array(rows), plant.events


@pytest.mark.parametrize(
    ("scene", "instants"), [(flexible_rod, 20), (pendulum_with_friction, 6)]
)
def test_a_saved_state_goes_on_to_the_last_bit(
    scene: Callable[[], sidtool.Scene], instants: int
) -> None:
    """At random instants, over events and changes of friction, with jumps of inputs."""
    plant = scene().compile().plant()
    rng = np.random.default_rng(2)
    for _ in range(instants):
        plant.reset()
        plant.advance(float(rng.uniform(0.0, 0.8 * plant.end)))
        state, spans = plant.state(), rng.uniform(0.0, 0.02 * plant.end, 8)
        torques = rng.uniform(-3.0, 3.0, 8)

        expected, events = _moved(plant, spans, torques)
        plant.restore(pickle.loads(pickle.dumps(state)))
        found, events_again = _moved(plant, spans, torques)
        assert np.array_equal(found, expected)
        assert events_again == events


def test_a_state_goes_on_in_another_plant() -> None:
    compiled = pendulum_with_friction().compile()
    one, other = compiled.plant(), compiled.plant()
    one.set(torque=1.0)
    one.advance(0.83)
    other.restore(pickle.loads(pickle.dumps(one.state())))
    for plant in (one, other):
        plant.advance(0.4)
    assert np.array_equal(one.read("pivot.angle"), other.read("pivot.angle"))


def test_friction_and_events_are_those_of_a_run() -> None:
    scene = pendulum_with_friction()
    expected = scene.simulate()
    plant = scene.compile().plant()
    found = run_in(plant, expected.t[1:])
    assert np.abs(found - expected.values[1:])[:, :2].max() < 1e-7
    kinds = [(event.name, event.kind) for event in plant.events]
    assert kinds == [(event.name, event.kind) for event in expected.events]
    assert len(kinds) >= 4
    times = [[event.t for event in each.events] for each in (plant, expected)]
    assert np.abs(np.subtract(*times)).max() < 1e-7


def test_outputs_at_the_start_are_those_of_a_run() -> None:
    """Friction and samples are decided there: a box rests where it is, not at zero."""
    law = {"type": "expression", "value": "torque - 6*arm.wz - 2", "sample_time": 0.02}
    box = {"mass": 0.5, "inertia": 1e-3, "initial": {"position": [0.3, 0.1]}}
    pin = {"type": "revolute", "markers": ["ground", "arm.pivot"]}
    rail = {"type": "prismatic", "axis": [1.0, 0.0], "friction": {"coefficient": 0.2}}
    ground = {"markers": {"rail": {"position": [0.0, 0.1]}}}
    record = ["box.x", "rail.displacement", "rail.friction", "motor.value", "pivot.fy"]
    arm = pendulum().bodies["arm"].model_dump(by_alias=True, exclude_none=True)
    scene = pendulum(
        ground=ground,
        bodies={"arm": arm, "box": box},
        joints={"pivot": pin, "rail": rail | {"markers": ["ground.rail", "box"]}},
        forces={
            "motor": {"type": "actuator", "joint": "pivot", "function": law},
            "push": {"type": "force", "marker": "box", "force": [0.4, 0.0]},
        },
        outputs={"record": record},
    )
    result, plant = scene.simulate(), scene.compile().plant()
    for _ in range(2):
        start = plant.read(*record)
        np.testing.assert_allclose(start, result.values[0], rtol=1e-9, atol=1e-9)
        plant.advance(0.5)
        assert plant["box.x"] == pytest.approx(0.3, abs=1e-9)
        plant.reset()


def test_an_unloaded_bearing_does_not_move(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing turns or loads the vertical axis of an arm that falls in a plane. What
    asymmetries of its mesh in the 12th digit do there once let it slip and stick
    without end."""
    folder = tmp_path / "arm"
    shutil.copytree(EXAMPLES / "robot_arm", folder)
    monkeypatch.chdir(folder)
    runpy.run_path("mesh.py", run_name="__main__")
    sid = sidtool.convert(sidtool.Model.load(folder / "arm.toml"))
    content = sidtool.Scene.load(folder / "scene.toml").model_dump(
        by_alias=True, exclude_none=True
    )
    del content["drives"], content["initial"]
    content["outputs"]["record"] = ["yaw.angle"]
    for name, torque in (("yaw", 0.0), ("shoulder", -95.0), ("elbow", -20.0)):
        friction = {"coefficient": 0.1, "static": 0.15, "radius": 0.05}
        content["joints"][name]["friction"] = friction
        content["forces"][name] = {
            "type": "actuator",
            "joint": name,
            "function": {"type": "constant", "value": torque},
        }
    scene = sidtool.Scene.model_validate(content)
    plant = scene.compile(sids={"upper": sid, "forearm": sid}).plant()
    plant.advance(0.01)
    assert abs(plant["yaw.angle"]) < 1e-12
    assert not any(event.name == "yaw" for event in plant.events)


def test_events_cost_no_more_where_a_program_looks_often(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Steps are searched once, not at each call; events are those of a run."""
    scene = pendulum(events={"level": {"quantity": "pivot.angle", "value": -0.3}})
    expected = [(e.name, e.kind, e.t) for e in scene.simulate().events]
    searches = list[int]()
    find = EventDetector._distances_to_values

    def counted(detector: EventDetector, t: Array, z: Array, v: Array) -> Array:
        searches.append(len(t))
        return find(detector, t, z, v)

    monkeypatch.setattr(EventDetector, "_distances_to_values", counted)
    plant, counts = scene.compile().plant(), list[int]()
    for calls in (10, 1000):
        plant.reset()
        searches.clear()
        for k in range(1, calls + 1):
            plant.advance_to(k / calls)
        counts.append(len(searches))
        found = [(e.name, e.kind) for e in plant.events]
        assert found == [each[:2] for each in expected] and found
        times = [e.t for e in plant.events]
        np.testing.assert_allclose(times, [each[2] for each in expected], rtol=1e-12)
    assert counts[1] < 2 * counts[0]  # more in steps with an event alone


@pytest.mark.parametrize("calls", [13, 250])
def test_sampled_laws_are_sampled_at_their_times(calls: int) -> None:
    """Whether calls end at the samples or not; rounding of times does not decide."""
    law = {
        "type": "expression",
        "value": "torque - 6*pivot.angle - pivot.angle_rate",
        "sample_time": 0.02,
    }
    motor = {"type": "actuator", "joint": "pivot", "function": law}
    scene = pendulum(forces={"motor": motor}, gravity=[0.0, -1.0])
    expected = scene.simulate()["pivot.angle"][-1]
    plant = scene.compile().plant()
    for _ in range(calls):
        plant.advance(1.0 / calls)
    assert plant.time == pytest.approx(1.0, abs=1e-12)
    assert plant["pivot.angle"] == pytest.approx(expected, abs=1e-8)


def test_small_motions_are_those_of_the_state_space() -> None:
    """Torques are held between samples, so that x' = Ad x + Bd u is exact there."""
    scene = pendulum(bodies={"arm": ARM_HANGING})
    space = scene.state_space(outputs=["pivot.angle", "pivot.angle_rate"])
    n, span = len(space.A), 0.02
    both = np.zeros((n + 1, n + 1))
    both[:n, :n], both[:n, n:] = space.A, space.B
    discrete = expm(span * both)[:n]
    plant = scene.compile().plant(rtol=1e-11)
    rest, x = plant.read("pivot.angle", "pivot.angle_rate"), np.zeros(n)
    difference, largest = 0.0, 0.0
    for torque in 1e-3 * np.sin(np.arange(40.0)):
        plant.set(torque=torque)
        plant.advance(span)
        x = discrete @ np.append(x, torque)
        moved = plant.read("pivot.angle", "pivot.angle_rate") - rest
        difference = max(difference, float(np.abs(moved - space.C @ x).max()))
        largest = max(largest, float(np.abs(moved).max()))
    assert difference < 1e-6 * largest


def test_an_event_ends_the_motion_until_it_is_reset() -> None:
    event = {"quantity": "pivot.angle", "value": -0.5, "action": "stop"}
    scene = pendulum(events={"low": event})
    expected = scene.simulate()
    plant = scene.compile().plant()
    start = plant.state()
    for _ in range(10):
        plant.advance(0.1)
        if plant.stopping_event:
            break
    assert plant.stopping_event == "low"
    assert plant.time == pytest.approx(expected.t[-1], abs=1e-9)
    assert plant["pivot.angle"] == pytest.approx(-0.5, abs=1e-8)
    with pytest.raises(sidtool.InputError, match="low"):
        plant.advance(0.1)
    plant.restore(start)
    plant.advance(0.01)
    assert not plant.stopping_event


@pytest.mark.parametrize(
    ("settings", "error"),
    [
        ({"integrator": "dop853"}, 1e-8),
        ({"integrator": "radau13"}, 1e-8),
        ({"integrator": "generalised_alpha", "step": 1e-3}, 1e-4),
        ({"integrator": "trapezoidal", "rtol": 1e-6}, 1e-4),
    ],
)
def test_all_integrators_advance_plants(settings: Any, error: float) -> None:
    scene = pendulum()
    expected = scene.simulate(rtol=1e-11)["pivot.angle"][1:]
    plant = scene.compile().plant(**settings)
    assert np.abs(run_in(plant, TIMES)[:, 0] - expected).max() < error


def test_stiff_springs_change_the_method_as_in_a_run() -> None:
    spring = {
        "type": "spring_damper",
        "joint": "pivot",
        "stiffness": 1e7,
        "damping": 1e5,
    }
    scene = pendulum(forces={"stop": spring}, accuracy={"integrator": "auto"})
    expected = scene.simulate()
    assert "then" in str(expected.settings["integrator"])
    plant = scene.compile().plant()
    found = run_in(plant, expected.t[1:])
    assert np.abs(found - expected.values[1:])[:, 0].max() < 1e-7


def test_a_reset_with_changes_is_a_run_with_them() -> None:
    compiled = pendulum().compile()
    plant = compiled.plant()
    plant.set(torque=4.0)
    plant.advance(0.3)
    changes = {"arm.mass": 3.0, "arm.initial.angular_velocity": 1.0}
    plant.reset(changes)
    expected = compiled.run(changes)
    assert plant.inputs == {"torque": 0.0}
    assert np.abs(run_in(plant, TIMES) - expected.values[1:]).max() < 1e-9
    plant.reset()
    assert plant.time == 0.0
    assert plant["pivot.angle_rate"] == pytest.approx(expected.values[0, 1])


def test_outputs_that_are_not_recorded_can_be_read() -> None:
    plant = pendulum().compile().plant(["arm.x"])
    plant.advance(0.2)
    angle = plant["pivot.angle"]
    assert plant["arm.x"] == pytest.approx(0.4 * np.cos(angle))
    assert plant["arm.y"] == pytest.approx(0.4 * np.sin(angle))
    plant.set(torque=1.0)
    assert plant["inputs.torque"] == 1.0
    assert plant["motor.torque"] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("act", "text"),
    [
        (lambda p: p.set(speed=1.0), "speed"),
        (lambda p: p.set(torque=float("nan")), "nan"),
        (lambda p: p.set(torque="much"), "much"),
        (lambda p: p.advance(-0.1), "before"),
        (lambda p: p.advance(1.5), "end"),
        (lambda p: p["pivot.angel"], "angel"),
        (lambda p: p["energy.dissipated"], "integral"),
        (
            lambda p: p.restore(pendulum_with_friction().compile().plant().state()),
            "another",
        ),
    ],
)
def test_bad_calls_are_refused_and_change_nothing(
    act: Callable[[sidtool.Plant], Any], text: str
) -> None:
    plant = pendulum().compile().plant()
    with pytest.raises(sidtool.InputError, match=text):
        act(plant)
    plant.advance(0.1)
    assert plant.time == pytest.approx(0.1)
