"""Elastic coordinates that name other shapes after a SID was replaced."""

from __future__ import annotations

from pathlib import Path

import pytest

import sidtool
from sidtool.cli import run
from sidtool.convert import sid_from_model
from sidtool.formats.model import ModelFile
from sidtool.formats.sid import SID
from sidtool.formats.toml_files import validated

from .bodies import beam_data

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
    return sid_from_model(validated(data, ModelFile))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A scene with a beam that bends in y first, another such, and one in z first."""
    (tmp_path / "scene.toml").write_text(SCENE)
    for name, sizes in {
        "tall": (0.01, 0.05),
        "same": (0.012, 0.05),
        "flat": (0.03, 0.01),
    }.items():
        sidtool.write(tmp_path / f"{name}.SID_FEM", beam(*sizes))
    return tmp_path


def test_a_swap_to_other_shapes_is_said(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = str(folder / "scene.toml")
    assert run(["simulate", scene, "--sid", f"rod={folder / 'flat.SID_FEM'}"]) == 0
    said = capsys.readouterr().out
    assert "elastic coordinates of rod name other shapes" in said
    assert "q1 is bending z, was bending y" in " ".join(said.split())
    found = sidtool.simulate(scene, sids={"rod": folder / "flat.SID_FEM"})
    assert any("q1 is bending z, was bending y" in note for note in found.notes)


def test_a_swap_to_the_same_shapes_is_not(folder: Path) -> None:
    scene = str(folder / "scene.toml")
    assert not sidtool.simulate(scene, sids={"rod": folder / "same.SID_FEM"}).notes
    assert not sidtool.simulate(scene, sids={"rod": beam(0.01, 0.05)}).notes
