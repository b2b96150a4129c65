"""What a release contains, and that its version is the same everywhere."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import sidtool
from tests.distribution import FOLDERS, faults_of_sdist, faults_of_wheel
from tests.places import ROOT

BUILD = "from setuptools import build_meta; build_meta.build_{}({!r})"


def built(kind: str, source: Path, target: Path) -> Path:
    """Build an sdist or a wheel of a source tree, without a network."""
    command = [sys.executable, "-c", BUILD.format(kind, str(target))]
    done = subprocess.run(
        command, cwd=source, capture_output=True, encoding="utf-8", check=False
    )
    assert done.returncode == 0, done.stderr
    (path,) = target.glob("*.whl" if kind == "wheel" else "*.tar.gz")
    return path


def test_the_wheel_of_the_sdist_is_complete(tmp_path: Path) -> None:
    """Nothing of the packages is missing; no links, no tests, no other packages."""
    tree = tmp_path / "tree"
    hidden = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for folder in [*FOLDERS, "tests/formats/diagnostics"]:
        shutil.copytree(ROOT / folder, tree / folder, ignore=hidden)
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tree)
    sdist = built("sdist", tree, tmp_path / "out")
    assert faults_of_sdist(sdist) == []
    with tarfile.open(sdist, encoding="utf-8") as archive:
        archive.extractall(tmp_path / "extracted", filter="data")
    (source,) = (tmp_path / "extracted").iterdir()
    wheel = built("wheel", source, tmp_path / "out")
    assert faults_of_wheel(wheel) == []
    assert wheel.name.split("-")[1] == sidtool.__version__


def test_links_tests_and_foreign_files_of_a_wheel_are_found(tmp_path: Path) -> None:
    wheel = tmp_path / "w.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        link = zipfile.ZipInfo("sidtool/solver/x.py")
        link.external_attr = 0o120777 << 16
        archive.writestr(link, "target")
        archive.writestr("sidtool/tests/test_a.py", "")
        archive.writestr("formats/a.py", "")
    faults = faults_of_wheel(wheel)
    assert "link: sidtool/solver/x.py" in faults
    assert "test: sidtool/tests/test_a.py" in faults
    assert "outside of the package: formats/a.py" in faults
    assert "missing: sidtool/__init__.py" in faults


def test_the_version_is_semantic_and_the_same_everywhere() -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+", sidtool.__version__)
    cited = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {sidtool.__version__}\n" in cited
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.findall(r"^## (\S+)", changes, re.MULTILINE)[0] == sidtool.__version__


def test_the_change_log_has_a_line_for_each_change() -> None:
    """Each change is one line, in a section that states its type."""
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest = text.split("\n## ")[1]
    sections = re.split(r"\n### ", newest)[1:]
    assert {s.split("\n")[0] for s in sections} <= {
        "Added",
        "Changed",
        "Deprecated",
        "Removed",
        "Fixed",
        "Security",
    }
    for section in sections:
        assert re.findall(r"^ +\S.*", section, re.MULTILINE) == []
