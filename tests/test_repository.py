"""What the repository holds, and that optional programs are hidden from the tests."""

from __future__ import annotations

import importlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.optional import NAMES, PACKAGES, PROGRAMS, hidden_path
from tests.places import ROOT, posix

TOP_LEVEL = {
    ".ci",
    ".github",
    ".gitignore",
    "CHANGELOG.md",
    "CITATION.cff",
    "CONTRIBUTING.md",
    "LICENSE",
    "Makefile",
    "README.md",
    "benchmarks",
    "docs",
    "examples",
    "formats",
    "pyproject.toml",
    "setup.py",
    "sidtool",
    "solver",
    "tests",
}


def tracked() -> list[str]:
    """Mode, digest and path of every file of a clone."""
    if not (ROOT / ".git").exists():
        pytest.skip("this copy is not a clone")
    command = ["git", "-c", "core.quotepath=off", "ls-files", "-s"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
    return done.stdout.decode().splitlines()


@pytest.mark.needs("git")
def test_the_top_level_has_only_expected_files() -> None:
    assert {line.split("\t")[1].split("/")[0] for line in tracked()} == TOP_LEVEL


@pytest.mark.needs("git")
def test_no_file_is_a_link() -> None:
    """Windows writes links as text files, and the package would lack what they name."""
    assert [line for line in tracked() if line.startswith("120000")] == []


@pytest.mark.parametrize("name", PROGRAMS)
def test_an_optional_program_is_hidden(name: str) -> None:
    for alias in PROGRAMS[name]:
        assert shutil.which(alias) is None
        with pytest.raises(FileNotFoundError):
            subprocess.run([alias, "--version"], check=False)


@pytest.mark.parametrize("name", PACKAGES)
def test_an_optional_package_is_hidden(name: str) -> None:
    for module in PACKAGES[name]:
        with pytest.raises(ModuleNotFoundError):
            importlib.import_module(module)
        command = [sys.executable, "-c", f"import {module}"]
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, encoding="utf-8"
        )
        assert "ModuleNotFoundError" in done.stderr


@pytest.mark.needs("git")
def test_a_program_that_a_test_needs_is_found() -> None:
    done = subprocess.run(["git", "--version"], capture_output=True, check=True)
    assert b"git version" in done.stdout
    assert shutil.which("ccx") is None


@posix
def test_only_optional_programs_are_hidden(tmp_path: Path) -> None:
    for folder, programs in {"a": ("ccx", "sh2"), "b": ("make2",)}.items():
        (tmp_path / folder).mkdir()
        for program in programs:
            (tmp_path / folder / program).write_text("#!/bin/sh\n", encoding="utf-8")
            (tmp_path / folder / program).chmod(0o755)
    path = os.pathsep.join(str(tmp_path / name) for name in ("a", "b", "missing"))
    hidden = hidden_path(path, tmp_path / "links")
    assert shutil.which("ccx", path=path) and not shutil.which("ccx", path=hidden)
    assert shutil.which("sh2", path=hidden) and shutil.which("make2", path=hidden)


def test_every_mark_is_listed(request: pytest.FixtureRequest) -> None:
    marks = [m for item in request.session.items for m in item.iter_markers("needs")]
    assert {name for mark in marks for name in mark.args} <= NAMES


def test_a_clone_is_one_package_before_it_is_installed() -> None:
    """As for `python -m sidtool` in it; `-S` hides what is installed."""
    code = (
        f"import sys; sys.path.insert(0, {str(ROOT)!r}); "
        "from importlib.util import find_spec; "
        "print(*(find_spec(f'sidtool.{n}').origin for n in ('formats', 'solver')))"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", code],
        capture_output=True,
        encoding="utf-8",
        check=True,
    )
    found = [ROOT / name / "__init__.py" for name in ("formats", "solver")]
    assert done.stdout.split() == [str(path) for path in found]
