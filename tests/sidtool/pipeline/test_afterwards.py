"""Outputs after a run are those that the run would have recorded."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.formats.base.errors import InputError
from sidtool.formats.result import Result, read_result
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.formats.toml.reading import validate_data
from tests.codes import unwrapped
from tests.places import SLIDER_CRANK

PATTERNS = ("*.x", "rod.*.ux", "*.v*", "bearing.*", "crank_pin.f*", "rod.q*", "*.a*")


def recording(scene: SceneFile, *names: str) -> SceneFile:
    outputs = scene.outputs.model_copy(update={"record": names})
    return scene.model_copy(update={"outputs": outputs})


@pytest.fixture(scope="module")
def scene() -> SceneFile:
    content = read_scene(SLIDER_CRANK / "slider_crank.toml")
    time = content.time.model_copy(update={"end": 0.5})
    return content.model_copy(update={"time": time})


@pytest.fixture(scope="module")
def files(scene: SceneFile, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("afterwards")
    sidtool.write(folder / "r.h5", sidtool.simulate(scene, base_folder=SLIDER_CRANK))
    return folder


def test_outputs_afterwards_are_those_of_a_run_that_records_them(
    scene: SceneFile, files: Path
) -> None:
    """Another run, whose scene names the outputs; motion does not depend on that."""
    recorded = sidtool.simulate(recording(scene, *PATTERNS), base_folder=SLIDER_CRANK)
    assert {"rod.piston_pin.ux", "bearing.angle_rate", "crank_pin.f2"} <= set(
        recorded.names
    )
    found = sidtool.outputs(sidtool.read(files / "r.h5"), PATTERNS)
    assert set(found) == set(recorded.names)
    for name, values in found.items():
        size = max(abs(recorded[name]).max(), 1e-6)
        assert np.allclose(values, recorded[name], rtol=0, atol=1e-9 * size), name


def test_a_result_answers_by_name(files: Path) -> None:
    result = sidtool.read(files / "r.h5")
    rate = np.gradient(result["piston.x"], result.t)
    assert np.allclose(result["piston.vx"][2:-2], rate[2:-2], atol=2e-2)
    assert result["rod.q*"].shape == (len(result.t), 5)
    with pytest.raises(InputError, match="there is no body 'tip'"):
        result["tip.x"]
    with pytest.raises(InputError, match="stands for no output"):
        result["tip.*"]
    with pytest.raises(InputError, match="integral along the steps"):
        result["energy.balance"]


def test_a_rigid_body_has_no_elastic_coordinates(scene: SceneFile) -> None:
    """It was a KeyError, and a ValueError of numpy."""
    short = scene.with_({"time.end": 0.02, "rod.rigid": True})
    result = sidtool.simulate(short, base_folder=SLIDER_CRANK)
    for name in ("rod.q1", "rod.q*", "rod.vq2"):
        with pytest.raises(InputError, match=r"determine rod.*a body that was rigid"):
            result[name]
    assert result["rod.piston_pin.uy"].max() == 0.0
    assert "rod.x" in sidtool.outputs(result, ["rod.*"])


def test_columns_have_the_order_of_the_names(scene: SceneFile) -> None:
    """Recorded ones came first: the third column of q* was not the third q."""
    part = sidtool.simulate(
        recording(scene, "rod.q3", "piston.x"), base_folder=SLIDER_CRANK
    )
    whole = sidtool.simulate(recording(scene, "rod.q*"), base_folder=SLIDER_CRANK)
    assert list(whole.names) == [f"rod.q{k}" for k in range(1, 6)]
    np.testing.assert_allclose(part["rod.q*"], whole.values, rtol=1e-9, atol=1e-15)
    requested = ["crank.vx", "piston.x", "rod.q1", "rod.q3"]
    assert list(part.outputs(requested)) == requested


def test_results_without_their_sids_are_refused(files: Path) -> None:
    plain = replace(sidtool.read(files / "r.h5"), sids={})
    with pytest.raises(InputError, match="holds no SID of rod"):
        plain["piston.vx"]


def test_the_result_holds_the_sids_of_a_run(files: Path) -> None:
    stored = read_result(files / "r.h5").sids["rod"]
    given = sidtool.read(SLIDER_CRANK / "rod_q4.SID_FEM")
    for name, block in given.blocks.items():
        assert np.array_equal(stored.blocks[name].m0, block.m0)
    assert [n.id for n in stored.nodes] == [n.id for n in given.nodes]


def spatial_wheel(rate: float, step: float) -> dict[str, Any]:
    """A wheel about a tilted shaft, turned evenly: its angle is rate * t."""
    bearing = {"position": [0, 0, 0], "axis_angle": [0.4, 0, 0]}
    return {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "spatial",
        "time": {"end": 4.0, "output_step": step},
        "ground": {"markers": {"shaft": bearing}},
        "bodies": {
            "wheel": {
                "mass": 2.0,
                "inertia": [0.1, 0.1, 0.2],
                "initial": {
                    "axis_angle": bearing["axis_angle"],
                    "angular_velocity": [
                        0.0,
                        -rate * float(np.sin(0.4)),
                        rate * float(np.cos(0.4)),
                    ],
                },
            }
        },
        "joints": {"shaft": {"type": "revolute", "markers": ["ground.shaft", "wheel"]}},
        "outputs": {"record": ["wheel.x"]},
    }


def simulated(content: dict[str, Any]) -> Result:
    return sidtool.simulate(validate_data(content, SceneFile))


def test_turns_in_space_are_counted_afterwards() -> None:
    result = simulated(spatial_wheel(7.0, 0.02))
    assert not any("shaft" in name for name in result.position_names)
    assert np.allclose(result["shaft.angle"], 7.0 * result.t, atol=1e-5)
    assert np.allclose(result["shaft.angle_rate"], 7.0, atol=1e-5)


def test_turns_too_fast_for_the_output_times_are_refused() -> None:
    result = simulated(spatial_wheel(7.0, 0.9))
    with pytest.raises(InputError, match="cannot be counted afterwards"):
        result["shaft.angle"]


def test_callables_of_the_run_are_known_to_its_result(
    scene: SceneFile, tmp_path: Path
) -> None:
    drives = {"crank_angle": (lambda t: 5.0 * t, lambda t: 5.0 + 0.0 * t)}
    result = sidtool.simulate(scene, base_folder=SLIDER_CRANK, drives=drives)
    assert np.allclose(result["bearing.angle_rate"], 5.0, atol=1e-6)
    assert np.allclose(result["crank.pin.vx"], -0.5 * np.sin(5.0 * result.t), atol=1e-6)
    sidtool.write(tmp_path / "r.h5", result)
    again = sidtool.read(tmp_path / "r.h5")
    found = sidtool.outputs(again, "bearing.angle", drives=drives)["bearing.angle"]
    assert np.allclose(found, 5.0 * result.t, atol=1e-9)


def test_the_command_adds_columns(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, target = str(files / "r.h5"), files / "more.h5"
    names = "rod.piston_pin.vx,rod.q*"
    assert run(["outputs", source, "--add", names, "-o", str(target)]) == 0
    assert "rod.piston_pin.vx" in capsys.readouterr().out
    more = read_result(target)
    assert more.names == (*read_result(source).names, "rod.piston_pin.vx")
    piston = sidtool.read(source)["piston.vx"]
    assert np.allclose(more["rod.piston_pin.vx"], piston, rtol=0, atol=1e-9)
    capsys.readouterr()
    assert run(["outputs", source, "--add", "piston.vx", "--json"]) == 0
    columns = json.loads(capsys.readouterr().out)
    assert columns["piston.vx"] == piston.tolist()


def test_the_command_lists_what_there_is(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["outputs", str(files / "r.h5")]) == 0
    lines = dict(line.split("  ", 1) for line in capsys.readouterr().out.splitlines())
    assert "q1*" in lines["rod"] and "vq1" in lines["rod"]
    assert "angle_rate" in lines["bearing"]
    assert "vx_body" in lines["each BODY"] and "wz" in lines["each BODY.MARKER"]


def test_the_command_refuses_unavailable_outputs(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = str(files / "r.h5")
    assert run(["outputs", source, "--add", "rod.tip.x"]) == 2
    assert run(["outputs", source, "--add", "piston.x", "-o", source]) == 2
    assert (
        run(["outputs", str(SLIDER_CRANK / "rod_q4.SID_FEM"), "--add", "piston.x"]) == 2
    )
    text = unwrapped(capsys.readouterr().err)
    assert all(w in text for w in ("has no marker 'tip'", "would be", "a SID file"))
    assert "scene of the result" not in text  # which is not what is wrong
