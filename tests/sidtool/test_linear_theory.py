"""The limit of linear theory is reported everywhere; beyond it there is no result.

A cantilever under a tip force F has the deflection F L^3 / (3 E I) and the tip rotation
F L^2 / (2 E I): these determine which runs leave the theory.
"""

from __future__ import annotations

import json
import re
import warnings
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import sidtool
from sidtool.cli.main import cli
from sidtool.formats.result import read_result
from sidtool.formats.sid_files import write_sid
from sidtool.measurement import cache
from sidtool.measurement.runs import OutsideTheory
from tests.codes import codes, only
from tests.solver.scenes import scene
from tests.steel_bars import steel_bar

#: E I of the bar of 1 m, 40 mm wide and 20 mm high, in N m^2.
STIFFNESS = 2.1e11 * 0.04 * 0.02**3 / 12.0
#: Static deflections of the tip under a force in [m], and that of a force that is let
#: go at once: the double.
SAFE, FAR, USELESS = 0.02, 0.15, 3.0


def loaded(share: float, count: int = 1, **more: Any) -> Any:
    """Bars on a wall, the last one under a force that bends it by a share of 1 m."""
    names = [f"b{k + 1}" for k in range(count)]
    bar = {"sid": "bar.SID_FEM", "markers": {"a": 1, "b": 2}}
    joints = {
        f"wall_{name}": {"type": "fixed", "markers": ["ground", f"{name}.a"]}
        for name in names
    }
    force = {"type": "force", "marker": f"{names[-1]}.b"}
    push = force | {"force": [0.0, -3.0 * STIFFNESS * share]}
    return scene(
        dict.fromkeys(names, bar),
        joints,
        forces={"push": push},
        end=0.1,
        outputs={"record": [f"{names[-1]}.b.uy"]},
        **more,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scenes as files, beside the SID of their bars."""
    path: Path = tmp_path_factory.mktemp("bars")
    write_sid(path / "bar.SID_FEM", steel_bar(width=0.04, modes=6))
    created = {"safe": (SAFE,), "far": (FAR,), "useless": (USELESS,), "nine": (FAR, 9)}
    for name, arguments in created.items():
        text = loaded(*arguments).model_dump_json(by_alias=True, exclude_none=True)
        (path / f"{name}.json").write_text(text, encoding="utf-8")
    return path


def command(*arguments: object) -> Any:
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


def test_a_deflection_beyond_the_theory_is_a_warning_everywhere(folder: Path) -> None:
    stored = folder / "far.h5"
    with pytest.warns(sidtool.DiagnosticWarning, match="N411 b1") as caught:
        result = sidtool.simulate(folder / "far.json")
    body = result.bodies["b1"]
    assert body.deflection == pytest.approx(2.0 * FAR, rel=0.05)
    assert body.rotation == pytest.approx(1.5 * 2.0 * FAR, rel=0.1)
    warning = only(result, "N411")
    assert result.diagnostics[0] == warning and warning.subject == "b1"
    assert warning.data["deflection"] == body.deflection
    assert caught[0].message.code == "N411"  # type: ignore[union-attr]

    for quiet in ((), ("--quiet",)):
        found = command(
            "simulate", folder / "far.json", "-o", stored, "--force", *quiet
        )
        assert found.exit_code == 0
        assert "N411 b1" in found.stderr and "N411" not in found.stdout
    read = read_result(stored)
    assert read.diagnostics == result.diagnostics
    assert only(read, "N411").data == warning.data
    assert read.bodies["b1"].rotation == body.rotation
    assert "N411 b1" in command("info", stored).stdout
    found = command("simulate", folder / "far.json", "--json")
    assert warning.as_data() in json.loads(found.stdout)["diagnostics"]
    assert "N411 b1" in found.stderr


def test_a_code_is_ignored_and_strict_runs_fail_by_warnings(folder: Path) -> None:
    ignored = command("simulate", folder / "far.json", "--ignore", "n411", "--json")
    found = {d["code"] for d in json.loads(ignored.stdout)["diagnostics"]}
    assert "N411" not in found | {ignored.stderr[8:12]}
    quiet = [f"--ignore={code}" for code in found]
    strict = ("simulate", folder / "far.json", "--strict")
    assert command(*strict).exit_code == 1
    assert command(*strict, "--ignore", "N411", *quiet).exit_code == 0
    assert command(*strict, "--ignore", "N999").exit_code == 2
    key = "diagnostics.ignore=['N411']"
    assert "N411" not in command("simulate", folder / "far.json", "--set", key).stderr


def test_within_the_theory_there_is_no_warning(folder: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", sidtool.DiagnosticWarning)
        warnings.filterwarnings("ignore", "N220")  # the load jumps at the start
        assert codes(sidtool.simulate(folder / "safe.json")) == ["N220"]
        assert not codes(sidtool.static_equilibrium(folder / "safe.json"))
    ignored = command("simulate", folder / "safe.json", "--ignore", "N220")
    assert "warning" not in ignored.stderr


def test_a_plant_warns_once_and_stops_where_numbers_mean_nothing(folder: Path) -> None:
    plant = sidtool.Scene.load(folder / "far.json").compile().plant()
    with pytest.warns(sidtool.DiagnosticWarning, match="N41[13] b1") as caught:
        for _ in range(10):
            plant.advance(0.01)
    assert len(caught) == 1
    plant = sidtool.Scene.load(folder / "useless.json").compile().plant()
    with pytest.raises(sidtool.SimulationError) as stop:
        plant.advance(0.1)
    assert stop.value.code == "N414"
    with pytest.raises(sidtool.InputError, match="stopped"):
        plant.advance(0.01)
    plant.reset()
    plant.advance(1e-4)


def test_numbers_without_meaning_are_an_error(folder: Path) -> None:
    """The bar bends by six times its length: exit status 1, and the files hold it."""
    stored = folder / "useless.h5"
    with pytest.raises(sidtool.SimulationError) as stop:
        sidtool.simulate(folder / "useless.json")
    result = stop.value.result
    assert result is not None and not result.completed and result.message
    assert result.t[-1] == pytest.approx(0.1) and "N411" not in codes(result)
    again = ("simulate", folder / "useless.json", "-o", stored)
    for arguments in (again, (*again, "--continue")):
        failed = command(*arguments)
        assert failed.exit_code == 1 and "FAILED, 0 to 0.1 s" in failed.stdout
        assert not read_result(stored).completed and read_result(stored).message
    for analysis in ("static", "modes"):
        found = command("analyse", analysis, folder / "useless.json")
        assert found.exit_code == 1 and "b1" in found.stderr


def test_the_worst_body_is_never_cut_off(folder: Path) -> None:
    found = command("simulate", folder / "nine.json")
    assert "N411 b9" in found.stderr
    rows = [line.split()[0] for line in found.stdout.splitlines()]
    bodies = [name for name in rows if re.fullmatch(r"b\d", name)]
    assert len(bodies) == 8 and bodies[0] == "b9"


def test_analyses_of_a_state_carry_its_warnings(folder: Path) -> None:
    with pytest.warns(sidtool.DiagnosticWarning):
        rest = sidtool.static_equilibrium(folder / "far.json")
    with pytest.warns(sidtool.DiagnosticWarning):
        modes = sidtool.linearise(folder / "far.json")
    deflection = abs(rest.result().values[0, 0])
    assert deflection == pytest.approx(FAR, rel=0.02)
    assert codes(rest) == ["N411"] and set(rest.diagnostics) <= set(modes.diagnostics)
    assert rest.result().diagnostics == rest.diagnostics
    for analysis in ("static", "modes"):
        found = command("analyse", analysis, folder / "far.json", "--json")
        assert found.exit_code == 0
        assert only(rest, "N411").as_data() in json.loads(found.stdout)["diagnostics"]


def test_a_study_carries_the_notes_of_its_reference(folder: Path) -> None:
    settings: Any = {"integrators": ["radau5"], "rtol": [1e-3]}
    with pytest.warns(sidtool.DiagnosticWarning, match="b1"):
        study = sidtool.study(folder / "far.json", folder=folder / "kept", **settings)
    assert study.diagnostics[0].code == "N411"
    assert {"N411", "b1"} <= set(re.findall(r"\w+", study.report()))
    with pytest.warns(sidtool.DiagnosticWarning, match="b1"):  # of what was kept
        again = sidtool.study(folder / "far.json", folder=folder / "kept", **settings)
    assert again.diagnostics == study.diagnostics
    safe = sidtool.study(folder / "safe.json", **settings).diagnostics
    assert "N411" not in [each.code for each in safe]


def test_accuracy_refuses_from_where_a_run_warns(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One threshold for both: a tenth of the size."""
    monkeypatch.setattr(cache, "cache_path", lambda: tmp_path)
    sids = {"b1": folder / "bar.SID_FEM"}
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "N411")
        below = sidtool.simulate(loaded(0.045), sids=sids)
    with pytest.warns(sidtool.DiagnosticWarning, match="N411"):
        above = sidtool.simulate(loaded(0.055), sids=sids)
    assert below.bodies["b1"].deflection < 0.1 < above.bodies["b1"].deflection
    with pytest.raises(OutsideTheory, match="b1"):
        sidtool.simulate(loaded(0.055), sids=sids, accuracy=1e-2)
