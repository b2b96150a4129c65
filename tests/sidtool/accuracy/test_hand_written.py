"""Scenes as a user writes them: errors against runs that the search has never seen.

What small deformations leave out is judged by the same bodies with geometric
stiffening, whose own remainder is of an order higher.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

import sidtool
from sidtool.formats.base.sid import SID
from sidtool.formats.scene import SceneFile
from sidtool.measurement import cache

from .hand_written import crane, drive, pendulum, yoke

WANTED = 1e-2


@pytest.fixture(autouse=True)
def _own_cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "cache_path", lambda: tmp_path / "kept")


def finest(scene: SceneFile, sids: Mapping[str, SID]) -> sidtool.Result:
    more = {"quadratic_inertia": True}
    flexible = {n: b.model_copy(update=more) for n, b in scene.sid_bodies.items()}
    whole = scene.model_copy(update={"bodies": {**scene.bodies, **flexible}})
    return sidtool.simulate(whole, sids=sids, integrator="radau13", rtol=1e-9)


@pytest.mark.parametrize("made", [crane, pendulum, yoke, drive])
def test_errors_and_neglected_terms_stay_within_their_estimates(
    made: Callable[[bool], tuple[SceneFile, dict[str, SID]]],
) -> None:
    scene, sids = made(False)
    result = sidtool.simulate(scene, sids=sids, accuracy=WANTED)
    exact, stiffened = finest(scene, sids), finest(*made(True))
    assert result.accuracy is not None
    assert len(result.accuracy.outputs) >= len(scene.outputs.record) - 1
    for output in result.accuracy.outputs:
        name = output.name
        zero = np.zeros(len(result.t))
        values = result[name] if name in result.names else zero
        assert output.theory is not None
        assert output.relative <= WANTED
        assert np.abs(values - exact[name]).max() <= output.error
        left_out = np.abs(values - stiffened[name]).max()
        assert left_out <= output.error + output.theory
