"""Scenes, models and results as objects of Python."""

from __future__ import annotations

import inspect
import pydoc
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sidtool
from sidtool.api import tables
from sidtool.formats.scene import (
    SceneFile,
    forces as force_kinds,
    functions as function_kinds,
    joints as joint_kinds,
)
from sidtool.formats.toml.tables import Table
from sidtool.solver.compiler import precompile
from tests.codes import unwrapped
from tests.places import SLIDER_CRANK

G = 9.81


def projectile(**changes: Any) -> sidtool.Scene:
    """A point mass thrown upwards at 60 degrees."""
    speed = 4.0
    velocity = speed * np.array([np.cos(np.pi / 3), np.sin(np.pi / 3)])
    start = sidtool.Initial(position=np.array([0.1, 0.2]), velocity=velocity)
    given: dict[str, Any] = {
        "title": "thrown",
        "dimension": "planar",
        "gravity": np.array([0.0, -G]),
        "time": sidtool.Time(end=0.5, output_step=np.float32(0.125)),
        "bodies": {"stone": sidtool.RigidBody(mass=np.int64(2), initial=start)},
        "outputs": sidtool.Outputs(record=["stone.x", "stone.y", "stone.vy"]),
    }
    return sidtool.Scene(**given | changes)


def test_everything_public_is_there_and_documented(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # help lists the names of classes: their own pages take a second
    monkeypatch.setattr(pydoc.TextDoc, "docclass", lambda self, kind, name, *_: name)
    classes = {name for name in vars(tables) if not name.startswith("_")}
    assert classes < set(sidtool.__all__) <= set(dir(sidtool))
    text = pydoc.render_doc(sidtool)
    for name in ("Scene", "Revolute", "SidBody", "simulate", "Pid", "Model"):
        assert name in text
    for name in sidtool.__all__:
        assert getattr(sidtool, name).__doc__, name
    assert (Path(sidtool.__file__).parent / "py.typed").is_file()


def test_constructors_show_their_keys_before_their_first_use() -> None:
    class Part(Table):
        mass: float

    class Piece(Part):
        length: float = 1.0

    for kind, keys in ((Part, ["mass"]), (Piece, ["mass", "length"])):
        assert list(inspect.signature(kind).parameters) == keys
    assert Piece(mass=2.0).length == 1.0


def test_every_kind_that_files_know_has_its_class() -> None:
    for module in (joint_kinds, force_kinds, function_kinds):
        kinds = [
            kind
            for name, kind in vars(module).items()
            if isinstance(kind, type) and "type" in getattr(kind, "model_fields", {})
        ]
        assert len(kinds) > 4
        for kind in kinds:
            assert getattr(sidtool, kind.__name__) is kind
            parameters = inspect.signature(kind).parameters
            assert set(parameters) >= {"type"}
            assert parameters["type"].default == kind.model_fields["type"].default


def test_a_scene_in_python_follows_mechanics(tmp_path: Path) -> None:
    scene = projectile()
    result = scene.simulate()
    t = result.t
    expected = 0.2 + 4 * np.sin(np.pi / 3) * t - G * t**2 / 2
    np.testing.assert_allclose(result["stone.y"], expected, atol=1e-8)
    np.testing.assert_allclose(result["stone.vx"], 2.0, rtol=1e-8)  # not recorded
    scene.save(tmp_path / "thrown.toml")
    again = sidtool.read(tmp_path / "thrown.toml")
    assert type(again) is sidtool.Scene and again == scene
    np.testing.assert_array_equal(again.simulate().values, result.values)
    assert sidtool.Scene.of_result(result).bodies == scene.bodies
    data = tomllib.loads((tmp_path / "thrown.toml").read_text(encoding="utf-8"))
    assert data["format"] == "sidtool scene" and data["bodies"]["stone"]["mass"] == 2


def test_lists_tuples_arrays_and_plain_tables_are_equivalent() -> None:
    variants = {
        "mass": 2.0,
        "initial": {"position": (0.1, 0.2), "velocity": [2.0, 12**0.5]},
    }
    velocity = np.array(variants["initial"]["velocity"])  # type: ignore[index]
    start = sidtool.Initial(position=[0.1, 0.2], velocity=velocity)
    other = projectile(bodies={"stone": sidtool.RigidBody(mass=2, initial=start)})
    assert projectile(bodies={"stone": variants}) == other


def test_files_are_found_after_a_scene_is_saved_in_another_folder(
    tmp_path: Path,
) -> None:
    scene = sidtool.Scene.load(SLIDER_CRANK / "slider_crank.toml")
    (tmp_path / "below").mkdir()
    scene.with_({"time.end": 0.02}).save(tmp_path / "below" / "short.toml")
    moved = sidtool.Scene.load(tmp_path / "below" / "short.toml")
    result = moved.simulate()
    assert result.t[-1] == 0.02 and result.sids["rod"].nq == 5


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: sidtool.RigidBody(mass=-1.0), "RigidBody: mass: found -1"),
        (lambda: sidtool.RigidBody(), "RigidBody: mass: is missing"),
        (lambda: sidtool.RigidBody(mass=1, masss=2), "RigidBody: masss: .*mass"),
        (lambda: sidtool.RigidBody(mass=np.nan), "RigidBody: mass: .*finite"),
        (lambda: sidtool.RigidBody(mass=1j), "RigidBody: mass: found '1j'; .*a number"),
        (lambda: sidtool.Revolute(markers=["a"]), r"Revolute: markers\[1\]"),
        (
            lambda: sidtool.Revolute(markers=["a", 1]),
            r"Revolute: markers\[1\]: found 1",
        ),
        (lambda: sidtool.Actuator(function=abs), "Actuator: function"),
        (lambda: sidtool.Event(quantity="a.x", action="halt"), "Event: action"),
        (lambda: projectile(gravity=np.zeros(3)), "Scene: gravity: found 3 components"),
        (lambda: projectile(joints={"a": {"type": "weld"}}), "Scene: joints.a.type"),
        (lambda: projectile(bodies={"a": {"mass": 0}}), "Scene: bodies.a.mass"),
        (lambda: sidtool.NodeMarker(node=0), "NodeMarker: node"),
        (lambda: sidtool.ModalReduction(modes=2.5), "ModalReduction: modes"),
        (lambda: projectile().save("thrown.json"), "thrown.json: is no TOML"),
    ],
)
def test_wrong_arguments_are_named(make: Any, message: str) -> None:
    with pytest.raises(sidtool.InputError, match=message):
        make()


def test_errors_of_a_loaded_scene_name_its_file(tmp_path: Path) -> None:
    (tmp_path / "lost.toml").write_text(
        (SLIDER_CRANK / "slider_crank.toml").read_text(encoding="utf-8"),
        encoding="utf-8",
    )
    scene = sidtool.Scene.load(tmp_path / "lost.toml").with_({"rod.sid": "none.SID"})
    for act in (scene.simulate, scene.static_equilibrium):
        with pytest.raises(sidtool.InputError, match=r"none.SID"):
            act()


def test_a_model_of_python_is_that_of_the_file() -> None:
    model = sidtool.Model.load(SLIDER_CRANK / "rod_q4.toml")
    coarse = model.with_({"discretisation.elements": [30, 2], "reduction.modes": 2})
    points = np.array(
        [[[0, -0.03], [0, 0.03]], [[0.5, 0], [0.5, 0]], [[1, -0.03], [1, 0.03]]]
    )
    knots = [np.repeat([0, 1], 3), [0, 0, 1, 1]]
    created = sidtool.Model(
        title=model.title,
        material=sidtool.Material(
            youngs_modulus=2.1e11, poissons_ratio=0.3, density=7850
        ),
        geometry=sidtool.NurbsGeometry(
            degrees=[2, 1], knots=knots, control_points=points, thickness=0.01
        ),
        discretisation=sidtool.Q4Discretisation(
            elements=np.array([30, 2]), formulation="full_integration"
        ),
        frame=sidtool.TangentFrame(marker="crank_pin", clamp="left"),
        markers={
            "crank_pin": sidtool.NodeMarker(node=1, edge="left", at=0.5),
            "piston_pin": sidtool.NodeMarker(node=2, edge="right", at=0.5),
        },
        reduction=sidtool.ModalReduction(modes=2),
        damping=sidtool.RayleighDamping(alpha=3.86, beta=2.25e-5),
    )
    one, other = created.convert(), sidtool.convert(coarse)
    np.testing.assert_array_equal(one.Ke.m0, other.Ke.m0)
    thick = created.with_({"geometry.thickness": 0.02}).convert()
    assert thick.mass == pytest.approx(2 * one.mass, rel=1e-12)


def test_results_have_units_and_name_missing_outputs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    result = projectile().simulate()
    assert result.units == {"stone.x": "m", "stone.y": "m", "stone.vy": "m/s"}
    assert result.unit("stone.momentum_x") == "kg m/s"
    assert result.unit("angular_momentum.z") == "kg m\N{SUPERSCRIPT TWO}/s"
    assert result.unit("stone.rotation_x") == "rad"
    assert result.unit("stone.quaternion_0") == ""
    assert len(result.plot("stone.*x").axes) >= 1
    for name, act in (("pandas", result.to_dataframe), ("xarray", result.to_xarray)):
        monkeypatch.setitem(sys.modules, name, None)
        with pytest.raises(sidtool.InputError, match=f"{name} is not installed"):
            act()


def test_objects_show_themselves_shortly_and_in_notebooks() -> None:
    scene = projectile(title="<b>")
    shown = [
        scene,
        sidtool.Model.load(SLIDER_CRANK / "rod_q4.toml"),
        sidtool.read(SLIDER_CRANK / "rod_q4.SID_FEM"),
        scene.simulate(),
    ]
    for thing in shown:
        assert len(repr(thing)) < 120 and str(thing) == repr(thing)
        page = thing._repr_html_()
        assert page.count("<table>") == page.count("</table>") > 0
        assert "<b>" not in page
    assert "thrown" in repr(projectile()) and "200.553" in shown[2]._repr_html_()


def test_compiling_is_announced_at_a_prompt_and_in_notebooks(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delattr(sys, "ps1", raising=False)
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)
    precompile.print_compiling("one")
    monkeypatch.setitem(sys.modules, "ipykernel", sys)
    precompile.print_compiling("two")
    assert unwrapped(capsys.readouterr().err) == "sidtool: two\n"


def test_equal_scenes_may_come_from_anywhere(tmp_path: Path) -> None:
    scene = projectile(parameters={"a": 1.0})
    plain = SceneFile.checked(scene.file_data(), "table")
    assert plain.model_dump() == scene.model_dump()


def test_the_page_on_python_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    page = (SLIDER_CRANK.parents[1] / "docs" / "python.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    exec("".join(blocks), {})
    assert len(blocks) >= 4 and (tmp_path / "pendulum.toml").is_file()


@pytest.mark.parametrize(
    ("name", "suggestion"),
    [
        ("Revolut", "perhaps Revolute"),
        ("spring_damper", "perhaps SpringDamper"),
        ("xyz", r"dir\(sidtool\) lists all"),
    ],
)
def test_an_unknown_name_suggests_the_nearest(name: str, suggestion: str) -> None:
    """In notebooks, too, where Python's own suggestion is not shown."""
    with pytest.raises(AttributeError, match=f"no attribute '{name}'; {suggestion}$"):
        getattr(sidtool, name)


@pytest.mark.parametrize(
    ("call", "argument"),
    [
        (sidtool.read, "path"),
        (sidtool.convert, "model"),
        (sidtool.validate, "sid"),
        (sidtool.simulate, "scene"),
        (sidtool.study, "scene"),
        (lambda scene: sidtool.sweep(scene, "a=1", "b.x.max"), "scene"),
        (sidtool.static_equilibrium, "scene"),
        (sidtool.linearise, "scene"),
        (lambda content: sidtool.write("motion.h5", content), "content"),
    ],
)
def test_invalid_paths_are_refused_by_the_name_of_the_argument(
    call: Any, argument: str
) -> None:
    with pytest.raises(sidtool.InputError, match=f"{argument}: is of the type dict"):
        call({"format": "sidtool model"})
