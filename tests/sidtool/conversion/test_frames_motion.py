"""The slider-crank moves the same, whatever the body frame of its rod."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.conversion.frame_change import change_frame
from sidtool.formats.base.sid import SID
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import read_data, validate_data
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.places import SLIDER_CRANK

from ..models import rod

Q4 = {"type": "q4", "elements": [60, 4]}
PINS = ["crank_pin", "piston_pin"]
FRAMES: dict[str, dict[str, Any]] = {
    "tangent": {"type": "tangent", "marker": "crank_pin"},
    "chord": {"type": "chord", "markers": PINS},
    "buckens": {"type": "buckens"},
}


def piston(sid: SID) -> np.ndarray:
    """x of the piston over the first second."""
    data = read_data(SLIDER_CRANK / "slider_crank.toml")
    data["time"]["end"] = 1.0
    data["accuracy"]["rtol"] = 1e-8
    data["outputs"]["record"] = ["piston.x"]
    # The crank pin starts at the crank's end, wherever the frame is.
    data["bodies"]["rod"]["initial"]["position"] = [0.1 - sid.node(1).position[0], 0.0]
    scene = validate_data(data, SceneFile)
    result = sidtool.simulate(scene, sids={"rod": sid}, base_folder=SLIDER_CRANK)
    assert result.completed
    return result["piston.x"]


@cache
def clamped_modes(frame: str, stiffened: bool = False) -> SID:
    """The five modes of the rod held at its left edge, seen from any frame."""
    modes = {"method": "modal", "modes": 5, "fix": "left"}
    tables: dict[str, Any] = {"stiffening": {}} if stiffened else {}
    return sid_from_model(rod(Q4, frame=FRAMES[frame], reduction=modes, **tables))


@pytest.fixture(scope="module")
def reference() -> np.ndarray:
    return piston(clamped_modes("tangent"))


@pytest.fixture(scope="module")
def stiffened() -> np.ndarray:
    return piston(clamped_modes("tangent", stiffened=True))


@pytest.mark.parametrize("frame", ["chord", "buckens"])
def test_the_same_deformations_give_the_same_motion(
    frame: str, reference: np.ndarray
) -> None:
    """1e-6: what is left is the foreshortening that a linear field leaves out."""
    x = piston(clamped_modes(frame))
    assert np.abs(x - reference).max() < 1e-6 * np.abs(reference).max()


@pytest.mark.parametrize("frame", ["chord", "buckens"])
def test_with_the_second_order_field_no_difference_is_left(
    frame: str, stiffened: np.ndarray
) -> None:
    """Geometric stiffening is that field: 2e-9."""
    x = piston(clamped_modes(frame, stiffened=True))
    assert np.abs(x - stiffened).max() < 2e-9


@pytest.mark.parametrize("frame", ["tangent:2", "chord:1,2", "buckens"])
def test_re_referenced_sids_move_the_same(frame: str, stiffened: np.ndarray) -> None:
    sid = change_frame(clamped_modes("tangent", stiffened=True), frame)
    assert np.abs(piston(sid) - stiffened).max() < 2e-9


def test_other_deformations_differ_less_the_more_there_are() -> None:
    """Craig-Bampton in one frame against attachment modes in another."""
    differences = []
    for modes in (0, 2):
        runs = []
        for frame, method in (("tangent", "craig_bampton"), ("buckens", "attachment")):
            reduction = {"method": method, "interfaces": PINS, "modes": modes}
            model = rod(Q4, frame=FRAMES[frame], reduction=reduction, stiffening={})
            runs.append(piston(sid_from_model(model)))
        differences.append(np.abs(runs[0] - runs[1]).max())
    assert differences[0] > 20 * differences[1]
    assert differences[1] < 2e-9
