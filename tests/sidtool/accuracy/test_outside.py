"""Where the theory of small deformations ends there is no number, but what would do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sidtool.accuracy import OutsideTheory
from sidtool.convert import sid_from_model
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid import Taylor
from sidtool.formats.toml.reading import validated

from ..beams import beam_data
from .arms import cantilever, particles, simulated, spun, swinging


@pytest.mark.parametrize(
    ("scene", "stiffened", "message"),
    [
        (swinging(gravity=[0.0, -12.0]), True, "of its length.*joints of type fixed"),
        # with stiffening it stays within a tenth, and was told to be cut into two
        (swinging(gravity=[0.0, -3.0]), False, "stiffening matters and the SID lacks"),
        (spun(2.5, 20.0), False, "stiffening matters and the SID lacks it.*convert"),
        (spun(5.0, 20.0), False, "diverges.*lacks the geometric stiffening"),
    ],
)
def test_what_leaves_the_theory_is_refused_with_what_would_do(
    scene: SceneFile, stiffened: bool, message: str
) -> None:
    """What diverges for want of stiffening, to 1e15 lengths, is not to be cut into as
    many parts."""
    with pytest.raises(OutsideTheory, match=message):
        simulated(scene, cantilever(2, stiffened=stiffened), accuracy=1e-2)


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
    sid = sid_from_model(validated(data, ModelFile))
    assert np.abs(sid.node(2).psi.m0[0]).max() > 1.0
    with pytest.raises(OutsideTheory, match="matters and the SID lacks it.*convert"):
        simulated(spun(2.5, 20.0), sid, accuracy=1e-2)


def test_elastic_rotations_count_as_well() -> None:
    """Shape functions that turn much and move little."""
    scene, sid = particles(False)
    turned = tuple(
        replace(node, psi=Taylor(np.outer([0.0, 0.0, 1.0], [30.0, 0.0, 0.0, 0.0])))
        for node in sid.nodes
    )
    with pytest.raises(OutsideTheory, match="turns elastically by .* rad"):
        simulated(scene, replace(sid, nodes=turned), accuracy=1e-2)
