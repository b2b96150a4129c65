"""Bodies of a scene that are given by their models."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.cli.main import run
from sidtool.formats.model.refine import refine_model, with_modes
from sidtool.formats.result import Decision
from sidtool.formats.scene import SceneFile, read_scene
from sidtool.measurement import cache
from sidtool.solver import compile_scene
from sidtool.solver.simulation.replay import scene_of
from sidtool.view.body_fields import find_fields
from tests.codes import codes, only
from tests.steel_bars import bar_data

from ..accuracy.arms import cantilever, spun, swinging
from ..beams import beam, beam_data

LINEAR = {"type": "iga", "degrees": [1, 1]}
COARSE = {"type": "q4", "elements": [4, 1]}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Choices are kept here."""
    monkeypatch.setattr(cache, "cache_path", lambda: tmp_path / "kept")
    return tmp_path


def written(folder: Path, scene: SceneFile, mesh: Any, modes: int) -> Path:
    """A scene file whose arm is made of the model beside it."""
    data = beam_data(mesh, reduction={"method": "modal", "modes": modes})
    (folder / "arm.json").write_text(json.dumps(data), encoding="utf-8")
    content = scene.model_dump(mode="json", by_alias=True, exclude_none=True)
    content["bodies"]["arm"] |= {"model": "arm.json"}
    del content["bodies"]["arm"]["sid"]
    path = folder / "scene.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def forbid(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object) -> None:
        raise AssertionError("converted again")

    monkeypatch.setattr(
        import_module("sidtool.pipeline.model_to_sid"), "sid_from_model", never
    )


def test_a_model_is_converted_once(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = spun(0.3, 2.0)
    mesh = {"type": "iga", "degrees": [3, 2], "elements": [10, 1]}
    path = written(folder, scene, mesh, 3)
    first = sidtool.simulate(path)
    expected = sidtool.simulate(scene, sids={"arm": cantilever(3)})
    assert first["arm.tip.uy"] == pytest.approx(expected["arm.tip.uy"], abs=1e-9)
    (stored,) = (folder / ".sidtool").iterdir()
    with monkeypatch.context() as patch:
        forbid(patch)
        again = sidtool.simulate(path)
    assert np.array_equal(again.values, first.values)
    stored.write_bytes(stored.read_bytes()[:100])
    assert sidtool.simulate(path)["arm.tip.x"] == pytest.approx(first["arm.tip.x"])
    data = json.loads((folder / "arm.json").read_text(encoding="utf-8"))
    data["material"]["density"] *= 2.0
    (folder / "arm.json").write_text(json.dumps(data), encoding="utf-8")
    heavier = sidtool.simulate(path)
    assert np.abs(heavier["arm.tip.uy"]).max() > 1.5 * np.abs(first["arm.tip.uy"]).max()


@pytest.mark.parametrize("name", ["bodies.arm", "arm"])
def test_a_change_of_the_model_replaces_the_sid(folder: Path, name: str) -> None:
    """And back: what is not meant any more is not looked for, nor used in silence."""
    path = written(folder, spun(0.3, 0.5), COARSE, 2)
    created = sidtool.Scene.load(path)
    other = created.with_({f"{name}.sid": "gone.SID_FEM"})
    assert other.bodies["arm"].model is None
    back = other.with_({f"{name}.model": "arm.json"})
    assert not back.bodies["arm"].sid and back == created
    both = other.with_({f"{name}.model": "arm.json", f"{name}.sid": "kept.h5"})
    assert (both.bodies["arm"].sid, both.bodies["arm"].model) == ("kept.h5", "arm.json")
    command = ["simulate", str(path), "--set", f"{name}.sid=gone.SID_FEM"]
    assert run(command) == 2
    assert run([*command, "--set", f"{name}.model=gone.toml"]) == 2
    assert run(["simulate", str(path), "--set", f"{name}.model=arm.json"]) == 0


def test_a_scene_saved_in_another_folder_finds_its_models(folder: Path) -> None:
    scene = sidtool.Scene.load(written(folder, spun(0.3, 0.5), COARSE, 2))
    (folder / "runs").mkdir()
    scene.save(folder / "runs" / "scene.toml")
    again = sidtool.Scene.load(folder / "runs" / "scene.toml")
    model = again.bodies["arm"].model
    assert model and (folder / "runs" / model).resolve() == folder / "arm.json"
    assert again.simulate().completed


def pressed(folder: Path, modes: int) -> Path:
    """A clamped arm that is pressed in its middle, slowly, with 0.02 N in the end."""
    end = 20.0
    ramp = {"type": "sine_ramp", "from": 0.0, "to": 0.9 * end, "end": 1.0}
    push = {
        "type": "force",
        "marker": "arm.mid",
        "force": [0.0, 0.02],
        "function": ramp,
    }
    clamp = {"type": "fixed", "markers": ["ground", "arm.root"]}
    markers = {"root": 1, "tip": 2, "mid": 3}
    content = swinging(
        end,
        gravity=None,
        bodies={"arm": {"sid": "arm", "markers": markers}},
        joints={"clamp": clamp},
        forces={"push": push},
        outputs={"record": ["arm.mid.uy", "arm.tip.uy"]},
    )
    mesh = {"type": "iga", "degrees": [3, 2], "elements": [10, 1]}
    path = written(folder, content, mesh, modes)
    data = json.loads((folder / "arm.json").read_text(encoding="utf-8"))
    data["markers"]["mid"] = {"node": 3, "parameters": [0.5, 0.5]}
    (folder / "arm.json").write_text(json.dumps(data), encoding="utf-8")
    return path


def test_a_rod_that_is_loaded_in_its_middle_needs_its_static_shape(
    folder: Path,
) -> None:
    """Deflection a^3 / 3 EI of the beam under the load; one mode has an error
    of 10 %.
    """
    path = pressed(folder, 1)
    result = sidtool.simulate(path, accuracy={"arm.mid.uy": 2e-4})
    assert static_shapes(result).kept
    at_rest = 0.02 * 0.5**3 / 3.0
    assert result["arm.mid.uy"][-1] == pytest.approx(at_rest, rel=1e-3)
    again = sidtool.simulate(path, accuracy={"arm.mid.uy": 2e-4})
    assert not again.accuracy.searched
    assert np.array_equal(again.values, result.values)
    one = sidtool.simulate(path)["arm.mid.uy"][-1]
    assert one / at_rest == pytest.approx(0.9, abs=0.02)
    path = pressed(folder, 2)
    unconstrained = sidtool.simulate(path, accuracy={"arm.tip.uy": 0.05})
    assert not static_shapes(unconstrained).kept
    assert static_shapes(unconstrained).output == "arm.tip.uy"


def static_shapes(result: sidtool.Result) -> Decision:
    """What was decided on static shape functions."""
    decisions = result.accuracy.decisions
    (found,) = [d for d in decisions if d.what == "static shape functions"]
    return found


def test_of_a_sid_static_shapes_are_not_judged() -> None:
    result = sidtool.simulate(
        spun(0.3, 2.0), sids={"arm": cantilever(2)}, accuracy={"arm.tip.uy": 0.1}
    )
    excluded = only(result, "N603")
    assert excluded.subject == "arm" and excluded.data["loads"] == ("arm.root",)


def test_mesh_and_modes_are_refined_as_far_as_needed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against another discretisation, finer than any that the search makes."""
    scene = spun(0.3, 20.0)
    path = written(folder, scene, COARSE, 1)
    expected = {"arm.tip.uy": 5e-3}
    result = sidtool.simulate(path, accuracy=expected)
    arm = scene.bodies["arm"].model_copy(update={"quadratic_inertia": True})
    fine = scene.model_copy(update={"bodies": {"arm": arm}})
    exact = sidtool.simulate(fine, sids={"arm": cantilever(8)}, rtol=1e-9)
    true = exact["arm.tip.uy"]
    error = np.abs(result["arm.tip.uy"] - true).max() / np.ptp(true)
    assert error <= result.error["arm.tip.uy"] <= 5e-3
    coarse = sidtool.simulate(path)["arm.tip.uy"]
    assert np.abs(coarse - true).max() / np.ptp(true) > 5e-3
    assert result.accuracy.budget[0].part == "mesh"
    assert {"N612", "N613"} <= {*codes(result)}
    with monkeypatch.context() as patch:
        forbid(patch)
        again = sidtool.simulate(path, accuracy=expected)
    assert not again.accuracy.searched
    assert np.array_equal(again.values, result.values)


def test_a_refusal_names_the_largest_remaining_error(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pin lets go of a bar at once: more modes change its force, a finer mesh hardly;
    the mesh was named, with its 1e-6 N of 6e-5 N that were allowed."""
    monkeypatch.chdir(folder)
    (folder / "bar.json").write_text(json.dumps(bar_data(elements=8)), encoding="utf-8")
    scene = sidtool.Scene(
        dimension="planar",
        gravity=[0.0, -9.81],
        time={"end": 1e-5, "output_step": 1e-5},
        bodies={"bar": {"model": "bar.json", "markers": {"root": 1}}},
        joints={"pin": {"type": "revolute", "markers": ["ground", "bar.root"]}},
        outputs={"record": ["pin.fy"]},
    )
    with pytest.raises(sidtool.InputError, match="bar: .* modes: the last change"):
        scene.simulate(accuracy=1e-2)


@pytest.mark.parametrize(
    ("mesh", "key", "expected"),
    [
        (COARSE, "elements", (8, 2)),
        ({"type": "iga", "degrees": [3, 2], "elements": [5, 1]}, "elements", (10, 2)),
        ({"type": "iga", "degrees": [3, 2], "functions": [8, 3]}, "functions", (13, 4)),
        (
            {
                "type": "iga",
                "degrees": [1, 1],
                "knots": [[0, 0, 1, 1], [0, 0, 0.5, 1, 1]],
            },
            "knots",
            ((0, 0, 0.5, 1, 1), (0, 0, 0.25, 0.5, 0.75, 1, 1)),
        ),
    ],
)
def test_each_element_is_halved(mesh: Any, key: str, expected: Any) -> None:
    finer = refine_model(beam(mesh), 1)
    assert finer is not None
    assert getattr(finer.discretisation, key) == expected
    more = with_modes(finer, 7)
    assert more is not None and more.reduction.modes == 7


def test_models_that_cannot_be_converted_are_refused(folder: Path) -> None:
    path = written(folder, spun(0.3, 2.0), COARSE, 1)
    with pytest.raises(sidtool.InputError, match="has to be converted first"):
        compile_scene(read_scene(path), folder)
    content = json.loads(path.read_text(encoding="utf-8"))
    content["bodies"]["arm"]["model"] = "leg.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(sidtool.InputError, match="leg.json"):
        sidtool.simulate(path)


def test_analyses_of_a_body_that_is_its_model(folder: Path) -> None:
    """A driven cantilever of unit length, mass and stiffness: w / 8, 3.516 rad/s."""
    scene = spun(0.3, 2.0).model_copy(update={"gravity": (0.0, -0.01)})
    mesh = {"type": "iga", "degrees": [3, 2], "elements": [10, 1]}
    path = written(folder, scene, mesh, 3)
    rest = sidtool.static_equilibrium(path).result()
    assert rest["arm.tip.uy"][0] == pytest.approx(-0.01 / 8.0, rel=5e-3)
    modes = sidtool.linearise(path).frequencies
    assert modes[0] * 2.0 * np.pi == pytest.approx(3.516, rel=5e-3)


def test_commands_take_a_body_that_is_its_model(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each says of the model what it says of the SID that `convert` makes of it."""
    mesh = {"type": "iga", "degrees": [3, 2], "elements": [10, 1]}
    path, sid = written(folder, spun(0.3, 2.0), mesh, 3), folder / "arm.h5"
    assert run(["convert", str(folder / "arm.json"), "-o", str(sid)]) == 0
    capsys.readouterr()
    assert run(["validate", str(sid)]) == 0
    with_writer = capsys.readouterr().out
    lines = with_writer.splitlines(keepends=True)
    assert lines.pop(1).startswith("written by sidtool")
    judged = "".join(lines)
    assert run(["validate", str(folder / "arm.json")]) == 0
    assert capsys.readouterr().out == judged
    assert run(["validate", str(path)]) == 0
    assert capsys.readouterr().out == f"body arm\n\n{with_writer}"
    assert run(["validate", str(path), "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["passed"] and data["bodies"]["arm"]["passed"]
    assert run(["info", str(path)]) == 0
    assert "arm.json" in capsys.readouterr().out


def test_bodies_of_models_are_shown_whole(folder: Path) -> None:
    """The field of the model is evaluated once: some 60 points, not the two nodes."""
    mesh = {"type": "iga", "degrees": [3, 2], "elements": [10, 1]}
    path = written(folder, spun(0.3, 2.0), mesh, 3)
    result = sidtool.simulate(path)
    for _ in range(2):
        known = find_fields(scene_of(result), result.sids, {}, [folder])
        assert len(known["arm"].positions) > 60
        (stored,) = (folder / ".sidtool").glob("*.field.h5")
    other = sidtool.simulate(path, sids={"arm": cantilever(4)})
    assert find_fields(scene_of(other), other.sids, {}, [folder]) == {}
    assert stored.is_file()
