"""The examples of CONTRIBUTING apply, and touch no more files than it says."""

from __future__ import annotations

import subprocess

import pytest

from tests.places import ROOT

#: Examples of `docs/adding`, and how many files they change beside tests.
MOST = {"primitive": 3, "force": 2, "integrator": 2}


def test_every_example_is_known() -> None:
    assert {path.stem for path in (ROOT / "docs/adding").iterdir()} == set(MOST)


@pytest.mark.needs("git")
@pytest.mark.parametrize("name", MOST)
def test_an_example_of_how_to_add_applies(name: str) -> None:
    diff = ROOT / "docs/adding" / f"{name}.diff"
    subprocess.run(["git", "apply", "--check", diff], cwd=ROOT, check=True)
    lines = diff.read_text(encoding="utf-8").splitlines()
    changed = [line.split(" b/")[1] for line in lines if line.startswith("diff --git")]
    tests = [path for path in changed if path.startswith("tests/")]
    assert len(tests) == 1 and len(changed) - 1 <= MOST[name]
