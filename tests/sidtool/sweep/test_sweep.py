"""Design parameters against closed solutions; failures, going on, tables, pictures."""

from __future__ import annotations

import csv
import importlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.special import ellipk

import sidtool
from sidtool.api.study import sweep
from sidtool.cli.common import table_on_screen
from sidtool.cli.main import run
from sidtool.formats.base.errors import InputError
from sidtool.study import StudyInterrupted
from sidtool.sweep import Sweep, SweepPoint
from sidtool.sweep.design import parse_axes
from tests.codes import unwrapped, with_code

from ..accuracy import arms
from ..study.parts import bar

whole_module = importlib.import_module("sidtool.study.run_study")

GRAVITY, ANGLE = 9.81, 2.0
PENDULUM = f"""
format = "sidtool scene"
version = 1
dimension = "planar"
gravity = [0.0, -{GRAVITY}]
[parameters]
length = 1.0
unused = 1.0
[time]
end = 3.0
output_step = 0.1
[accuracy]
rtol = 1e-9
[bodies.bob]
mass = 1.0
initial = {{position = ["length*sin({ANGLE})", "-length*cos({ANGLE})"]}}
[joints.string]
type = "distance"
markers = ["ground", "bob"]
[events.bottom]
quantity = "bob.x"
value = 0.0
action = "stop"
"""


@pytest.fixture
def pendulum(tmp_path: Path) -> Path:
    path = tmp_path / "pendulum.toml"
    path.write_text(PENDULUM, encoding="utf-8")
    return path


def cantilever(folder: Path) -> sidtool.Scene:
    """The bar of studies, clamped, at rest under a force across it at its tip."""
    model = bar(method="craig_bampton")
    (folder / "bar.json").write_text(json.dumps(model), encoding="utf-8")
    content = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "spatial",
        "time": {"end": 1e-4, "output_step": 1e-4},
        "initial": {"state": "static"},
        "bodies": {"bar": {"model": "bar.json", "markers": {"root": 1, "tip": 2}}},
        "joints": {"clamp": {"type": "fixed", "markers": ["ground", "bar.root"]}},
        "forces": {
            "load": {"type": "force", "marker": "bar.tip", "force": [0.0, 0.05, 0.0]}
        },
    }
    path = folder / "scene.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    return sidtool.Scene.load(path)


def test_quarter_period_of_a_pendulum_over_its_length(pendulum: Path) -> None:
    """K(sin(angle/2)) sqrt(l/g), from the time at which an event ends the run."""
    found = sweep(pendulum, "length=0.25:4:3:log", ["t.end", "bob.y.min"])
    assert np.allclose(found["length"], [0.25, 1.0, 4.0], rtol=1e-14)
    exact = ellipk(np.sin(ANGLE / 2) ** 2) * np.sqrt(found["length"] / GRAVITY)
    assert np.allclose(found["t.end"], exact, rtol=1e-7)
    assert np.allclose(found["bob.y.min"], -found["length"], rtol=1e-7)
    assert found.units == {"length": "", "t.end": "s", "bob.y.min": "m"}


def test_a_run_beyond_linear_theory_is_seen_among_others() -> None:
    """In the warnings of Python, in the table, in the counts and in its own point."""
    gravity = {"gravity[1]": [-0.01, -5.0]}
    sids = {"arm": arms.cantilever(2)}
    with pytest.warns(sidtool.DiagnosticWarning, match="N411 arm"):
        found = sweep(arms.swinging(0.4), gravity, "arm.tip.y.min", sids=sids)
    has_code = ["N411" in [d.code for d in point.diagnostics] for point in found.points]
    assert has_code == [False, True]
    assert found.data()["codes"]["N411"] == 1 and with_code(found, "N411")
    assert "N411" in found["message"][1] and "1 of 2" in found.report()


def test_a_long_sweep_fits_on_a_screen() -> None:
    """45 lines, the first rows; `-v` has all of 60."""
    points = [SweepPoint({"h": float(k)}, {"y.max": 1.0}) for k in range(60)]
    found = Sweep(points=tuple(points), axes=("h",), measures=("y.max",))
    text = table_on_screen(found.report, verbose=False)
    assert len(text.splitlines()) <= 45 and "... and 22 more (-v prints all)" in text
    assert len(table_on_screen(found.report, verbose=True).splitlines()) == 62


def test_deflection_of_a_cantilever_over_load_and_height_of_its_model(
    tmp_path: Path,
) -> None:
    """F L^3/(3 E I) in both models; a grid of keys of the scene and of the model."""
    height, force = "bar.model.geometry.section.height", "load.force[1]"
    over = {height: np.array([0.01, 0.02]), force: [0.05, 0.1]}
    sweep = cantilever(tmp_path).sweep(over, "bar.tip.uy.end,bar.tip.u*.max")
    assert list(sweep[height]) == [0.01, 0.01, 0.02, 0.02]
    inertia = 0.01 * sweep[height] ** 3 / 12
    exact = sweep[force] * 0.5**3 / (3 * 2e9 * inertia)
    assert np.allclose(sweep["bar.tip.uy.end"], exact, rtol=2e-3)  # and shear
    assert np.allclose(sweep["bar.tip.ux.max"], 0.0, atol=1e-3 * exact.min())
    assert [sweep.units[name] for name in sweep.axes] == ["m", "N"]


def test_measures_of_a_vibration() -> None:
    """x = 1 + 0.5 cos(2 pi t) over a whole period, on a spring."""
    scene = sidtool.Scene(
        dimension="planar",
        time=sidtool.Time(end=1.0, output_step=0.01),
        accuracy=sidtool.Accuracy(rtol=1e-9),
        bodies={"mass": sidtool.RigidBody(mass=1.0, initial={"position": [1.5, 0.0]})},
        forces={
            "spring": sidtool.SpringDamper(
                markers=["ground", "mass"],
                rest=1.0,
                stiffness=float(4 * np.pi**2),
            )
        },
    )
    of = [f"mass.x.{m}" for m in ("max", "min", "end", "mean", "rms", "amplitude")]
    (point,) = sweep(scene, {"mass.mass": [1.0]}, of).points
    exact = [1.5, 0.5, 1.5, 1.0, np.sqrt(1.0 + 0.125), 0.5]
    assert np.allclose(list(point.measures.values()), exact, rtol=1e-7)


def test_failed_runs_are_rows_and_finished_ones_are_stored(
    pendulum: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table, picture = tmp_path / "s.csv", tmp_path / "s.png"
    command = ["sweep", str(pendulum), "--over", "bob.mass=-1,1", "--over"]
    of = ["--of", "string.f1.min", "-o", str(table), "-o", str(picture)]
    assert run([*command, "length=1,2", *of, "--jobs", "1"]) == 1
    assert "2 of 4 runs failed" in unwrapped(capsys.readouterr().err)
    with table.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.reader(stream))
    assert rows[0] == ["bob.mass [kg]", "length", "string.f1.min [N]", "message"]
    assert [bool(row[2]) for row in rows[1:]] == [False, False, True, True]
    assert ["mass" in row[3] for row in rows[1:]] == [True, True, False, False]
    assert picture.read_bytes().startswith(b"\x89PNG")
    stored = set((tmp_path / "s.points").iterdir())
    assert len(stored) == 2
    command[3] = "bob.mass=1"
    assert run([*command, "length=1,2,3", *of, "--jobs", "1", "--json"]) == 0
    assert len(set((tmp_path / "s.points").iterdir()) - stored) == 1
    points = json.loads(capsys.readouterr().out)["points"]
    force = [p["measures"]["string.f1.min"] for p in points]
    assert force[:2] == [float(row[2]) for row in rows[3:]]


def test_finished_points_are_not_run_again(
    pendulum: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[Any] = []
    original = whole_module.run_task

    def counted(task: Any) -> Any:
        calls.append(task)
        return original(task)

    monkeypatch.setattr(whole_module, "run_task", counted)
    again: dict[str, Any] = {"over": "length=1:2:4", "of": "t.end"}
    again["folder"] = tmp_path / "kept"
    with pytest.raises(StudyInterrupted, match="enough"):
        sweep(pendulum, stop=lambda: "enough" if len(calls) == 2 else "", **again)
    found = sweep(pendulum, **again)
    assert len(calls) == 4
    assert np.array_equal(found["t.end"], sweep(pendulum, **again)["t.end"])
    assert len(calls) == 4
    sweep(pendulum, "accuracy.rtol=1e-8", "t.end", folder=again["folder"])
    assert len(calls) == 5


def test_a_table_without_and_with_pandas(pendulum: Path, tmp_path: Path) -> None:
    found = sweep(pendulum, {"length": [1.0, 2.0], "title": ["a", "b"]}, "bob.*.max")
    assert list(found)[:2] == ["length", "title"] and len(found) == len(list(found))
    assert list(found["title"]) == ["a", "b", "a", "b"]
    assert "bob.vx.max" in found and "bob.vx" not in found
    found.plot(tmp_path / "a.svg")
    pandas = pytest.importorskip("pandas")
    table = found.to_dataframe()
    assert isinstance(table, pandas.DataFrame) and list(table) == list(found)
    assert table.attrs["units"]["bob.vx.max"] == "m/s"
    assert isinstance(found, Sweep) and "bob.vx.max" in found._repr_html_()


@pytest.mark.parametrize(
    ("over", "of"),
    [
        ("length", "bob.x.max"),
        ("length=1:2", "bob.x.max"),
        ("length=1:2:0", "bob.x.max"),
        ("length=0:2:3:log", "bob.x.max"),
        ("length=1,,2", "bob.x.max"),
        ("lenght=1,2", "bob.x.max"),
        ("bob.weight=1,2", "bob.x.max"),
        ("bob.mass=-1,-2", "bob.x.max"),
        ("length=1,2", "bob.x"),
        ("length=1,2", "bob.nothing.max"),
        ("length=1,2", "bab.x.max"),
        ("length=1,2", "*.q1.max"),
        ("length=1,2", "bob.q1.max"),
        ("bob.model.height=1,2", "bob.x.max"),
        ("parameters.unused=1,2", "bob.x.max"),
    ],
)
def test_wrong_wishes_are_refused(
    over: str, of: str, pendulum: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["sweep", str(pendulum), "--over", over, "--of", of, "--jobs", "1"]
    assert run(command) == 2
    assert "expected" in unwrapped(capsys.readouterr().err)


def test_a_range_without_a_count_is_no_text(pendulum: Path) -> None:
    """The error of 1:2 names the form of a range."""
    with pytest.raises(InputError) as refused:
        parse_axes("length=1:2")
    assert "FROM:TO:COUNT" in (refused.value.expected or "")
