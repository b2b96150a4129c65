"""`sidtool study`: errors against a reference, recommendations, and the command."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.formats.base.errors import InputError
from sidtool.formats.scene import SceneFile
from sidtool.measurement import outputs
from sidtool.solver import compile_scene
from sidtool.solver.integrators.registry import INTEGRATORS
from sidtool.study import (
    Point,
    Setting,
    default_settings,
    is_hopeless,
    make_reference,
    recommend_point,
    run_study,
)
from tests.codes import unwrapped
from tests.solver.scenes import scene

SCENE = """
format = "sidtool scene"
version = 1
title = "Pendulum"
dimension = "planar"
gravity = [0.0, -9.81]

[time]
end = 0.5
output_step = 0.05

[bodies.bob]
mass = 1.0
initial = { position = [1.0, 0.0] }

[joints.rod]
type = "distance"
markers = ["ground", "bob"]
length = 1.0

[outputs]
record = ["bob.x", "bob.y"]
"""


def pendulum(*more: str) -> SceneFile:
    """A point mass on a massless rod, at rest and level at first."""
    ball: dict[str, Any] = {"mass": 1.0, "initial": {"position": [1.0, 0.0]}}
    rod = {"type": "distance", "markers": ["ground", "ball"], "length": 1.0}
    record = ["ball.x", "ball.y", *more]
    return scene({"ball": ball}, {"rod": rod}, gravity=[0.0, -9.81], record=record)


def test_the_reference_knows_the_pendulum() -> None:
    """x^2 + y^2 = 1, and the fall of a bob that starts level: v^2 = 2 g (-y)."""
    reference = make_reference(compile_scene(pendulum("ball.vx", "ball.vy")))
    x, y, vx, vy = reference.values.T
    assert x**2 + y**2 == pytest.approx(1.0, abs=1e-10)
    assert vx**2 + vy**2 == pytest.approx(-2 * 9.81 * y, abs=1e-8)
    assert reference.uncertainty < 1e-8


def test_tighter_tolerances_cost_steps_and_gain_digits() -> None:
    settings = default_settings(["radau5"], [1e-3, 1e-6, 1e-9])
    points = run_study(pendulum(), settings=settings).points
    assert points[0].error > 10 * points[1].error > 100 * points[2].error
    assert points[0].steps < points[1].steps < points[2].steps


def test_fixed_steps_gain_the_order_of_the_method() -> None:
    settings = default_settings(["trapezoidal"], (), [0.02, 0.01])
    coarse, fine = run_study(pendulum(), settings=settings).points
    assert coarse.error / fine.error == pytest.approx(4.0, rel=0.2)


def test_outputs_that_remain_zero_are_omitted() -> None:
    projectile = scene(
        {"ball": {"mass": 1.0, "initial": {"velocity": [1.0, 0.0]}}},
        record=["ball.x", "ball.y"],
    )
    reference = make_reference(compile_scene(projectile))
    assert reference.names == ("ball.x",)
    assert reference.left_out == ("ball.y",)


def test_a_scene_without_outputs_cannot_be_studied() -> None:
    with pytest.raises(InputError, match="records no outputs"):
        run_study(scene({"ball": {"mass": 1.0}}))


def test_all_integrators_are_studied_by_default() -> None:
    assert {s.integrator for s in default_settings()} == set(INTEGRATORS)
    with pytest.raises(InputError, match="no integrator 'euler'"):
        default_settings(["euler"])


def test_hopeless_integrators_get_no_tighter_tolerances(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With these limits an integrator is hopeless if it is slower with no smaller
    error.
    """
    monkeypatch.setattr(outputs, "LONG_RUN_SECONDS", 0.0)
    monkeypatch.setattr(outputs, "HOPELESS_RATIO", 1.0)
    expected = default_settings(["radau9", "trapezoidal"], [1e-4, 1e-5, 1e-6])
    study = run_study(pendulum(), settings=expected).points
    assert [p.setting for p in study] == expected
    trapezoidal = study[3:]
    assert trapezoidal[0].steps > 0
    assert trapezoidal[-1].message == "left out, far too slow"
    assert run_study(pendulum(), settings=expected[3:]).points[-1].steps > 0


def test_only_long_runs_are_hopeless() -> None:
    assert is_hopeless(2.0, 1e-3, [(0.05, 1e-4)])
    assert not is_hopeless(2.0, 1e-5, [(0.05, 1e-4)])
    assert not is_hopeless(2.0, 1e-3, [(0.5, 1e-4)])
    assert not is_hopeless(0.9, 1e-3, [(1e-3, 1e-4)])
    assert not is_hopeless(np.inf, np.inf, [(1e-3, 1e-4)])


def test_the_fastest_setting_that_is_good_enough_is_recommended() -> None:
    points = [
        Point(Setting("radau5", rtol=1e-3), 1e-3, 1.0, 10),
        Point(Setting("radau5", rtol=1e-6), 1e-6, 3.0, 30),
        Point(Setting("trapezoidal", rtol=1e-6), 1e-5, 2.0, 20),
        Point(Setting("trapezoidal", step=1e-3), np.inf, np.inf, 0, "stopped"),
    ]
    assert recommend_point(points, 1e-2) is points[0]
    assert recommend_point(points, 2e-5) is points[2]
    assert recommend_point(points, 2e-6) is points[1]
    assert recommend_point(points, 1e-9) is None
    assert points[1].setting.key == 'integrator = "radau5", rtol = 1e-06'


def test_the_command_recommends_and_draws(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "pendulum.toml"
    path.write_text(SCENE, encoding="utf-8")
    arguments = [
        "study",
        str(path),
        "--jobs",
        "1",
        "--wanted",
        "1e-4",
        "-o",
        str(tmp_path / "out"),
    ]
    arguments += ["--integrator", "radau5", "--rtol", "1e-4", "--rtol", "1e-6"]
    assert run(arguments) == 0
    text = capsys.readouterr().out
    assert 'integrator = "radau5", rtol = ' in text
    written = (tmp_path / "out" / "study.txt").read_text(encoding="utf-8")
    assert written.partition("\n\nAll points")[0] in text
    rows = list(csv.DictReader((tmp_path / "out" / "study.csv").open(encoding="utf-8")))
    assert [row["rtol"] for row in rows] == ["0.0001", "1e-06"]
    assert (tmp_path / "out" / "study.png").read_bytes().startswith(b"\x89PNG")
    data, again = tmp_path / "out" / "study.json", tmp_path / "again.svg"
    stored = sidtool.read(data)
    assert {p.integrator for p in stored.points} and stored.uncertainty > 0
    assert all(p.error is None or p.error > 0 for p in stored.points)
    assert run(["plot", str(data), "-o", str(again)]) == 0
    assert "relative error" in again.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "arguments", [["--wanted", "-1"], ["--rtol", "7"], ["--of", "bob.q1"]]
)
def test_wrong_wishes_are_refused(
    arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "pendulum.toml"
    path.write_text(SCENE, encoding="utf-8")
    assert run(["study", str(path), "--jobs", "1", *arguments]) == 2
    assert "expected" in unwrapped(capsys.readouterr().err)


def test_errors_below_the_uncertainty_are_not_resolved() -> None:
    reference = make_reference(compile_scene(pendulum()))
    point = run_study(pendulum(), settings=[Setting("radau13", rtol=1e-13)]).points[0]
    assert point.error >= reference.uncertainty > 0.0


def test_auto_is_studied_on_request() -> None:
    assert default_settings(["auto"], [1e-6]) == [Setting("auto", rtol=1e-6)]
    point = run_study(pendulum(), settings=[Setting("auto", rtol=1e-6)]).points[0]
    assert point.error < 1e-5


def chaotic(end: float) -> SceneFile:
    """A double pendulum that starts upside down, beside a body that falls."""
    bodies: dict[str, Any] = {
        name: {
            "mass": 1.0,
            "inertia": 1.0 / 12.0,
            "markers": {"a": {"position": [-0.5, 0.0]}, "b": {"position": [0.5, 0.0]}},
            "initial": {"position": [0.0, height], "angle": angle},
        }
        for name, height, angle in (("upper", 0.5, 1.5), ("lower", 1.5, 1.7))
    }
    bodies["ball"] = {"mass": 1.0}
    joints = {
        "shoulder": {"type": "revolute", "markers": ["ground", "upper.a"]},
        "elbow": {"type": "revolute", "markers": ["upper.b", "lower.a"]},
    }
    record = ["lower.x", "ball.y"]
    gravity = [0.0, -9.81]
    return scene(bodies, joints, end=end, steps=200, gravity=gravity, record=record)


def test_chaotic_outputs_are_named_and_nothing_is_recommended_for_them() -> None:
    """They do not count as rounding; what can be predicted is compared."""
    system = compile_scene(chaotic(40.0))
    reference = make_reference(system)
    assert reference.names == ("ball.y",) and reference.left_out == ()
    assert reference.unpredictable["lower.x"] > 0.1
    with pytest.raises(InputError, match="no output can be predicted"):
        make_reference(system, ["lower.x"])
    assert make_reference(compile_scene(chaotic(2.0))).unpredictable == {}
