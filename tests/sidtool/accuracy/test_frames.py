"""The frames of bodies, and what small deformations leave out.

The independent reference is the same arm with geometric stiffening, whose two frames
differ by a hundredth of what is looked at here.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg

import sidtool
from sidtool.accuracy.frames import NEGLECT_FACTOR, neglected_order
from sidtool.conversion.frame_change import change_frame
from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.scene import SceneFile
from sidtool.measurement import cache
from tests.codes import only

from .arms import cantilever, swinging

RECORD = ["arm.tip.x", "arm.tip.y", "pin.fx"]


@pytest.fixture(autouse=True)
def _own_cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "cache_path", lambda: tmp_path / "kept")


def frames(found: sidtool.Result) -> tuple[dict[str, float], list[Diagnostic]]:
    """What small deformations leave out, of what was measured, and diagnostics on
    frames that were changed or not compared.
    """
    about = [
        each
        for each in found.diagnostics
        if each.code == "N608" or "frame" in str(each.data.get("what"))
    ]
    left = {o.name: o.theory for o in found.accuracy.outputs if o.theory is not None}
    lines = [line for line in found.accuracy.budget if line.part == "theory"]
    assert len(lines) == bool(left)
    return left, about


def sagging(gravity: float, **changes: Any) -> SceneFile:
    return swinging(0.8, gravity=[0.0, -gravity], **changes)


def apart(found: sidtool.Result, other: sidtool.Result, name: str) -> float:
    return float(np.abs(found[name] - other[name]).max())


def richest(sid: SID) -> sidtool.Result:
    """An arm with all its terms, bent by 2.7 %."""
    arm = {"sid": "arm", "markers": {"root": 1, "tip": 2}, "quadratic_inertia": True}
    scene = sagging(1.0, bodies={"arm": arm})
    return sidtool.simulate(scene, sids={"arm": sid}, rtol=1e-9)


@pytest.fixture(scope="module")
def exact() -> sidtool.Result:
    """The arm with geometric stiffening."""
    return richest(change_frame(cantilever(2, stiffened=True), "buckens:1"))


def test_a_strongly_bent_arm_is_put_in_the_frame_with_less_error(
    exact: sidtool.Result,
) -> None:
    sids = {"arm": cantilever(2)}
    result = sidtool.simulate(sagging(1.0), sids=sids, accuracy=0.3)
    own = richest(sids["arm"])
    left, (changed,) = frames(result)
    assert changed.code == "N608" and changed.data["frames"] == ("buckens",)
    better = richest(change_frame(sids["arm"], "buckens:1"))
    errors = result.accuracy.absolute()
    for name in RECORD:
        assert apart(better, exact, name) < 0.6 * apart(own, exact, name)
        assert apart(better, exact, name) < left[name]
        assert apart(result, exact, name) < errors[name] + left[name]
        assert max(apart(result, other, name) for other in (own, better)) < errors[name]
        assert result.error[name] < 0.3
    again = sidtool.simulate(sagging(1.0), sids=sids, accuracy=0.3)
    assert not again.accuracy.searched
    assert np.array_equal(again["arm.tip.x"], result["arm.tip.x"])


@pytest.mark.parametrize(
    "law",
    [{"type": "rayleigh", "alpha": 0.3, "beta": 0.0}, {"type": "modal", "ratio": 0.02}],
)
def test_damping_is_the_same_in_all_frames(law: dict[str, Any]) -> None:
    """A law of the scene is a matrix in the SID, in whose frame it holds: mass matrices
    and modes are others in mean axes, which were damped otherwise."""
    arm = {"sid": "arm", "markers": {"root": 1, "tip": 2}}
    sids = cantilever(2)
    ratio = law.get("ratio", 0.0)
    squares, modes = scipy.linalg.eigh(sids.Ke.m0, sids.Me.m0)
    weighted = sids.Me.m0 @ modes
    matrix = (weighted * 2.0 * ratio * np.sqrt(squares)) @ weighted.T
    matrix = matrix + law.get("alpha", 0.0) * sids.Me.m0
    found = [
        sidtool.simulate(
            sagging(1.0, bodies={"arm": arm | more}), sids={"arm": sid}, accuracy=0.04
        )
        for more, sid in (
            ({"damping": law}, sids),
            ({"damping": law}, sids),
            ({}, replace(sids, De=Taylor(matrix))),
        )
    ]
    results_of_frames = [frames(one) for one in found]
    assert [each.code for each in results_of_frames[0][1]] == ["N608"]
    assert [one.accuracy.searched for one in found] == [True, False, True]
    for name in RECORD:
        assert results_of_frames[0][0][name] == pytest.approx(
            results_of_frames[2][0][name], rel=1e-3
        )
        assert np.array_equal(found[0][name], found[1][name])
        errors = sum(one.accuracy.absolute()[name] for one in found[::2])
        assert apart(found[0], found[2], name) < errors


def test_without_a_better_frame_that_of_the_scene_is_kept(
    exact: sidtool.Result,
) -> None:
    """No model without stiffening is as exact as that, which a note says."""
    sids = {"arm": cantilever(2)}
    result = sidtool.simulate(sagging(1.0), sids=sids, accuracy=1e-3)
    own = richest(sids["arm"])
    left, about = frames(result)
    assert not about
    errors = result.accuracy.absolute()
    for name in RECORD:
        assert apart(result, own, name) < errors[name]
        assert 0.2 * left[name] < apart(result, exact, name) < left[name]
    beyond = only(result, "N609")
    assert beyond.subject == "pin.fx" and beyond.data["ratio"] > 1.0


@pytest.mark.parametrize(
    "seen", ["arm.x", "arm.tip.uy", "arm.angle", "arm.vx_body"], ids=lambda name: name
)
def test_outputs_relative_to_a_frame_keep_it(seen: str) -> None:
    """The place of the frame and displacements from it: also judged in others."""
    sids = {"arm": cantilever(2)}
    pin = {"pin": {"type": "revolute", "markers": ["ground", "arm.tip"]}}
    start = {"position": [-1.0, 0.0]}
    arm = {"sid": "arm", "markers": {"root": 1, "tip": 2}, "initial": start}
    outputs = {"record": ["arm.root.y", "arm.q1", seen]}
    scene = sagging(0.1, joints=pin, bodies={"arm": arm}, outputs=outputs)
    result = sidtool.simulate(scene, sids=sids, accuracy=0.05)
    left, about = frames(result)
    if seen.endswith("_body"):
        assert not left and [each.subject for each in about] == ["arm"]
        return
    assert not about
    assert left["arm.q1"] > 0.0
    rows = {o.name: o.variation for o in result.accuracy.outputs}
    assert 0.0 < left[seen] < 0.2 * rows[seen]


def test_arms_that_start_bent_keep_their_frame() -> None:
    sid = cantilever(2)
    body = {"sid": "arm", "markers": {"root": 1, "tip": 2}}
    body["initial"] = {"elastic": [0.02, 0.0]}
    result = sidtool.simulate(
        sagging(0.3, bodies={"arm": body}), sids={"arm": sid}, accuracy=0.2
    )
    left, (excluded,) = frames(result)
    assert not left and (excluded.code, excluded.subject) == ("N603", "arm")


def test_frames_of_stiffened_arms_report_their_neglected_terms() -> None:
    """With stiffening no frame is better: the estimate covers the difference to the
    other frame.
    """
    sid = cantilever(2, stiffened=True)
    tangent, mean = (
        sidtool.simulate(sagging(3.0), sids={"arm": s}, accuracy=1e-2)
        for s in (sid, change_frame(sid, "buckens:1"))
    )
    for found in (tangent, mean):
        left, about = frames(found)
        assert not about
        for name in RECORD:
            assert left[name] > apart(tangent, mean, name) - 0.01 * left[name]


@pytest.mark.parametrize("stiffened", [False, True])
def test_frames_without_a_run_change_less_than_estimated(stiffened: bool) -> None:
    sid = cantilever(2, stiffened=stiffened)
    for gravity in (0.03, 2.0 if stiffened else 0.2):
        one, other = (
            sidtool.simulate(sagging(gravity), sids={"arm": s}, rtol=1e-9)
            for s in (sid, change_frame(sid, "buckens:1"))
        )
        for name in RECORD:
            observed = apart(one, other, name) / np.ptp(one[name])
            assert observed <= NEGLECT_FACTOR * neglected_order("arm", one)


def test_a_stiff_arm_is_not_run_in_other_frames() -> None:
    sid = cantilever(2, stiffened=True)
    scene = swinging(0.4, gravity=[0.0, -0.03])
    result = sidtool.simulate(scene, sids={"arm": sid}, accuracy=1e-2)
    assert frames(result) == ({}, [])
