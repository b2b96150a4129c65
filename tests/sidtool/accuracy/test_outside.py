"""Where the theory of small deformations ends there is no number, but what would do."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sidtool.formats.base.sid import Taylor
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.measurement.runs import OutsideTheory
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.codes import codes

from ..beams import beam_data
from .arms import cantilever, particles, refined, simulated, spun, swinging


@pytest.mark.parametrize(
    ("scene", "stiffened", "message"),
    [
        (swinging(gravity=[0.0, -12.0]), True, "N411 arm"),
        # with stiffening the deflection stays below a tenth; splitting the body was
        # suggested
        (swinging(gravity=[0.0, -3.0]), False, "N404 arm"),
        (spun(2.5, 20.0), False, "N404 arm"),
        (spun(5.0, 20.0), False, "N405 arm"),
    ],
)
def test_large_deformations_are_refused_with_a_remedy(
    scene: SceneFile, stiffened: bool, message: str
) -> None:
    """What diverges for want of stiffening, to 1e15 lengths, is not to be cut into as
    many parts."""
    with pytest.raises(OutsideTheory, match=message):
        simulated(scene, cantilever(2, stiffened=stiffened), accuracy=1e-2)


@pytest.mark.parametrize(("speed", "refused"), [(4.0, True), (0.02, False)])
def test_a_solid_that_flaps_across_its_spin_lacks_stiffening(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, speed: float, refused: bool
) -> None:
    """Rotation does not soften it, so its SID shows no effect; a stiffened one would
    add 1.19 (speed / first frequency)^2 of its stiffness.
    """
    monkeypatch.chdir(tmp_path)
    corners = [
        [[[x, y, z] for z in (-0.005, 0.005)] for y in (-0.05, 0.05)] for x in (0, 1)
    ]
    data = beam_data({"type": "hex20", "elements": [2, 1, 1]})
    data["geometry"] = {
        "type": "nurbs_volume",
        "degrees": [1, 1, 1],
        "knots": [[0, 0, 1, 1]] * 3,
        "control_points": corners,
    }
    data["material"] = {"youngs_modulus": 1e9, "poissons_ratio": 0.0, "density": 1e4}
    for marker in data["markers"].values():
        marker["at"] = [0.5, 0.5]
    Path("blade.json").write_text(json.dumps(data), encoding="utf-8")
    ramp = {"type": "sine_ramp", "from": 0.0, "to": 1.0, "end": 1.0}
    scene = spun(
        speed,
        1.0,
        dimension="spatial",
        bodies={"arm": {"model": "blade.json", "markers": {"root": 1, "tip": 2}}},
        forces={
            "push": {
                "type": "force",
                "marker": "arm.tip",
                "force": [0.0, 0.0, 0.5],
                "function": ramp,
            }
        },
        outputs={"record": ["arm.tip.uz"]},
    )
    if refused:
        with pytest.raises(OutsideTheory, match="N606 arm"):
            refined(scene, 3e-2)
    else:
        assert "N606" not in codes(refined(scene, 3e-2))


def test_twist_is_no_stiffening() -> None:
    """A flat bar whose sections rotation turns is refused as one that only bends."""
    data = beam_data({"type": "beam", "elements": 4}) | {
        "geometry": {
            "type": "beam",
            "start": [0, 0, 0],
            "end": [1, 0, 0],
            "section": {"shape": "rectangle", "height": 0.01, "width": 0.02},
        },
        "frame": {"type": "tangent", "marker": "root", "clamp": "start"},
        "markers": {
            "root": {"node": 1, "parameters": [0]},
            "tip": {"node": 2, "parameters": [1]},
        },
        "reduction": {"method": "modal", "modes": 12},
    }
    data["material"]["density"] /= 2.0
    data["material"]["youngs_modulus"] /= 2.0
    sid = sid_from_model(validate_data(data, ModelFile))
    assert np.abs(sid.node(2).psi.m0[0]).max() > 1.0
    with pytest.raises(OutsideTheory, match="N404 arm"):
        simulated(spun(2.5, 20.0), sid, accuracy=1e-2)


def test_elastic_rotations_count_as_well() -> None:
    """Shape functions that turn much and move little."""
    scene, sid = particles(False)
    turned = tuple(
        replace(node, psi=Taylor(np.outer([0.0, 0.0, 1.0], [30.0, 0.0, 0.0, 0.0])))
        for node in sid.nodes
    )
    with pytest.raises(OutsideTheory, match="N413 arm"):
        simulated(scene, replace(sid, nodes=turned), accuracy=1e-2)
