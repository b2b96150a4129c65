"""Long runs: chosen in a first part, with errors that are seen on all of the time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.accuracy import long_run_part as long, long_run_reference
from sidtool.api import interrupts
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.measurement import cache, candidates, runs as runs_
from sidtool.measurement.request import requested
from sidtool.measurement.runs import OutsideTheory
from sidtool.solver import compile_scene
from tests.codes import only, with_code
from tests.places import SLIDER_CRANK

from .arms import cantilever, particles, simulated, spun, swinging
from .test_accuracy import finest

TIGHT = {"integrator": "radau13", "rtol": 1e-11}
WANTED = 1e-3


@pytest.fixture(autouse=True)
def _all_are_long(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "cache_path", lambda: tmp_path / "kept")
    monkeypatch.setattr(long, "LONG_RUN_SECONDS", 0.0)


@pytest.fixture
def ends(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[float]]:
    """Until when each run of the search goes."""
    found: list[float] = []

    def counted(make: Any) -> Any:
        def run(self: runs_.Runs, *key: Any) -> Any:
            known = self.count
            try:
                return make(self, *key)
            finally:  # also of runs that leave the theory
                if self.count > known:
                    found.append(self.scene.time.end)

        return run

    for name in ("tight_run", "run_initial_interval"):
        monkeypatch.setattr(runs_.Runs, name, counted(getattr(runs_.Runs, name)))
    yield found


def lasting(scene: SceneFile, end: float, rows: int) -> SceneFile:
    more = {"end": end, "output_step": end / rows}
    time = scene.time.model_copy(update=more)
    return scene.model_copy(update={"time": time})


def check(scene: SceneFile, sid: SID, found: sidtool.Result) -> None:
    expected = simulated(finest(scene), sid, **TIGHT)
    for name in scene.outputs.record:
        error = np.abs(found[name] - expected[name]).max() / np.ptp(expected[name])
        assert error <= found.error[name] <= WANTED


@pytest.mark.parametrize("spatial", [False, True])
def test_a_long_motion_is_run_to_its_end_a_few_times_only(
    spatial: bool, ends: list[float]
) -> None:
    scene, sid = particles(spatial)
    scene = lasting(scene, 30.0 * scene.time.end, 600)
    result = simulated(scene, sid, accuracy=WANTED)
    check(scene, sid, result)
    assert result.accuracy is not None
    whole = sum(end == scene.time.end for end in ends)
    assert 2 <= whole <= 7 < len(ends) == result.accuracy.runs
    assert only(result, "N616").data["span"] == pytest.approx(scene.time.end)
    assert result.accuracy.decisions


def test_the_run_that_proves_the_model_is_the_one_that_is_delivered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A cached choice is run again: both results are equal."""
    scene, sid = particles(False)
    scene = lasting(scene, 60.0 * scene.time.end, 1200)
    again = interrupts.run_interruptible
    monkeypatch.setattr(interrupts, "run_interruptible", None)
    result = simulated(scene, sid, accuracy=WANTED)
    monkeypatch.setattr(interrupts, "run_interruptible", again)
    expected = simulated(scene, sid, accuracy=WANTED)
    assert result.accuracy is not None and result.accuracy.searched
    assert expected.accuracy is not None and not expected.accuracy.searched
    for table in ("t", "values", "positions", "velocities", "multipliers"):
        assert np.array_equal(getattr(result, table), getattr(expected, table))
    for attribute in ("notes", "scene", "settings", "names", "drift", "error"):
        assert getattr(result, attribute) == getattr(expected, attribute)


def test_a_motion_that_begins_late_is_not_judged_by_its_beginning(
    ends: list[float],
) -> None:
    """Nothing turns in the first part, where every shape function could be left out."""
    scene, sid = particles(False)
    turn = {"type": "smooth_step", "from": 1.2, "to": 1.8, "end": 1.0}
    bodies = {"arm": {"sid": "arm", "markers": {"root": 1, "tip": 2}}}
    content = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
    content |= {
        "bodies": bodies,
        "drives": {"turn": {"joint": "pin", "function": turn}},
    }
    content |= {"initial": {"state": "static"}}
    late = lasting(SceneFile.model_validate(content), 2.0, 400)
    result = simulated(late, sid, accuracy=WANTED)
    check(late, sid, result)
    assert ends.count(2.0) > 3
    assert result.accuracy is not None
    assert not with_code(result, "N616")


def test_mesh_errors_do_not_force_full_runs() -> None:
    """It was counted twice in the first part, where nothing kept the request then."""
    scene, sid = particles(False)
    scene = lasting(scene, 60.0 * scene.time.end, 1200)
    sids = {"arm": sid}
    request = requested(scene, sids, WANTED)

    def compiled(content: SceneFile, found: Any) -> Any:
        return compile_scene(content, ".", found)

    whole = candidates.finest_model(scene, sids)
    runs = runs_.Runs(
        scene, sids, compiled, request.names, runs_.expected_runs(whole, "planar")
    )
    size = np.ptp(runs.columns(whole, simulated(finest(scene), sid, **TIGHT)), axis=0)
    meshes = 0.45 * request.allowed(size)
    found = long.select_in_initial_interval(runs, whole, request, meshes)
    assert found is not None
    assert (found.chosen.errors > meshes).all()
    assert any(line.part == "shape functions" for line in found.lines)


def test_where_choices_in_a_part_cost_too_much_a_few_whole_runs_do(
    ends: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An undamped spatial four-bar of 36 elastic coordinates had made 62 tight ones."""
    monkeypatch.setattr(long, "MAX_FULL_RUNS", 0.0)
    scene, sid = particles(True)
    scene = lasting(scene, 30.0 * scene.time.end, 600)
    result = simulated(scene, sid, accuracy=WANTED)
    check(scene, sid, result)
    assert result.accuracy is not None
    assert (
        ends.count(scene.time.end)
        <= 2 * long_run_reference.MAX_LEVELS + long_run_reference.MAX_TRIALS
    )
    assert with_code(result, "N618")
    lines = {line.part: line for line in result.accuracy.budget}
    assert max(lines["integration"].errors.values()) > 0.0
    retained = result.sids["arm"].nq, lines["shape functions"].choice
    assert f" of {retained[0]}" in retained[1]


def test_shape_functions_of_little_energy_are_omitted_by_few_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Here the smallest model is taken to be the fastest."""

    def size(_: Any, choice: candidates.Choice, *__: Any, **___: Any) -> float:
        return float(sum(len(retained) for _, retained in choice.kept))

    monkeypatch.setattr(runs_.Runs, "seconds", size)
    monkeypatch.setattr(long, "MAX_FULL_RUNS", 0.0)
    scene, sid = particles(False)
    scene = lasting(scene, 60.0 * scene.time.end, 1200)
    stiff = np.diag([4e3, 9e3, 6e8, 5e9])
    sid = replace(sid, Ke=Taylor(stiff), De=Taylor(2e-6 * stiff))
    result = simulated(scene, sid, accuracy=0.1)
    expected = simulated(finest(scene), sid, **TIGHT)
    for name in scene.outputs.record:
        error = np.abs(result[name] - expected[name]).max() / np.ptp(expected[name])
        assert error <= result.error[name] <= 0.1
    assert result.accuracy is not None
    assert "4 of arm" in "".join(only(result, "N618").data["omitted"])


def test_short_runs_that_were_taken_for_long_ones_are_searched_as_a_whole() -> None:
    """As on a busy machine. Two loose runs of the slider-crank never show its modes."""
    result = sidtool.simulate(SLIDER_CRANK / "slider_crank.toml", accuracy=1e-2)
    expected = sidtool.simulate(
        SLIDER_CRANK / "slider_crank.toml", integrator="radau13", rtol=1e-10
    )
    for name, error in result.error.items():
        differences = np.abs(result[name] - expected[name]).max() / np.ptp(
            expected[name]
        )
        assert differences <= error <= 1e-2


def test_large_deformations_at_the_start_are_reported_before_long_runs(
    ends: list[float],
) -> None:
    scene = lasting(spun(2.0, 0.5), 40.0, 800)
    with pytest.raises(OutsideTheory):
        simulated(scene, cantilever(), accuracy=WANTED)
    assert max(ends) < 40.0


def test_output_steps_beyond_the_end_leave_no_first_part() -> None:
    """The search for ends of first parts doubled zero without end."""
    scene = spun(2.0, 0.05)
    time = scene.time.model_copy(update={"output_step": 30.0 * scene.time.end})
    long_steps = scene.model_copy(update={"time": time})
    with pytest.raises(InputError, match="no output"):  # of one time alone
        simulated(long_steps, cantilever(2, stiffened=True), accuracy=WANTED)


def test_a_scene_with_formulas_gets_its_accuracy() -> None:
    """It was refused after the whole search, as what is kept had no parameters."""
    content = swinging(0.1).model_dump(mode="json", by_alias=True, exclude_none=True)
    content["gravity"] = [0.0, -0.981]
    plain = validate_data(content, SceneFile)
    content |= {"parameters": {"g": 9.81}, "gravity": [0.0, "-g/10"]}
    with_formula = validate_data(content, SceneFile)
    sid = cantilever(2, stiffened=True)
    result = simulated(with_formula, sid, accuracy=1e-2)
    known = simulated(with_formula, sid, accuracy=1e-2)
    assert result.completed and known.accuracy is not None
    assert not known.accuracy.searched
    expected = simulated(plain, sid, **TIGHT)
    for name in plain.outputs.record:
        size = np.ptp(expected[name])
        assert np.abs(result[name] - expected[name]).max() <= 1e-2 * size
