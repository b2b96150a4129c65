"""Names of files that are not UTF-8, and what a command does without a name."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

import sidtool
import sidtool.api.study as asked_study
from sidtool.cli.main import run
from tests.places import SLIDER_CRANK, posix

#: Bytes of Latin-1, as Python has them in names of POSIX.
BYTES = "st\udcfcck"
STONE = """
format = "sidtool scene"
version = 1
dimension = "planar"
bodies.stone = { mass = 1.0, initial = { velocity = [2.0, 0.0] } }
outputs.record = ["stone.x"]
[time]
end = 0.1
output_step = 0.05
"""


@posix
def test_scenes_whose_names_are_not_utf_8(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = tmp_path / f"{BYTES}.toml"
    scene.write_text(STONE, encoding="utf-8")
    result = str(scene.with_suffix(".h5"))
    assert run(["simulate", str(scene), "-o", result]) == 0
    np.testing.assert_allclose(sidtool.read(result)["stone.x"], [0.0, 0.1, 0.2])
    assert run(["export", result, "-o", str(scene.with_suffix(".vtkhdf"))]) == 0
    pvd = scene.with_suffix(".pvd")  # XML, which names files
    assert run(["export", result, "-o", str(pvd)]) == 2 and not pvd.exists()
    titles = []

    def study(*_: object, title: str, **__: object) -> None:
        titles.append(title)
        raise sidtool.InputError("is not run here")

    monkeypatch.setattr(asked_study, "study", study)
    assert run(["study", str(scene), "-o", str(tmp_path / "study")]) == 2
    assert [title.encode() for title in titles] == [b"st?ck"]


@posix
def test_a_sid_whose_name_is_not_utf_8(tmp_path: Path) -> None:
    sid = tmp_path / f"{BYTES}.SID_FEM"
    sid.write_bytes((SLIDER_CRANK / "rod_q4.SID_FEM").read_bytes())
    scene = SLIDER_CRANK / "slider_crank.toml"
    short = ("--set", "time.end=0.01", "--sid", f"rod={sid}")
    result = str(tmp_path / "r.h5")
    assert run(["simulate", str(scene), *short, "-o", result]) == 0
    held = json.loads(sidtool.read(result).scene)["bodies"]["rod"]["sid"]
    assert held.endswith("st?ck.SID_FEM")
    with pytest.raises(sidtool.InputError) as caught:
        sidtool.SidBody(sid=sid)
    assert caught.value.place == "sid"


def test_endings_may_be_in_upper_case(tmp_path: Path) -> None:
    """Windows makes no difference; S.TOML was "a SID file"."""
    (tmp_path / "S.TOML").write_text(STONE, encoding="utf-8")
    sidtool.Scene.load(tmp_path / "S.TOML").save(tmp_path / "Saved.Toml")
    data = tomllib.loads((tmp_path / "Saved.Toml").read_text(encoding="utf-8"))
    (tmp_path / "S.JSON").write_text(json.dumps(data), encoding="utf-8")
    for name in ("S.TOML", "Saved.Toml", "S.JSON"):
        result, table = tmp_path / f"{name}.H5", tmp_path / f"{name}.CSV"
        command = ["simulate", str(tmp_path / name), "--set", "time.end=0.05"]
        assert run([*command, "-o", str(result), "-o", str(table)]) == 0
        np.testing.assert_allclose(sidtool.read(result)["stone.x"], [0.0, 0.1])
        assert np.loadtxt(table, delimiter=",", skiprows=1).shape == (2, 2)


def test_halves_of_characters_are_refused_by_their_key(tmp_path: Path) -> None:
    path = tmp_path / "scene.json"
    path.write_text(r'{"format": "sidtool scene", "title": "\ud800"}', encoding="utf-8")
    with pytest.raises(sidtool.InputError) as caught:
        sidtool.Scene.load(path)
    assert caught.value.place == "title"


def test_outputs_writes_what_was_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`outputs r.h5 -o o.csv` listed names, wrote nothing and said so by status 0."""
    (tmp_path / "s.toml").write_text(STONE, encoding="utf-8")
    result, table = str(tmp_path / "r.h5"), tmp_path / "o.csv"
    assert run(["simulate", str(tmp_path / "s.toml"), "-o", result]) == 0
    assert run(["outputs", result, "-o", str(table)]) == 0
    rows = np.loadtxt(table, delimiter=",", skiprows=1)
    np.testing.assert_allclose(rows[:, 1], 2.0 * rows[:, 0])
    capsys.readouterr()
    assert run(["outputs", result, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    np.testing.assert_allclose(data["stone.x"], 2.0 * np.array(data["t"]))
    assert run(["outputs", result]) == 0
    assert "stone" in capsys.readouterr().out
    assert run(["outputs", result, "--add", ","]) == 2
