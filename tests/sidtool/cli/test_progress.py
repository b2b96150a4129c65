"""Long computations report their progress; a terminal shows it with the
remaining time.
"""

from __future__ import annotations

import io
import re
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import sidtool
from sidtool.cli import progress
from sidtool.cli.main import run
from sidtool.formats.base.progress import (
    EqualStages,
    NamedStages,
    TimeEstimate,
    count_within,
    iterate_with_progress,
    report_stage,
    use_listener,
)
from sidtool.solver.compiler import precompile
from tests.places import SLIDER_CRANK

SCENE = str(SLIDER_CRANK / "slider_crank.toml")
SHORT = ["--set", "time.end=0.2"]
Reports = list[tuple[str, float | None]]


class Terminal(io.StringIO):
    """What somebody sees."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def reports() -> Reports:
    return []


def heard(reports: Reports, *arguments: str) -> dict[str, list[float | None]]:
    """Shares by what is done, of a command."""
    with use_listener(lambda text, share: reports.append((text, share))):
        assert run(list(arguments)) == 0
    found: dict[str, list[float | None]] = {}
    for text, share in reports:
        found.setdefault(text, []).append(share)
    return found


def test_every_long_command_reports_progress(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reports: Reports
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("STEPS_PER_CHUNK", "ENDS_PER_CHUNK"):  # steps between two looks
        monkeypatch.setattr(f"sidtool.solver.output.dense_output.{name}", 10)
    monkeypatch.setattr("sidtool.solver.simulation.preparation.STEPS_PER_REPORT", 10)
    commands = {
        "simulating": ["simulate", SCENE, "--set", "time.end=0.08", "-o", "r.h5"],
        "drawing pictures": ["animate", "r.h5", "-o", "m.gif"],
        "writing times": ["export", "r.h5", "-o", "m.vtkhdf"],
        "measuring points": [
            *["study", SCENE, *SHORT, "--integrator", "radau9"],
            *["--rtol", "1e-2", "--rtol", "1e-3", "--rtol", "1e-4", "--rtol", "1e-5"],
        ],
    }
    for text, words in commands.items():
        shares = heard(reports, *words)[text]
        known = [share for share in shares if share is not None]
        assert len(known) == len(shares) >= 2
        assert known == sorted(known) and 0 <= known[0] < 0.6 and known[-1] <= 1
    sid = tmp_path / "rod.SID_FEM"
    reports.clear()
    stages = heard(
        reports, "convert", str(SLIDER_CRANK / "rod_q4.toml"), "-o", str(sid)
    )
    assert sum("reducing" in text or "discretising" in text for text in stages) == 2
    assert_one_way([share for _, share in reports])
    assert "evaluating outputs" in heard(reports, "outputs", "r.h5", "--add", "rod.vx")


def test_the_model_search_reports_progress(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reports: Reports
) -> None:
    monkeypatch.setattr(
        "sidtool.measurement.cache.cache_path", lambda: tmp_path / "kept"
    )
    found = heard(reports, "simulate", SCENE, *SHORT, "--accuracy", "piston.x=1e-2")
    assert sum(text.startswith("choosing: ") for text in found) > 1
    assert_one_way([s for text, s in reports if text.startswith("choosing: ")])


def test_the_mesh_search_reports_progress(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reports: Reports
) -> None:
    """Conversions and runs of one search are one way, whatever turns up on it."""
    monkeypatch.setattr("sidtool.measurement.cache.cache_path", lambda: None)
    folder = tmp_path / "beam"
    assert run(["new", str(folder), "--from", "beam"]) == 0
    scene = folder / "scene.toml"
    text = scene.read_text(encoding="utf-8").replace(
        'sid = "beam.SID_FEM"', 'model = "beam.toml"'
    )
    scene.write_text(text.replace("end = 1.0", "end = 0.05"), encoding="utf-8")
    heard(reports, "simulate", str(scene), "--accuracy", "bar.tip.y=1e-2")
    texts = [text for text, _ in reports]
    first = next(k for k, text in enumerate(texts) if text.startswith("choosing"))
    search = reports[first : texts.index("simulating")]
    assert "discretising" in [text for text, _ in search]
    assert_one_way([s for text, s in search if text != "compiling, once"])


def assert_one_way(shares: list[float | None]) -> None:
    """Each share is known, none is below those before it; in the end most is done."""
    known = [share for share in shares if share is not None]
    assert len(known) == len(shares) > 4
    assert known == sorted(known) and 0.0 <= known[0] < 0.3 and 0.7 < known[-1] <= 1.0
    assert len(set(known)) > 4


def test_weights_of_stages_correct_the_remaining_time() -> None:
    """Whatever parts take, each ends where its estimate says; nothing falls."""
    reports: Reports = []
    with use_listener(lambda text, share: reports.append((text, share))):
        report_stage("before")
        with count_within(
            NamedStages({"mesh": 1.0, "modes": 3.0, "nothing": 0.0})
        ) as parts:
            report_stage("not begun")
            parts.enter("mesh")
            report_stage("mesh", 0.5)
            parts.enter("modes")
            with count_within(EqualStages(2)) as steps:
                for _ in range(4):  # more than expected
                    steps.next()
                    report_stage("modes", 0.5)
                    report_stage("modes")  # nobody knows
            parts.enter("nothing")
            report_stage("nothing")
        report_stage("after", 0.1)
    steps_ = [0.25 + 0.75 * s for s in (0.25, 0.75, 5 / 6, 7 / 8)]
    assert [share for _, share in reports] == pytest.approx(
        [None, 0.0, 0.125, *(s for s in steps_ for _ in range(2)), 1.0, 0.1]
    )


def test_the_remaining_time_follows_the_pace_so_far() -> None:
    pace = TimeEstimate()
    assert pace.left() is None
    pace.at(10.0, 0.2)
    assert pace.left() is None
    for now, share, left in ((14.0, 0.4, 12.0), (16.0, 0.4, 12.0), (30.0, 1.0, 0.0)):
        pace.at(now, share)
        assert pace.left() == pytest.approx(left)


def test_kernels_are_counted(monkeypatch: pytest.MonkeyPatch, reports: Reports) -> None:
    """Three groups of four kernels, without processes: each as it is ready."""
    created: list[str] = []
    monkeypatch.setattr(precompile, "_compile_here", created.append)
    monkeypatch.setattr(precompile.kernel_cache, "is_writable", lambda: False)
    with use_listener(lambda text, share: reports.append((text, share))):
        precompile._compile([("a", "b"), ("c",), ("d",)], None)
    assert created == ["a", "b", "c", "d"]
    assert [share for _, share in reports] == [0.0, 0.5, 0.75, 1.0]


def shown(
    work: Callable[[], None], monkeypatch: pytest.MonkeyPatch, patience: float = 0.0
) -> str:
    monkeypatch.setattr(progress, "MIN_DURATION", patience)
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("TERM", "xterm")
    with progress.show_progress():
        work()
    return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", terminal.getvalue())


def counting(seconds: float = 0.0) -> None:
    for _ in iterate_with_progress(range(20), "counting sheep"):
        time.sleep(seconds)


def test_a_terminal_shows_progress_and_remaining_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    visible = shown(lambda: counting(0.05), monkeypatch)
    lines = [line for line in re.split(r"[\r\n]", visible) if "counting sheep" in line]
    assert any(re.search(r"\d+% 0:00:0\d left 0:00:0\d", line) for line in lines), (
        visible
    )


def test_short_work_shows_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    assert shown(counting, monkeypatch, patience=60.0) == ""


def test_work_without_a_known_fraction_shows_the_elapsed_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def work() -> None:
        for text in ("first [x]", "then"):
            report_stage(text)
            time.sleep(0.15)

    visible = shown(work, monkeypatch)
    assert "first [x]" in visible and "then" in visible and "%" not in visible


def test_work_without_reports_shows_the_elapsed_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A factorisation reports its stage at its start, and nothing until its end."""

    def work() -> None:
        report_stage("factorising")
        time.sleep(1.5)

    visible = shown(work, monkeypatch, patience=0.1)
    assert "factorising" in visible and {"0:00:00", "0:00:01"} <= set(
        re.findall(r"\d:\d\d:\d\d", visible)
    )


@pytest.mark.parametrize("quiet", [True, False])
def test_quiet_silences_it(
    quiet: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["simulate", SCENE, *SHORT, "-o", str(tmp_path / "r.h5")]
    words += ["--quiet"] if quiet else []
    visible = shown(lambda: assert_done(words), monkeypatch)
    assert ("simulating" in visible) != quiet
    if quiet:
        assert visible == ""


def assert_done(words: list[str]) -> None:
    assert run(words) == 0


def test_results_do_not_depend_on_listeners(reports: Reports) -> None:
    scene = sidtool.Scene.load(SCENE).with_({"time.end": 0.1})
    alone = scene.simulate()
    with use_listener(lambda text, share: reports.append((text, share))):
        heard_ = scene.simulate()
    assert (alone.values == heard_.values).all()
