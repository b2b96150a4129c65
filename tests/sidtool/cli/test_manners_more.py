"""Analyses without output times, runs that go on with friction and a chosen model,
and sampled loops that run away."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.measurement import cache
from tests.codes import unwrapped, with_code
from tests.places import SLIDER_CRANK

from .test_going_on import interrupted, pendulum

SCENE, SID = SLIDER_CRANK / "slider_crank.toml", SLIDER_CRANK / "rod_q4.SID_FEM"


def block(time: dict[str, Any], stiffness: float = 0.0, **law: Any) -> sidtool.Scene:
    """1.5 kg on a line, with a spring, a weight and a force."""
    on_slide = {"type": "spring_damper", "joint": "slide", "stiffness": stiffness}
    pull = {"type": "force", "marker": "block", "force": [1.0, 0.0], **law}
    return sidtool.Scene(
        dimension="planar",
        gravity=[3.0, 0.0],
        time=time,
        bodies={
            "block": {"mass": 1.5, "inertia": 0.1, "initial": {"position": [0.02, 0]}}
        },
        joints={
            "slide": {
                "type": "prismatic",
                "markers": ["ground", "block"],
                "axis": [1.0, 0.0],
            }
        },
        forces={"pull": pull} | ({"spring": on_slide} if stiffness else {}),
        outputs={"record": ["block.x"]},
    )


def test_analyses_of_one_state_need_no_output_times(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    scene = block({"end": 1.0}, stiffness=60.0)
    scene.save("s.toml")
    assert run(["analyse", "static", "s.toml", "--json"]) == 0
    rest = json.loads(capsys.readouterr().out)["outputs"]["block.x"]
    assert rest == pytest.approx((3 * 1.5 + 1) / 60.0, rel=1e-9)
    assert run(["analyse", "modes", "s.toml"]) == 0
    assert run(["info", "s.toml"]) == 0
    assert "no output times" in capsys.readouterr().out
    for command in (["simulate"], ["analyse", "inverse"]):
        assert run([*command, "s.toml", "-o", "r.h5"]) == 2
        stderr = unwrapped(capsys.readouterr().err)
        assert "time: neither is given" in stderr or "can move" in stderr
    assert not Path("r.h5").exists()
    with pytest.raises(sidtool.InputError, match="time: neither is given"):
        scene.simulate()


def test_trim_prints_its_numbers_as_data(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cache, "cache_path", lambda: tmp_path / "kept")
    small = tmp_path / "small.SID_FEM"
    scene = sidtool.Scene.load(SCENE).with_({"time.end": 0.3})
    scene.save(tmp_path / "s.toml")
    words = ["trim", str(SID), str(tmp_path / "s.toml"), "-o", str(small), "--json"]
    assert run([*words, "--accuracy", "piston.x=1e-2"]) == 0
    out, err = capsys.readouterr()
    data = json.loads(out)
    sid = sidtool.read(small)
    assert data["bodies"] == ["rod"] and data["shape_functions"]["of"] == 5
    assert len(data["shape_functions"]["kept"]) == sid.nq < 5
    assert data["nodes"]["kept"] == [node.id for node in sid.nodes]
    (output,) = data["accuracy"]["outputs"]
    assert output["name"] == "piston.x" and 0 <= output["error"] <= output["allowed"]
    assert "written" in err and "piston.x" in data["errors"]


def test_a_run_with_friction_continues(monkeypatch: pytest.MonkeyPatch) -> None:
    """The pin rubs: the swing decays, sticks, and what was lost is summed on."""
    monkeypatch.setattr("sidtool.solver.output.dense_output.STEPS_PER_CHUNK", 2)
    pin = sidtool.Revolute(
        markers=["ground", "bar.pin"],
        friction=sidtool.JointFriction(coefficient=0.35, radius=0.05),
    )
    names = ["pin.angle", "energy.*", "pin.friction", "pin.sticking"]
    scene = pendulum(
        joints={"pin": pin}, events={}, outputs=sidtool.Outputs(record=names)
    )
    exact = scene.simulate(rtol=1e-10)
    for after in (0.43, 2.11):
        part = interrupted(scene, after)
        assert not part.completed and after - 0.2 < part.t[-1] < 2.95
        whole = scene.simulate(unfinished=part)
        np.testing.assert_array_equal(whole.t, exact.t)
        for name in ("pin.angle", "energy.dissipated", "energy.balance"):
            scale = max(np.ptp(exact[name]), 1.0)
            np.testing.assert_allclose(whole[name], exact[name], atol=1e-4 * scale)
        same = whole["pin.sticking"] == exact["pin.sticking"]
        assert same.mean() > 0.9


def test_a_run_of_a_selected_model_continues(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The choice is found again, not searched for: the same model goes on, and its
    errors are those that were promised."""
    monkeypatch.setattr(cache, "cache_path", lambda: tmp_path / "kept")
    monkeypatch.setattr("sidtool.solver.output.dense_output.STEPS_PER_CHUNK", 2)
    monkeypatch.setattr("sidtool.solver.output.dense_output.ENDS_PER_CHUNK", 2)
    monkeypatch.setattr("sidtool.solver.simulation.preparation.STEPS_PER_REPORT", 2)
    scene = sidtool.Scene.load(SCENE).with_({"time.end": 0.6})

    def told(t: float) -> None:
        if t > 0.15:
            signal.raise_signal(signal.SIGINT)

    scene.simulate(accuracy={"piston.x": 1e-4, "rod.q1": 1e-2})
    with pytest.raises(sidtool.Interrupted) as caught:
        scene.simulate(accuracy={"piston.x": 1e-4, "rod.q1": 1e-2}, progress=told)
    part = caught.value.result
    assert not part.completed and part.t[-1] < 0.59
    whole = scene.simulate(accuracy={"piston.x": 1e-4, "rod.q1": 1e-2}, unfinished=part)
    exact = scene.with_({"rod.quadratic_inertia": True}).simulate(rtol=1e-11)
    assert whole.completed and whole.accuracy is not None
    assert not whole.accuracy.searched
    np.testing.assert_array_equal(whole.t, exact.t)
    for name, allowed in (("piston.x", 1e-4), ("rod.q1", 1e-2)):
        off = np.abs(whole[name] - exact[name]).max() / np.ptp(exact[name])
        assert off <= allowed


@pytest.mark.parametrize("gain, unstable", [(50.0, True), (2.0, False)])
def test_a_sampled_loop_that_runs_away_is_named(gain: float, unstable: bool) -> None:
    """x' of 1.5 kg held back by -gain v for 0.2 s at a time: v is multiplied by
    1 - 0.2 gain / 1.5 each time."""
    scene = block(
        {"end": 12.0, "output_step": 0.2},
        function={
            "type": "expression",
            "value": f"-{gain}*block.vx",
            "sample_time": 0.2,
        },
    )
    result = scene.simulate()
    found = with_code(result, "N512")
    assert bool(found) == unstable
    if unstable:
        assert found[0].subject == "pull"
        v = result["block.vx"]
        factor = 1 - 0.2 * gain / 1.5
        np.testing.assert_allclose(v[-1] / v[-2], factor, rtol=1e-3)
