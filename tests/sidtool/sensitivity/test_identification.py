"""Identified numbers and their intervals against linear theory and exact motions."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run
from tests.codes import codes
from tests.pages import Page

from . import scenes
from .test_derivatives import position, velocity

TRUE = {"block.mass": 2.0, "spring.stiffness": 50.0, "spring.damping": 0.4}
REST = (0.4, 0.5, 0.3)
T = np.linspace(0.0, 2.0, 101)
NOISE = 2e-3


def measured(seed: int) -> dict[str, np.ndarray]:
    """The closed solution with independent noise."""
    noise = NOISE * np.random.default_rng(seed).standard_normal(len(T))
    return {"t": T, "block.x": position(T, *TRUE.values(), *REST).real + noise}


def test_stiffness_and_damping_with_their_intervals() -> None:
    """Deviations are those of linear theory, s^2 (J^T J)^-1, with the exact J."""
    scene = scenes.oscillator().with_({"spring.stiffness": 60.0, "spring.damping": 1.0})
    keys = ["spring.stiffness", "spring.damping"]
    found = sidtool.identify(scene, keys, measured(3))
    columns = []
    for k in (1, 2):
        numbers = [2.0, *map(complex, found.x.values()), *REST]
        numbers[k] += 1e-30j
        columns.append(np.imag(position(T, *numbers)) / 1e-30)
    J = np.column_stack(columns)
    noise = found.noises["block.x"]
    assert noise == pytest.approx(NOISE, rel=0.2)
    expected = noise * np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    assert found.fit.deviations == pytest.approx(expected, rel=1e-4)
    for key in keys:
        low, high = found.intervals[key]
        assert low < found.x[key] < high
        assert abs(found.x[key] - TRUE[key]) < 2.0 * (high - low)
    assert not codes(found)


def test_exact_measurements_of_two_outputs() -> None:
    """Without noise the numbers are found to the error of the runs; NaN is left out."""
    scene = scenes.oscillator().with_({"spring.stiffness": 70.0, "spring.rest": 0.3})
    numbers = [*TRUE.values(), *REST]
    x, v = position(T, *numbers).real, velocity(T, *numbers).real
    x[::7] = np.nan
    found = sidtool.identify(
        scene,
        ["spring.stiffness", "spring.rest"],
        {"t": T, "block.x": x, "block.vx": v},
        ranges={"spring.rest": (0.0, 1.0)},
    )
    assert found.x["spring.stiffness"] == pytest.approx(50.0, rel=1e-6)
    assert found.x["spring.rest"] == pytest.approx(0.4, rel=1e-6)


@pytest.mark.filterwarnings("ignore::sidtool.DiagnosticWarning")
def test_what_makes_intervals_doubtful() -> None:
    """Mass and stiffness move a block alike; residuals of a wrong model are smooth."""
    scene = scenes.oscillator(damping=0.0)
    x = position(T, 2.0, 50.0, 0.4, *REST).real
    keys = ["block.mass", "spring.stiffness"]
    found = sidtool.identify(scene, keys, {"t": T, "block.x": x})
    assert {"N739", "N740"} <= {*codes(found)}


def test_a_measured_frequency() -> None:
    target = {"frequency(1)": (0.9, 0.01)}
    found = sidtool.identify(scenes.oscillator(), "spring.stiffness", targets=target)
    stiffness = 2.0 * (2.0 * np.pi * 0.9) ** 2
    assert found.x["spring.stiffness"] == pytest.approx(stiffness, rel=1e-6)
    low, high = found.intervals["spring.stiffness"]
    assert high - low == pytest.approx(2 * 1.96 * 2 * 0.01 / 0.9 * stiffness, rel=1e-3)


def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene, table = tmp_path / "scene.toml", tmp_path / "measured.csv"
    scenes.oscillator().save(scene)
    data = measured(3)
    rows = np.column_stack([T, data["block.x"]]).tolist()
    lines = [f"{t!r},{x!r}" for t, x in rows] + ["2.0,"]
    table.write_text("t [s],block.x [m]\n" + "\n".join(lines), encoding="utf-8")
    files = [str(tmp_path / name) for name in ("fit.png", "fit.json", "fit.html")]
    words = ["identify", str(scene), "--with", "spring.stiffness", "--json"]
    words += ["--measured", str(table), "--range", "spring.stiffness=10:100"]
    words += ["--target", "mass(block)=2+-0.1", "-o", files[0], "-o", files[1]]
    words += ["-o", files[2]]
    assert run(words) == 0
    found = json.loads(capsys.readouterr().out)
    low, high = found["variables"]["spring.stiffness"]["interval"]
    assert abs(low + high - 100.0) < 2.0 * (high - low) < 2.0
    assert all(Path(name).stat().st_size > 300 for name in files)
    tables = Page(Path(files[2]).read_text(encoding="utf-8")).tables
    value = found["variables"]["spring.stiffness"]["value"]
    assert tables["Variables"][1][2] == f"{value:.8g}"
    assert [row[0] for row in tables["Measured"][1:]] == ["block.x", "mass(block)"]


def test_measurements_in_other_units(tmp_path: Path) -> None:
    """Milliseconds and millimetres of the same block; without noise it is found."""
    x = position(T, *TRUE.values(), *REST).real
    table = tmp_path / "measured.csv"
    rows = np.column_stack([1e3 * T, 1e3 * x])
    head = "t [ms],block.x [mm]"
    np.savetxt(table, rows, "%.17g", ",", header=head, comments="")
    scene = scenes.oscillator().with_({"spring.stiffness": 60.0})
    found = sidtool.identify(scene, "spring.stiffness", table)
    assert found.x["spring.stiffness"] == pytest.approx(50.0, rel=1e-6)
    of = f"error(block.x, {table})"
    true = scenes.oscillator()
    assert sidtool.sensitivity(true, "spring.stiffness", of).values[0] < 1e-7


@pytest.mark.parametrize(
    "text",
    [
        "",
        "t,block.x,block.x\n0,1,1\n2,3,3\n",
        "t,block.x\n0,1,1,2\n2,3,3,4\n",
        "t [mm],block.x\n0,1\n1,2\n",
        "t,block.x [s]\n0,1\n1,2\n",
        "time,x\n0,1\n",
        "t,block.x\n0,one\n",
        "t,block.x\n1,0\n0,0\n",
        "t\n0\n",
    ],
)
def test_wrong_tables(text: str, tmp_path: Path) -> None:
    table = tmp_path / "measured.csv"
    table.write_text(text, encoding="utf-8")
    with pytest.raises(sidtool.InputError, match=r"measured\.csv"):
        sidtool.identify(scenes.oscillator(), "spring.stiffness", table)


def test_wrong_arguments() -> None:
    scene, key = scenes.oscillator(), "spring.stiffness"
    one = {"t": [0.0], "block.x": [0.5]}
    for wrong in ({}, {"block.x": [0.5]}, {"t": [0.0, 1.0], "block.x": [0.5]}, one):
        with pytest.raises(sidtool.InputError):
            sidtool.identify(scene, key, wrong)
    with pytest.raises(sidtool.InputError):
        sidtool.identify(scene, key, measured(1), ranges={"other": (0.0, 1.0)})
