"""``sidtool analyse``: what is printed and written, and how it fails."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.formats.result import read_result
from sidtool.report.analyses import mode_rows
from tests.codes import unwrapped
from tests.places import SLIDER_CRANK

PENDULUM = """
format = "sidtool scene"
version = 1
dimension = "planar"
gravity = [0, -9.81]
time = { end = 1, output_step = 0.1 }
[bodies.bob]
mass = 2
inertia = 0.1
markers.top = { position = [0, 1] }
initial = { position = [0.8, -0.6], angle = 0.9 }
[joints.hinge]
type = "revolute"
markers = ["ground", "bob.top"]
[outputs]
record = ["bob.y", "hinge.fy"]
"""
DRIVEN = (
    PENDULUM
    + """
[drives.turn]
joint = "hinge"
function = { type = "smooth_step", from = 0, to = 1, end = 1.5, continuity = 3 }
"""
)


@pytest.fixture
def pendulum(tmp_path: Path) -> Path:
    path = tmp_path / "pendulum.toml"
    path.write_text(PENDULUM, encoding="utf-8")
    return path


def test_static_prints_outputs_and_forces(
    pendulum: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = pendulum.with_name("rest.h5")
    assert run(["analyse", "static", str(pendulum), "-o", str(target)]) == 0
    text = capsys.readouterr().out
    assert "bob.y" in text and re.search("hinge +f1, f2 +0, 19.62 +N", text)
    assert read_result(target)["bob.y"][0] == pytest.approx(-1.0, abs=1e-9)


def test_modes_are_written_with_their_shapes(
    pendulum: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = pendulum.with_name("modes.json")
    assert run(["analyse", "modes", str(pendulum), "-o", str(target)]) == 0
    (mode,) = json.loads(target.read_text(encoding="utf-8"))["modes"]
    hertz = np.sqrt(2 * 9.81 / 2.1) / (2 * np.pi)
    assert mode["frequency"] == pytest.approx(hertz, rel=1e-7)
    assert len(mode["shape"]) == 3
    assert f"{hertz:.5g}" in capsys.readouterr().out
    same = sidtool.linearise(pendulum)
    assert same.frequencies == pytest.approx([hertz], rel=1e-7)


def test_a_start_that_is_no_steady_motion_has_no_modes(
    pendulum: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A pendulum that falls has m g l cos(angle) at this instant, labelled."""
    target = pendulum.with_name("modes.json")
    command = ["analyse", "modes", str(pendulum), "--about", "start", "-o", str(target)]
    assert run(command) == 1
    printed = capsys.readouterr()
    assert "N718" in printed.err and "Hz" not in printed.out
    assert not target.exists()
    assert run([*command, "--frozen"]) == 0
    capsys.readouterr()
    written = json.loads(target.read_text(encoding="utf-8"))
    (mode,) = written["modes"]
    hertz = np.sqrt(2 * 9.81 * -written["position"][1] / 2.1) / (2 * np.pi)
    assert mode["frequency"] == pytest.approx(hertz, rel=1e-6)
    assert "N715" in [each["code"] for each in written["diagnostics"]]


def test_inverse_needs_a_prescribed_motion(
    pendulum: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["analyse", "inverse", str(pendulum)]) == 2
    message = unwrapped(capsys.readouterr().err)
    assert "pendulum.toml" in message and "1 of 3 coordinates" in message
    pendulum.write_text(DRIVEN, encoding="utf-8")
    target = pendulum.with_name("forces.csv")
    assert run(["analyse", "inverse", str(pendulum), "-o", str(target)]) == 0
    assert "turn.f1" in capsys.readouterr().out
    assert len(target.read_text(encoding="utf-8").splitlines()) == 12


def test_inverse_of_flexible_bodies_is_quasi_static_on_demand(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "slow.toml"
    text = (SLIDER_CRANK / "slider_crank.toml").read_text(encoding="utf-8")
    text = text.replace("rod_q4.SID_FEM", (SLIDER_CRANK / "rod_q4.SID_FEM").as_posix())
    scene.write_text(
        text.replace("output_step = 0.01", "output_step = 0.5"), encoding="utf-8"
    )
    assert run(["analyse", "inverse", str(scene)]) == 2
    assert "the option quasi-static" in unwrapped(capsys.readouterr().err)
    target = tmp_path / "forces.h5"
    command = ["analyse", "inverse", str(scene), "--quasi-static", "-o", str(target)]
    assert run(command) == 0
    assert "crank_angle.f1" in capsys.readouterr().out
    written = read_result(target)
    same = sidtool.inverse_dynamics(scene, quasi_static=True)
    assert "quasi-static" in written.settings["analysis"]
    assert np.array_equal(written["rod.q1"], same["rod.q1"])
    assert written["rod.q1"][-1] != 0


def test_inverse_stores_the_motion_before_an_impossible_position(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The bob on its arm of 1 m reaches down to y = -1."""
    scene, target = tmp_path / "pulled.toml", tmp_path / "forces.h5"
    pull = """
[drives.pull]
marker = "bob"
coordinate = "y"
function = { type = "polynomial", pieces = [{ from = 0, coefficients = [-0.6, -1.1] }] }
"""
    scene.write_text(PENDULUM + pull, encoding="utf-8")
    assert run(["analyse", "inverse", str(scene), "-o", str(target)]) == 1
    assert "N722" in unwrapped(capsys.readouterr().err)
    result = read_result(target)
    assert not result.completed and "N722" in result.message
    assert len(result.t) == 4
    assert result["bob.y"] == pytest.approx(-0.6 - 1.1 * result.t, abs=1e-9)


def test_a_body_that_can_fall_is_reported_in_one_line(
    pendulum: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pendulum.write_text(
        PENDULUM.replace("[joints.hinge]", "[joints.gone]"), encoding="utf-8"
    )
    text = pendulum.read_text(encoding="utf-8")
    start, end = text.index("[joints.gone]"), text.index("[outputs]")
    pendulum.write_text(
        text[:start] + text[end:].replace(', "hinge.fy"', ""), encoding="utf-8"
    )
    assert run(["analyse", "static", str(pendulum)]) == 1
    assert "N701" in unwrapped(capsys.readouterr().err)


@pytest.mark.parametrize("command", [["info"], ["analyse", "modes"], ["linearise"]])
def test_a_static_start_at_a_pole_of_a_law_names_it(
    command: list[str], pendulum: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pole = """
[initial]
state = "static"
[forces.push]
type = "force"
marker = "bob"
force = [1, 0]
function = { type = "expression", value = "1/bob.vx" }
"""
    pendulum.write_text(PENDULUM + pole, encoding="utf-8")
    assert run([*command, str(pendulum)]) == 2
    assert "N509" in unwrapped(capsys.readouterr().err)


@pytest.mark.parametrize("seed", [1, 2])
def test_rounding_does_not_order_the_coordinates_of_a_mode(seed: int) -> None:
    """Equal amplitudes of shafts on one axis; another processor rounds otherwise."""
    modes = sidtool.linearise(SLIDER_CRANK / "slider_crank.toml", about="start")
    rounding = np.random.default_rng(seed).uniform(-1e-13, 1e-13, modes.shapes.shape)
    rows = mode_rows(replace(modes, shapes=1.0 + rounding))
    assert {row[-1] for row in rows} == {", ".join(modes.names[:3])}
