"""`sidtool new` makes folders to start from."""

from __future__ import annotations

from pathlib import Path

import pytest

from sidtool.cli.main import run
from sidtool.pipeline import examples
from sidtool.pipeline.examples import EXAMPLE_TITLES
from sidtool.pipeline.files import kind_of
from tests.codes import unwrapped
from tests.places import EXAMPLES

#: Examples without flexible bodies.
RIGID = ("journal_bearing",)


@pytest.mark.parametrize("start", EXAMPLE_TITLES)
def test_every_start_is_its_example(
    start: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "mine"
    assert run(["new", str(folder), "--from", start]) == 0
    names = {path.name for path in folder.iterdir()}
    assert "README.md" in names
    for name in names:
        assert (folder / name).read_bytes() == (EXAMPLES / start / name).read_bytes()
        assert str(folder / name) in capsys.readouterr().out or len(names) > 1
    kinds = {kind_of(path) for path in folder.glob("*.toml")}
    assert "scene" in kinds
    assert "model" in kinds or start in RIGID


def test_existing_files_are_not_changed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "scene.toml").write_text("mine", encoding="utf-8")
    assert run(["new", str(folder)]) == 2
    assert "exists already" in unwrapped(capsys.readouterr().err)
    assert (folder / "scene.toml").read_text(encoding="utf-8") == "mine"
    assert run(["new", str(tmp_path / "no" / "folder")]) == 2
    assert "cannot be made" in unwrapped(capsys.readouterr().err)
    assert run(["new", str(tmp_path / "x"), "--from", "toaster"]) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_a_failed_copy_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(examples.shutil, "copyfile", full)
    assert run(["new", str(tmp_path / "mine")]) == 2
    assert "No space left" in unwrapped(capsys.readouterr().err)
    assert list(tmp_path.iterdir()) == []
