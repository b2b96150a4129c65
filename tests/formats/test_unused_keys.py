"""Keys that have no effect are refused or named, and true is no number."""

from __future__ import annotations

from typing import Any, Literal, get_args, get_origin

import pytest

import sidtool
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import ModelFile
from sidtool.formats.reference import ReferenceFile
from sidtool.formats.scene import SceneFile
from sidtool.formats.scene.unused_keys import unused_keys
from sidtool.formats.study import StudyFile
from sidtool.formats.toml.reading import validate_data
from tests.sidtool.bodies import volume_data
from tests.sidtool.models import rod_data


def scene_data() -> dict[str, Any]:
    return {
        "format": "sidtool scene",
        "version": 1,
        "dimension": "planar",
        "time": {"end": 1.0, "output_step": 0.5},
        "bodies": {"a": {"mass": 1.0, "inertia": 1.0}, "b": {"sid": "b.SID_FEM"}},
        "joints": {"pin": {"type": "revolute", "markers": ["ground", "a"]}},
    }


def model_data() -> dict[str, Any]:
    return rod_data() | {
        "geometry": {"type": "mesh", "file": "a.inp", "engine": "calculix"},
        "discretisation": {"type": "mesh"},
        "frame": {"type": "buckens"},
    }


def scene_with(**changes: Any) -> SceneFile:
    data = scene_data()
    for key, value in changes.items():
        *above, last = key.split("__")
        table: Any = data
        for part in above:
            table = table.setdefault(part, {})
        table[last] = value
    return SceneFile.checked(data, "test")


@pytest.mark.parametrize("file", [SceneFile, ModelFile, StudyFile, ReferenceFile])
def test_true_is_no_version(file: Any) -> None:
    info = file.model_fields["version"]
    assert get_origin(info.annotation) is Literal and get_args(info.annotation) == (1,)
    name = get_args(file.model_fields["format"].annotation)[0]
    with pytest.raises(InputError) as caught:
        validate_data({"format": name, "version": True}, file)
    assert caught.value.place == "version"


def test_true_is_no_order_of_elements() -> None:
    data = model_data()
    data["geometry"]["order"] = True
    with pytest.raises(InputError) as caught:
        ModelFile.checked(data, "test")
    assert caught.value.place == "geometry.order"


@pytest.mark.parametrize("kind", ["hex20", "tet4", "tet10"])
def test_formulation_is_for_elements_that_have_it(kind: str) -> None:
    chosen = {"type": kind, "elements": [2, 1, 1], "formulation": "full_integration"}
    with pytest.raises(InputError) as caught:
        ModelFile.checked(volume_data(chosen), "test")
    assert caught.value.place == "discretisation.formulation"


def test_a_volume_has_no_plane_state() -> None:
    chosen = {"type": "iga", "degrees": [2, 1, 1], "elements": [1, 1, 1]}
    ModelFile.checked(volume_data(chosen), "test")
    with pytest.raises(InputError) as caught:
        ModelFile.checked(volume_data(chosen | {"state": "plane_strain"}), "test")
    assert caught.value.place == "discretisation.state"


@pytest.mark.parametrize("key", ["time", "rotations", "states", "sids"])
def test_parts_of_a_result_need_a_result(key: str) -> None:
    value: Any = 1.0 if key == "time" else {"pin": "x" if key == "sids" else 1.0}
    with pytest.raises(InputError) as caught:
        scene_with(initial={key: value})
    assert caught.value.place == "initial"


def test_a_coordinate_is_one_of_a_joint() -> None:
    force = {"type": "spring_damper", "stiffness": 1.0, "coordinate": "angle"}
    scene_with(forces={"k": force | {"joint": "pin"}})
    with pytest.raises(InputError) as caught:
        scene_with(forces={"k": force | {"markers": ["ground", "a"]}})
    assert caught.value.place == "forces.k.coordinate"


def named(scene: SceneFile, *, fixed_step: bool = False, radius: bool = False) -> str:
    found = unused_keys(scene, fixed_step=fixed_step, spectral_radius=radius)
    return " ".join(each.subject for each in found if each.code == "N244")


def test_keys_of_other_integrators_are_named() -> None:
    radius = scene_with(accuracy__spectral_radius=0.5)
    assert "accuracy.spectral_radius" in named(radius)
    assert not named(radius, radius=True)
    tolerance = scene_with(accuracy__rtol=1e-4)
    assert "accuracy.rtol" in named(tolerance, fixed_step=True)
    assert not named(tolerance)
    assert not named(scene_with(accuracy__rtol=1e-6), fixed_step=True)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("shape_functions", [1]),
        ("quadratic_inertia", True),
        ("geometric_stiffening", False),
        ("damping", {"type": "frequency"}),
        ("initial__elastic", [0.1]),
        ("initial__elastic_velocity", [0.1]),
    ],
)
def test_keys_of_the_deformation_of_a_rigid_body_are_named(
    key: str, value: Any
) -> None:
    place = f"bodies__b__{key}"
    assert not named(scene_with(**{place: value}))
    rigid = scene_with(**{place: value, "bodies__b__rigid": True})
    assert place.replace("__", ".") in named(rigid)


def test_parameters_tables_and_terms_that_no_formula_reads_are_named() -> None:
    """`with = "2*n"` in place of `width` leaves `width` unread: a likely mistake."""
    table = {"x": [0.0, 1.0], "values": [0.0, 1.0]}
    law = {
        "type": "expression",
        "value": "gain*used - lookup(curve, a.x)",
        "terms": {"used": "a.vx", "idle": "a.vy"},
        "parameters": {"gain": 2.0, "loss": 3.0},
    }
    scene = scene_with(
        parameters={"width": 1.0, "n": 2.0, "weight": "n**2"},
        tables={"curve": table, "other": table},
        bodies__a__mass="weight",
        forces__f={"type": "force", "marker": "a", "force": [1.0, 0.0]}
        | {"function": law},
    )
    assert set(named(scene).split()) == {
        "parameters.width",
        "tables.other",
        "forces.f.function.terms.idle",
        "forces.f.function.parameters.loss",
    }


@pytest.mark.parametrize("inertia", [None, 1.0])
def test_a_point_mass_has_no_angular_velocity(inertia: float | None) -> None:
    """Its initial angular velocity is named as without effect."""
    body = {"mass": 1.0, "initial": {"angular_velocity": 2.0}} | (
        {} if inertia is None else {"inertia": inertia}
    )
    data = scene_data() | {"bodies": {"a": body}}
    del data["joints"]
    found = sidtool.simulate(sidtool.Scene.checked(data, "test"))
    told = [(d.code, d.subject) for d in found.diagnostics]
    key = "bodies.a.initial.angular_velocity"
    assert told == ([("N244", key)] if inertia is None else [])


def test_parameters_of_models_that_no_formula_reads_are_named() -> None:
    data = rod_data()
    data["parameters"] = {"rho": 7850.0, "depth": 0.1}
    data["material"]["density"] = "rho"
    sid = sidtool.convert(ModelFile.checked(data, "test"))
    named = [note.subject for note in sid.diagnostics if note.code == "N145"]
    assert named == ["parameters.depth"]
