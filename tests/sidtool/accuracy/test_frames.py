"""What small deformations leave out: one scene said in two frames of its body."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sidtool
from sidtool.accuracy import cached
from sidtool.accuracy.frames import FACTOR, left_out
from sidtool.conversion.rereference import rereferenced
from sidtool.formats.result import BudgetLine

from .arms import cantilever, swinging


@pytest.fixture(autouse=True)
def _apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cached, "folder", lambda: tmp_path / "kept")


def frames(found: sidtool.Result) -> tuple[BudgetLine | None, str]:
    """The line of the budget, and the sentence."""
    lines = [line for line in found.accuracy.budget if line.part == "frames"]
    told = [text for text in found.accuracy.sentences if text.startswith("frames:")]
    assert len(told) == 1 and len(lines) <= 1
    return (lines[0] if lines else None), told[0]


@pytest.mark.parametrize(
    ("stiffened", "gravity", "remedy"),
    [
        (False, 0.3, "a SID of arm with geometric"),
        (True, 3.0, "bodies cut into several"),
    ],
)
def test_two_frames_see_what_the_budget_says(
    stiffened: bool, gravity: float, remedy: str
) -> None:
    """Said in the frame of mean axes the scene differs by the line of the first, and
    its own line is as large: neither frame is better than the other by what is told."""
    sid = cantilever(2, stiffened=stiffened)
    scene = swinging(0.8, gravity=[0.0, -gravity])
    names = scene.outputs.record
    tangent, mean = (
        sidtool.simulate(scene, sids={"arm": s}, accuracy=1e-3)
        for s in (sid, rereferenced(sid, "buckens:1"))
    )
    seen = {n: np.abs(tangent[n] - mean[n]).max() for n in names}
    for found, other in ((tangent, "mean axes"), (mean, "")):
        line, told = frames(found)
        assert line is not None and other in told and remedy in told
        for name in names:
            apart = found.accuracy.absolute()[name] + 0.3 * seen[name]
            assert line.errors[name] == pytest.approx(seen[name], abs=apart)
            assert line.errors[name] > 0.3 * seen[name]


@pytest.mark.parametrize("stiffened", [False, True])
def test_frames_that_are_not_run_change_less_than_is_said(stiffened: bool) -> None:
    sid = cantilever(2, stiffened=stiffened)
    for gravity in (0.03, 2.0 if stiffened else 0.2):
        scene = swinging(0.8, gravity=[0.0, -gravity])
        one, other = (
            sidtool.simulate(scene, sids={"arm": s}, rtol=1e-9)
            for s in (sid, rereferenced(sid, "buckens:1"))
        )
        for name in scene.outputs.record:
            seen = np.abs(one[name] - other[name]).max() / np.ptp(one[name])
            assert seen <= FACTOR * left_out("arm", one)


def test_a_stiff_arm_is_not_run_in_other_frames() -> None:
    sid = cantilever(2, stiffened=True)
    scene = swinging(0.4, gravity=[0.0, -0.03])
    found = sidtool.simulate(scene, sids={"arm": sid}, accuracy=1e-2)
    line, told = frames(found)
    assert line is None and "deforms so little" in told
