"""Bulk data of Nastran and ANSYS, by packages that need not be there."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.elements.solid_mesh import mesh_matrices
from sidtool.formats.base.errors import InputError
from sidtool.importers.ansys.archive import collapsed_element
from sidtool.importers.mesh_files import read_mesh
from sidtool.mesh.mesh import ElementBlock, Mesh, check_mesh
from sidtool.mesh.reference_elements import edge_nodes, reference_element
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.codes import codes
from tests.metamorphic.parts.meshes import STEEL

from .mesh_files import BDF, bdf_text, cdb_mesh, cdb_text, mesh_model, msh_2, rod_mesh


def test_nastran(tmp_path: Path) -> None:
    """One tetrahedron with its material, with and without executive section."""
    path = tmp_path / "one.bdf"
    plain = BDF.split("BEGIN BULK\n")[1]
    for text in (BDF, plain, "SOL 101\nCEND\nSPC = 9\n" + BDF):
        path.write_text(text, encoding="utf-8")
        imported = read_mesh(path)
        assert imported.mesh.blocks[0].kind == "tet4"
        assert imported.materials["5"].density == 7850.0
        assert imported.materials["5"].youngs_modulus == 2.1e11
        assert set(imported.mesh.node_sets["SPC9"]) == {0, 1, 2}


def test_ansys(tmp_path: Path) -> None:
    path = tmp_path / "one.cdb"
    path.write_text(cdb_text(), encoding="utf-8")
    imported = read_mesh(path)
    assert imported.mesh.blocks[0].kind == "hex8"
    check_mesh(imported.mesh)


BULK: dict[str, tuple[str, Callable[[Mesh], str], str]] = {
    "bdf": ("rod.bdf", bdf_text, "SPC9"),
    "cdb": ("rod.cdb", cdb_mesh, "LEFT"),
}


@pytest.mark.parametrize("kind", ["hex8", "hex20", "tet4", "tet10"])
@pytest.mark.parametrize("name", BULK)
def test_bulk_data_hold_the_same_mesh(tmp_path: Path, name: str, kind: str) -> None:
    """The rod by every element: nodes, order of nodes, sets, and its frequencies."""
    file, writer, clamped = BULK[name]
    mesh = rod_mesh(kind)
    (tmp_path / file).write_text(writer(mesh), encoding="utf-8")
    imported = read_mesh(tmp_path / file)
    assert_allclose(imported.mesh.positions, mesh.positions, atol=1e-9)
    (block,) = imported.mesh.blocks
    assert block.kind == kind
    assert (block.nodes == mesh.blocks[0].nodes).all()
    assert set(imported.mesh.node_sets[clamped]) == set(mesh.node_sets["0.0"])
    frame = {"type": "tangent", "marker": "crank_pin", "clamp": clamped}
    sid = sid_from_model(mesh_model(tmp_path, file, frame=frame))
    (tmp_path / "rod.msh").write_text(msh_2(mesh), encoding="utf-8")
    expected = sid_from_model(mesh_model(tmp_path, "rod.msh"))
    assert_allclose(np.diag(sid.Ke.m0), np.diag(expected.Ke.m0), rtol=1e-6)


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("bdf", "CTETRA,1,7,", "CTETRA,1,7,1", "node 11, which is not defined"),
        (
            "bdf",
            "CTETRA,1,7,1,2,3,4",
            "CBEAM,1,7,1,2,0.,0.,1.",
            "CBEAM 1 has the property 7",
        ),
        ("bdf", "GRID,4,,", "GRID,4,6,", "coordinate system"),
        ("cdb", "1,185", "1,181", "of type 181"),
    ],
)
def test_mistakes_in_bulk_data(
    tmp_path: Path, name: str, old: str, new: str, message: str
) -> None:
    file, *_ = BULK[name]
    text = BDF if name == "bdf" else cdb_text()
    assert old in text
    (tmp_path / file).write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError, match=message) as caught:
        read_mesh(tmp_path / file)
    assert caught.value.source == str(tmp_path / file)


def fixed(width: int, name: str, *words: str) -> str:
    return name.ljust(8) + "".join(word.rjust(width) for word in words)


#: The tetrahedron of `BDF` in small and large fields, material by E and G.
SMALL = "\n".join(
    [
        "SOL 103",
        "CEND",
        "BEGIN BULK",
        "$ a comment",
        fixed(8, "GRID", "1", "", "0.", "0.", "0."),
        fixed(8, "grid", "2", "", "1.", "", "0.0"),
        fixed(16, "GRID*", "3", "", "0.", "10.-1") + "*A",
        fixed(16, "*A", "0.0"),
        "GRID,4,,0.,0.,1.+0",
        fixed(8, "CTETRA", "1", "7", "1", "2", "3", "4"),
        fixed(8, "PSOLID", "7", "5"),
        fixed(8, "MAT1", "5", "2.1+11", "8.077+10", "", "7.85+3"),
        fixed(8, "SPC1", "9", "123", "1", "THRU", "3"),
        "ENDDATA",
        "",
    ]
)


def test_small_and_large_fields_are_free_ones(tmp_path: Path) -> None:
    for name, text in (("free", BDF), ("small", SMALL)):
        (tmp_path / f"{name}.bdf").write_text(text, encoding="utf-8")
    free, small = (read_mesh(tmp_path / f"{n}.bdf") for n in ("free", "small"))
    assert_allclose(small.mesh.positions, free.mesh.positions, atol=0)
    assert (small.mesh.blocks[0].nodes == free.mesh.blocks[0].nodes).all()
    assert small.materials["5"].density == 7850.0
    assert small.materials["5"].poissons_ratio == pytest.approx(0.3, abs=1e-4)
    assert list(small.mesh.node_sets["SPC9"]) == [0, 1, 2]


@pytest.mark.parametrize("marks", [("", ""), ("*", "+"), ("*N7", "+E7")])
def test_marks_of_continuations_right_behind_their_cards(
    tmp_path: Path, marks: tuple[str, str]
) -> None:
    """The form of each mark is free, and many cards are read together."""
    large, small = marks
    rows = np.random.default_rng(0).uniform(size=(40, 3)).round(6)
    lines = ["BEGIN BULK", "PSOLID,7,5", "MAT1,5,2.1+11,,.3,7850."]
    for n, (x, y, z) in enumerate(rows.tolist(), start=1):
        lines += [fixed(16, "GRID*", str(n), "", str(x), str(y)) + large]
        lines += [fixed(16, large or "*", str(z))]
    for n in range(4):
        nodes = [str(10 * n + k) for k in range(1, 11)]
        lines += [fixed(8, "CTETRA", str(n + 1), "7", *nodes[:6]) + small]
        lines += [fixed(8, small or "+", *nodes[6:])]
    (tmp_path / "a.bdf").write_text(
        "\n".join([*lines, "ENDDATA", ""]), encoding="utf-8"
    )
    mesh = read_mesh(tmp_path / "a.bdf").mesh
    assert_allclose(mesh.positions, rows, atol=0)
    assert sorted(mesh.blocks[0].nodes.ravel()) == list(range(40))


@pytest.mark.parametrize(
    ("card", "message"),
    [
        ("CHEXAFD,2,7,1,2,3,4", "CHEXAFD is not supported"),
        ("CWELD,9,1,1,PARTPAT", "CWELD is not supported"),
        ("CONM1,9,1,,5.0", "masses of CONM1 9 are 5, 0, 0"),
        ("CMASS2,9,5.,1,1", "masses at node 1 are 5, 0, 0"),
        ("CMASS2,9,5.,1,1,2,1", "a mass between the nodes 1 and 2"),
        ("CMASS1,9,5,1,1", "the property 5, which is not defined"),
        ("CMASS4,9,5.,1,2", "CMASS4 is not supported"),
        ("CELAS3,9,7,1", "CELAS3 is not supported"),
        ("DMIG,K2,0,6,1", "DMIG is not supported"),
        ("RBE1,9,1,123456,2,3", "RBE1 is not supported"),
        ("MPC,9,1,1,1.,99,1,-1.", "direction 1 of 99"),
        ("MATT1,5,3\nTEMPD,1,90.", "MATT1 is not supported"),
        ("GRDSET,,3", "coordinate system 3 is not defined"),
        ("BEGIN SUPER=2\nGRID,9,,0.,0.,0.", "BEGIN SUPER=2, which is not supp"),
        ("MAT1,5,7.+10,,.3,2700.", "material 5 is defined twice"),
        ("PSOLID,7,6", "property 7 is defined twice"),
        ("GRID,4,,0.,0.,9.", "node 4 is defined twice"),
        ("CTETRA,2,7,1,2,3", "CTETRA of 3 nodes"),
        ("CTETRA,2,7,1,2,3,4,5,6", "names node 5"),
        ("CTETRA,1,7,1,2,3,4", "element 1 is defined twice"),
        ("+X,1,2", "continues no card"),
        ("GRID,9,,1,2,3,4,5,6,7,8,9", "has 12 fields"),
    ],
)
def test_no_card_is_lost(tmp_path: Path, card: str, message: str) -> None:
    path = tmp_path / "one.bdf"
    path.write_text(BDF.replace("ENDDATA", card + "\nENDDATA"), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_mesh(path)
    if "is not supported" in message:
        name = card.split(",")[0].lower()
        assert len(read_mesh(path, [name]).mesh.blocks) == 1


def test_cards_without_effect_are_listed(tmp_path: Path) -> None:
    path = tmp_path / "one.bdf"
    more = "FORCE,1,1,,5.,1.,0.,0.\nPARAM,POST,-1\nPARAM,WTMASS,.5\nSPC,8,4,12\n"
    path.write_text(BDF.replace("ENDDATA", more + "ENDDATA"), encoding="utf-8")
    imported = read_mesh(path)
    assert imported.materials["5"].density == 3925.0
    assert codes(imported) == ["N110", "N116", "N112"]
    _, factor, unread = imported.diagnostics
    assert factor.data["key"] == "PARAM WTMASS" and factor.data["factor"] == 0.5
    *idle, directions = unread.data["keywords"]
    assert idle == ["FORCE", "PARAM POST"] and "SPC8" in directions


def test_cards_of_other_files_are_read(tmp_path: Path) -> None:
    (tmp_path / "more.txt").write_text("GRID,4,,0.,0.,1.\n", encoding="utf-8")
    text = BDF.replace("GRID,4,,0.,0.,1.\n", "INCLUDE 'more.txt'\n")
    (tmp_path / "one.bdf").write_text(text, encoding="utf-8")
    assert len(read_mesh(tmp_path / "one.bdf").mesh.positions) == 4


MP = "MP,EX,{m},{e}\nMPDATA,R5.0, 1,PRXY,       {m}, 1, 0.3,\nMP,DENS,{m},{rho}\n"
#: Two unit cubes side by side, nodes and elements one by one.
SINGLE = (
    "/PREP7\nET,1,185\nKEYOPT,1,2,3\n"
    + "".join(
        f"N,{i + 1},{i // 4},{(0, 1, 1, 0)[i % 4]},{(0, 0, 1, 1)[i % 4]}\n"
        for i in range(12)
    )
    + MP.format(m=1, e=2.1e11, rho=7850.0)
    + MP.format(m=2, e=7e10, rho=2700.0)
    + "TYPE,1\nMAT,1\nEN,1,1,2,3,4,5,6,7,8\nMAT,2\nEN,2,5,6,7,8,9,10,11,12\nFINISH\n"
)


def test_ansys_materials_and_single_nodes_and_elements(tmp_path: Path) -> None:
    """Materials were never read: 157 for 106 kg."""
    path = mesh_model(
        tmp_path,
        "two.cdb",
        frame={"type": "buckens"},
        markers={"p": {"node": 1, "mesh_node": 1}},
    )
    data = json.loads(path.read_text(encoding="utf-8"))
    del data["material"]
    path.write_text(json.dumps(data), encoding="utf-8")
    (tmp_path / "two.cdb").write_text(SINGLE, encoding="utf-8")
    assert sid_from_model(path).mass == pytest.approx(7850 + 2700, rel=1e-12)
    mesh = read_mesh(tmp_path / "two.cdb").mesh
    assert {block.formulation for block in mesh.blocks} == {"incompatible_modes"}


def test_archives_of_new_releases_mean_the_same(tmp_path: Path) -> None:
    """UNBL where R5.0 was; pressure in a block."""
    pressure = "SFEBLOCK,4,PRES,         1,        16,0\n(i9,i4,i4,6(pg20.9))\n"
    pressure += "        1   5   1      1000.00000          1000.00000\n"
    pressure += "SFE,end,LOC,       -1,\nFINISH"
    text = SINGLE.replace("FINISH", pressure).replace("MPDATA,R5.0", "MPDATA,UNBL")
    before, after = tmp_path / "before.cdb", tmp_path / "after.cdb"
    before.write_text(SINGLE, encoding="utf-8")
    after.write_text(text, encoding="utf-8")
    assert read_mesh(after).materials == read_mesh(before).materials
    assert sum(len(block.nodes) for block in read_mesh(after).mesh.blocks) == 2


def test_elements_that_carry_loads_alone_are_listed(tmp_path: Path) -> None:
    """SURF154, as Workbench lays it under a pressure."""
    loads = "ET,2,154\nTYPE,2\nEN,9,1,2,3,4\nFINISH"
    (tmp_path / "two.cdb").write_text(SINGLE.replace("FINISH", loads), encoding="utf-8")
    mesh = read_mesh(tmp_path / "two.cdb")
    assert sum(len(block.nodes) for block in mesh.mesh.blocks) == 2
    assert any("elements of type 154" in note.line for note in mesh.diagnostics)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("CE,1,0,1,UX,1,2,UX", "node, label and factor of every term"),
        ("CE,1,0.1,1,UX,1,2,UX,-1", "CE 1 has the constant 0.1"),
        ("CE,R5.0,DEFI,2,1,0.\nCE,R5.0,NODE,1,TEMP,1,2,UX,-1", "names TEMP of node 1"),
        ("CP,1,UX,1,99", "names UX of node 99"),
        ("CP,R5.0,DEFI,2,1,UX", "CP, number, label, nodes"),
        ("RLBLOCK,1,2,6,7\nno\nformats", "RLBLOCK|no formats"),
        ("CERIG,1,2", "CERIG is not supported"),
        ("RBE3,1,ALL,2", "RBE3 is not supported"),
        ("NGEN,2,4,1,4,1", "NGEN is not supported"),
        ("EGEN,2,4,1", "EGEN is not supported"),
        ("MP,GSX,1,1e9", "property GSX of material 1"),
        ("N,1,0,0,0", "node 1 is defined twice"),
        ("EN,2,1,2,3,4,5,6,7,8", "element 2 is defined twice"),
        ("EBLOCK,10,,1,1", "EBLOCK without SOLID"),
        ("ET,1,181", "of type 181"),
    ],
)
def test_no_command_is_lost(tmp_path: Path, line: str, message: str) -> None:
    path = tmp_path / "two.cdb"
    path.write_text(SINGLE.replace("FINISH", line + "\nFINISH"), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_mesh(path)
    if message.endswith("is not supported"):
        assert len(read_mesh(path, [line.split(",")[0]]).mesh.blocks) == 2


def test_blocks_hold_what_they_announce(tmp_path: Path) -> None:
    path = tmp_path / "rod.cdb"
    text = cdb_mesh(rod_mesh("hex8"))
    path.write_text(
        text.replace(
            "EBLOCK,19,SOLID,         6,         6",
            "EBLOCK,19,SOLID,         6,         7",
        ),
        encoding="utf-8",
    )
    with pytest.raises(InputError, match="EBLOCK announces 7 entries and holds 6"):
        read_mesh(path)


#: The corners of a brick that are one -> the element that it becomes.
COLLAPSED = {
    "wedge": [0, 1, 2, 2, 4, 5, 6, 6],
    "pyramid": [0, 1, 2, 3, 4, 4, 4, 4],
    "tet": [0, 1, 2, 2, 4, 4, 4, 4],
}


@pytest.mark.parametrize("quadratic", [False, True])
@pytest.mark.parametrize("shape", COLLAPSED)
def test_collapsed_bricks_are_prisms_pyramids_and_tetrahedra(
    shape: str, quadratic: bool
) -> None:
    """Every node of the element is where its reference node is."""
    brick = reference_element("hex20")
    corner = dict(enumerate(COLLAPSED[shape]))
    places = {i: np.array(brick.nodes[i]) for i in range(8)}
    points = [places[corner[i]] for i in range(8)]
    points += [(points[a] + points[b]) / 2 for a, b in edge_nodes("hex20")]
    order = [*range(12), *range(12, 20)]
    keys = [tuple(points[i]) for i in order]
    number = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    count = 20 if quadratic else 8
    kind, nodes = collapsed_element(
        "hex20" if quadratic else "hex8", [number[key] for key in keys[:count]]
    )
    where = np.array([list(number)[n] for n in nodes])
    assert kind.startswith(shape) and len(set(nodes)) == len(nodes)
    for k, (a, b) in enumerate(edge_nodes(kind), start=reference_element(kind).corners):
        assert_allclose(where[k], (where[a] + where[b]) / 2)
    mesh = Mesh(where, (ElementBlock(kind, np.arange(len(nodes))[None], np.ones(1)),))
    check_mesh(mesh)


#: What ANSYS writes before the nodes and behind the elements of an archive.
HEADER = """/COM,ANSYS RELEASE 2019 R2           BUILD 19.4
/PREP7
/NOPR
ANTYPE, 2
MODCONTROL,ON
QRDOPT,OFF ,YES ,NO  ,LANB,OFF
*IF,_CDRDOFF,EQ,1,THEN     !if solid model was read in
_CDRDOFF=             !reset flag, numoffs already performed
*ELSE              !offset database for the following FE model
NUMOFF,NODE,      321
*ENDIF
*SET,_GUI_CLR_BG,' systemButtonFace               '
"""


def test_archives_as_ansys_writes_them(tmp_path: Path) -> None:
    """Header, branches and the end of the elements change nothing."""
    path = tmp_path / "two.cdb"
    path.write_text(
        HEADER + cdb_text().removeprefix("/PREP7\n") + "EN,R5.5,ATTR, -1,\n",
        encoding="utf-8",
    )
    (block,) = read_mesh(path).mesh.blocks
    assert block.nodes.shape == (1, 8)
    path.write_text(
        HEADER + cdb_text().replace("ET, ", "*IF,A,EQ,1,THEN\nET, "), encoding="utf-8"
    )
    with pytest.raises(InputError, match="ET depends on a parameter"):
        read_mesh(path)


@pytest.mark.parametrize(
    ("given", "linear", "corners"), [("tet10", 187, 4), ("hex20", 186, 8)]
)
def test_quadratic_elements_without_middle_nodes_are_linear(
    tmp_path: Path, given: str, linear: int, corners: int
) -> None:
    """SOLID186 and SOLID187 whose middle nodes were removed."""
    kind = "hex8" if corners == 8 else "tet4"
    path = tmp_path / "rod.cdb"
    path.write_text(cdb_mesh(rod_mesh(kind)), encoding="utf-8")
    plain = read_mesh(path).mesh
    text = path.read_text(encoding="utf-8")
    known = next(k for k in (185, 285) if f"ET,        1,{k}" in text)
    path.write_text(
        text.replace(f"ET,        1,{known}", f"ET,        1,{linear}").replace(
            "KEYOPT,1,2,3", "KEYOPT,1,2,1"
        ),
        encoding="utf-8",
    )
    (block,) = read_mesh(path).mesh.blocks
    assert block.kind == kind != given
    assert (block.nodes == plain.blocks[0].nodes).all()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "EBLOCK",
            "CSYS,1\nN,99,1.,2.,3.\nEBLOCK",
            "99 is given in the coordinate system 1",
        ),
        ("EBLOCK", "LOCAL,11,1,0.,0.,0.\nN,99,1.,2.,3.\nEBLOCK", "system 11"),
        (
            "        8        0        1        1",
            "        9        0        1        1",
            "announces 9 nodes and has 8",
        ),
        (
            "        0        0        0        8",
            "        1        0        0        8",
            "dead",
        ),
        ("EBLOCK", "MPDATA,R5.0, 3,EX, 1, 2, 7.0E10\nEBLOCK", "entry 2 behind 0"),
    ],
)
def test_what_an_archive_says_of_nodes_and_elements(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    text = cdb_text()
    assert old in text
    (tmp_path / "one.cdb").write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_mesh(tmp_path / "one.cdb")


def test_a_constant_that_depends_on_temperature_is_none(tmp_path: Path) -> None:
    """Its table goes over several lines, each of which is constant."""
    rows = ["MP,EX,1,2.0E11", "MP,NUXY,1,0.3", "MP,DENS,1,7850."]
    hot = ["MPDATA,R5.0, 6,EX, 1, 1, 2.0E11, 2.0E11, 2.0E11"]
    hot += ["MPDATA,R5.0, 6,EX, 1, 4, 1.0E11, 1.0E11, 1.0E11"]
    for given, count in ((rows, 1), (rows + hot[:1], 1), (rows + hot, 0)):
        text = cdb_text().replace("NBLOCK", "\n".join([*given, "NBLOCK"]), 1)
        (tmp_path / "one.cdb").write_text(text, encoding="utf-8")
        assert len(read_mesh(tmp_path / "one.cdb").materials) == count


SOLIDS = ["hex8", "hex20", "wedge6", "wedge15", "tet4", "tet10", "pyramid5"]


@pytest.mark.parametrize("kind", SOLIDS)
def test_solids_of_nastran_counted_left_handed(tmp_path: Path, kind: str) -> None:
    """They were refused as inverted. A skew element whose nodes are counted as those of
    its mirror image, x and y exchanged, is the same body: mass and stiffness."""
    reference = reference_element(kind).nodes
    skew = np.eye(3) + np.random.default_rng(5).uniform(-0.2, 0.2, (3, 3))
    count = len(reference)
    exchanged = reference[:, [1, 0, 2]]
    gaps = np.linalg.norm(exchanged[:, None] - reference, axis=2)
    left = gaps.argmin(axis=1)
    assert gaps.min(axis=1).max() == 0 and not np.array_equal(left, range(count))
    found = []
    for name, nodes in (("right", np.arange(count)), ("left", left)):
        block = ElementBlock(kind, nodes[None], np.array([1]))
        path = tmp_path / f"{name}.bdf"
        mesh = Mesh(reference @ skew, (block,), {"0.0": nodes[:1]})
        path.write_text(bdf_text(mesh), encoding="utf-8")
        imported = read_mesh(path)
        check_mesh(imported.mesh)
        found.append(mesh_matrices(imported.mesh, {"5": STEEL}, "solid"))
    for right, turned in zip(*found, strict=True):
        size = np.abs(right).max()
        assert_allclose(turned.toarray(), right.toarray(), atol=1e-9 * size)
