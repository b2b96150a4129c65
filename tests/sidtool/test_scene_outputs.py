"""Stresses recorded by scenes, and joints or forces where a body cannot be felt."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

import sidtool
from sidtool.cli.main import run
from sidtool.elements.material_points import stress_rows
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID, Taylor
from sidtool.formats.base.stress import COMPONENTS, peak_stress, stress_norm
from sidtool.formats.motion_kinds import dead_nodes
from sidtool.formats.scene import SceneFile
from sidtool.formats.sid_files import read_sid
from sidtool.formats.toml.reading import read_data, validate_data
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model
from sidtool.reduction.admissible_space import constrained_space
from sidtool.reduction.body_frames import FRAMES
from sidtool.reduction.methods import REDUCTIONS
from tests.codes import unwrapped
from tests.places import SLIDER_CRANK

from .beams import beam
from .conversion.test_stress import MESHES, TIP_LOAD, TOP
from .models import Q4, rod

FORCE = 1e-3
STRESSES = [f"sigma_{pair}" for pair in COMPONENTS]


def loaded(force: list[float], record: list[str], **more: Any) -> SceneFile:
    """A cantilever on the ground with a force at its tip."""
    markers = {"root": 1, "tip": 2, "top": 3}
    data = {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "time": {"end": 0.01, "output_step": 0.01},
        "bodies": {"beam": {"sid": "beam.SID_FEM", "markers": markers}},
        "joints": {"hub": {"type": "fixed", "markers": ["ground", "beam.root"]}},
        "forces": {"push": {"type": "force", "marker": "beam.tip", "force": force}},
        "outputs": {"record": record},
    }
    return validate_data(data | more, SceneFile)


@pytest.mark.parametrize("mesh", MESHES)
def test_a_loaded_cantilever_in_equilibrium_has_the_stress_of_the_full_model(
    mesh: str,
) -> None:
    """Against the finite elements to 1e-7, and sigma_xx = F (L - x) h / (2 I)."""
    model = beam(MESHES[mesh], markers=TOP, reduction=TIP_LOAD, stress={})
    sid, body = sid_from_model(model), finite_element_model(model)
    names = [f"beam.top.{name}" for name in [*STRESSES, "von_mises"]]
    scene = loaded([0.0, FORCE], [*names, "beam.peak_von_mises"])
    equilibrium = sidtool.static_equilibrium(scene, sids={"beam": sid}).result()
    load = body.marker("tip").displacement[1].T.toarray() * FORCE
    frame = FRAMES["tangent"](body, model.frame)
    full = constrained_space(body, frame).static(load)[:, 0]
    rows = stress_rows(body.marker("top").gradient, body.continua[0])
    exact = rows @ full
    assert_allclose(equilibrium.values[0, :6], exact, atol=1e-9 * np.abs(exact).max())
    theory = FORCE * 0.5 * 0.005 / (0.01 * 0.01**3 / 12)
    assert equilibrium["beam.top.sigma_xx"][0] == pytest.approx(-theory, rel=5e-3)
    assert equilibrium["beam.top.von_mises"][0] == pytest.approx(theory, rel=1e-2)
    assert equilibrium["beam.peak_von_mises"][0] >= equilibrium["beam.top.von_mises"][0]


@pytest.fixture(scope="module")
def stressed_rod() -> SID:
    return sid_from_model(rod(Q4, stress={"peak_points": 12}))


def test_the_rod_in_motion_has_the_stress_of_its_deformation(
    stressed_rod: SID,
) -> None:
    """At every instant, that of the finite elements at the same displacement."""
    data = read_data(SLIDER_CRANK / "slider_crank.toml")
    data["time"]["end"] = 1.0
    names = [f"rod.crank_pin.{name}" for name in STRESSES]
    data["outputs"]["record"] = ["rod.q*", *names, "rod.*_von_mises"]
    result = sidtool.simulate(
        validate_data(data, SceneFile),
        sids={"rod": stressed_rod},
        base_folder=SLIDER_CRANK,
    )
    model = rod(Q4)
    body = finite_element_model(model)
    frame = FRAMES["tangent"](body, model.frame)
    basis = REDUCTIONS["modal"](body, frame, model.reduction)
    q = result.values[:, :5]
    rows = stress_rows(body.marker("crank_pin").gradient, body.continua[0])
    full = (rows @ basis.reconstruct(q.T)).T
    found = result.values[:, 5:11]
    assert np.abs(found).max() > 1e5
    assert_allclose(found, full, atol=1e-9 * np.abs(full).max())
    assert_allclose(result["rod.peak_von_mises"], peak_stress(stressed_rod, q))
    assert_allclose(result["rod.norm_von_mises"], stress_norm(stressed_rod, q))


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("rod.piston_pin.sigma_xx", "rod holds no stress; expected .* \\[stress\\]"),
        ("rod.peak_von_mises", r"rod.peak_von_mises: the SID of rod holds no stress"),
        ("crank.pin.von_mises", "crank is rigid; expected the stress of a SID body"),
        ("crank.peak_von_mises", "crank is rigid"),
        ("rod.crank_pin.sigma_zx", "a quantity out of .*sigma_xz"),
        ("rod.von_mises", "a quantity out of .*peak_von_mises"),
    ],
)
def test_stress_that_is_not_there_is_refused(output: str, message: str) -> None:
    data = read_data(SLIDER_CRANK / "slider_crank.toml")
    data["outputs"]["record"] = [output]
    with pytest.raises(InputError, match=message):
        sidtool.simulate(validate_data(data, SceneFile), base_folder=SLIDER_CRANK)


def test_a_node_without_stress_rows_is_refused(stressed_rod: SID) -> None:
    plain = [replace(n, sigma=None) if n.id == "2" else n for n in stressed_rod.nodes]
    data = read_data(SLIDER_CRANK / "slider_crank.toml")
    data["outputs"]["record"] = ["rod.piston_pin.sigma_xx"]
    with pytest.raises(InputError, match="node 2 of rod carries no .* nodes 1, "):
        sidtool.simulate(
            validate_data(data, SceneFile),
            sids={"rod": replace(stressed_rod, nodes=tuple(plain))},
            base_folder=SLIDER_CRANK,
        )


@pytest.fixture(scope="module")
def held_at_both_ends(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Modes of the rod with both edges clamped: the piston pin is dead."""
    reduction = {"method": "modal", "modes": 5, "fix": "right"}
    sid = sid_from_model(rod(Q4, reduction=reduction))
    path = tmp_path_factory.mktemp("dead") / "rod.SID_FEM"
    sidtool.write(path, sid)
    return path


def test_a_joint_on_a_dead_node_is_refused(
    held_at_both_ends: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The crank pin is dead as well, but there the frame is: that is no harm."""
    scene = str(SLIDER_CRANK / "slider_crank.toml")
    arguments = ["simulate", scene, "--sid", f"rod={held_at_both_ends}"]
    assert run(arguments) == 2
    error = unwrapped(capsys.readouterr().err)
    assert "slider_crank.toml: joints.piston_pin: the joint piston_pin acts on" in error
    assert "node 2 of rod, where all shape functions vanish" in error
    assert "or --accept-defects" in error
    assert run([*arguments, "--accept-defects", "--rtol", "1e-2"]) == 0


@pytest.mark.parametrize("kind", ["force", "spring", "drive"])
def test_a_load_on_a_dead_node_is_refused(kind: str, held_at_both_ends: Path) -> None:
    push: dict[str, Any] = {"type": "force", "marker": "beam.tip", "force": [0.0, 1.0]}
    spring = {
        "type": "spring_damper",
        "markers": ["ground", "beam.tip"],
        "stiffness": 1.0,
    }
    constant = {"type": "constant", "value": 0.03}
    hold = {"marker": "beam.tip", "coordinate": "y", "function": constant}
    tables: dict[str, Any] = {
        "force": {"forces": {"load": push}},
        "spring": {"forces": {"load": spring}},
        "drive": {"forces": {}, "drives": {"load": hold}},
    }
    bodies = {"beam": {"sid": "rod.SID_FEM", "markers": {"root": 1, "tip": 2}}}
    scene = loaded([0.0, 1.0], [], bodies=bodies, **tables[kind])
    with pytest.raises(InputError, match=r"s\.load: the (force|drive) load acts on"):
        sidtool.simulate(scene, base_folder=held_at_both_ends.parent)


def test_info_of_a_scene_names_dead_nodes(
    held_at_both_ends: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (SLIDER_CRANK / "slider_crank.toml").read_text(encoding="utf-8")
    scene = held_at_both_ends.parent / "scene.toml"
    scene.write_text(text.replace("rod_q4.SID_FEM", "rod.SID_FEM"), encoding="utf-8")
    assert run(["info", str(scene)]) == 0
    assert "joint piston_pin acts on node 2 of rod" in capsys.readouterr().out


def test_the_founding_rods_have_no_dead_nodes() -> None:
    """Both clamp their left edge; the crank pin carries their frame."""
    for name in ("rod_q4", "rod_iga"):
        assert dead_nodes(read_sid(SLIDER_CRANK / f"{name}.SID_FEM")) == ()


def test_a_body_held_away_from_its_origin_is_held_there() -> None:
    """One place that rests is where the frame is; of two, neither is."""
    sid = sid_from_model(rod(Q4))
    first, second = sid.nodes
    away = Taylor(np.array([[-0.5], [0.0], [0.0]]), first.origin.m1)
    moved = replace(sid, nodes=(replace(first, origin=away), second))
    assert dead_nodes(moved) == ()
    fixed = replace(second, phi=first.phi, psi=first.psi)
    assert dead_nodes(replace(moved, nodes=(moved.nodes[0], fixed))) == ("1", "2")


def test_field_files_have_no_dead_nodes(field_data: Path) -> None:
    """Clamped nodes at the origin, free bodies, corners that still turn."""
    for path in (field_data / "sid").iterdir():
        assert dead_nodes(read_sid(path)) == (), path.name
