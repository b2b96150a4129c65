"""A vibration without energy that limits the steps is reported, with a remedy."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.formats.base.sid import SID
from sidtool.formats.diagnostics import Diagnostic
from sidtool.formats.model import ModelFile
from sidtool.formats.motion_kinds import named_by_kind
from sidtool.formats.scene import read_scene
from sidtool.formats.toml.reading import validate_data
from sidtool.mesh.mesh import Mesh
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.codes import only, with_code

from ..places import SLIDER_CRANK
from .bodies import beam_data
from .elements.bores import pinned
from .elements.drawn_parts import drawn_part

FOLDER = str(SLIDER_CRANK)


@pytest.fixture(scope="module")
def rod() -> SID:
    """The undamped rod as a beam, with modes out of the plane of the slider-crank."""
    data = beam_data({"type": "beam", "elements": 20, "theory": "timoshenko"}, 12)
    data.pop("damping", None)
    return sid_from_model(validate_data(data, ModelFile))


def run(rod: SID, kind: str, energy: float, **changes: Any) -> sidtool.Result:
    """The slider-crank, with energy [J] in one mode at the start."""
    scene = read_scene(FOLDER + "/slider_crank.toml")
    number = named_by_kind(rod)[kind]
    speeds = np.zeros(rod.nq)
    speeds[number - 1] = np.sqrt(2 * energy / rod.Me.m0[number - 1, number - 1])
    body = scene.bodies["rod"]
    start = body.initial.model_copy(update={"elastic_velocity": tuple(speeds)})
    body = body.model_copy(update={"initial": start} | changes)
    outputs = scene.outputs.model_copy(update={"record": ("piston.x",)})
    update = {"bodies": dict(scene.bodies) | {"rod": body}, "outputs": outputs}
    update["time"] = scene.time.model_copy(update={"end": 2.0})
    return sidtool.simulate(
        scene.model_copy(update=update), sids={"rod": rod}, base_folder=FOLDER
    )


def vibration_notes(result: sidtool.Result) -> list[Diagnostic]:
    return with_code(result, "N322")


@pytest.mark.parametrize(
    ("kind", "energy"), [("bending_z7", 1e-5), ("bending_z6", 3e-6)]
)
def test_the_vibration_that_limits_steps_is_named_and_the_advice_helps(
    rod: SID, kind: str, energy: float
) -> None:
    number = named_by_kind(rod)[kind]
    slow = run(rod, kind, energy)
    found = only(slow, "N322").data
    assert found["number"] == number and found["kind"] == "bending z"
    k, m = (x.m0[number - 1, number - 1] for x in (rod.Ke, rod.Me))
    hertz = np.sqrt(k / m) / (2 * np.pi)
    assert found["frequency"] == pytest.approx(hertz, rel=0.02)
    assert found["energy"] == pytest.approx(energy, rel=0.1)
    retained = tuple(i for i in range(1, rod.nq + 1) if i != number)
    start = read_scene(FOLDER + "/slider_crank.toml").bodies["rod"].initial
    without = run(rod, kind, energy, shape_functions=retained, initial=start)
    assert not vibration_notes(without)
    assert without.counters["steps"] < 0.1 * slow.counters["steps"]
    assert np.abs(without["piston.x"] - slow["piston.x"]).max() < 1e-6


def test_a_vibration_that_matters_is_not(rod: SID) -> None:
    """A hundred times the energy of what the run stores otherwise, and none at all."""
    assert not vibration_notes(run(rod, "bending_z7", 1.0))
    assert not vibration_notes(run(rod, "bending_z7", 0.0))


def test_a_pin_out_of_the_plane_costs_no_steps(tmp_path: Path) -> None:
    """An imported con-rod without damping, one pin of it 0.08 mm off in z.

    The vibration out of the plane that this excites took fifteen times the steps.
    """
    part = drawn_part("rod", "tet10", 1)
    span = part.mesh.positions[part.loaded, 0].mean()
    stretch = np.array([1 / span, 1 / span, 1.0])
    mesh = Mesh(part.mesh.positions * stretch, part.mesh.blocks)
    steps = []
    for off in (0.0, 8e-5):
        height = np.ptp(mesh.positions[:, 2]) / 2
        markers = {
            name: {
                "node": node,
                "position": [node - 1.0, 0.0, height + off * (node - 1)],
                "tie": {"type": "distributing", "to": name},
            }
            for node, name in enumerate(("crank_pin", "piston_pin"), 1)
        }
        sets = {"crank_pin": part.fixed, "piston_pin": part.loaded}
        model = pinned(tmp_path, mesh, sets, markers)
        choices = {
            "frame": {"type": "chord", "markers": list(markers)},
            "reduction": {
                "method": "attachment",
                "modes": 8,
                "interfaces": list(markers),
                "rotations": False,
            },
        }
        data = json.loads(model.model_dump_json()) | choices
        sid = sid_from_model(validate_data(data, ModelFile))
        scene = read_scene(FOLDER + "/slider_crank.toml")
        times = scene.time.model_copy(update={"end": 0.3})
        scene = scene.model_copy(update={"time": times})
        result = sidtool.simulate(scene, sids={"rod": sid}, base_folder=FOLDER)
        steps.append(result.counters["steps"])
        (gap,) = [d.data["gap"] for d in with_code(sid, "N136")] or [0.0]
        assert gap == pytest.approx(off, rel=1e-6, abs=1e-12)
    assert steps[1] < 1.2 * steps[0]
