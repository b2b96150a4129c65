"""`sidtool.study`: a study as scripts and notebooks ask for it, beside the command."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.study import Study
from tests.places import SLIDER_CRANK

SCENE = SLIDER_CRANK / "slider_crank.toml"


@pytest.fixture(scope="module")
def found() -> Study:
    scene = sidtool.Scene.load(SCENE).with_({"time.end": 0.1})
    return scene.study({"modes": [1, 5], "terms": "all"}, rtol=[1e-4, 1e-7])


def test_points_are_those_of_the_command(found: Study, tmp_path: Path) -> None:
    """Errors and sizes do not depend on who asks, nor on how it is said."""
    words = ["--set", "time.end=0.1", "--over", "modes=1:5,terms=all", "--jobs", "1"]
    words += ["--rtol", "1e-4", "--rtol", "1e-7", "-o", str(tmp_path / "by_command")]
    assert run(["study", str(SCENE), *words]) == 0
    found.save(tmp_path / "by_script")
    texts = []
    for name in ("by_command", "by_script"):
        with (tmp_path / name / "study.csv").open(encoding="utf-8") as stream:
            rows = list(csv.DictReader(stream))
        texts.append([{**row, "seconds": "", "conversion": ""} for row in rows])
        for end in ("txt", "json", "png", "svg"):
            assert (tmp_path / name / f"study.{end}").stat().st_size > 0
    assert texts[0] == texts[1] and len(texts[0]) == 4


def test_a_study_reports_its_points(found: Study) -> None:
    """One mode where five are the reference: its error is that of two runs by hand."""
    assert sorted(p.choices["modes"] for p in found.points) == ["1", "1", "5", "5"]
    short = {"time.end": 0.1, "outputs.record": ["piston.x"]}
    scene = sidtool.Scene.load(SCENE).with_(short)
    one, five = (
        sidtool.simulate(scene, rtol=1e-9, sids={"rod": _modes(count)})
        for count in (1, 5)
    )
    poor = [p for p in found.points if p.choices["modes"] == "1"]
    tight = min(poor, key=lambda p: p.setting.rtol or 1.0)
    assert tight.setting.rtol == 1e-7
    differences = np.abs(one["piston.x"] - five["piston.x"]).max() / np.ptp(
        five["piston.x"]
    )
    assert tight.errors["piston.x"] == pytest.approx(differences, rel=1e-2)
    front = found.front("size")
    assert [p.size for p in front] == sorted({p.size for p in front})
    assert found.recommended(1.0) in found.points
    assert "4 points over modes" in repr(found)
    assert found._repr_html_().count("<tr>") == 5
    drawn = {axes.get_xlabel() for axes in found.plot().axes}
    assert drawn == {"wall time [s]", "elastic coordinates"}
    assert callable(
        sidtool.study
    )  # importing the package of this name has not hidden it


def test_a_table_of_pandas(found: Study) -> None:
    table = found.to_dataframe()
    assert list(table["error"]) == [p.error for p in found.points]
    assert table.attrs["units"]["seconds"] == "s"


def _modes(count: int) -> sidtool.SID:
    model = sidtool.Model.load(SLIDER_CRANK / "rod_q4.toml")
    return model.with_({"reduction.modes": count}).convert()


def test_invalid_studies_are_refused() -> None:
    with pytest.raises(sidtool.InputError, match="color.*mesh, modes"):
        sidtool.study(SCENE, over={"color": [1]})
    with pytest.raises(sidtool.InputError, match="rtol: found 1"):
        sidtool.study(SCENE, rtol=[1.0])


def test_callables_are_studied_as_the_same_function_of_a_file() -> None:
    """A crank of the angle 40 t^2, of the file and of a program: the same errors."""
    motion = {"type": "polynomial", "pieces": [{"from": 0, "coefficients": [0, 0, 40]}]}
    scene = sidtool.Scene.load(SCENE).with_({"time.end": 0.1})
    over, rtol = {"modes": [1, 5]}, [1e-4, 1e-7]
    of_file = scene.with_({"crank_angle.function": motion}).study(over, rtol=rtol)
    left = scene.with_({"crank_angle.function": {"type": "callable"}})
    program = {"crank_angle": (lambda t: 40 * t * t, lambda t: 80 * t, lambda t: 80.0)}
    called = left.study(over, rtol=rtol, drives=program)
    for one, other in zip(of_file.points, called.points, strict=True):
        assert one.choices == other.choices and not other.message
        if one.choices["modes"] == "1":
            assert other.errors == pytest.approx(one.errors, rel=1e-3)
    with pytest.raises(sidtool.InputError, match="do not know callables"):
        left.study(over, rtol=rtol, drives=program, jobs=2)
