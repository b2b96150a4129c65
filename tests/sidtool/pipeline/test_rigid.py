"""`rigid = true` and `--rigid`: a body with a SID whose flexibility is left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import sidtool
from sidtool.cli.main import run
from sidtool.cli.simulate import simulate as command
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.formats.sid_files import read_sid
from tests.codes import only, unwrapped
from tests.places import SLIDER_CRANK

SCENE = SLIDER_CRANK / "slider_crank.toml"


def with_numbers() -> SceneFile:
    """The scene with the rod's mass, centre and inertia in place of its SID."""
    scene = read_scene(SCENE)
    sid = read_sid(SLIDER_CRANK / "rod_q4.SID_FEM")
    rod = scene.bodies["rod"]
    centre = sid.mdCM.m0[:2, 0] / sid.mass
    inertia = sid.J.m0[2, 0] - sid.mass * centre @ centre
    markers = {
        name: {"position": tuple(sid.node(node).origin.m0[:2, 0])}
        for name, node in rod.markers.items()
    }
    body = {
        "mass": sid.mass,
        "inertia": inertia,
        "centre_of_mass": tuple(centre),
        "markers": markers,
        "initial": rod.initial.model_dump(include={"position", "angle", "fixed"}),
    }
    content = scene.model_dump(exclude_none=True)
    content["bodies"]["rod"] = body
    record = [t for t in scene.outputs.record if not t.startswith("rod.q")]
    content["outputs"]["record"] = record
    return SceneFile.model_validate(content)


def test_patterns_of_elastic_outputs_are_left_out_of_rigid_bodies() -> None:
    """As exact names are; of what stands for other bodies, too, the rest remains."""
    record = ["piston.x", "*od.q1", "rod.*.uy", "r*d.*.ux"]
    scene = read_scene(SCENE).with_({"outputs.record": record})
    rigid = sidtool.simulate(scene, rigid=["rod"], base_folder=SLIDER_CRANK)
    assert rigid.names == ("piston.x",)
    assert "rod.*.uy" in str(only(rigid, "N240"))
    flexible = sidtool.simulate(scene, base_folder=SLIDER_CRANK)
    assert {"rod.q1", "rod.piston_pin.ux"} <= set(flexible.names)


def test_rigid_takes_bodies_separated_by_commas(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["simulate", str(SCENE), "-o", str(tmp_path / "r.h5"), "--rigid"]
    assert run([*command, "rod,crank"]) == 2
    assert "'crank'" in unwrapped(capsys.readouterr().err)
    assert run([*command, "rod,"]) == 0
    assert only(sidtool.read(tmp_path / "r.h5"), "N240").subject == "rod"


def test_a_rigid_rod_moves_like_one_given_by_numbers() -> None:
    expected = sidtool.simulate(with_numbers(), base_folder=SLIDER_CRANK, rtol=1e-9)
    result = sidtool.simulate(SCENE, rigid=["rod"], rtol=1e-9)
    for name in ("piston.x",):
        assert result[name] == pytest.approx(expected[name], abs=1e-10)


def test_a_rigid_body_omits_flexibility_only() -> None:
    rigid = sidtool.simulate(SCENE, rigid=["rod"])
    flexible = sidtool.simulate(SCENE)
    difference = np.abs(rigid["piston.x"] - flexible["piston.x"]).max()
    assert 1e-6 < difference < 1e-4  # the founding paper: 1.2e-5 m
    assert not [name for name in rigid.names if name.startswith("rod.q")]
    found = only(rigid, "N240")
    assert found.subject == "rod" and "rod.q1" in str(found)


def test_the_scene_and_the_command_give_the_same_result(tmp_path: Path) -> None:
    csv = tmp_path / "rigid.csv"
    done = CliRunner().invoke(command, [str(SCENE), "--rigid", "rod", "-o", str(csv)])
    assert done.exit_code == 0, done.output
    assert "1 note" in done.output
    scene = read_scene(SCENE)
    rod = scene.bodies["rod"].model_copy(update={"rigid": True})
    rigid_scene = scene.model_copy(update={"bodies": {**scene.bodies, "rod": rod}})
    result = sidtool.simulate(rigid_scene, base_folder=SLIDER_CRANK)
    table = np.genfromtxt(csv, delimiter=",", names=True, comments="#")
    column = next(n for n in table.dtype.names if n.startswith("pistonx"))
    assert table[column] == pytest.approx(result["piston.x"], abs=1e-9)


def test_other_names_are_refused() -> None:
    with pytest.raises(sidtool.InputError, match="'crank'") as error:
        sidtool.simulate(SCENE, rigid=["crank"])
    assert "rod" in str(error.value)
