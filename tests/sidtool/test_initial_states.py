"""Scenes that start in a state of another result."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run

from .study.parts import bar

FINE = {"integrator": "radau9", "rtol": 1e-10}


def spinning(**more: Any) -> sidtool.Scene:
    """A bar that a torque turns by several turns against a torsion spring, placed
    obliquely in space, beside a cart under a controller with an integral."""
    given: dict[str, Any] = {
        "dimension": "spatial",
        "gravity": [0.0, 0.0, -9.81],
        "time": {"end": 2.0, "output_step": 0.05},
        "bodies": {
            "bar": {
                "mass": 1.0,
                "inertia": [0.02, 0.1, 0.1],
                "markers": {"pin": {"position": [-0.5, 0.0, 0.0]}},
                "initial": {
                    "position": [0.4, 0.3, 0.0],
                    "axis_angle": [0.0, 0.0, float(np.arctan2(0.3, 0.4))],
                    "angular_velocity": [0.0, 0.0, 20.0],
                },
            },
            "cart": {
                "mass": 2.0,
                "inertia": [1.0, 1.0, 1.0],
                "initial": {"position": [1.0, 0.0, 2.0]},
            },
        },
        "joints": {
            "pin": {
                "type": "revolute",
                "markers": ["ground", "bar.pin"],
                "axis": [0.0, 0.0, 1.0],
            },
            "rail": {
                "type": "prismatic",
                "markers": ["ground.rail", "cart"],
                "axis": [1.0, 0.0, 0.0],
            },
        },
        "ground": {"markers": {"rail": {"position": [0.0, 0.0, 2.0]}}},
        "forces": {
            "spring": {"type": "spring_damper", "joint": "pin", "stiffness": 0.4},
            "hold": {
                "type": "actuator",
                "joint": "rail",
                "function": {
                    "type": "pid",
                    "measured": "rail.displacement",
                    "p": 30.0,
                    "i": 20.0,
                    "d": 4.0,
                },
            },
        },
        "outputs": {
            "record": ["bar.*", "pin.angle", "rail.displacement", "hold.force"]
        },
    }
    return sidtool.Scene.checked(given | more | HEAD, "scene")


HEAD = {"format": "sidtool scene", "version": 1}


def test_a_run_in_two_halves_is_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whole turns and the integral of a controller go on; in Python and by files."""
    monkeypatch.chdir(tmp_path)  # where paths of scenes made in Python begin
    scene = spinning()
    whole = scene.simulate(**FINE)
    assert np.ptp(whole["pin.angle"]) > 4 * np.pi
    first = scene.with_({"time.end": 1.0}).simulate(**FINE)
    then = {"time.start": 1.0, "initial": {"state": "result", "file": first}}
    second = scene.with_(then).simulate(**FINE)
    late = whole.t > 0.99
    for name in whole.names:
        scale = max(np.ptp(whole[name]), 1e-3)
        assert np.abs(second[name] - whole[name][late]).max() < 1e-7 * scale, name
    first.save(tmp_path / "first.h5")
    path, result = tmp_path / "scene.toml", tmp_path / "second.h5"
    by_name = {**then, "initial": {"state": "result", "file": "first.h5"}}
    scene.with_({**by_name, "accuracy": FINE}).save(path)
    assert run(["simulate", str(path), "-o", str(result)]) == 0
    read = sidtool.read(result)
    assert np.array_equal(read.values, second.values)
    (tmp_path / "first.h5").unlink()
    assert np.allclose(read["cart.vx"], whole["cart.vx"][late], atol=1e-7)
    middle = {"state": "result", "file": whole, "time": 1.0}
    again = scene.with_({**then, "initial": middle}).simulate(**FINE)
    assert np.allclose(again.values, second.values, rtol=1e-6, atol=1e-6)
    with pytest.raises(sidtool.InputError, match="given as an object"):
        scene.with_(then).save(path)


def test_a_drive_releases_its_joint() -> None:
    """A wheel that was driven, without coordinates of its own, turns on freely."""
    parts: dict[str, Any] = {
        "dimension": "planar",
        "time": {"end": 1.0, "output_step": 0.1},
        "bodies": {"wheel": {"mass": 1.0, "inertia": 0.5}},
        "joints": {"axle": {"type": "revolute", "markers": ["ground", "wheel"]}},
    }
    ramp = {"type": "polynomial", "pieces": [{"from": 0.0, "coefficients": [0, 0, 4]}]}
    driven = sidtool.Scene.checked(
        parts | HEAD | {"drives": {"motor": {"joint": "axle", "function": ramp}}}, "s"
    ).simulate()
    start = {"state": "result", "file": driven}
    free = sidtool.Scene.checked(
        parts | HEAD | {"initial": sidtool.Start(**start).file_data()}, "s"
    ).simulate()
    assert np.allclose(free["wheel.angle"], 4.0 + 8.0 * free.t, rtol=1e-12)
    assert np.allclose(free["wheel.wz"], 8.0, rtol=1e-12)


@pytest.fixture(scope="module")
def sid() -> sidtool.SID:
    return sidtool.Model.checked(bar(method="craig_bampton"), "bar").convert()


def clamped(sid: sidtool.SID, **more: Any) -> sidtool.Scene:
    return sidtool.Scene(
        **{
            "dimension": "spatial",
            "time": sidtool.Time(end=0.04, output_step=5e-4),
            "bodies": {"bar": sidtool.SidBody(sid=sid, markers={"root": 1, "tip": 2})},
            "joints": {"clamp": sidtool.Fixed(markers=["ground", "bar.root"])},
        }
        | more
    )


def test_a_bent_bar_is_released(sid: sidtool.SID) -> None:
    """From rest under a force: it vibrates about zero with what the force deflected it
    by, and keeps the elastic energy that it had."""
    load = sidtool.PointForce(marker="bar.tip", force=[0.0, 0.05, 0.0])
    more = {"forces": {"load": load}, "initial": sidtool.Start(state="static")}
    short = sidtool.Time(end=1e-4, output_step=1e-4)
    held = clamped(sid, time=short, **more).simulate()
    free = clamped(sid, initial=sidtool.Start(state="result", file=held))
    result = free.simulate(rtol=1e-9)
    bent = held["bar.tip.uy"][-1]
    assert result["bar.tip.uy"][0] == pytest.approx(bent, rel=1e-9)
    assert np.abs(result["bar.tip.vy"][0]) < 1e-6
    assert not any("equilibrium" in note for note in result.notes)
    energy = result["energy.elastic"]
    assert energy[0] == pytest.approx(0.5 * 0.05 * bent, rel=1e-3)
    assert result["bar.tip.uy"].min() < -0.8 * bent


def test_results_that_do_not_fit_the_scene_are_refused(
    sid: sidtool.SID, tmp_path: Path
) -> None:
    scene = spinning(time={"end": 0.1, "output_step": 0.1})
    result = scene.simulate()
    start = {"state": "result", "file": result}
    for changes, message in (
        ({"initial": start | {"time": 0.05}}, "no state at t"),
        ({"initial": start, "bodies.third": {"mass": 1.0}}, "no body 'third'"),
        ({"initial": {"state": "result", "file": "nothing.h5"}}, "nothing.h5"),
    ):
        with pytest.raises(sidtool.InputError, match=message):
            scene.with_(changes).simulate()
    with pytest.raises(sidtool.InputError, match="file"):
        scene.with_({"initial": {"state": "result"}})
    with pytest.raises(sidtool.InputError, match="result"):
        scene.with_({"initial": {"file": "r.h5"}})
    short = sidtool.Time(end=1e-3, output_step=1e-3)
    other = clamped(sid, time=short).simulate()
    coarse = sidtool.Model.checked(bar(6, method="craig_bampton"), "bar").convert()
    begun = clamped(coarse, initial=sidtool.Start(state="result", file=other))
    with pytest.raises(sidtool.InputError, match="another SID"):
        begun.simulate()
    with pytest.raises(sidtool.InputError, match="no body"):
        scene.with_({"initial": {"state": "result", "file": other}}).simulate()
