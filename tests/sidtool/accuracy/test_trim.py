"""`sidtool trim`: what a scene needs of a SID, and that the rest was not needed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import sidtool
from sidtool.accuracy.trimmed_sid import used_nodes
from sidtool.cli.main import run
from sidtool.formats.base.sid import SID
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_files import read_sid, write_sid
from sidtool.measurement import cache
from tests.bodies import particle_body
from tests.codes import unwrapped

from .arms import particles
from .test_accuracy import TIGHT, finest


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "cache_path", lambda: tmp_path / "kept")


def files(tmp_path: Path) -> tuple[SceneFile, SID]:
    scene, sid = particles(False)
    write_sid(tmp_path / "arm.h5", sid)
    content = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
    content["bodies"]["arm"]["sid"] = "arm.h5"
    (tmp_path / "scene.json").write_text(json.dumps(content), encoding="utf-8")
    return scene, sid


def test_the_small_body_moves_as_the_whole_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene, sid = files(tmp_path)
    small = tmp_path / "small.SID_FEM"
    command = ["trim", str(tmp_path / "arm.h5"), str(tmp_path / "scene.json")]
    assert run([*command, "-o", str(small), "--accuracy", "arm.tip.y=1e-4"]) == 0
    stdout = capsys.readouterr().out
    left = read_sid(small)
    assert 0 < left.nq < sid.nq and f"{left.nq} of 4 shape functions" in stdout
    assert "arm.tip.y" in stdout and "allowed" in stdout
    whole = sidtool.simulate(finest(scene), sids={"arm": sid}, **TIGHT)
    few = sidtool.simulate(finest(scene), sids={"arm": left}, **TIGHT)
    error = np.abs(few["arm.tip.y"] - whole["arm.tip.y"]).max()
    assert 0 < error <= 1e-4 * np.ptp(whole["arm.tip.y"])


def test_nodes_that_a_scene_names_are_kept() -> None:
    sid = particle_body(2, 9, planar=True, seed=1, nodes=6)
    scene, _ = particles(False)

    def used(*record: str) -> set[str]:
        outputs = scene.outputs.model_copy(update={"record": record})
        content = scene.model_copy(update={"outputs": outputs})
        return used_nodes(content, ["arm"], sid)

    assert used("arm.tip.x") == {"1", "2"}
    assert used("arm.5.x", "arm.q1") == {"1", "2", "5"}
    assert used("arm.*.x") == {"1", "2", "3", "4", "5", "6"}
    assert used("arm.q*", "*.x") == {"1", "2"}


def test_a_body_that_is_not_in_the_scene_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, sid = files(tmp_path)
    write_sid(tmp_path / "leg.h5", sid)
    command = ["trim", str(tmp_path / "leg.h5"), str(tmp_path / "scene.json")]
    assert run([*command, "-o", str(tmp_path / "small.h5")]) == 2
    assert "no body of the scene has the SID" in unwrapped(capsys.readouterr().err)
    assert not (tmp_path / "small.h5").exists()
