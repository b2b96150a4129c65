"""Examples in folders of their own, and their results."""

from __future__ import annotations

import fnmatch
import shutil
from pathlib import Path

import sidtool
from sidtool.formats.result import Result
from tests.places import EXAMPLES

#: Files of the examples in the repository; their commands write others.
OWN = (
    "*.toml",
    "*.md",
    "*.py",
    "*.ipynb",
    "*.png",
    "*_stations.csv",
    "*_table.csv",
    "rod_*.SID_FEM",
)


#: Examples of test_vibration_examples.py: another process runs their commands.
IN_OTHER_FILE = (
    "helicopter",
    "imported_mesh",
    "parameter_study",
    "unbalance",
    "xylophone",
)


def check_files(folder: Path) -> None:
    """Check that no command changed a file of the repository, and that git ignores the
    others that they wrote into a copy of an example.
    """
    text = (EXAMPLES / ".gitignore").read_text(encoding="utf-8")
    rules = [rule.rstrip("/") for rule in text.split("\n")]
    for path in folder.iterdir():
        own = EXAMPLES / folder.name / path.name
        if any(fnmatch.fnmatch(path.name, pattern) for pattern in OWN) and own.exists():
            assert path.read_bytes() == own.read_bytes(), path.name
        else:
            assert any(fnmatch.fnmatch(path.name, rule) for rule in rules), path.name


def copy_examples(top: Path) -> None:
    """Copy the files of every example to a folder of its name."""
    for path in EXAMPLES.glob("*/*"):
        if any(fnmatch.fnmatch(path.name, own) for own in OWN):
            (top / path.parent.name).mkdir(exist_ok=True)
            shutil.copyfile(path, top / path.parent.name / path.name)


def result_of(folder: Path) -> Result:
    result = sidtool.read(folder / "result.h5")
    assert isinstance(result, Result) and result.completed
    assert result.drift["position"] < 1e-10
    assert not any(note.rstrip().endswith("?") for note in result.notes), result.notes
    return result
