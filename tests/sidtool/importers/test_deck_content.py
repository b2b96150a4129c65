"""Nothing in a deck is lost: read, refused by name, or listed as without effect."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.testing import assert_allclose

from sidtool.cli.main import cli
from sidtool.elements.mesh_contact import check_contact
from sidtool.formats.base.errors import InputError
from sidtool.importers.calculix_engine import free_deck
from sidtool.importers.mesh_files import read_mesh
from sidtool.mesh.mesh import ElementBlock, Mesh
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.codes import only, with_code

from .decks import STEEL, Block, body, deck, deck_file, frequencies, listed
from .mesh_files import rod_mesh
from .test_mixed_meshes import MESHES

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")

BLOCK = Block((3, 2, 1), (0.6, 0.2, 0.1))
MASS = 7850 * 0.6 * 0.2 * 0.1

REFUSED = {
    "*CYCLIC SYMMETRY MODEL, N=4, TIE=T": "mesh of the whole body",
    "*NONSTRUCTURAL MASS, ELSET=E, UNITS=TOTAL MASS\n5.": "NONSTRUCTURAL MASS",
    "*RIGID BODY, NSET=NONE, REF NODE=1": "no node set 'NONE'",
    "*COUPLING, REF NODE=1, SURFACE=S, CONSTRAINT NAME=C\n*KINEMATIC": "surface 'S'",
    "*SURFACE, NAME=S\nE, S1\n*COUPLING, REF NODE=1, SURFACE=S\n*KINEMATIC\n1, 2": (
        "holds the directions 1, 2"
    ),
    "*KINEMATIC\n1, 3": "KINEMATIC stands alone",
    "*CONTACT PAIR, INTERACTION=I\nA, B": "CONTACT PAIR",
    "*EMBEDDED ELEMENT\nE": "EMBEDDED ELEMENT",
    "*SPRING, ELSET=G\n\n1e5": "SPRING",
    "*MASS, ELSET=M\n3.": "MASS names 'M'",
    "*ROTARY INERTIA, ELSET=M\n3.": "ROTARY INERTIA names 'M'",
    "*NMAP, NSET=LEFT, TYPE=CARTESIAN\n0,0,0": "NMAP is not known",
    "*STEP\n*MODEL CHANGE, TYPE=ELEMENT, REMOVE\nE\n*END STEP": "MODEL CHANGE",
    "*MATERIAL, NAME=S\n*ELASTIC\n1e9, 0.3": "material S is defined twice",
    "*DENSITY\n1000.": "DENSITY of material S is defined twice",
    "*MATERIAL, NAME=T\n*ELASTIC\n1e9, 0.3\n*DENSITY\n1.\n*SOLID SECTION, ELSET=E, "
    "MATERIAL=T": "element 1 has another section already",
    "*SHELL SECTION, ELSET=E, MATERIAL=S\n0.1": "element 1 has another section already",
    "*USER ELEMENT": "USER ELEMENT is not known",
    "*NODE, WHATEVER=3\n99, 0, 0, 0": "parameter WHATEVER",
    "*NSET, NSET=X, INSTANCE=Q\n1": "instance 'Q', which is not defined",
}


@pytest.mark.parametrize("lines", REFUSED)
def test_content_that_changes_a_body_is_refused_by_name(
    tmp_path: Path, lines: str
) -> None:
    text = deck(BLOCK, "C3D8I") + lines + "\n"
    with pytest.raises(InputError, match=REFUSED[lines]) as caught:
        body(tmp_path, text)
    assert caught.value.source == str(tmp_path / "part.inp")
    assert "line" in (caught.value.place or "")


def test_refused_content_may_be_ignored_on_purpose(tmp_path: Path) -> None:
    text = deck(BLOCK, "C3D8I") + "*DASHPOT\n*SPRING\n"
    sid = body(tmp_path, text, ignore=["spring", "*Dashpot"])
    assert sid.mass == pytest.approx(MASS, rel=1e-12)
    with pytest.raises(InputError, match="SPRING is not supported"):
        body(tmp_path, text, ignore=["DASHPOT"])


def test_convert_lists_what_has_no_effect_and_what_is_replaced(tmp_path: Path) -> None:
    text = deck(BLOCK, "C3D8R").replace("*DENSITY", "*EXPANSION\n1e-5\n*DENSITY")
    text += "*DAMPING, ALPHA=3.\n*BOUNDARY\nLEFT, 1, 3\n*STEP\n*STATIC\n*CLOAD\n"
    text += "1, 1, 5.\n*SOMETHING OF A STEP\n*END STEP\n"
    source = deck_file(tmp_path, text)
    output = str(tmp_path / "body.SID_FEM")
    result = CliRunner().invoke(cli, ["convert", str(source), "-o", output, "-v"])
    assert result.exit_code == 0, result.output
    of_the_basis = ("N160", "N161", "N163")
    read, replaced, unread, used = (
        each
        for each in sid_from_model(source).diagnostics
        if each.code not in of_the_basis
    )
    for each in (read, replaced, unread, used):
        assert each.line in " ".join(result.output.split())
    assert (read.code, read.data["elements"], read.data["used"]) == ("N110", 6, 24)
    assert (replaced.code, replaced.data["type"]) == ("N114", "C3D8R")
    assert replaced.data["count"] == 6
    keywords = ["*EXPANSION", "*DAMPING", "*BOUNDARY", "all steps"]
    assert unread.code == "N112"
    assert [str(k).split(" (")[0] for k in unread.data["keywords"]] == keywords
    assert (used.code, used.data["name"]) == ("N117", "S")
    assert used.data["properties"] == "E = 2.1e+11 Pa, nu = 0.3, density = 7850 kg/m^3"


def test_surplus_nodes_of_element_lines_are_noted(tmp_path: Path) -> None:
    """As decks of CalculiX that were quadratic once, and a section with an offset."""
    text = deck(BLOCK, "C3D8I")
    lines = BLOCK.element_lines()
    text = text.replace(lines, lines.replace("\n", ", 1, 2,\n"))
    text = text.replace("MATERIAL=S\n", "MATERIAL=S, OFFSET=0.5\n")
    (tmp_path / "part.inp").write_text(text, encoding="utf-8")
    mesh = read_mesh(tmp_path / "part.inp")
    (surplus,) = with_code(mesh, "N120")
    assert "10 nodes" in surplus.message and "first 8" in surplus.message
    assert "OFFSET of *SOLID SECTION" in only(mesh, "N112").data["keywords"]
    assert body(tmp_path, text).mass == pytest.approx(MASS, rel=1e-12)
    first = lines.splitlines()[0]
    mixed = text.replace(f"{first}, 1, 2,", first)
    assert mixed != text
    with pytest.raises(InputError, match="has 10 nodes"):
        body(tmp_path, mixed)


def test_elements_and_nodes_of_other_files_are_read(tmp_path: Path) -> None:
    text = deck(BLOCK, "C3D8I")
    lines = BLOCK.element_lines().splitlines(keepends=True)
    (tmp_path / "more.txt").write_text(
        "** a comment\n" + "".join(lines[2:]), encoding="utf-8"
    )
    (tmp_path / "nodes.txt").write_text(BLOCK.node_lines(), encoding="utf-8")
    text = text.replace(
        "".join(lines[2:]), "*ELEMENT, TYPE=C3D8I, ELSET=E, INPUT=more.txt\n"
    )
    text = text.replace("*NODE\n" + BLOCK.node_lines(), "*NODE, INPUT=nodes.txt\n")
    assert body(tmp_path, text).mass == pytest.approx(MASS, rel=1e-12)
    (tmp_path / "more.txt").unlink()
    with pytest.raises(InputError, match="more.txt.*no such file"):
        body(tmp_path, text)


def test_files_of_results_are_not_needed(tmp_path: Path) -> None:
    """*SUBMODEL drives nodes by results of another run; steps name such files, too."""
    text = deck(BLOCK, "C3D8I")
    text += "*SUBMODEL, TYPE=NODE, INPUT=whole.frd\n1, 2\n*STEP\n"
    text += "*CRACK PROPAGATION, INPUT=whole.frd, MATERIAL=S\n*END STEP\n"
    assert body(tmp_path, text).mass == pytest.approx(MASS, rel=1e-12)
    (tmp_path / "whole.inp").write_text(text, encoding="utf-8")
    assert not any("SUBMODEL" in line for line in free_deck(tmp_path / "whole.inp"))


def test_keyword_lines_continue_after_a_comma(tmp_path: Path) -> None:
    text = deck(BLOCK, "C3D8I")
    text = text.replace(
        "*ELEMENT, TYPE=C3D8I, ELSET=E\n", "*Element,\n  type = C3D8I,\n  ELSET=E\n"
    )
    text = text.replace("*SOLID SECTION, ", "*SOLIDSECTION,\n")
    assert body(tmp_path, text).mass == pytest.approx(MASS, rel=1e-12)


def test_empty_sets_and_abbreviated_parameters(tmp_path: Path) -> None:
    text = deck(BLOCK, "C3D8I") + "*NSET, NSET=NONE\n*ELSET, ELSET=NOTHING\n"
    text += "*NSET, NSET=SOME, GEN\n2, 6, 2\n"
    (tmp_path / "part.inp").write_text(text, encoding="utf-8")
    sets = read_mesh(tmp_path / "part.inp").mesh.node_sets
    assert not sets["NONE"].size and not sets["NOTHING"].size
    assert list(sets["SOME"] + 1) == [2, 4, 6]


def test_surface_elements_next_to_solids_name_nodes(tmp_path: Path) -> None:
    """As Gmsh writes its input files; with a section they would be shells."""
    a, b, c, d = BLOCK.left[0], BLOCK.left[1], BLOCK.left[4], BLOCK.left[3]
    skin = f"*ELEMENT, TYPE=CPS4, ELSET=SKIN\n90, {a}, {b}, {c}, {d}\n"
    skin += f"*ELEMENT, TYPE=T3D2, ELSET=LINE\n91, {a}, {b}\n"
    plain, text = deck(BLOCK, "C3D8I"), deck(BLOCK, "C3D8I") + skin
    sid = body(tmp_path, text, held="LEFT")
    expected = body(tmp_path, plain, held="LEFT")
    assert_allclose(frequencies(sid), frequencies(expected), rtol=1e-12)
    (tmp_path / "part.inp").write_text(text, encoding="utf-8")
    sets = read_mesh(tmp_path / "part.inp").mesh.node_sets
    assert {n + 1 for n in sets["SKIN"]} == {a, b, c, d}
    for name, message in (("SKIN", "mixes plane and solid"), ("LINE", "T3D2 is not")):
        section = f"*SOLID SECTION, ELSET={name}, MATERIAL=S\n1.\n"
        with pytest.raises(InputError, match=message):
            body(tmp_path, text + section)


def hanging(coarse: Block, fine: Block) -> str:
    """A fine block behind a coarse one; nodes at the same place are one."""
    shift = coarse.points[-1][0]
    number = {tuple(np.round(p, 9)): i for i, p in enumerate(coarse.points, 1)}
    points = [(p[0] + shift, *p[1:]) for p in fine.points]
    own = {}
    lines = ["*NODE", coarse.node_lines().strip()]
    for i, point in enumerate(points, 1):
        key = tuple(np.round(point, 9))
        if key not in number:
            number[key] = len(number) + 1
            lines.append(f"{number[key]}, " + ", ".join(map(repr, point)))
        own[i] = number[key]
    kind = "C3D8I" if len(shift_of(coarse)) == 3 else "CPS4I"
    lines += [f"*ELEMENT, TYPE={kind}, ELSET=E", coarse.element_lines().strip()]
    for i, element in enumerate(fine.elements, len(coarse.elements) + 1):
        lines.append(f"{i}, " + ", ".join(str(own[n]) for n in element))
    lines.append("*MATERIAL, NAME=S\n*ELASTIC\n2.1e11, 0.3\n*DENSITY\n7850.")
    return "\n".join([*lines, "*SOLID SECTION, ELSET=E, MATERIAL=S", "0.1", ""])


def shift_of(block: Block) -> tuple[float, ...]:
    return block.points[-1]


@pytest.mark.parametrize(
    ("coarse", "fine"),
    [
        ((1, 1, 1), (1, 2, 1)),
        ((2, 1, 2), (3, 3, 2)),
        ((2, 1), (2, 2)),
        ((1, 2), (1, 4)),
    ],
)
def test_hanging_nodes_are_refused(
    tmp_path: Path, coarse: tuple[int, ...], fine: tuple[int, ...]
) -> None:
    size = (0.4, 0.2, 0.1)[: len(coarse)]
    text = hanging(Block(coarse, size), Block(fine, size))
    with pytest.raises(InputError, match="hanging node"):
        body(tmp_path, text)
    same = hanging(Block(coarse, size), Block((3, *coarse[1:]), size))
    mass = 7850 * 0.8 * 0.2 * 0.1
    assert body(tmp_path, same).mass == pytest.approx(mass, rel=1e-12)


#: Elements laid over the block 3 x 2 x 1, and the nodes that they need besides.
OVER = {
    "the same nodes in another order": ("C3D8I", [2, 6, 5, 1, 14, 18, 17, 13], ""),
    "one large over several": ("C3D8I", [1, 4, 12, 9, 13, 16, 24, 21], ""),
    "a tetrahedron in a hexahedron": ("C3D4", [1, 2, 5, 13], ""),
    "shifted, with a common edge": (
        "C3D8I",
        [1, 30, 31, 32, 13, 33, 34, 35],
        "30,.1,.05,.0\n31,.1,.15,.0\n32,.0,.1,.0\n"
        "33,.1,.05,.1\n34,.1,.15,.1\n35,.0,.1,.1\n",
    ),
}


@pytest.mark.parametrize("name", OVER)
def test_elements_over_others_are_refused(tmp_path: Path, name: str) -> None:
    """They would count twice in mass and stiffness."""
    kind, nodes, more = OVER[name]
    text = deck(BLOCK, "C3D8I").replace("*ELEMENT", more + "*ELEMENT", 1)
    extra = f"*ELEMENT, TYPE={kind}, ELSET=E\n50, " + ", ".join(map(str, nodes))
    with pytest.raises(
        InputError, match="cover the same place|have the same nodes|lies on a quad"
    ):
        body(tmp_path, text + extra + "\n")


@pytest.mark.parametrize("name", [*MESHES, "hex20", "tet10"])
def test_sound_meshes_are_neither_hanging_nor_overlapping(name: str) -> None:
    mesh = MESHES[name][0] if name in MESHES else rod_mesh(name)
    check_contact(mesh, "mesh")
    twisted = np.array(mesh.positions)
    angle = 0.3 * twisted[:, 0]
    c, s, (y, z) = np.cos(angle), np.sin(angle), twisted[:, -2:].T.copy()
    if mesh.dimension == 3:
        twisted[:, 1], twisted[:, 2] = c * y - s * z, s * y + c * z
        check_contact(Mesh(twisted, mesh.blocks), "mesh")


def test_a_folded_strip_that_covers_itself_is_refused() -> None:
    """No two elements share three nodes: only positions show the overlap."""
    points = np.array([[0, 0], [2, 0], [2, 1], [0, 1], [1.2, 0.1], [1.1, 0.9]], float)
    blocks = (
        ElementBlock("quad4", np.array([[0, 1, 2, 3]]), np.array([1])),
        ElementBlock("tri3", np.array([[1, 5, 4]]), np.array([2])),
    )
    with pytest.raises(InputError, match="1 .quad4. and 2 .tri3.|2 .tri3. and 1"):
        check_contact(Mesh(points, blocks), "mesh")


def test_the_deck_of_the_tests_has_the_mass_of_its_block(tmp_path: Path) -> None:
    sid = body(tmp_path, deck(BLOCK, "C3D8I") + listed("RIGHT", BLOCK.right))
    assert sid.mass == pytest.approx(MASS, rel=1e-12)
    assert STEEL["rho"] == 7850


@pytest.mark.parametrize(
    ("kind", "nodes", "message"),
    [
        ("D", 3, "networks of fluids"),
        ("F3D8", 8, "one of fluids"),
        ("DC3D8", 8, "conducts heat"),
        ("CAX8R", 8, "axisymmetric.*whole body"),
        ("SPRING2", 2, "force between markers"),
        ("GAPUNI", 2, "force between markers"),
        ("WHATEVER", 4, "WHATEVER is not supported; expected C3D4"),
    ],
)
def test_elements_that_make_no_body_are_refused_with_the_reason(
    kind: str, nodes: int, message: str, tmp_path: Path
) -> None:
    words = ", ".join(map(str, range(1, nodes + 1)))
    text = deck(BLOCK, "C3D8I") + f"*ELEMENT, TYPE={kind}\n99, {words}\n"
    with pytest.raises(InputError, match=message):
        body(tmp_path, text)
