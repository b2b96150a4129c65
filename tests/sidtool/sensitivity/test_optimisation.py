"""Optimal designs against closed solutions; history, restart, the command."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.formats.design import DesignFile
from sidtool.sensitivity.optimisation import Iteration, write_history
from tests.pages import Page
from tests.places import ROOT

from . import scenes
from .scenes import G
from .test_derivatives import ellipk

pytestmark = pytest.mark.filterwarnings("ignore::sidtool.DiagnosticWarning")


def design(**tables: Any) -> DesignFile:
    head = {"format": "sidtool design", "version": 1, "scene": "scene.toml"}
    return DesignFile.checked(head | tables, "design")


@pytest.mark.parametrize("method", ["slsqp", "trust-constr"])
def test_the_shortest_pendulum_of_a_period(method: str) -> None:
    """It needs 0.7 s to its lowest point: L = g (0.7 / K(1/2))^2."""
    wanted = design(
        variables={"length": {"key": "parameters.length", "min": 0.5, "max": 3.0}},
        objective={"minimise": "min(bob.y)"},
        limits=[{"of": "end_time", "min": 0.7}, {"of": "end_time", "max": 0.8}],
        method={"name": method},
    )
    wanted = wanted.with_(
        {"objective": {"maximise": "min(bob.y)"}, "variables.length.start": 1.2}
    )
    found = sidtool.optimise(wanted, scene=scenes.pendulum())
    length = G * (0.7 / ellipk(0.5)) ** 2
    assert found.x["length"] == pytest.approx(length, rel=1e-4)
    assert found.values["min(bob.y)"] == pytest.approx(-length, rel=1e-4)
    assert found.converged and found.is_feasible


def test_the_lightest_bar_of_a_deflection(tmp_path: Path) -> None:
    """Under its own weight a bar sags by ~ 1 / h^2, with two dimensions as one."""
    scene = sidtool.Scene.load(ROOT / "examples/beam/scene.toml")
    model = sidtool.Model.load(ROOT / "examples/beam/beam.toml")
    coarse = {"discretisation.elements": 3, "reduction.modes": 4}
    scene = scene.with_({"bar.model": model.with_(coarse)})
    before = scene.static_equilibrium()["bar.tip.y"]
    limit = 0.6 * before
    section = "bar.model.geometry.section"
    wanted = design(
        variables={
            "height": {"key": f"{section}.height", "min": 0.005, "max": 0.05},
            "wider": {"keys": {f"{section}.width": 1.0}, "min": -0.012, "max": 0.01},
        },
        objective={"minimise": "mass(bar)"},
        limits=[{"of": "static(bar.tip.y)", "min": limit}],
        method={"tolerance": 1e-4},
    )
    found = sidtool.optimise(wanted, scene=scene)
    assert found.x["height"] == pytest.approx(0.01 / math.sqrt(0.6), rel=1e-3)
    assert found.x["wider"] == pytest.approx(-0.012)
    changed = found.model_changes["bar"]
    assert changed["geometry.section.width"] == pytest.approx(0.008)
    assert "at its bound" in found.report() and "reached" in found.report()
    found.save(tmp_path / "way.png")
    assert (tmp_path / "way.png").stat().st_size > 1000
    found.save(tmp_path / "report.html")
    tables = Page((tmp_path / "report.html").read_text(encoding="utf-8")).tables
    assert tables["Variables"][1][:3] == ["height", *_numbers(found, "height")]
    assert tables["Objective and limits"][2][-1] == "reached"
    assert len(tables["Iterations"]) == 1 + len(found.history)
    best = {**found.values, **found.x}
    assert tables["Iterations"][-1][1:] == [f"{x:.6g}" for x in best.values()]


def _numbers(found: sidtool.Optimum, name: str) -> list[str]:
    start = found.history[0].x[[*found.design.variables].index(name)]
    return [f"{start:.6g}", f"{found.x[name]:.6g}"]


def test_the_command_and_its_restart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The damping with which a block moves least, found from two starts."""
    scenes.oscillator().save(tmp_path / "scene.toml")
    wanted = design(
        scene=str(tmp_path / "scene.toml"),
        variables={"c": {"key": "spring.damping", "min": 0.1, "max": 60.0}},
        objective={"minimise": "rms(block.vx)"},
    )
    path, history = tmp_path / "design.toml", tmp_path / "history.json"
    wanted.save(path)
    command = ["optimise", str(path), "-o", str(history), "--json"]
    assert run(command) == 0
    first = json.loads(capsys.readouterr().out)
    assert first["converged"] and len(first["history"]) > 2
    assert run([*command, "--continue"]) == 0
    second = json.loads(capsys.readouterr().out)
    assert second["history"][0]["x"] == first["history"][-1]["x"]
    assert len(second["history"]) <= len(first["history"]) // 2 + 1
    write_history(history, ["c"], [Iteration((30.0,), (0.1,))])  # of an ended search
    assert run([*command, "--continue"]) == 0
    third = json.loads(capsys.readouterr().out)
    assert third["history"][0]["x"] == [30.0]
    assert third["best"]["x"]["c"] == pytest.approx(first["best"]["x"]["c"], rel=1e-2)
    values = [
        scenes.oscillator().with_({"spring.damping": c}).simulate()["block.vx"]
        for c in (0.8 * first["best"]["x"]["c"], 1.25 * first["best"]["x"]["c"])
    ]
    assert all(
        (v**2).mean() ** 0.5 > first["best"]["values"]["rms(block.vx)"] for v in values
    )


@pytest.mark.parametrize(
    "changes",
    [
        {"variables.c.min": 3.0},
        {"variables.c.key": "spring.nothing"},
        {"objective.minimise": "rms(block.nothing)"},
        {"objective.minimise": "mass(block), max(block.x)"},
        {"limits": [{"of": "biggest(block.x)", "max": 1.0}]},
    ],
)
def test_wrong_designs(changes: dict[str, Any]) -> None:
    wanted = design(
        variables={"c": {"key": "spring.damping", "min": 0.1, "max": 60.0}},
        objective={"minimise": "rms(block.vx)"},
    )
    with pytest.raises(sidtool.InputError):
        sidtool.optimise(wanted.with_(changes), scene=scenes.oscillator())
