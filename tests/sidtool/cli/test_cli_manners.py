"""--quiet and --json on every command that prints numbers; completion of the shell."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import pytest

import sidtool
from sidtool.cli.main import cli, run
from sidtool.formats.text import counted_noun
from tests.places import SLIDER_CRANK

SCENE, SID = SLIDER_CRANK / "slider_crank.toml", SLIDER_CRANK / "rod_q4.SID_FEM"
#: Commands that print no numbers.
SILENT = {"explain", "demo", "schema", "warmup", "new"}
SHORT = ["--set", "time.end=0.1"]


def commands(group: click.Group, before: tuple[str, ...] = ()) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, command in group.commands.items():
        path = (*before, name)
        if isinstance(command, click.Group):
            found |= commands(command, path)
        else:
            found[" ".join(path)] = command
    return found


@pytest.mark.parametrize("name", sorted(set(commands(cli)) - SILENT))
def test_every_command_that_prints_numbers_has_the_options(name: str) -> None:
    options = {o for p in commands(cli)[name].params for o in p.opts}
    writes_only = {"plot", "animate", "report"}
    assert "--json" in options or name in writes_only, options
    assert "--quiet" in options or name == "info", options


def printed_json(
    capsys: pytest.CaptureFixture[str], *arguments: Any
) -> tuple[Any, str]:
    assert run([*map(str, arguments), "--json"]) == 0
    out, err = capsys.readouterr()
    return json.loads(out), err


def test_numbers_as_data(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "r.h5"
    data, err = printed_json(capsys, "simulate", SCENE, *SHORT, "-o", target)
    assert data["completed"] and data["times"]["count"] == 11
    assert not err and data["diagnostics"] == []
    known, _ = printed_json(capsys, "info", target)
    result = sidtool.read(target)
    assert known["outputs"]["piston.x"]["last"] == result["piston.x"][-1]
    assert known["outputs"]["piston.x"]["unit"] == "m"
    assert known["counters"] == data["counters"]
    sid, _ = printed_json(capsys, "info", SID)
    assert sid["modes"][0]["frequency"] == pytest.approx(31.7011, abs=1e-4)
    other, _ = printed_json(capsys, "convert", SID, "-o", tmp_path / "rod.h5")
    assert other["mass"] == sid["mass"] and set(sid["nodes"]) == {"1", "2"}
    scene, _ = printed_json(capsys, "info", SCENE)
    assert scene == sidtool.Scene.load(SCENE).file_data()
    modes, _ = printed_json(capsys, "analyse", "modes", SCENE, "--about", "start")
    assert len(modes["modes"]) == 5
    forces, _ = printed_json(
        capsys, "analyse", "inverse", SCENE, *SHORT, "--quasi-static"
    )
    assert forces["outputs"]["piston.x"]["first"] == pytest.approx(1.1)
    rest, _ = printed_json(capsys, "analyse", "static", SCENE)
    assert rest["outputs"]["piston.x"] == pytest.approx(1.1)


def test_quiet_commands_print_nothing_but_errors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "r.h5"
    assert run(["simulate", str(SCENE), *SHORT, "-o", str(target), "--quiet"]) == 0
    assert capsys.readouterr() == ("", "") and target.is_file()
    assert run(["validate", str(SID), "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert run(["simulate", str(SCENE), "--set", "time.end=-1", "--quiet"]) == 2
    out, err = capsys.readouterr()
    assert out == "" and "time.end" in err
    print("spoken again")
    assert capsys.readouterr().out == "spoken again\n"


def test_the_shell_completes_commands() -> None:
    words = {"COMP_WORDS": "sidtool si", "COMP_CWORD": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "sidtool"],
        env=os.environ | words | {"_SIDTOOL_COMPLETE": "bash_complete"},
        capture_output=True,
        text=True,
        timeout=60,
        encoding="utf-8",
    )
    assert done.stdout == "plain,simulate\n"


def test_errors_keep_to_the_width_of_a_screen_and_names_of_files_stay_whole(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A name with spaces can be copied from the error, however long it is."""
    path = tmp_path / " ".join(["part of a long name"] * 6) / "scene.toml"
    path.parent.mkdir()
    path.write_text(
        'title = "t"\n[bodies.arm]\nsid = "no.SID_FEM"\nwrong_key_of_it = 1\n',
        encoding="utf-8",
    )
    assert run(["simulate", str(path), "-o", str(tmp_path / "r.h5")]) == 2
    lines = capfd.readouterr().err.splitlines()
    (named,) = (line for line in lines if str(path) in line)
    assert all(len(line) <= 100 for line in lines if line != named)
    assert run(["plot", str(path), "-o", "a.png", "--kind", "k" * 50]) == 2
    lines = capfd.readouterr().err.splitlines()
    assert "k" * 50 in "".join(lines) and max(map(len, lines)) <= 100


def test_counts_agree_with_their_nouns() -> None:
    nouns = "degree of freedom", "body", "point mass", "key"
    assert [counted_noun(2, noun) for noun in nouns] == [
        "2 degrees of freedom",
        "2 bodies",
        "2 point masses",
        "2 keys",
    ]
    assert counted_noun(1, "body") == "1 body" and counted_noun(0, "key") == "0 keys"


@pytest.mark.parametrize("name", ["part.bdf", "part.INP", "part.msh", "part.cdb"])
@pytest.mark.parametrize("command", [["info"], ["convert", "-o", "part.SID_FEM"]])
def test_a_mesh_is_no_body_yet_and_the_way_to_one_is_told(
    name: str,
    command: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(name).write_text("GRID,1,,0.,0.,0.\n", encoding="utf-8")
    assert run([*command, name]) == 2
    text = " ".join(capsys.readouterr().err.split())
    assert f'type = "mesh", file = "{name}"' in text and "--from imported_mesh" in text
    assert not Path("part.SID_FEM").exists()
