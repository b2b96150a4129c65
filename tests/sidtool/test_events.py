"""Events and damping of a scene file, from the file to what the tool says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from sidtool.cli.main import run

SCENE = """
format = "sidtool scene"
version = 1
dimension = "planar"
gravity = [0.0, -9.81]
time = { end = 2.0, output_step = 0.1 }
[bodies.ball]
mass = 1.0
initial = { position = [0.0, 2.0] }
[outputs]
record = ["ball.y"]
[events.landing]
quantity = "ball.y"
direction = "falling"
action = "stop"
[events.half_way]
quantity = "ball.y"
value = 1.0
"""


class Tool:
    """The command line on one scene."""

    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.folder, self.capsys = folder, capsys

    def __call__(self, *arguments: str, scene: str = SCENE) -> tuple[int, str]:
        """Exit status and what is printed."""
        (self.folder / "ball.toml").write_text(scene, encoding="utf-8")
        command, *rest = arguments
        status = run([command, str(self.folder / "ball.toml"), *rest])
        printed = self.capsys.readouterr()
        return status, printed.out + printed.err


@pytest.fixture
def tool(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Tool:
    return Tool(tmp_path, capsys)


def test_crossings_are_listed_with_their_times(tool: Tool) -> None:
    file = str(tool.folder / "r.h5")
    status, text = tool("simulate", "-o", file)
    assert status == 0
    assert re.search(r"half_way +falling at t = 0.451523640986 s", text)
    assert "event landing ended the run at t = 0.638550857 s" in text
    assert run(["info", file]) == 0
    out = tool.capsys.readouterr().out
    assert re.search(r"landing +falling at t = 0.638550856", out)


def test_events_are_part_of_what_a_scene_describes(tool: Tool) -> None:
    _, text = tool("info")
    assert "landing   ball.y = 0, falling  stop" in text
    assert "half_way  ball.y = 1           record" in text


def test_a_study_ends_where_its_runs_end(tool: Tool) -> None:
    status, text = tool(
        "study", "--integrator", "dop853", "--rtol", "1e-6", "--jobs", "1"
    )
    assert status == 0
    assert "dop853" in text


@pytest.mark.parametrize(
    ("found", "place"),
    [
        ('quantity = "ball.yy"', "events.landing.quantity"),
        ('quantity = "ball.y"\nwhen = 1', "events.landing.when"),
    ],
)
def test_wrong_events_are_refused_with_their_key(
    found: str, place: str, tool: Tool
) -> None:
    wrong = SCENE.replace('quantity = "ball.y"', found, 1)
    status, text = tool("simulate", scene=wrong)
    assert status == 2
    assert place in text


def test_the_spectral_radius_is_set_and_reported(tool: Tool) -> None:
    method = 'accuracy = { integrator = "generalised_alpha", spectral_radius = 0.5 }\n'
    scene = SCENE.replace("[bodies.ball]", method + "[bodies.ball]")
    assert "spectral radius 0.5" in tool("simulate", scene=scene)[1]
    changed = tool("simulate", "--spectral-radius", "0.9", scene=scene)
    assert "spectral radius 0.9" in changed[1]
    status, text = tool("simulate", "--spectral-radius", "1.1", scene=scene)
    assert status == 2 and "--spectral-radius" in text
