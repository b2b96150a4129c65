"""Inputs of a scene: in forces, formulas and drives, from tables."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.formats.scene import unit_of
from tests.codes import unwrapped

INPUT = {"type": "input", "name": "command"}


def pendulum(**parts: Any) -> sidtool.Scene:
    """An arm of 2 kg on a joint with an axis across the plane."""
    content = {
        "dimension": "planar",
        "gravity": [0.0, -9.81],
        "time": {"end": 1.0, "output_step": 0.05},
        "bodies": {
            "arm": {
                "mass": 2.0,
                "inertia": 0.05,
                "initial": {"position": [0.4, 0.0]},
                "markers": {"pivot": {"position": [-0.4, 0.0]}},
            }
        },
        "joints": {"pivot": {"type": "revolute", "markers": ["ground", "arm.pivot"]}},
        "inputs": {"command": {}},
        "outputs": {"record": ["pivot.angle"]},
    }
    return sidtool.Scene.model_validate(content | parts)


def motor(function: Any) -> dict[str, Any]:
    return {"motor": {"type": "actuator", "joint": "pivot", "function": function}}


def servo(of: str, function: Any = INPUT) -> dict[str, Any]:
    return {"servo": {"joint": "pivot", "of": of, "function": function}}


TIMES = np.arange(10) * 0.1
VALUES = 3.0 * np.sin(7.0 * TIMES)
TABLE = {"command": (TIMES, VALUES)}


def constant_pieces() -> dict[str, Any]:
    ends = [*TIMES[1:].tolist(), None]
    return {
        "type": "polynomial",
        "pieces": [
            {"from": start, "coefficients": [value]} | ({"to": end} if end else {})
            for start, end, value in zip(TIMES.tolist(), ends, VALUES, strict=True)
        ],
    }


def factor_of(value: float) -> dict[str, Any]:
    return {"type": "expression", "value": f"{value}*command"}


@pytest.mark.parametrize(
    "function",
    [
        INPUT,
        factor_of(1.0),
        {"type": "expression", "value": "inputs.command"},
        {"type": "sum", "parts": [INPUT, {"type": "constant", "value": 0.0}]},
    ],
    ids=["function", "formula", "output name", "sum"],
)
def test_a_held_input_is_a_function_of_constant_pieces(function: Any) -> None:
    """To the last bit: the same steps, which end at the jumps."""
    found = pendulum(forces=motor(function)).simulate(inputs=TABLE)
    expected = pendulum(forces=motor(constant_pieces())).simulate()
    assert np.array_equal(found.positions, expected.positions)
    assert found.counters["steps"] == expected.counters["steps"]
    assert found.events == ()


def test_an_input_stays_at_its_initial_value_without_a_table() -> None:
    scene = pendulum(forces=motor(INPUT), inputs={"command": {"initial": 2.0}})
    expected = pendulum(forces=motor({"type": "constant", "value": 2.0}))
    assert np.array_equal(scene.simulate().positions, expected.simulate().positions)
    held = pendulum(forces=motor(INPUT)).simulate(inputs={"command": 2.0})
    assert np.array_equal(held.positions, scene.simulate().positions)


def test_a_number_takes_the_place_of_the_table_of_the_scene() -> None:
    table = {"times": [0.0, 0.5], "values": [1.0, 5.0]}
    scene = pendulum(forces=motor(INPUT), inputs={"command": table})
    scene = sidtool.Scene(**scene.model_dump(by_alias=True, exclude_none=True))
    result = scene.simulate(inputs={"command": 3.0})
    assert np.array_equal(result["inputs.command"], np.full(len(result.t), 3.0))


def test_before_its_first_time_a_held_input_has_its_initial_value() -> None:
    outputs = {"record": ["inputs.command"]}
    scene = pendulum(inputs={"command": {"initial": 5.0}}, outputs=outputs)
    result = scene.simulate(inputs={"command": ([0.52], [1.0])})
    expected = np.where(result.t < 0.52, 5.0, 1.0)
    assert np.array_equal(result["inputs.command"], expected)


def test_a_held_acceleration_adds_up_to_the_angle() -> None:
    """Exact for pieces of constant acceleration."""
    result = pendulum(drives=servo("acceleration")).simulate(inputs=TABLE)
    angle = rate = 0.0
    for acceleration in VALUES:
        angle += 0.1 * rate + 0.005 * acceleration
        rate += 0.1 * acceleration
    assert result["pivot.angle"][-1] == pytest.approx(angle, abs=1e-12)


def test_a_linear_rate_adds_up_to_the_angle() -> None:
    t = np.linspace(0.0, 1.0, 11)
    inputs = {"command": {"interpolation": "linear"}}
    scene = pendulum(drives=servo("rate"), inputs=inputs)
    result = scene.simulate(inputs={"command": (t, t**2)})
    assert result["pivot.angle"][-1] == pytest.approx(0.335, abs=1e-12)


def test_a_smooth_angle_is_that_of_its_table() -> None:
    t = np.linspace(0.0, 1.0, 21)
    inputs = {"command": {"interpolation": "smooth"}}
    scene = pendulum(drives=servo("value"), inputs=inputs)
    result = scene.simulate(inputs={"command": (t, np.sin(t))})
    assert np.allclose(result["pivot.angle"], np.sin(t), atol=1e-12)


def test_a_servo_follows_a_held_input_with_a_lag() -> None:
    """Critically damped, w = 20/s: 1 - (1 + w t) exp(-w t)."""
    lag = {"x": {"rate": "v"}, "v": {"rate": "400*(command - x) - 40*v"}}
    law = {"type": "expression", "value": "x", "states": lag}
    result = pendulum(drives=servo("value", law)).simulate(inputs={"command": 1.0})
    wt = 20.0 * result.t
    assert np.allclose(result["pivot.angle"], 1 - (1 + wt) * np.exp(-wt), atol=1e-6)


first_order = {"type": "expression", "value": "x", "states": {"x": {"rate": "command"}}}


@pytest.mark.parametrize(
    ("interpolation", "of", "function"),
    [
        ("hold", "value", INPUT),
        ("linear", "value", INPUT),
        ("hold", "rate", INPUT),
        ("hold", "rate", factor_of(2.0)),
        ("hold", "value", first_order),
    ],
)
def test_drives_refuse_inputs_that_jump(
    interpolation: str, of: str, function: Any
) -> None:
    inputs = {"command": {"interpolation": interpolation}}
    scene = pendulum(drives=servo(of, function), inputs=inputs)
    with pytest.raises(sidtool.InputError) as caught:
        scene.simulate()
    assert caught.value.place == "drives.servo.function"
    assert "command" in caught.value.problem
    assert "acceleration" in str(caught.value.expected)


def test_the_ends_of_a_table_hold_outside_of_its_times() -> None:
    """Straight lines, of an input as of the force itself."""
    table = {"interpolation": "linear", "times": [0.2, 0.4], "values": [1.0, 3.0]}
    inputs = {"command": table}
    by_input = pendulum(forces=motor(INPUT), inputs=inputs).simulate()
    by_force = pendulum(forces=motor({"type": "table"} | table)).simulate()
    expected = np.interp(by_input.t, table["times"], table["values"])
    assert by_input["motor.torque"] == pytest.approx(expected, abs=1e-12)
    assert by_force["motor.torque"] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("parts", "place"),
    [
        ({"forces": motor(INPUT | {"name": "torqe"})}, "forces.motor.function.name"),
        ({"parameters": {"command": 1.0}}, "inputs.command"),
        ({"inputs": {"t": {}}}, "inputs.t"),
        ({"inputs": {"sin": {}}}, "inputs.sin"),
        ({"inputs": {"command": {"times": [0.0]}}}, "inputs.command.values"),
        (
            {"inputs": {"command": {"times": [0.0, 0.0], "values": [1.0, 2.0]}}},
            "inputs.command.times",
        ),
        (
            {
                "inputs": {
                    "command": {
                        "times": [0.0, 0.5],
                        "values": [1.0, 2.0],
                        "interpolation": "smooth",
                    }
                }
            },
            "inputs.command.times",
        ),
        ({"outputs": {"record": ["inputs.torque"]}}, "outputs.record[0]"),
        (
            {"forces": motor(factor_of(1.0) | {"parameters": {"command": 1.0}})},
            "forces.motor.function.parameters.command",
        ),
    ],
)
def test_wrong_inputs_are_refused_with_their_key(
    parts: dict[str, Any], place: str
) -> None:
    with pytest.raises(sidtool.InputError) as caught:
        pendulum(**parts)
    assert caught.value.place == place


def test_an_unknown_input_of_a_run_is_refused() -> None:
    with pytest.raises(sidtool.InputError, match="comand"):
        pendulum().simulate(inputs={"comand": 1.0})
    with pytest.raises(sidtool.InputError, match="inputs.command"):
        pendulum().simulate(inputs={"command": ([0.0, 1.0], [1.0])})


def test_an_input_that_nothing_takes_is_told() -> None:
    codes = [d.code for d in pendulum().simulate().diagnostics]
    assert "N244" in codes
    used = pendulum(forces=motor(INPUT)).simulate().diagnostics
    assert "N244" not in [d.code for d in used]


def test_the_unit_of_an_input_is_stated_or_that_of_its_force() -> None:
    assert unit_of("inputs.command", pendulum(forces=motor(INPUT))) == "N m"
    stated = pendulum(inputs={"command": {"unit": "V"}})
    assert unit_of("inputs.command", stated) == "V"


def test_a_law_of_a_program_reads_an_input() -> None:
    forces = motor({"type": "callable"})
    law = sidtool.Law(lambda t, y: y[0], reads=["command"])
    found = pendulum(forces=forces).simulate(inputs=TABLE, forces={"motor": law})
    expected = pendulum(forces=motor(INPUT)).simulate(inputs=TABLE)
    assert np.allclose(found.positions, expected.positions, atol=1e-12)


def test_the_command_reads_tables_and_continues(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    scene = tmp_path / "arm.json"
    scene.write_text(
        pendulum(forces=motor(INPUT)).model_dump_json(by_alias=True), encoding="utf-8"
    )
    rows = [f"{t},{v}" for t, v in zip(TIMES, VALUES, strict=True)]
    (tmp_path / "all.csv").write_text("\n".join(["t,value", *rows]), encoding="utf-8")
    (tmp_path / "half.csv").write_text(
        "\n".join(["t,value", *rows[:5]]), encoding="utf-8"
    )
    command = ["simulate", "arm.json", "-o", "r.h5"]
    half = ["--input", "command=half.csv", "--set", "time.end=0.5"]
    assert run([*command, *half]) == 0
    assert run([*command, "--input", "command=all.csv", "--continue"]) == 0
    found = sidtool.read(tmp_path / "r.h5")
    assert json.loads(found.scene)["inputs"]["command"]["times"] == TIMES.tolist()
    expected = pendulum(forces=motor(INPUT)).simulate(inputs=TABLE)
    assert np.allclose(found["pivot.angle"], expected["pivot.angle"], atol=1e-5)
    metres = "t,value [m]\n0,1\n1,1\n"  # of what a motor takes as N m
    (tmp_path / "metres.csv").write_text(metres, encoding="utf-8")
    assert run([*command, "--force", "--input", "command=metres.csv"]) == 2
    assert "has the unit m" in unwrapped(capsys.readouterr().err)
    (tmp_path / "all.csv").write_text("t,value\n0,1\n0.1,x", encoding="utf-8")
    assert run([*command, "--force", "--input", "command=all.csv"]) == 2
    assert "line 3" in unwrapped(capsys.readouterr().err)
