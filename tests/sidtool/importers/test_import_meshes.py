"""Meshes of CalculiX, Abaqus and Gmsh: the same body from all; clear messages."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.formats.model import read_model
from sidtool.importers.mesh_files import MESH_READERS, read_mesh
from sidtool.mesh.mesh import check_mesh
from sidtool.pipeline.model_to_sid import finite_element_model, sid_from_model

from ..bodies import volume
from .mesh_files import FORMATS, inp_text, mesh_model, msh_2, msh_4, rod_mesh


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet4", "tet10"])
@pytest.mark.parametrize("name", FORMATS)
def test_every_format_holds_the_same_mesh(tmp_path: Path, name: str, kind: str) -> None:
    mesh = rod_mesh(kind)
    file, writer = FORMATS[name]
    (tmp_path / file).write_text(writer(mesh), encoding="utf-8")
    imported = read_mesh(tmp_path / file)
    assert_allclose(imported.mesh.positions, mesh.positions, atol=1e-15)
    assert (imported.mesh.blocks[0].nodes == mesh.blocks[0].nodes).all()
    assert imported.mesh.blocks[0].kind == kind
    sets = {k.lower(): v for k, v in imported.mesh.node_sets.items()}
    assert set(sets["left"]) == set(mesh.node_sets["0.0"])
    check_mesh(imported.mesh)


@pytest.mark.parametrize("name", FORMATS)
def test_an_imported_rod_is_the_sampled_rod(tmp_path: Path, name: str) -> None:
    file, writer = FORMATS[name]
    (tmp_path / file).write_text(writer(rod_mesh("hex20")), encoding="utf-8")
    clamp = {"type": "tangent", "marker": "crank_pin", "clamp": "LEFT"}
    changes = {"frame": clamp} if name == "inp" else {}
    sid = sid_from_model(mesh_model(tmp_path, file, **changes))
    own = sid_from_model(volume({"type": "hex20", "elements": [6, 1, 1]}, 5))
    assert_allclose(np.diag(sid.Ke.m0), np.diag(own.Ke.m0), rtol=1e-9)
    assert sid.mass == pytest.approx(3.14, rel=1e-12)


def test_the_file_s_own_material_is_used(tmp_path: Path) -> None:
    (tmp_path / "rod.inp").write_text(inp_text(rod_mesh("hex8")), encoding="utf-8")
    clamp = {"type": "tangent", "marker": "crank_pin", "clamp": "LEFT"}
    with_own = mesh_model(tmp_path, "rod.inp", frame=clamp, material=None)
    data = json.loads(with_own.read_text(encoding="utf-8"))
    del data["material"]
    with_own.write_text(json.dumps(data), encoding="utf-8")
    own = finite_element_model(read_model(with_own))
    given = finite_element_model(
        read_model(mesh_model(tmp_path, "rod.inp", frame=clamp))
    )
    assert abs(own.stiffness - given.stiffness).max() == 0
    assert abs(own.mass - given.mass).max() == 0


@pytest.mark.parametrize(
    ("old", "new", "message", "place"),
    [
        ("C3D8I", "S4R", "S4R is not supported", "line 33"),
        ("10, 0.0", "10, zero", "'zero'", "line 5"),
        ("11, 0.0", "10, 0.0", "node 10 is defined twice", "line 6"),
        ("1, 10, 14, 16", "1, 10, 14, 999", "node 999, which is not defined", ""),
        ("MATERIAL=STEEL", "MATERIAL=Wood", "'Wood', which is not defined", ""),
        ("ELSET=eall,", "ELSET=other,", "'other', which is not defined", ""),
        ("0.3\n", "0.6\n", "nu between -1 and 0.5", ""),
        ("*ELASTIC\n", "*ELASTIC, TYPE=ORTHO\n", "has 2 constants", ""),
    ],
)
def test_mistakes_in_inp(
    tmp_path: Path, old: str, new: str, message: str, place: str
) -> None:
    text = inp_text(rod_mesh("hex8"))
    assert old in text
    path = tmp_path / "rod.inp"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_mesh(path)
    assert caught.value.source == str(path)
    assert message in str(caught.value)
    assert caught.value.place is None or place in caught.value.place


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("4.1 0 8", "4.1 1 8", "ends early"),
        ("$EndNodes", "$EndNoodles", "expected $EndNodes"),
        ("$EndElements", "", "ends inside $Elements"),
        ("3 1 5 6", "3 1 12 6", "type 12, which is not supported"),
        ("3 1 5 6", "3 1 5 7", "$Elements ends early"),
    ],
)
def test_mistakes_in_msh(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = msh_4(rod_mesh("hex8"))
    assert old in text
    path = tmp_path / "rod.msh"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_mesh(path)
    assert message in str(caught.value) and caught.value.source == str(path)


@cache
def written(name: str) -> str:
    """The rod as a file of a format."""
    return FORMATS[name][1](rod_mesh("hex8"))


@given(data=st.data(), name=st.sampled_from(list(FORMATS)))
@settings(
    max_examples=60,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_damaged_files_end_in_a_message(
    tmp_path: Path, data: st.DataObject, name: str
) -> None:
    """Cut off or with a character changed: a sound mesh, or one `InputError`."""
    file, text = FORMATS[name][0], written(name)
    at = data.draw(st.integers(0, len(text) - 1))
    cut = data.draw(st.booleans())
    letter = data.draw(st.sampled_from("0 9,.-*$\nxé"))
    spoiled = text[:at] + ("" if cut else letter + text[at + 1 :])
    path = tmp_path / file
    path.unlink(missing_ok=True)  # to shorten a file takes much longer
    path.write_text(spoiled, encoding="utf-8")
    try:
        check_mesh(read_mesh(path).mesh)
    except InputError as error:
        assert str(error)


def test_node_sets_and_nodes_of_a_model_must_exist_in_the_mesh(tmp_path: Path) -> None:
    (tmp_path / "rod.msh").write_text(msh_2(rod_mesh("hex8")), encoding="utf-8")
    frame = {"type": "tangent", "marker": "crank_pin", "clamp": "top"}
    cases: list[tuple[dict[str, Any], str]] = [
        ({"frame": frame}, "one of left, rod"),
        ({"geometry": {"type": "mesh", "file": "no.msh"}}, "no such file"),
        ({"geometry": {"type": "mesh", "file": "rod.stl"}}, "not known as meshes"),
    ]
    for changes, message in cases:
        with pytest.raises(InputError, match=message):
            sid_from_model(mesh_model(tmp_path, "rod.msh", **changes))
    markers = {"crank_pin": {"node": 1, "mesh_node": 7}}
    with pytest.raises(InputError, match="has no node 7") as caught:
        sid_from_model(mesh_model(tmp_path, "rod.msh", markers=markers))
    assert caught.value.place == "markers.crank_pin.mesh_node"


@pytest.mark.parametrize("ending", MESH_READERS)
def test_no_reader_lets_an_empty_file_pass(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"empty{ending}"
    path.write_text("\n", encoding="utf-8")
    with pytest.raises(InputError, match="is empty"):
        read_mesh(path)
