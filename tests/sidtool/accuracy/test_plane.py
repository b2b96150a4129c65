"""Spatial scenes whose motion is planar."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sidtool.accuracy.reference_run import out_of_plane_zeros
from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.scene import SceneFile
from sidtool.measurement import cache
from tests.bodies import particle_body

from .arms import TIGHT, finest, simulated, swinging


@pytest.fixture(autouse=True)
def _own_cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "cache_path", lambda: tmp_path)


def flat_in_space(record: list[str], **arm: Any) -> tuple[SceneFile, SID]:
    """A cloud that stays in the plane, on a pin in space, with a spring across."""
    sid = particle_body(4, 9, planar=True, seed=5)
    Ke = np.diag([4e3, 9e3, 6e5, 5e6])
    sid = replace(sid, Ke=Taylor(Ke), De=Taylor(2e-4 * Ke))
    pull = {"markers": ["ground.wall", "arm.tip"], "stiffness": 40.0, "rest": 0.5}
    content = {
        "dimension": "spatial",
        "gravity": [1.0, -9.81, 0.0],
        "ground": {"markers": {"wall": {"position": [1.5, 0.2, 0.0]}}},
        "bodies": {
            "arm": {
                "sid": "arm",
                "markers": {"root": 1, "tip": 2},
                "initial": {"angular_velocity": [0.0, 0.0, 3.0]},
                **arm,
            }
        },
        "joints": {"pin": {"type": "revolute", "markers": ["ground", "arm.root"]}},
        "forces": {"pull": {"type": "spring_damper", **pull}},
        "outputs": {"record": record},
    }
    return swinging(0.4, **content), sid


def test_a_spatial_scene_whose_motion_is_planar_is_solved_in_the_plane() -> None:
    names = ["arm.tip.x", "arm.tip.vy", "arm.tip.z", "pin.fx", "pin.mz", "pin.angle"]
    scene, sid = flat_in_space(names)
    result = simulated(scene, sid, accuracy=1e-4)
    decision = next(d for d in result.accuracy.decisions if d.what == "space")
    assert not decision.kept
    assert json.loads(result.scene)["dimension"] == "planar"
    expected = simulated(finest(scene), sid, **TIGHT)
    for name in set(result.error):
        error = np.abs(result[name] - expected[name]).max() / np.ptp(expected[name])
        assert error <= result.error[name] <= 1e-4
    assert not result["arm.tip.z"].any()


def test_a_flat_scene_may_record_by_wildcards() -> None:
    """A name whose quantity is a wildcard alone was refused as no quantity."""
    scene, sid = flat_in_space(["arm.tip.*"])
    result = simulated(scene, sid, accuracy=1e-2)
    assert json.loads(result.scene)["dimension"] == "planar"
    assert {"arm.tip.x", "arm.tip.z", "arm.tip.uy"} <= set(result.names)


def test_out_of_plane_rounding_is_not_assessed() -> None:
    """A rate of 1.6e-10 rad/s, beside 40 in the plane, was to be predicted to a
    thousandth: the error of its integration."""
    names = ("arm.tip.wx", "arm.tip.z", "pin.mx", "arm.tip.vy")
    largest = np.array([1.6e-10, 1e-13, 2e-8, 1e-12])
    rounding = 1e-12 * np.array([40.0, 2.0, 1e3, 40.0])
    scene, _ = flat_in_space(list(names))
    found = out_of_plane_zeros(scene, names, largest, rounding)
    assert found.tolist() == [True, True, True, False]
    assert not out_of_plane_zeros(scene, names, 1e6 * largest, rounding).any()
    pin = {"type": "revolute", "markers": ["ground", "arm.root"], "axis": [0, 1, 1]}
    content = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
    tilted = SceneFile.model_validate(content | {"joints": {"pin": pin}})
    assert not out_of_plane_zeros(tilted, names, largest, rounding).any()


@pytest.mark.parametrize(
    ("record", "spin"),
    [
        (["arm.tip.x", "pin.mx"], [0.0, 0.0, 3.0]),
        (["arm.tip.x"], [0.3, 0.0, 3.0]),
    ],
)
def test_motions_that_leave_the_plane_are_solved_in_space(
    record: list[str], spin: list[float]
) -> None:
    """A requested out-of-plane force, and an out-of-plane motion."""
    scene, sid = flat_in_space(record, initial={"angular_velocity": spin})
    forces = scene.ground.markers["wall"].model_copy(update={"position": (1.5, 0, 0.1)})
    ground = scene.ground.model_copy(update={"markers": {"wall": forces}})
    if spin[0]:
        ball = {"type": "spherical", "markers": ["ground", "arm.root"]}
        content = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
        scene = SceneFile.model_validate(content | {"joints": {"pin": ball}})
    else:
        scene = scene.model_copy(update={"ground": ground})
    result = simulated(scene, sid, accuracy=1e-3)
    assert json.loads(result.scene)["dimension"] == "spatial"
