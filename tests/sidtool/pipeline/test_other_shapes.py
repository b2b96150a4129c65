"""Elastic coordinates that name other shapes after a SID was replaced."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.formats.model import ModelFile
from sidtool.formats.scene import read_scene
from sidtool.formats.toml.reading import validate_data
from sidtool.measurement.request import requested
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.codes import codes, only, unwrapped

from ..bodies import beam_data

SCENE = """
format = "sidtool scene"
version = 1
dimension = "planar"
time = { end = 0.01, output_step = 0.01 }
outputs.record = ["rod.q1"]
bodies.rod = { sid = "tall.SID_FEM" }
joints.clamp = { type = "fixed", markers = ["ground", "rod.1"] }
"""


def beam(height: float, width: float) -> SID:
    data = beam_data({"type": "beam", "elements": 8}, 2)
    section = {"shape": "rectangle", "height": height, "width": width}
    data["geometry"]["section"] = section
    return sid_from_model(validate_data(data, ModelFile))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A scene with a beam that bends in y first, another such, and one in z first."""
    (tmp_path / "scene.toml").write_text(SCENE, encoding="utf-8")
    for name, sizes in {
        "tall": (0.01, 0.05),
        "same": (0.012, 0.05),
        "flat": (0.03, 0.01),
    }.items():
        sidtool.write(tmp_path / f"{name}.SID_FEM", beam(*sizes))
    return tmp_path


def test_replaced_shape_functions_are_noted(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = str(folder / "scene.toml")
    assert run(["simulate", scene, "--sid", f"rod={folder / 'flat.SID_FEM'}"]) == 0
    assert "warning N242 rod" in unwrapped(capsys.readouterr().err)
    result = sidtool.simulate(scene, sids={"rod": folder / "flat.SID_FEM"})
    changes = only(result, "N242").data["changes"]
    assert "q1 is bending z, was bending y" in changes  # type: ignore[operator]


def test_a_swap_to_the_same_shapes_is_not(folder: Path) -> None:
    scene = str(folder / "scene.toml")
    for sid in (folder / "same.SID_FEM", beam(0.01, 0.05)):
        assert not codes(sidtool.simulate(scene, sids={"rod": sid}))


def recorded(folder: Path, names: str, sid: str) -> sidtool.Result:
    """The planar or spatial scene with a push, and one of its SIDs."""
    push = 'forces.push = { type = "force", marker = "rod.2", force = [0, 3, 4] }'
    text = SCENE.replace('["rod.q1"]', names) + push + "\n"
    scene = folder / "pushed.toml"
    scene.write_text(text.replace('"planar"', '"spatial"'), encoding="utf-8")
    return sidtool.simulate(scene, sids={"rod": folder / f"{sid}.SID_FEM"})


def test_a_mode_that_is_named_by_its_kind_stays_the_same_one(folder: Path) -> None:
    """It is q1 of the tall beam and q2 of the flat one; its velocity is its slope."""
    names = '["rod.bending_y1", "rod.vbending_y1", "rod.bending_z1", "rod.q*"]'
    for sid, (along_y, along_z) in {"tall": (1, 2), "flat": (2, 1)}.items():
        found = recorded(folder, names, sid)
        assert (found["rod.bending_y1"] == found[f"rod.q{along_y}"]).all()
        assert (found["rod.bending_z1"] == found[f"rod.q{along_z}"]).all()
        assert np.abs(found["rod.bending_y1"]).max() > 0
        assert found["rod.vbending_y1"][-1] != found["rod.bending_y1"][-1]


def test_a_planar_scene_knows_kinds(folder: Path) -> None:
    text = SCENE.replace('["rod.q1"]', '["rod.bending_y1", "rod.q1"]')
    (folder / "kinds.toml").write_text(text, encoding="utf-8")
    result = sidtool.simulate(folder / "kinds.toml")
    assert (result["rod.bending_y1"] == result["rod.q1"]).all()


def test_kinds_that_a_body_has_not_are_refused_with_those_it_has(folder: Path) -> None:
    expected = r"rod has no elastic coordinate bending_y2; .*bending_y1, bending_z1"
    with pytest.raises(InputError, match=expected):
        recorded(folder, '["rod.bending_y2"]', "tall")
    with pytest.raises(InputError, match="bending_y1 or another kind"):
        recorded(folder, '["rod.bending_w1"]', "tall")


def test_a_law_reads_a_mode_by_its_kind(folder: Path) -> None:
    """A spring from a formula pushes back along y: less motion, of the same mode."""
    names = '["rod.bending_y1", "rod.bending_z1", "rod.2.uy"]'
    free = recorded(folder, names, "flat")
    law = """
[forces.back]
type = "force"
marker = "rod.2"
force = [0, 1, 0]
function = { type = "expression", value = "-1e4 * rod.bending_y1" }
"""
    scene = folder / "pushed.toml"
    scene.write_text(scene.read_text(encoding="utf-8") + law, encoding="utf-8")
    held = sidtool.simulate(scene, sids={"rod": folder / "flat.SID_FEM"})
    assert held["rod.bending_y1"][-1] != free["rod.bending_y1"][-1]


def test_an_accuracy_is_requested_by_kind_of_mode(folder: Path) -> None:
    scene = read_scene(folder / "scene.toml")
    asked = requested(scene, {"rod": beam(0.03, 0.01)}, {"rod.bending_y1": 1e-3})
    assert asked.names == ("rod.q2",)
