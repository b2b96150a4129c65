"""Prestress by forces: the same body in every frame, and at rest when they act."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import SceneFile
from sidtool.formats.toml.reading import validate_data
from sidtool.pipeline.model_to_sid import sid_from_model
from sidtool.solver import compile_scene
from sidtool.solver.analyses.linearisation import linearise
from sidtool.solver.analyses.static_equilibrium import static_equilibrium

from ..beams import beam_data as membrane_data
from ..elements.test_held_markers import FRAMES, slender

FORCES = {"beam": [150.0, 8.0, -5.0], "membrane": [2.0, 0.3]}


def part(kind: str, frame: str) -> Any:
    """A slender body with its ends as interfaces, as plain data."""
    if kind == "beam":
        return slender([1, 0, 0], frame)
    data = membrane_data({"type": "q4", "elements": [30, 2]})
    for marker in data["markers"].values():
        del marker["at"]
        marker["tie"] = {"type": "distributing", "to": marker.pop("edge")}
    reduction = {"method": "craig_bampton", "interfaces": ["root", "tip"], "modes": 4}
    return data | {"frame": dict(FRAMES[frame]), "reduction": reduction}


def body(kind: str, frame: str, **prestress: Any) -> SID:
    stiffening = {"prestress": prestress} if prestress else {}
    data = part(kind, frame) | {"stiffening": stiffening}
    return sid_from_model(validate_data(data, ModelFile))


def clamped(kind: str, sid: SID) -> Any:
    """A scene that clamps the root and pulls at the tip."""
    markers = {"root": "1", "tip": "2"}
    force = FORCES[kind]
    scene = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "spatial" if len(force) == 3 else "planar",
        "time": {"end": 1.0, "output_step": 0.5},
        "outputs": {"record": ["soft.q*", "soft.tip.x", "soft.tip.y"]},
        "bodies": {
            "soft": {
                "sid": "-",
                "markers": markers,
                "initial": {"position": list(-sid.node(1).position[: len(force)])},
            }
        },
        "joints": {"root": {"type": "fixed", "markers": ["ground", "soft.root"]}},
        "forces": {"pull": {"type": "force", "marker": "soft.tip", "force": force}},
    }
    sids = {"soft": sid}
    return compile_scene(validate_data(scene, SceneFile), ".", sids, keep_joints=True)


def at_rest(system: Any) -> np.ndarray:
    """(2,) where the tip is when the force acts."""
    rest = static_equilibrium(system).result()
    return np.array([rest["soft.tip.x"][0], rest["soft.tip.y"][0]])


@cache
def supported(kind: str, frame: str) -> SID:
    return body(kind, frame, forces={"tip": FORCES[kind]}, support="root")


@cache
def deflection(kind: str) -> float:
    """Of the tip [m], of the body without prestress."""
    sid = body(kind, "tangent")
    place = sid.node(2).position - sid.node(1).position
    return float(abs(at_rest(clamped(kind, sid))[1] - place[1]))


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("kind", FORCES)
def test_the_body_rests_undeformed_under_its_loads(kind: str, frame: str) -> None:
    """Clamped at its support, whatever its frame; without prestress it bends."""
    sid = supported(kind, frame)
    place = sid.node(2).position - sid.node(1).position
    bent = deflection(kind)
    assert bent > 1e-6
    found = at_rest(clamped(kind, sid)) - place[:2]
    assert_allclose(found, 0.0, atol=1e-6 * bent)


@pytest.mark.parametrize("kind", FORCES)
def test_its_frequencies_do_not_depend_on_the_frame(kind: str) -> None:
    """Of the clamped body under its loads; the tension raises the first."""
    found = {}
    for frame in FRAMES:
        system = clamped(kind, supported(kind, frame))
        found[frame] = linearise(system).frequencies[:2]
    for frequencies in found.values():
        assert_allclose(frequencies, found["tangent"], rtol=1e-5)
    default = body(kind, "tangent", forces={"tip": FORCES[kind]})
    alone = linearise(clamped(kind, default)).frequencies[:2]
    assert_allclose(found["tangent"], alone, rtol=1e-7)


@pytest.mark.parametrize("frame", ["chord", "buckens"])
def test_loads_that_nothing_holds_are_refused(frame: str) -> None:
    with pytest.raises(InputError, match="are not in balance; expected support"):
        body("beam", frame, forces={"tip": [1.0, 0.0, 0.0]})
    pulled = {"tip": [90.0, 0.0, 0.0], "root": [-90.0, 0.0, 0.0]}
    assert body("beam", frame, forces=pulled).ksigma.m0.any()
