"""Every example runs, and its files are of the kinds that they say."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import sidtool
from sidtool.kinds import kind_of

EXAMPLES = Path(__file__).parents[1] / "examples"
FILES = sorted(EXAMPLES.glob("*/*.toml")) + sorted(EXAMPLES.glob("*/*.SID_FEM"))


def of_kind(kind: str) -> list[Path]:
    return [path for path in FILES if kind_of(path) == kind]


def name(path: Path) -> str:
    return path.stem


def test_every_folder_explains_itself() -> None:
    for folder in EXAMPLES.iterdir():
        assert (folder / "README.md").is_file(), folder


@pytest.mark.parametrize("path", of_kind("model"), ids=name)
def test_models_convert_to_sids_without_errors(path: Path) -> None:
    """A beam has rotary inertia in Me and not in Oe, of which I12 warns."""
    checks = sidtool.validate(sidtool.convert(path))
    expected = ["I12"] if path.stem == "rod_beam" else []
    assert [c.id for c in checks if c.failed] == expected


@pytest.mark.parametrize("path", of_kind("sid"), ids=name)
def test_sids_are_good(path: Path) -> None:
    assert [c.id for c in sidtool.validate(path) if c.failed] == []


@pytest.mark.parametrize("path", of_kind("scene"), ids=name)
def test_scenes_run_to_their_end(path: Path) -> None:
    result = sidtool.simulate(path)
    assert result.completed
    assert result.t[-1] == sidtool.read(path).time.end
    assert result.drift["position"] < 1e-10


def test_the_python_of_the_readme_runs(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    readme = (EXAMPLES.parent / "README.md").read_text()
    (tmp_path / "examples").symlink_to(EXAMPLES)
    monkeypatch.chdir(tmp_path)
    for code in re.findall(r"```python\n(.*?)```", readme, re.DOTALL):
        exec(code, {})
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("I1 ") and lines[0].endswith("passed")
    assert lines[-1].startswith("3.0 1.1")
