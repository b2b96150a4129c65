"""Modules in the working folder that have our names are never run."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sidtool.solver.compiler import precompile
from tests.places import ROOT, SLIDER_CRANK

SIMULATE = "sidtool", "simulate", "slider_crank.toml", "--set", "time.end=0.05"
#: Leaves a trace and then fails.
HOSTILE = "open(__file__ + '.ran', 'w').close()\nraise SystemExit('hostile')\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("slider_crank.toml", "rod_q4.SID_FEM"):
        shutil.copy(SLIDER_CRANK / name, tmp_path / name)
    for name in ("solver", "formats", "numba", "click"):
        (tmp_path / f"{name}.py").write_text(HOSTILE, encoding="utf-8")
    return tmp_path


def python(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        encoding="utf-8",
    )


def ran(folder: Path) -> list[str]:
    return [path.name for path in folder.glob("*.ran")]


def test_the_command_line_runs_installed_modules(folder: Path) -> None:
    done = python(folder, "-m", *SIMULATE)
    assert done.returncode == 0, done.stderr
    assert ran(folder) == []


def test_compiling_processes_run_installed_modules(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A compiling process compiles the requested kernel and answers."""
    monkeypatch.chdir(folder)
    with precompile._new_process() as process:
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write("linear.newton_matrix:store_linearisation\n")
        process.stdin.flush()
        assert process.stdout.readline() == "done\n"
    assert process.returncode == 0 and ran(folder) == []


def test_scripts_next_to_foreign_modules_import_sidtool(tmp_path: Path) -> None:
    """They are not run, and a script gets its own modules under their names."""
    for name in ("solver", "formats"):
        text = f"open(__file__ + '.ran', 'w').close()\nmine = '{name}'\n"
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    (tmp_path / "script.py").write_text(
        "import os\nfrom sidtool import read\nimport sidtool.api.operations\n"
        "from sidtool.solver.simulation.simulate import simulate\n"
        "print([name for name in os.listdir() if name.endswith('.ran')])\n"
        "import solver, formats\nprint(solver.mine, formats.mine)\n",
        encoding="utf-8",
    )
    done = python(tmp_path, "script.py")
    assert done.stdout == "[]\nsolver formats\n", done.stderr


def test_the_path_of_the_environment_hides_nothing(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("numba", "click"):
        (folder / f"{name}.py").unlink()
    paths = [".", *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, paths)))
    done = python(folder, "-m", *SIMULATE)
    assert done.returncode == 0, done.stderr
    assert ran(folder) == []


def test_nothing_is_imported_a_second_time_by_a_short_name() -> None:
    """In the repository `solver` can be imported, too: as another module."""
    short = re.compile(r"^\s*(from|import) (solver|formats)\b", re.MULTILINE)
    top = ROOT
    for folder in ("sidtool", "formats", "solver", "tests", "benchmarks", "examples"):
        for path in (top / folder).rglob("*.py"):
            own = path == Path(__file__)
            assert own or not short.search(path.read_text(encoding="utf-8")), path
