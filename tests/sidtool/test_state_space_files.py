"""Commands `linearise` and `response`, their files, and other packages."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import loadmat

import sidtool
from sidtool.cli.main import run
from tests.solver.analyses.state_space_scenes import pendulum


@pytest.fixture
def scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> sidtool.Scene:
    monkeypatch.chdir(tmp_path)
    found = pendulum()
    found.save("arm.toml")
    return found


def test_files_hold_matrices_names_and_the_operating_point(
    scene: sidtool.Scene, capsys: pytest.CaptureFixture[str]
) -> None:
    expected = scene.state_space()
    for name in ("p.npz", "p.mat", "p.json"):
        assert run(["linearise", "arm.toml", "--descriptor", "-o", name]) == 0
        assert run(["linearise", "arm.toml", "-o", name]) == 0  # one of its own
    assert "arm.wz_body" in capsys.readouterr().out
    arrays = np.load("p.npz")
    assert_array_equal(arrays["A"], expected.A)
    assert tuple(arrays["state_names"]) == expected.state_names
    assert_array_equal(arrays["second_order_K"], expected.second_order.K)
    assert_array_equal(arrays["operating_outputs"], expected.outputs)
    matlab = loadmat("p.mat")
    assert_array_equal(matlab["B"], expected.B)
    assert matlab["input_names"][0, 0][0] == "torque"
    assert_array_equal(matlab["second_order"]["M"][0, 0], expected.second_order.M)
    data = json.loads(Path("p.json").read_text(encoding="utf-8"))
    assert data["format"] == "sidtool state space" and data["is_steady"] is True
    assert_array_equal(data["C"], expected.C)


def test_the_command_takes_inputs_outputs_and_a_time(scene: sidtool.Scene) -> None:
    options = ["--inputs", "torque", "--outputs", "arm.tip.*", "--about", "0.1"]
    assert run(["linearise", "arm.toml", *options, "-o", "p.json"]) == 0
    data = json.loads(Path("p.json").read_text(encoding="utf-8"))
    assert {"arm.tip.x", "arm.tip.vy"} <= {*data["output_names"]}
    assert data["about"] == 0.1


@pytest.mark.parametrize(
    "arguments",
    [
        ["linearise", "arm.toml", "-o", "p.h5"],
        ["linearise", "arm.toml", "--about", "middle"],
        ["linearise", "arm.toml", "--inputs", "load"],
        ["response", "arm.toml", "--from", "load"],
        ["response", "arm.toml", "--frequencies", "9:1"],
        ["response", "arm.toml", "-o", "bode.h5"],
    ],
)
def test_wrong_arguments_end_with_status_2(
    scene: sidtool.Scene, arguments: list[str]
) -> None:
    assert run(arguments) == 2


def test_responses_are_pictures_and_tables(
    scene: sidtool.Scene, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["response", "arm.toml", "--to", "pivot.angle", "--frequencies"]
    # a table is written twice: the second time over one of its own
    for name in ("bode.png", "bode.svg", "bode.csv", "bode.json", "bode.csv"):
        assert run([*command, "0.1:10:log:20", "-o", name]) == 0
    assert "unbounded" in capsys.readouterr().out  # no damping
    header, *rows = Path("bode.csv").read_text(encoding="utf-8").splitlines()
    assert header == "frequency [Hz],pivot.angle [rad/(N m)],pivot.angle phase [deg]"
    first = [float(cell) for cell in rows[0].split(",")]
    response = scene.state_space().response([0.1], outputs="pivot.angle")
    assert_allclose(first, [0.1, response.magnitude[0, 0], 0.0], atol=1e-9)
    data = json.loads(Path("bode.json").read_text(encoding="utf-8"))
    assert len(data["peaks"]) == 1 and len(data["frequencies"]) == len(rows)


def test_a_compiled_scene_is_linearised_with_other_numbers(
    scene: sidtool.Scene,
) -> None:
    found = scene.compile().state_space({"arm.mass": 3.0})
    expected = scene.with_({"bodies.arm.mass": 3.0}).state_space()
    assert_array_equal(found.A, expected.A)


def test_scipy_takes_it(scene: sidtool.Scene) -> None:
    space = scene.state_space()
    found = space.to_scipy()
    for name in "ABCD":
        assert_array_equal(getattr(found, name), getattr(space, name))


@pytest.mark.needs("control")
def test_python_control_takes_it(scene: sidtool.Scene) -> None:
    space = scene.state_space()
    plant = space.to_control()
    assert plant.state_labels[0] == "arm_rotation_z_body"
    assert plant.input_labels == ["torque"]
    expected = space.response([3.0 / (2.0 * np.pi)]).values[0]
    assert_allclose(plant(3.0j)[:, 0], expected, rtol=1e-12)


def test_it_is_a_table_of_pandas(scene: sidtool.Scene) -> None:
    response = scene.state_space().response([1.0, 2.0], outputs=["pivot.angle"])
    table = response.to_dataframe()
    assert table.attrs["units"]["pivot.angle"] == "rad/(N m)"
    assert_array_equal(table["pivot.angle"], response["pivot.angle"])
