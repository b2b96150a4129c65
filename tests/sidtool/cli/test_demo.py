"""The demo runs completely and prints all its parts."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

from sidtool.cli import main
from sidtool.cli.main import run
from sidtool.pipeline import examples
from tests.codes import unwrapped


def test_the_demo(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(warnings, "showwarning", main._print_warning)  # as `main` does
    assert run(["demo", "-o", str(tmp_path / "demo")]) == 0
    text, errors = capsys.readouterr()
    assert "warning N161 " in errors and ".py:" not in errors
    for row in (
        ["Q4", "31.7011", "200.5533", "560.6341", "1082.3189", "1254.9495"],
        ["paper,", "ANSYS", "31.8", "200.6", "560.6", "1082.3", "1254.9"],
        ["IGA", "31.4756", "199.1277", "556.6979", "1074.4210", "1254.9127"],
        ["paper,", "IGA", "31.7", "201.7", "564.5", "1089.3", "1255.5"],
    ):
        assert row in [line.split() for line in text.splitlines()]
    for word in ("piston.x at 1.5 s", "trapezoidal", "greatest difference"):
        assert word in text
    written = {path.name for path in (tmp_path / "demo").iterdir()}
    assert ("motion.html" in written) == ("in a browser" in text)
    assert "in a browser" in text or "sidtool[view]" in text
    ends = ("SID_FEM", "h5", "field.h5")
    assert written - {"motion.html"} == {
        *(f"rod_{kind}.{end}" for kind in ("q4", "iga") for end in ends),
        *("rod_q4.csv", "rod_iga.csv", "rod.png", "motion.png", "precision.png"),
    }


def test_without_the_examples_the_demo_reports_their_absence(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(examples, "_EXAMPLES", (tmp_path / "examples",))
    assert run(["demo", "-o", str(tmp_path / "demo")]) == 2
    assert "files of the example are not here" in unwrapped(capsys.readouterr().err)
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_way_of_the_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "demo").write_text("", encoding="utf-8")
    assert run(["demo", "-o", str(tmp_path / "demo")]) == 2
    assert "cannot be a folder" in unwrapped(capsys.readouterr().err)
