"""The slider-crank runs unchanged with the rod as solids and as beams."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import read_scene
from sidtool.formats.sid_files import read_sid
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import compile_scene, simulate
from tests.places import SLIDER_CRANK

from ..bodies import BEAMS, SOLIDS, beam, volume

SPACE = SLIDER_CRANK.parent / "rod_in_space"


def piston(rod: SID) -> np.ndarray:
    scene = read_scene(SLIDER_CRANK / "slider_crank.toml")
    result = simulate(compile_scene(scene, SLIDER_CRANK, sids={"rod": rod}))
    return result.values[:, result.names.index("piston.x")]


@pytest.fixture(scope="module")
def plane() -> np.ndarray:
    return piston(read_sid(SLIDER_CRANK / "rod_iga.SID_FEM"))


def rods() -> dict[str, ModelFile | Path]:
    return {
        "hex8": volume(SOLIDS["hex8"], 18),
        "tet10": volume(SOLIDS["tet10"], 18),
        "iga": volume(SOLIDS["iga"], 18),
        "euler": beam(BEAMS["beam"], 18),
        "lumped": beam(BEAMS["lumped"], 18),
        "example hex20": SPACE / "rod_hex20.toml",
        "example beam": SPACE / "rod_beam.toml",
    }


@pytest.mark.parametrize("name", rods())
def test_the_piston_moves_as_with_the_plane_rod(name: str, plane: np.ndarray) -> None:
    """Within 0.2 % of the effect of flexibility, 1.17e-5 m."""
    found = piston(sid_from_model(rods()[name]))
    assert np.abs(found - plane).max() < 2.3e-8
