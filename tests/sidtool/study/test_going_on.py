"""Studies of the command: fronts, wishes, and what is not computed again."""

from __future__ import annotations

import csv
import importlib
import json
import multiprocessing
import os
import signal
from pathlib import Path
from typing import Any

import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.measurement import tasks
from sidtool.measurement.tasks import as_completed, make_executor
from sidtool.study import StudyInterrupted, run_study
from tests.codes import unwrapped
from tests.places import posix

from ..accuracy.arms import swinging
from .parts import ONE, written

whole_module = importlib.import_module("sidtool.study.run_study")


def test_finished_points_are_not_computed_again(
    models: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After an end in the middle only the rest is run, and a wider study adds to it."""
    calls: list[Any] = []
    original = whole_module.run_task

    def counted(task: Any) -> Any:
        calls.append(task)
        return original(task)

    monkeypatch.setattr(whole_module, "run_task", counted)
    keep, given = tmp_path / "points", {"arm": models[1:]}
    again: dict[str, Any] = {"models": given, "settings": ONE, "keep": keep}

    def stop() -> str:
        return "enough" if len(calls) == 5 else ""

    axes = {"modes": (1, 2, 3, 4)}
    with pytest.raises(StudyInterrupted, match="enough"):
        run_study(swinging(0.4), axes, stop=stop, **again)
    assert len(calls) == 5
    first = run_study(swinging(0.4), axes, **again)
    assert len(calls) == 3 + 4
    monkeypatch.setattr(
        whole_module, "convert_model", lambda _: pytest.fail("converted")
    )
    second = run_study(swinging(0.4), axes, **again)
    assert len(calls) == 3 + 4
    assert [p.error for p in second.points] == [p.error for p in first.points]
    assert [p.seconds for p in second.points] == [p.seconds for p in first.points]
    assert second.points[0].conversion == first.points[0].conversion > 0.0
    run_study(swinging(0.41), axes | {"modes": (1,)}, **again)
    assert len(calls) > 7


def test_the_command_draws_fronts_and_continues(
    models: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In two processes; a scene whose body is its model."""
    path, out = written(tmp_path), tmp_path / "out"
    command = ["study", str(path), "--over", "modes=1:2"]
    command += ["--rtol", "1e-4", "--rtol", "1e-6", "-o", str(out), "--jobs"]
    assert run([*command, "2"]) == 0
    text = capsys.readouterr().out
    assert "Least error for the time" in text and "Least error for the size" in text
    with (out / "study.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 4 and {row["modes"] for row in rows} == {"1", "2"}
    points = sorted((out / "points").iterdir())
    assert run([*command, "1", "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert sorted((out / "points").iterdir()) == points
    assert [p["error"] for p in data["points"]] == [float(r["error"]) for r in rows]
    assert "Pareto front" in (out / "study.svg").read_text(encoding="utf-8")
    assert sidtool.read(out / "study.json").varied == ("modes", "integrator")


@pytest.mark.parametrize("points", [0, 1])
def test_an_interruption_reports_finished_points(
    points: int,
    models: list[Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path, out = written(tmp_path), tmp_path / "out"
    name = "run_task" if points else "_make_bodies"
    original = getattr(whole_module, name)

    def ended(*given: Any) -> Any:
        signal.raise_signal(signal.SIGINT)
        if points:
            return original(*given)
        raise StudyInterrupted("ended by Ctrl-C")

    monkeypatch.setattr(whole_module, name, ended)
    command = ["study", str(path), "--over", "modes=1:2", "-o", str(out)]
    assert run([*command, "--jobs", "1"]) == 130
    stderr = unwrapped(capsys.readouterr().err)
    assert ("finished points are in" in stderr) == (out / "points").exists()
    assert ("no point was finished" in stderr) == (not points)


@pytest.mark.parametrize(
    "arguments",
    [
        ["--over", "meshes"],
        ["--over", "modes=few"],
        ["--over", "frame=free"],
        ["--over", "modes", "--model", "leg=iga.json"],
        ["--over", "modes", "--model", "arm"],
        ["--over", "reduction,modes", "--of", "arm.q1"],
        ["--over", "modes", "--dask", "tcp://127.0.0.1:9"],
    ],
)
def test_wrong_wishes_are_refused(
    arguments: list[str],
    models: list[Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = written(tmp_path)
    assert run(["study", str(path), "--jobs", "1", *arguments]) == 2
    assert "expected" in unwrapped(capsys.readouterr().err)


def test_a_scene_that_stops_has_exit_status_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As `study --help` says; wrong input has 2."""
    path = tmp_path / "blocked.toml"
    line = {"position": [1.0, 0.5]}
    shrink = {"from": 0.0, "coefficients": [1.25**0.5, -0.5]}
    function = {"type": "polynomial", "pieces": [shrink]}
    sidtool.Scene(
        dimension="planar",
        time=sidtool.Time(end=3.0, output_step=0.5),
        bodies={"bar": sidtool.RigidBody(mass=1.0, inertia=0.1, initial=line)},
        joints={
            "rod": sidtool.Distance(markers=["ground", "bar"]),
            "rail": sidtool.PointOnLine(markers=["ground.side", "bar"]),
        },
        ground={"markers": {"side": {"position": [0.0, 0.5]}}},
        drives={"growth": sidtool.Drive(joint="rod", function=function)},
        outputs=sidtool.Outputs(record=["bar.x"]),
    ).save(path)
    few = ["--integrator", "radau9", "--rtol", "1e-2", "--jobs", "1"]
    assert run(["study", str(path), *few]) == 1
    assert "the reference stopped at t = 1.2" in unwrapped(capsys.readouterr().err)
    assert run(["study", str(path), *few, "--of", "bar.nothing"]) == 2


@posix
def test_signals_to_all_processes_end_none_of_a_pool() -> None:
    """Ending is the parent's matter, which keeps what was finished: neither while a
    process imports modules nor later do signals end it.
    """
    with make_executor(2, None) as (executor, _):
        others = multiprocessing.active_children()
        found = executor.submit(os.getpid)
        (process,) = set(multiprocessing.active_children()) - set(others)
        assert process.pid is not None
        for _ in range(2):
            for name in ("SIGINT", "SIGTERM", "SIGHUP"):
                os.kill(process.pid, getattr(signal, name))
            assert found.result() == process.pid
            found = executor.submit(os.getpid)
        assert found.result() == process.pid


@pytest.mark.parametrize(
    ("reason", "error"), [("", ChildProcessError), ("enough", StudyInterrupted)]
)
def test_a_process_that_is_ended_from_outside_ends_the_study(
    reason: str, error: type[Exception]
) -> None:
    """After a signal that was for the study, too, the study ends by that signal."""
    with (
        pytest.raises(error, match=reason or "ended from outside"),
        make_executor(2, None) as (executor, width),
    ):
        assert executor.submit(os._exit, 1).exception() is not None
        list(as_completed(executor, width, abs, iter([1]), lambda: reason))


def test_a_pool_has_no_more_processes_than_the_system_takes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Pools of Windows have at most 61, also on processors with 64 cores and more."""
    with make_executor(100, None) as (_, width):
        assert width >= 61
    monkeypatch.setattr(tasks, "MAX_POOL_PROCESSES", 2)
    with make_executor(100, None) as (_, width):
        assert width == 2
