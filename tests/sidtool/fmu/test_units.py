"""Units move as the program's own runs, whatever the communication step is."""

from __future__ import annotations

import random
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import sidtool
from sidtool.fmu import export as export_module, linking
from tests.sidtool.fmu import importer
from tests.sidtool.fmu.conftest import Export, slider_crank
from tests.sidtool.fmu.importer import DISCARD, ERROR, OK, WARNING, Instance, Library

pytestmark = pytest.mark.needs("cc")


def difference(
    rows: list[list[float]], result: sidtool.Result, every: int = 1
) -> float:
    """Largest difference of outputs, relative to the largest value of each.

    every : communication points for each output time of the result
    """
    values, worst = np.array(rows)[::every], 0.0
    for column, name in zip(values.T, result.names, strict=True):
        expected = result[name][: len(column)]
        size = np.abs(expected).max()
        if size > 1e-12:
            worst = max(worst, float(np.abs(column - expected).max() / size))
    return worst


@pytest.mark.parametrize("length", [1e-1, 1e-2, 1e-3])
def test_motion_is_that_of_a_run_at_all_communication_steps(
    slider: Library, length: float
) -> None:
    """The sequence of steps is that of the run: differences are rounding alone."""
    result = slider_crank().with_({"time.output_step": max(length, 1e-2)}).simulate()
    rows = Instance(slider).run(0.5, length)
    assert difference(rows, result, max(1, round(1e-2 / length))) < 1e-10


def test_inputs_that_jump_act_as_held_functions(export: Export) -> None:
    """Against a run with the same input as a table of constant values."""
    rng = random.Random(1)
    times = [0.02 * k for k in range(25)]
    values = [rng.uniform(-200.0, 200.0) for _ in times]
    scene = slider_crank(**{"accuracy.rtol": 1e-9, "time.output_step": 0.02})
    result = scene.simulate(inputs={"load": (times, values)})
    instance = Instance(export(scene))
    rows = []
    for time, value in zip(times, values, strict=True):
        assert instance.set("load", value) == OK
        rows.append(instance.get())
        assert instance.step(time, 0.02) == OK
    # At a jump the run has the accelerations and forces just before it.
    kept = [k for k, name in enumerate(result.names) if name in ("piston.x", "rod.q1")]
    for k in kept:
        expected = result[result.names[k]][: len(rows)]
        error = np.abs(np.array(rows)[:, k] - expected).max()
        assert error < 1e-7 * np.abs(expected).max()


def test_a_new_input_acts_at_once(slider: Library) -> None:
    """Accelerations follow from the inputs at the communication point; positions and
    velocities do not change there."""
    instance = Instance(slider)
    instance.step(0.0, 0.123)
    names = ["piston.x", "rod.vq2", "piston.ax", "inputs.load"]
    before = instance.get(names)
    instance.set("load", 1000.0)
    after = instance.get(names)
    assert after[:2] == before[:2]
    assert after[2] > before[2] + 1.0 and after[3] == 1000.0
    instance.set("load", 5.0)
    assert instance.get(names) == before


def test_roll_backs_leave_no_trace(slider: Library) -> None:
    """Over a break of the drive, with other inputs in what is taken back."""
    rng, length = random.Random(2), 0.45 / 250
    one, other = Instance(slider), Instance(slider)
    for k in range(250):
        time, value = k * length, rng.uniform(-300.0, 300.0)
        state = one.state()
        one.set("load", rng.uniform(-300.0, 300.0))
        assert one.step(time, rng.choice([0.5, 1.0, 3.0]) * length) == OK
        one.restore(state)
        one.free(state)
        for instance in (one, other):
            instance.set("load", value)
            assert instance.step(time, length) == OK
        assert one.get() == other.get()


def test_instances_share_nothing(slider: Library) -> None:
    """Two instances by turns move as each alone does."""
    alone = []
    for load in (0.0, 200.0):
        instance = Instance(slider)
        instance.set("load", load)
        alone.append(instance.run(0.4, 0.05))
        instance.close()
    pair = [Instance(slider), Instance(slider)]
    pair[1].set("load", 200.0)
    pair[0].set("load", 0.0)
    rows = [[instance.get()] for instance in pair]
    for k in range(8):
        for instance, own in zip(pair, rows, strict=True):
            instance.step(0.05 * k, 0.05)
            own.append(instance.get())
    assert rows == alone and alone[0][-1] != alone[1][-1]


def test_a_serialised_state_continues_in_another_process(
    slider: Library, file: Path, tmp_path: Path
) -> None:
    """A process without packages: to the last bit, over a break."""
    instance = Instance(slider)
    instance.set("load", 50.0)
    instance.step(0.0, 0.28)
    state = tmp_path / "state"
    state.write_bytes(instance.serialised())
    instance.step(0.28, 0.1)
    command = [sys.executable, "-I", "-S", importer.__file__, str(file), str(state)]
    outcome = subprocess.run(
        [*command, "0.28", "0.1"], capture_output=True, encoding="utf-8", check=True
    )
    assert [float.fromhex(x) for x in outcome.stdout.split()] == instance.get()


def test_states_of_other_units_are_refused(slider: Library) -> None:
    instance = Instance(slider)
    content = instance.serialised()
    assert instance.deserialise(content[:-8]) == ERROR
    assert instance.deserialise(b"\0" + content[1:]) == ERROR
    assert instance.deserialise(content) == OK
    assert [status for status, _ in instance.messages] == [ERROR, ERROR]


def test_a_reset_instance_begins_again(slider: Library) -> None:
    instance = Instance(slider)
    instance.set("load", 100.0)
    rows = instance.run(0.4, 0.1)
    instance.reset()
    assert instance.get(["inputs.load"]) == [5.0]
    instance.set("load", 100.0)
    assert instance.run(0.4, 0.1) == rows


def test_steps_of_length_zero_change_nothing(slider: Library) -> None:
    instance = Instance(slider)
    instance.step(0.0, 0.1)
    before = instance.get()
    assert instance.step(0.1, 0.0) == OK
    assert instance.get() == before


def test_communication_points_are_compared_with_a_tolerance(slider: Library) -> None:
    """Sums of steps differ from products by rounding; other times are errors."""
    instance = Instance(slider)
    assert instance.step(0.0, 0.1) == OK
    assert instance.step(0.1 + 1e-12, 0.1) == OK
    assert instance.step(0.25, 0.1) == ERROR
    assert instance.step(0.2, -0.1) == ERROR
    assert instance.step(0.2, 0.1) == OK


def test_a_negative_start_and_times_that_are_sums(export: Export) -> None:
    """4 000 communication steps, whose summed times are 1e-13 s off at the end."""
    pieces = [{"from": -1.0, "coefficients": [0.0, 20.0]}]
    scene = slider_crank(
        **{
            "time": {"start": -1.0, "end": 3.0, "output_step": 0.5},
            "drives.crank_angle.function.pieces": pieces,
            "bodies.crank.initial": {"angle": -1.0},
        }
    )
    result, instance = scene.simulate(), Instance(export(scene), start=-1.0)
    rows, time = [instance.get()], -1.0
    for k in range(4000):
        assert instance.step(time, 1e-3) == OK
        time += 1e-3
        if k % 500 == 499:
            rows.append(instance.get())
    assert time != 3.0
    assert difference(rows, result) < 1e-8


def test_a_unit_ends_with_its_scene(slider: Library) -> None:
    instance = Instance(slider, stop=1.0)
    assert instance.messages[0][0] == WARNING
    assert instance.step(0.0, 0.5) == OK
    before = instance.get()
    assert instance.step(0.5, 0.1) == DISCARD
    assert (
        instance.messages[-1][0] == DISCARD and "time.end" in instance.messages[-1][1]
    )
    assert instance.get() == before


def test_wrong_arguments_are_errors(slider: Library) -> None:
    wrong = Instance(slider, token="{other}")
    assert wrong.address is None and wrong.messages[0][0] == ERROR
    assert Instance(slider, start=1.0).start_status == ERROR
    instance = Instance(slider)
    assert instance.set("piston.x", 1.0) == ERROR
    assert instance.set("load", float("nan")) == ERROR
    assert (
        instance.call("CancelStep" if slider.version == "2.0" else "SetTime") == ERROR
    )
    assert len(instance.messages) == 3


@pytest.mark.parametrize("slider", ["3.0"], indirect=True)
def test_a_step_ends_early_at_a_break(slider: Library) -> None:
    """FMI 3.0 with event mode: where the drive is not smooth the importer may act."""
    instance = Instance(slider, events=True)
    assert instance.step(0.0, 0.2) == OK and not instance.early
    assert instance.step(0.2, 0.2) == OK and instance.early and instance.event
    assert instance.get(["time"]) == [0.3]
    assert instance.step(0.3, 0.1) == OK and not instance.early


def test_fixed_steps_end_at_communication_points(export: Export) -> None:
    """Steps of 1 ms as in a run, whatever the communication step is."""
    scene = slider_crank(**{"accuracy.step": 1e-3, "time.output_step": 0.01})
    result, library = scene.simulate(), export(scene)
    for length in (1e-2, 1e-3):
        rows = Instance(library).run(0.5, length)
        assert difference(rows, result, round(1e-2 / length)) < 1e-9


def test_a_library_is_small_and_shows_the_standard_alone(
    slider: Library, file: Path
) -> None:
    """No kernel of one unit may stand in for that of another."""
    assert file.stat().st_size < 1_000_000
    nm = shutil.which("nm")
    assert nm is not None
    listed = subprocess.run(
        [nm, "-D", "--defined-only", slider.path],
        capture_output=True,
        encoding="utf-8",
        check=True,
    )
    names = [line.split()[-1] for line in listed.stdout.splitlines()]
    assert names and all(name.startswith(("fmi2", "fmi3")) for name in names)


@pytest.mark.parametrize("slider", ["3.0"], indirect=True)
def test_two_exports_are_the_same_bytes(
    slider: Library, file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(export_module, "link", linking.link)
    linking._compiled.cache_clear()
    again = tmp_path / "machine.fmu"
    slider_crank().fmu(again, version=slider.version)
    assert again.read_bytes() == file.read_bytes()


def test_linear_inputs_reach_their_values_at_the_end_of_steps(export: Export) -> None:
    """Against a run with the same values as a table that straight lines join."""
    linear = {"inputs.load.interpolation": "linear", "inputs.load.initial": 0.0}
    scene = slider_crank(**linear, **{"accuracy.rtol": 1e-9, "time.output_step": 0.02})
    rng = random.Random(3)
    times = [0.02 * k for k in range(26)]
    values = [0.0, *(rng.uniform(-200.0, 200.0) for _ in times[1:])]
    result = scene.simulate(inputs={"load": (times, values)})
    instance = Instance(export(scene))
    rows = [instance.get()]
    for time, value in zip(times[:-1], values[1:], strict=True):
        instance.set("load", value)
        assert instance.step(time, 0.02) == OK
        rows.append(instance.get())
    assert difference(rows, result) < 1e-7


def test_a_smooth_input_drives_a_joint(export: Export) -> None:
    """A position that an importer prescribes: as the plant in Python moves it."""
    angle = {"initial": 0.0, "interpolation": "smooth", "unit": "rad"}
    scene = slider_crank(
        **{
            "inputs.angle": angle,
            "drives.crank_angle.function": {"type": "input", "name": "angle"},
            "accuracy.rtol": 1e-9,
        }
    )
    instance, plant = Instance(export(scene)), scene.compile().plant()
    for k in range(20):
        goal = 0.4 * np.sin(3.0 * 0.02 * (k + 1)) ** 2
        instance.set("angle", goal)
        plant.set(angle=goal)
        assert instance.step(0.02 * k, 0.02) == OK
        plant.advance(0.02)
        assert abs(instance.get(["crank.angle"])[0] - goal) < 1e-10
    for name in ("piston.x", "rod.q1"):
        expected = plant[name]
        assert abs(instance.get([name])[0] - expected) < 1e-8 * max(abs(expected), 1e-3)
