"""Meshes of other programs: the same body from every format; clear messages."""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from formats.errors import InputError
from formats.model import read_model
from sidtool.convert import finite_element_model, sid_from_model
from sidtool.frontends.mesh import Mesh, check_mesh
from sidtool.frontends.sampled_volume import sampled_volume
from sidtool.geometry.patch import patch_from_model
from sidtool.importers.meshes import MESH_READERS, read_mesh

from .bodies import volume, volume_data

ABAQUS = {"hex8": "C3D8I", "hex20": "C3D20R", "tet4": "C3D4", "tet10": "C3D10"}
GMSH = {"hex8": 5, "hex20": 17, "tet4": 4, "tet10": 11}
GMSH_ORDER = {
    "tet10": [0, 1, 2, 3, 4, 5, 6, 7, 9, 8],
    "hex20": [*range(8), 8, 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14],
}


def rod_mesh(kind: str) -> Mesh:
    geometry = volume({"type": kind, "elements": [6, 1, 1]}).geometry
    return sampled_volume(patch_from_model(geometry), (6, 1, 1), kind)


def inp_text(mesh: Mesh) -> str:
    (block,) = mesh.blocks
    lines = ["*HEADING", "a rod", "** a comment", "*Node, nset=Nall"]
    for i, x in enumerate(mesh.positions):
        lines.append(f"{i + 10}, " + ", ".join(repr(float(v)) for v in x))
    lines.append(f"*ELEMENT, TYPE={ABAQUS[block.kind]}, ELSET=Eall")
    for label, nodes in zip(block.labels, block.nodes, strict=True):
        words = [str(label), *(str(n + 10) for n in nodes)]
        for start in range(0, len(words), 8):
            more = "," if start + 8 < len(words) else ""
            lines.append(", ".join(words[start : start + 8]) + more)
    left = mesh.node_sets["0.0"] + 10
    lines += ["*NSET, NSET=LEFT", ", ".join(map(str, left))]
    lines += ["*NSET, NSET=All, GENERATE", f"10, {len(mesh.positions) + 9}"]
    lines += ["*MATERIAL, NAME=Steel", "*ELASTIC", "2.1e11, 0.3", "*DENSITY", "7850."]
    lines += ["*SOLID SECTION, ELSET=eall, MATERIAL=STEEL", "*STEP", "*STATIC"]
    return "\n".join([*lines, "*END STEP", ""])


def msh_2(mesh: Mesh) -> str:
    (block,) = mesh.blocks
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", "2"]
    lines += ['0 1 "left"', '3 2 "rod"', "$EndPhysicalNames", "$Nodes"]
    lines.append(str(len(mesh.positions)))
    for i, x in enumerate(mesh.positions):
        lines.append(f"{i + 10} " + " ".join(repr(float(v)) for v in x))
    lines += ["$EndNodes", "$Elements"]
    left = mesh.node_sets["0.0"] + 10
    order = GMSH_ORDER.get(block.kind, list(range(block.nodes.shape[1])))
    lines.append(str(len(left) + len(block.nodes)))
    lines += [f"{1000 + n} 15 2 1 1 {n}" for n in left]
    for label, nodes in zip(block.labels, block.nodes[:, order] + 10, strict=True):
        listed = " ".join(map(str, nodes))
        lines.append(f"{label} {GMSH[block.kind]} 2 2 1 {listed}")
    return "\n".join([*lines, "$EndElements", ""])


def msh_4(mesh: Mesh) -> str:
    (block,) = mesh.blocks
    n, left = len(mesh.positions), mesh.node_sets["0.0"] + 10
    lines = ["$MeshFormat", "4.1 0 8", "$EndMeshFormat", "$PhysicalNames", "2"]
    lines += ['0 1 "left"', '3 2 "rod"', "$EndPhysicalNames", "$Entities", "1 0 0 1"]
    lines += ["1 0 0 0 1 1", "1 0 0 0 1 1 1 1 2 0", "$EndEntities", "$Nodes"]
    lines += [f"1 {n} 10 {n + 9}", f"3 1 0 {n}"]
    lines += [str(i + 10) for i in range(n)]
    lines += [" ".join(repr(float(v)) for v in x) for x in mesh.positions]
    lines += ["$EndNodes", "$Elements", f"2 {len(left) + len(block.nodes)} 1 2000"]
    lines += [f"0 1 15 {len(left)}", *(f"{1000 + k} {k}" for k in left)]
    order = GMSH_ORDER.get(block.kind, list(range(block.nodes.shape[1])))
    lines.append(f"3 1 {GMSH[block.kind]} {len(block.nodes)}")
    for label, nodes in zip(block.labels, block.nodes[:, order] + 10, strict=True):
        lines.append(f"{label} " + " ".join(map(str, nodes)))
    return "\n".join([*lines, "$EndElements", ""])


FORMATS: dict[str, tuple[str, Callable[[Mesh], str]]] = {
    "inp": ("rod.inp", inp_text),
    "msh 2.2": ("rod.msh", msh_2),
    "msh 4.1": ("rod.msh", msh_4),
}


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet4", "tet10"])
@pytest.mark.parametrize("name", FORMATS)
def test_every_format_holds_the_same_mesh(tmp_path: Path, name: str, kind: str) -> None:
    mesh = rod_mesh(kind)
    file, writer = FORMATS[name]
    (tmp_path / file).write_text(writer(mesh))
    imported = read_mesh(tmp_path / file)
    assert_allclose(imported.mesh.positions, mesh.positions, atol=1e-15)
    assert (imported.mesh.blocks[0].nodes == mesh.blocks[0].nodes).all()
    assert imported.mesh.blocks[0].kind == kind
    sets = {k.lower(): v for k, v in imported.mesh.node_sets.items()}
    assert set(sets["left"]) == set(mesh.node_sets["0.0"])
    check_mesh(imported.mesh)


def mesh_model(folder: Path, file: str, **changes: Any) -> Path:
    data = volume_data({"type": "mesh"}, 5)
    data["geometry"] = {"type": "mesh", "file": file}
    data["frame"] = {"type": "tangent", "marker": "crank_pin", "clamp": "left"}
    data["markers"] = {
        "crank_pin": {"node": 1, "position": [0.0, -0.03, -0.005]},
        "piston_pin": {"node": 2, "mesh_node": 33},
    }
    (folder / "model.json").write_text(json.dumps(data | changes))
    return folder / "model.json"


@pytest.mark.parametrize("name", FORMATS)
def test_an_imported_rod_is_the_sampled_rod(tmp_path: Path, name: str) -> None:
    file, writer = FORMATS[name]
    (tmp_path / file).write_text(writer(rod_mesh("hex20")))
    clamp = {"type": "tangent", "marker": "crank_pin", "clamp": "LEFT"}
    changes = {"frame": clamp} if name == "inp" else {}
    sid = sid_from_model(mesh_model(tmp_path, file, **changes))
    own = sid_from_model(volume({"type": "hex20", "elements": [6, 1, 1]}, 5))
    assert_allclose(np.diag(sid.Ke.m0), np.diag(own.Ke.m0), rtol=1e-9)
    assert sid.mass == pytest.approx(3.14, rel=1e-12)


def test_the_file_s_own_material_is_used(tmp_path: Path) -> None:
    (tmp_path / "rod.inp").write_text(inp_text(rod_mesh("hex8")))
    clamp = {"type": "tangent", "marker": "crank_pin", "clamp": "LEFT"}
    with_own = mesh_model(tmp_path, "rod.inp", frame=clamp, material=None)
    data = json.loads(with_own.read_text())
    del data["material"]
    with_own.write_text(json.dumps(data))
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
        ("*ELASTIC\n", "*ELASTIC, TYPE=ORTHO\n", "isotropic", ""),
    ],
)
def test_mistakes_in_inp(
    tmp_path: Path, old: str, new: str, message: str, place: str
) -> None:
    text = inp_text(rod_mesh("hex8"))
    assert old in text
    path = tmp_path / "rod.inp"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        read_mesh(path)
    assert caught.value.source == str(path)
    assert message in str(caught.value)
    assert caught.value.place is None or place in caught.value.place


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("4.1 0 8", "4.1 1 8", "version 2.2 or 4.1 as text"),
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
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        read_mesh(path)
    assert message in str(caught.value) and caught.value.source == str(path)


@given(data=st.data(), name=st.sampled_from(list(FORMATS)))
@settings(
    max_examples=150,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
def test_damaged_files_end_in_a_message(
    tmp_path: Path, data: st.DataObject, name: str
) -> None:
    """Cut off or with a character changed: a sound mesh, or one `InputError`."""
    file, writer = FORMATS[name]
    text = writer(rod_mesh("hex8"))
    at = data.draw(st.integers(0, len(text) - 1))
    cut = data.draw(st.booleans())
    letter = data.draw(st.sampled_from("0 9,.-*$\nxé"))
    spoiled = text[:at] + ("" if cut else letter + text[at + 1 :])
    path = tmp_path / file
    path.write_text(spoiled)
    try:
        check_mesh(read_mesh(path).mesh)
    except InputError as error:
        assert str(error)


def test_what_a_model_asks_of_a_mesh_must_be_there(tmp_path: Path) -> None:
    (tmp_path / "rod.msh").write_text(msh_2(rod_mesh("hex8")))
    frame = {"type": "tangent", "marker": "crank_pin", "clamp": "top"}
    cases: list[tuple[dict[str, Any], str]] = [
        ({"frame": frame}, "one of left, rod"),
        ({"geometry": {"type": "mesh", "file": "no.msh"}}, "cannot be read"),
        ({"geometry": {"type": "mesh", "file": "rod.stl"}}, "not known as meshes"),
    ]
    for changes, message in cases:
        with pytest.raises(InputError, match=message):
            sid_from_model(mesh_model(tmp_path, "rod.msh", **changes))
    markers = {"crank_pin": {"node": 1, "mesh_node": 7}}
    with pytest.raises(InputError, match="has no node 7") as caught:
        sid_from_model(mesh_model(tmp_path, "rod.msh", markers=markers))
    assert caught.value.place == "markers.crank_pin.mesh_node"


CUBE = [(x ^ (y & 1), y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
NEXT = [(x + 1, y + 1, z) for x, y, z in CUBE if (x, y) != (0, 0)]
SECTION = "*SOLID SECTION, ELSET=E, MATERIAL=S"
MATERIAL = ["*MATERIAL, NAME=S", "*ELASTIC", "2.1e11, 0.3", "*DENSITY", "7850."]
BRICK = list(range(1, 9))
TETRAHEDRA = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
TETRAHEDRA += [(-1, 0, 0), (0, -1, 0), (0, 0, -1)]
SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]


def deck(
    points: list[tuple[int, ...]],
    kind: str,
    elements: list[list[int]],
    material: list[str] = MATERIAL,
    section: str = SECTION,
) -> str:
    lines = ["*NODE"]
    lines += [f"{i}, " + ", ".join(map(str, x)) for i, x in enumerate(points, 1)]
    lines.append(f"*ELEMENT, TYPE={kind}, ELSET=E")
    lines += [f"{i}, " + ", ".join(map(str, e)) for i, e in enumerate(elements, 1)]
    return "\n".join([*lines, "*NSET, NSET=HELD", "1, 2, 3, 4", *material, section, ""])


def deck_model(folder: Path, text: str, *, held: bool = False) -> Path:
    (folder / "part.inp").write_text(text)
    frame = {"type": "tangent", "marker": "p", "clamp": "HELD"}
    path = mesh_model(
        folder,
        "part.inp",
        frame=frame if held else {"type": "buckens"},
        markers={"p": {"node": 1, "mesh_node": 1}},
        reduction={"method": "modal", "modes": 3},
    )
    data = json.loads(path.read_text())
    del data["material"]
    data["discretisation"]["state"] = "plane_stress" if "CPS" in text else None
    data["geometry"]["thickness"] = 0.1 if "CPS" in text else None
    path.write_text(json.dumps(data))
    return path


BAD_DECKS = {
    "zero volume": (
        deck([(x, y, 0) for x, y, _ in CUBE], "C3D8", [BRICK]),
        "no volume",
    ),
    "zero area": (
        deck([(x, 0, 0) for x in range(4)], "CPS4", [[1, 2, 3, 4]]),
        "no volume|no area",
    ),
    "inverted": (deck(SQUARE, "CPS4", [[1, 4, 3, 2]]), "is inverted"),
    "folded": (
        deck([*SQUARE[:2], (0, 1, 0), (1, 1, 0)], "CPS4", [[1, 2, 3, 4]]),
        "fold",
    ),
    "twice": (deck(CUBE, "C3D8", [BRICK, BRICK]), "1 and 2 .* have the same nodes"),
    "apart": (
        deck(
            [*CUBE, *((x + 1, y, z) for x, y, z in CUBE)],
            "C3D8",
            [BRICK, [n + 8 for n in BRICK]],
        ),
        "2 unconnected parts",
    ),
    "no section": (deck(CUBE, "C3D8", [BRICK], section=""), "without a material"),
    "temperature": (
        deck(CUBE, "C3D8", [BRICK], [*MATERIAL[:3], "1e11, 0.3, 500.", *MATERIAL[3:]]),
        "constant materials",
    ),
    "shell": (deck(SQUARE, "S4R", [[1, 2, 3, 4]]), "S4R is not supported"),
    "nearly incompressible": (
        deck(
            CUBE,
            "C3D8",
            [BRICK],
            ["*MATERIAL, NAME=S", "*ELASTIC", "2.1e11, 0.4999", *MATERIAL[3:]],
        ),
        "makes hex8 elements lock",
    ),
}


@pytest.mark.parametrize("name", BAD_DECKS)
def test_bad_decks_end_in_a_message(tmp_path: Path, name: str) -> None:
    text, message = BAD_DECKS[name]
    with pytest.raises(InputError, match=message) as caught:
        sid_from_model(deck_model(tmp_path, text))
    assert caught.value.source == str(tmp_path / "part.inp")


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("name", ["at an edge", "at a node"])
def test_hinges_between_elements_are_found(
    tmp_path: Path, name: str, held: bool
) -> None:
    """Elements that share less than a face make a mechanism: singular stiffness."""
    text = deck(TETRAHEDRA, "C3D4", [[1, 2, 3, 4], [1, 6, 5, 7]])
    if name == "at an edge":
        points = [*CUBE, *NEXT]
        number = {point: i for i, point in enumerate(points, 1)}
        second = [number[x + 1, y + 1, z] for x, y, z in CUBE]
        text = deck(points, "C3D8", [BRICK, second])
    with pytest.raises(InputError, match="does not resist every|lost in the rounding"):
        sid_from_model(deck_model(tmp_path, text, held=held))


def test_what_no_element_uses_changes_nothing(tmp_path: Path) -> None:
    """A free node, and a material that no section names, however wrong."""
    plain = sid_from_model(deck_model(tmp_path, deck(CUBE, "C3D8", [BRICK])))
    other = ["*MATERIAL, NAME=X", "*ELASTIC", "-1e5, 0.3", "*DENSITY", "1.", *MATERIAL]
    more = deck([*CUBE, (5, 5, 5)], "C3D8", [BRICK], other)
    sid = sid_from_model(deck_model(tmp_path, more))
    assert sid.mass == plain.mass
    assert_allclose(sid.Ke.m0, plain.Ke.m0)


def importable(module: str) -> bool:
    """Whether a package is there and works with this NumPy."""
    try:
        importlib.import_module(module)
    except Exception:
        return False
    return True


BDF = """BEGIN BULK
GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID,3,,0.,1.,0.
GRID,4,,0.,0.,1.
CTETRA,1,7,1,2,3,4
PSOLID,7,5
MAT1,5,2.1+11,,0.3,7850.
SPC1,9,123,1,2,3
ENDDATA
"""


def test_nastran(tmp_path: Path) -> None:
    """With pyNastran one tetrahedron with its material; without, what is missing."""
    path = tmp_path / "one.bdf"
    path.write_text(BDF)
    if not importable("pyNastran.bdf.bdf"):
        with pytest.raises(InputError, match="needs the package pyNastran"):
            read_mesh(path)
        return
    imported = read_mesh(path)
    assert imported.mesh.blocks[0].kind == "tet4"
    assert imported.materials["5"].density == 7850.0
    assert set(imported.mesh.node_sets["SPC9"]) == {0, 1, 2}


def cdb_text() -> str:
    """A unit cube as ANSYS writes it."""
    corners = [(x ^ (y & 1), y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    lines = ["/PREP7", "ET,        1,185", "NBLOCK,6,SOLID,         8,         8"]
    lines.append("(3i9,6e21.13e3)")
    for i, corner in enumerate(corners):
        numbers = "".join(f"{x:.13f}E+000".rjust(21) for x in corner)
        lines.append(f"{i + 1:9d}{0:9d}{0:9d}" + numbers)
    lines += ["N,R5.3,LOC,       -1,", "EBLOCK,19,SOLID,         1,         1"]
    row = [1, 1, 1, 1, 0, 0, 0, 0, 8, 0, 1, *range(1, 9)]
    return "\n".join(
        [*lines, "(19i9)", "".join(f"{x:9d}" for x in row), "       -1", ""]
    )


def test_ansys(tmp_path: Path) -> None:
    """With mapdl-archive one brick; without, what is missing."""
    path = tmp_path / "one.cdb"
    path.write_text(cdb_text())
    if not importable("mapdl_archive"):
        with pytest.raises(InputError, match="needs the package mapdl-archive"):
            read_mesh(path)
        return
    imported = read_mesh(path)
    assert imported.mesh.blocks[0].kind == "hex8"
    check_mesh(imported.mesh)


NASTRAN = {"hex8": "CHEXA", "hex20": "CHEXA", "tet4": "CTETRA", "tet10": "CTETRA"}
NASTRAN_HEX20 = [*range(12), *range(16, 20), *range(12, 16)]
ANSYS = {"hex8": 185, "hex20": 186, "tet4": 285, "tet10": 187}


def bdf_text(mesh: Mesh) -> str:
    """A mesh in the free format of Nastran, eight fields to a line."""
    (block,) = mesh.blocks
    lines = ["BEGIN BULK", "PSOLID,7,5", "MAT1,5,2.1+11,,0.3,7850."]
    for i, x in enumerate(mesh.positions):
        lines.append(f"GRID,{i + 10},," + ",".join(f"{v:.10f}" for v in x))
    order = NASTRAN_HEX20 if block.kind == "hex20" else range(block.nodes.shape[1])
    for label, row in zip(block.labels, block.nodes, strict=True):
        words = [str(label), "7", *(str(row[k] + 10) for k in order)]
        groups = [words[k : k + 8] for k in range(0, len(words), 8)]
        first = f"{NASTRAN[block.kind]}," + ",".join(groups[0])
        rest = ["," + ",".join(group) for group in groups[1:]]
        lines += [f"{line}," for line in [first, *rest][:-1]] + [[first, *rest][-1]]
    left = [str(n + 10) for n in mesh.node_sets["0.0"]]
    lines += [f"SPC1,9,123,{n}" for n in left]
    return "\n".join([*lines, "ENDDATA", ""])


def cdb_mesh(mesh: Mesh) -> str:
    """A mesh as ANSYS writes it, with a component of nodes."""
    (block,) = mesh.blocks
    n, kind = len(mesh.positions), ANSYS[block.kind]
    lines = ["/PREP7", f"ET,        1,{kind}"]
    lines += [f"NBLOCK,6,SOLID,{n:10d},{n:10d}", "(3i9,6e21.13e3)"]
    for i, x in enumerate(mesh.positions):
        words = "".join(_fortran(v) for v in x)
        lines.append(f"{i + 10:9d}{0:9d}{0:9d}" + words)
    count = len(block.nodes)
    lines += ["N,R5.3,LOC,       -1,", f"EBLOCK,19,SOLID,{count:10d},{count:10d}"]
    lines.append("(19i9)")
    for label, row in zip(block.labels, block.nodes + 10, strict=True):
        head = [1, 1, 1, 1, 0, 0, 0, 0, len(row), 0, int(label)]
        words = [*head, *(int(v) for v in row[:8])]
        lines.append("".join(f"{x:9d}" for x in words))
        if len(row) > 8:
            lines.append("".join(f"{int(x):9d}" for x in row[8:]))
    left = [int(v) + 10 for v in mesh.node_sets["0.0"]]
    lines += ["       -1", f"CMBLOCK,LEFT    ,NODE,{len(left):8d}", "(8i10)"]
    for k in range(0, len(left), 8):
        lines.append("".join(f"{x:10d}" for x in left[k : k + 8]))
    return "\n".join([*lines, ""])


def _fortran(value: float) -> str:
    mantissa, exponent = f"{value:.13e}".split("e")
    return f"{mantissa}E{int(exponent):+04d}".rjust(21)


BULK: dict[str, tuple[str, str, Callable[[Mesh], str], str]] = {
    "bdf": ("pyNastran.bdf.bdf", "rod.bdf", bdf_text, "SPC9"),
    "cdb": ("mapdl_archive", "rod.cdb", cdb_mesh, "LEFT"),
}


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet4", "tet10"])
@pytest.mark.parametrize("name", BULK)
def test_bulk_data_hold_the_same_mesh(tmp_path: Path, name: str, kind: str) -> None:
    """The rod by every element: nodes, order of nodes, sets, and its frequencies."""
    module, file, writer, clamped = BULK[name]
    if not importable(module):
        pytest.skip(f"{module.split('.')[0]} does not work here")
    mesh = rod_mesh(kind)
    (tmp_path / file).write_text(writer(mesh))
    imported = read_mesh(tmp_path / file)
    assert_allclose(imported.mesh.positions, mesh.positions, atol=1e-9)
    (block,) = imported.mesh.blocks
    assert block.kind == kind
    assert (block.nodes == mesh.blocks[0].nodes).all()
    assert set(imported.mesh.node_sets[clamped]) == set(mesh.node_sets["0.0"])
    frame = {"type": "tangent", "marker": "crank_pin", "clamp": clamped}
    found = sid_from_model(mesh_model(tmp_path, file, frame=frame))
    (tmp_path / "rod.msh").write_text(msh_2(mesh))
    expected = sid_from_model(mesh_model(tmp_path, "rod.msh"))
    assert_allclose(np.diag(found.Ke.m0), np.diag(expected.Ke.m0), rtol=1e-6)


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("bdf", "CTETRA,1,7,", "CTETRA,1,7,1", "not defined|cannot be read"),
        ("bdf", "CTETRA,1,7,1,2,3,4", "CBEAM,1,7,1,2,0.,0.,1.", "is a CBEAM"),
        ("bdf", "GRID,4,,", "GRID,4,6,", "coordinate system 6"),
        ("cdb", "1,185", "1,181", "of type 181"),
    ],
)
def test_mistakes_in_bulk_data(
    tmp_path: Path, name: str, old: str, new: str, message: str
) -> None:
    module, file, *_ = BULK[name]
    if not importable(module):
        pytest.skip(f"{module.split('.')[0]} does not work here")
    text = BDF if name == "bdf" else cdb_text()
    assert old in text
    (tmp_path / file).write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=message) as caught:
        read_mesh(tmp_path / file)
    assert caught.value.source == str(tmp_path / file)


@pytest.mark.parametrize("ending", MESH_READERS)
def test_no_reader_lets_an_empty_file_pass(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"empty{ending}"
    path.write_text("\n")
    with pytest.raises(InputError, match="is empty"):
        read_mesh(path)
