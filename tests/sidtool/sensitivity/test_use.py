"""The command, functionals as texts, keys, tables of measurements."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.sensitivity.functionals import parse_functionals, split_at_commas
from sidtool.sensitivity.variables import find_variables

from . import scenes


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, table = tmp_path / "scene.toml", tmp_path / "table.csv"
    scenes.oscillator().save(path)
    texts = ["--with", "forces.*,block.mass", "--of", "mean(block.x), norm(block.x, 4)"]
    assert run(["sensitivity", str(path), *texts, "--json", "-o", str(table)]) == 0
    data = json.loads(capsys.readouterr().out)
    rows = data["sensitivities"]
    assert [row["functional"] for row in rows[:4]] == ["mean(block.x)"] * 4
    names = {row["variable"] for row in rows}
    springs = {f"forces.spring.{key}" for key in ("stiffness", "damping", "rest")}
    assert names == {"block.mass", *springs}
    shares = [abs(row["relative"]) for row in rows[:4]]
    assert shares == sorted(shares, reverse=True)
    assert data["runs"] == 1 and set(data["methods"].values()) == {"direct"}
    with table.open(newline="", encoding="utf-8") as stream:
        assert len([*csv.DictReader(stream)]) == len(rows)
    assert run(["sensitivity", str(path), *texts, "--method", "differences"]) == 0
    text = capsys.readouterr().out
    assert "norm(block.x, 4) = " in text
    assert "differences (as requested), " in text


@pytest.mark.parametrize(
    "text",
    [
        "block.x",
        "biggest(block.x)",
        "max(block.x, 1)",
        "norm(block.x)",
        "norm(block.x, 0.5)",
        "value(block.x, soon)",
        "max(block.nothing)",
        "frequency(first)",
        "error(block.x, missing.csv)",
        "",
    ],
)
def test_what_is_no_functional(text: str) -> None:
    with pytest.raises(sidtool.InputError):
        sidtool.sensitivity(scenes.oscillator(), "block.mass", text)


@pytest.mark.parametrize("text", ["value(block.x, 3)", "frequency(7)", "mass(rod)"])
def test_functionals_that_the_scene_does_not_have(text: str) -> None:
    with pytest.raises(sidtool.InputError):
        sidtool.sensitivity(scenes.oscillator(), "block.mass", text)


@pytest.mark.parametrize(
    "key", ["nothing.mass", "block.initial.angle", "x.*", "gravity", ""]
)
def test_what_is_no_variable(key: str) -> None:
    with pytest.raises(sidtool.InputError):
        find_variables(key, scenes.oscillator())


def test_functionals_as_texts() -> None:
    assert split_at_commas("value(a.x, 1), max(b.y)") == ["value(a.x, 1)", "max(b.y)"]
    kinds = [f.kind for f in parse_functionals(["max(a.x),end_time", "norm(a.x, 2*4)"])]
    assert kinds == ["max", "end_time", "norm"]


def test_distance_to_a_measurement(tmp_path: Path) -> None:
    """Root mean square distance to a motion that is 0.1 m away at all times."""
    result = scenes.oscillator().simulate()
    table = tmp_path / "measured.csv"
    x = result["block.x"]
    rows = np.column_stack([result.t, x + 0.1]).tolist()
    lines = [f"{t!r},{value!r}" for t, value in rows]
    table.write_text("t [s],block.x [m]\n" + "\n".join(lines), encoding="utf-8")
    found = sidtool.sensitivity(
        scenes.oscillator(), "spring.rest", f"error(block.x, {table})"
    )
    assert found.values[0] == pytest.approx(0.1, rel=1e-6)
    values = sidtool.sensitivity(
        scenes.oscillator(), "spring.rest", [f"value(block.x, {t!r})" for t, _ in rows]
    )
    assert found.derivatives[0, 0] == pytest.approx(
        -np.mean(values.derivatives[:, 0]), rel=1e-5
    )
