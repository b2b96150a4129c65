"""Decks that say the same body in another way, as engineers and other programs do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.importers.mesh_files import read_mesh

from . import decks
from .decks import STEEL, Block, frequencies, listed
from .test_import_couplings import REFERENCE, body, bulk, rigid

BLOCK = Block((4, 2, 2), (0.4, 0.04, 0.05))
PLATE = Block((6, 3), (0.3, 0.1))
TRIANGLES = ((0, 1, 2), (0, 2, 3))


def assert_same(found: SID, expected: SID) -> None:
    assert found.mass == pytest.approx(expected.mass, rel=1e-12)
    assert_allclose(found.J.m0, expected.J.m0, rtol=1e-9, atol=1e-12)
    origin = expected.node("1").origin.m0
    assert_allclose(found.node("1").origin.m0, origin, rtol=1e-9, atol=1e-12)
    assert_allclose(frequencies(found), frequencies(expected), rtol=1e-7)


def plane(card: str, depth: str, tail: str) -> str:
    """A plate in its plane; `tail` is what its elements have behind their nodes."""
    lines = ["BEGIN BULK", "MAT1,1,2.1e11,,0.3,7850.", f"PSHELL,1,1,{depth}"]
    lines += [f"GRID,{i},,{x!r},{y!r},0." for i, (x, y) in enumerate(PLATE.points, 1)]
    chosen = [
        [e[i] for i in corners]
        for e in PLATE.elements
        for corners in (TRIANGLES if card == "CTRIA3" else [(0, 1, 2, 3)])
    ]
    for i, nodes in enumerate(chosen, 1):
        lines.append(f"{card},{i},1,{','.join(map(str, nodes))}{tail}")
    return "\n".join([*lines, "ENDDATA", ""])


def in_plane(folder: Path, text: str) -> SID:
    own = {"type": "mesh", "state": "plane_stress"}
    return body(folder, text, discretisation=own)


@pytest.mark.parametrize(
    ("card", "tail"),
    [
        ("CQUAD4", ",,\n,,,0.02,0.02,0.02,0.02"),
        ("CQUAD4", ",,\n,,1,4.,4.,4.,4."),
        ("CTRIA3", ",,,\n,,,0.02,0.02,0.02"),
        ("CTRIA3", ",,,\n,,1,4.,4.,4."),
    ],
)
def test_plane_elements_have_their_own_thickness(
    card: str, tail: str, tmp_path: Path
) -> None:
    """T1 to T4 counted as an angle: a quarter of the mass, without a word."""
    found = in_plane(tmp_path, plane(card, "0.005", tail))
    assert_same(found, in_plane(tmp_path, plane(card, "0.02", "")))
    assert found.mass == pytest.approx(7850 * 0.3 * 0.1 * 0.02)


def test_a_thickness_for_every_corner_is_refused(tmp_path: Path) -> None:
    text = plane("CQUAD4", "0.005", ",,\n,,,0.02,0.02,0.02")
    with pytest.raises(InputError, match=r"0\.02, 0\.02, 0\.02, 0\.005 at its corners"):
        in_plane(tmp_path, text)


def test_a_mass_may_be_given_by_its_place(tmp_path: Path) -> None:
    """CID = -1: X are coordinates; it was refused."""
    cards = rigid(BLOCK, (0.45, 0.03, 0.01))
    inertia = ",0.3,0.01,0.4,0.02,0.03,0.5"
    expected = bulk(*cards, f"CONM2,5,{REFERENCE},,6.5,0.02,-0.05,0.04", inertia)
    placed = bulk(*cards, f"CONM2,5,{REFERENCE},-1,6.5,0.47,-0.02,0.05", inertia)
    assert_same(body(tmp_path, placed), body(tmp_path, expected))
    with pytest.raises(InputError, match="names node 77777, which is not defined"):
        body(tmp_path, bulk("CONM2,5,77777,-1,6.5,0.47,-0.02,0.05"))


def test_scalar_points_without_elements_change_nothing(tmp_path: Path) -> None:
    """Decks that were reduced have them for their modes."""
    cards = ["SPOINT,5001,THRU,5010", "QSET1,0,5001,THRU,5010", "BNDFIX1,123,1"]
    cards += ["SET3,9,GRID,1,2", "TABLEM1,7", ",0.,1.,100.,0.9,ENDT"]
    sid = body(tmp_path, bulk(*cards))
    assert_same(sid, body(tmp_path, bulk()))


def held_at_end(*lines: str) -> str:
    node = f"*NODE\n{REFERENCE}, 0.45, 0.03, 0.01\n"
    end = listed("END", BLOCK.right)
    mass = f"*ELEMENT, TYPE=MASS, ELSET=M\n900, {REFERENCE}\n*MASS, ELSET=M\n6.5\n"
    return decks.deck(BLOCK, "C3D8I") + node + end + mass + "\n".join([*lines, ""])


@pytest.mark.parametrize("kind", ["TIE NSET", "PIN NSET"])
def test_rigid_bodies_hold_nodes_as_abaqus_names_them(
    kind: str, tmp_path: Path
) -> None:
    """The nodes of a solid do not turn: tied and pinned ones are the same."""
    plain = held_at_end(f"*RIGID BODY, REF NODE={REFERENCE}, NSET=END")
    named = held_at_end(f"*Rigid Body, ref node={REFERENCE}, {kind.lower()}=End")
    assert_same(decks.body(tmp_path, named), decks.body(tmp_path, plain))


ROTARY = (
    f"*ELEMENT, TYPE=ROTARYI, ELSET=I\n901, {REFERENCE}",
    "*ROTARY INERTIA, ELSET=I\n0.3, 0.4, 0.5",
)
HOLD = f"*RIGID BODY, REF NODE={REFERENCE}, NSET=END"


def test_rotary_inertia_of_a_reference_node(tmp_path: Path) -> None:
    """As CONM2 has it."""
    block = Block((4, 2, 2), (0.4, 0.04, 0.05))
    cards = rigid(block, (0.45, 0.03, 0.01))
    mass = [f"CONM2,5,{REFERENCE},,6.5", ",0.3,,0.4,,,0.5"]
    expected = body(tmp_path, bulk(*cards, *mass, block=block))
    found = decks.body(tmp_path, held_at_end(HOLD, *ROTARY))
    assert_same(found, expected)
    with pytest.raises(InputError, match="products of inertia"):
        mixed = ROTARY[1].replace("0.5", "0.5, 0.1")
        decks.body(tmp_path, held_at_end(HOLD, ROTARY[0], mixed))


def test_rotary_inertia_of_a_turned_instance_is_refused(tmp_path: Path) -> None:
    """Its axes would turn with it."""
    head, tail = held_at_end(HOLD, *ROTARY).split("*MATERIAL")
    material, section = tail.split("*SOLID")
    (tmp_path / "part.inp").write_text(
        f"*PART, NAME=P\n{head}*SOLID{section}*END PART\n*ASSEMBLY, NAME=A\n"
        "*INSTANCE, NAME=I, PART=P\n0., 0., 0.\n0., 0., 0., 0., 0., 1., 30.\n"
        f"*END INSTANCE\n*END ASSEMBLY\n*MATERIAL{material}",
        encoding="utf-8",
    )
    with pytest.raises(InputError, match="instance is turned"):
        read_mesh(tmp_path / "part.inp")


SYSTEMS = {
    "*SYSTEM\n1., -2., 0.5, 1., -1., 0.5\n0., -2., 0.5": [[0, 1, 0], [-1, 0, 0]],
    "*SYSTEM\n1., -2., 0.5, 1., -1., 0.5": [[0, 1, 0], [-1, 0, 0]],
    "*SYSTEM\n1., -2., 0.5, 1., -2., 2.5\n1., -3., 1.5": [[0, 0, 1], [0, -1, 0]],
    "*SYSTEM\n1., -2., 0.5": [[1, 0, 0], [0, 1, 0]],
}


@pytest.mark.parametrize("system", SYSTEMS)
def test_nodes_in_a_system_of_their_own(system: str, tmp_path: Path) -> None:
    x, y = np.array(SYSTEMS[system], float)
    text = decks.deck(BLOCK, "C3D8I")
    path = tmp_path / "part.inp"
    path.write_text(text, encoding="utf-8")
    plain = read_mesh(path).mesh.positions
    path.write_text(
        text.replace("*NODE\n", f"{system}\n*NODE\n").replace(
            "*ELEMENT", "*SYSTEM\n*NODE\n9999, 1., 2., 3.\n*ELEMENT", 1
        ),
        encoding="utf-8",
    )
    mesh = read_mesh(path).mesh.positions
    expected = np.array([1.0, -2.0, 0.5]) + plain @ np.array([x, y, np.cross(x, y)])
    assert_allclose(mesh[:-1], expected, atol=1e-14)
    assert mesh[-1].tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("*SYSTEM\n0., 0.", "2 coordinates"),
        ("*SYSTEM\n0., 0., 0., 0., 0., 1.", "gives no axes"),
        (
            "*SYSTEM\n1., 0., 0.\n*NCOPY, SHIFT, OLD SET=LEFT, CHANGE NUMBER=9999",
            "NCOPY stands behind",
        ),
    ],
)
def test_systems_that_are_none(lines: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        decks.body(tmp_path, decks.deck(BLOCK, "C3D8I") + lines + "\n")


TABLE = "2.1e11, 0.3, 20.\n1.9e11, 0.3, 300.\n"


@pytest.mark.parametrize(
    ("temperature", "modulus"),
    [(None, 2.1e11), (-50.0, 2.1e11), (160.0, 2.0e11), (900.0, 1.9e11)],
)
def test_constants_are_those_of_the_initial_temperature(
    tmp_path: Path, temperature: float | None, modulus: float
) -> None:
    """Linear between the lines of a table, constant beyond them; zero by default."""
    plain = decks.deck(BLOCK, "C3D8I")
    text = plain.replace(f"{STEEL['e']!r}, {STEEL['nu']!r}\n", TABLE)
    if temperature is not None:
        text += f"*INITIAL CONDITIONS, TYPE=TEMPERATURE\nLEFT, {temperature}\n"
    frequencies = decks.frequencies(decks.body(tmp_path, text))
    steel = decks.frequencies(decks.body(tmp_path, plain))
    assert_allclose(frequencies, steel * np.sqrt(modulus / STEEL["e"]), rtol=1e-6)


def test_a_missing_constant_is_reported(tmp_path: Path) -> None:
    """Nodes of different temperatures have no one constant."""
    text = decks.deck(BLOCK, "C3D8I").replace(
        f"{STEEL['e']!r}, {STEEL['nu']!r}\n", TABLE
    )
    text += "*INITIAL CONDITIONS, TYPE=TEMPERATURE\n1, 20.\n2, 50.\n"
    with pytest.raises(InputError, match="values for several temperatures"):
        decks.body(tmp_path, text)


def test_elements_folded_by_curved_edges_are_reported(tmp_path: Path) -> None:
    """Gmsh draws such ones where its elements are large beside a fillet."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    pairs = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
    places = [*corners, *(corners[[a, b]].mean(axis=0) for a, b in pairs)]
    places[4] = np.array([0.5, 0.4, 0.4])
    rows = [
        f"GRID,{i},,{','.join(map(repr, x.tolist()))}" for i, x in enumerate(places, 1)
    ]
    rows += ["CTETRA,1,1,1,2,3,4,5,6", ",7,8,9,10", "PSOLID,1,1"]
    text = "\n".join(["BEGIN BULK", *rows, "MAT1,1,2.1e11,,0.3,7850.", "ENDDATA", ""])
    with pytest.raises(InputError, match=r"is folded.*Mesh\.HighOrderOptimize"):
        body(tmp_path, text, discretisation={"type": "mesh"})


def test_replicated_cards_of_nastran_are_the_cards_themselves(tmp_path: Path) -> None:
    """A strip of four squares in free and in fixed fields."""
    head = ["BEGIN BULK", "MAT1,1,2.1e11,,0.3,7850.", "PSHELL,1,1,0.01"]
    both = (
        [
            f"GRID,{10 * j + i},,{0.1 * i:.1f},{0.1 * j:.1f},0."
            for j in (1, 2)
            for i in range(1, 6)
        ],
        [f"CQUAD4,{i},1,{10 + i},{11 + i},{21 + i},{20 + i}" for i in range(1, 5)],
    )
    free = [
        *("GRID,11,,+1.-1,0.1,0.,,", "=,*1,,*.1,==", "=3"),
        *(
            "GRID    21              0.1     0.2     0.",
            "=       *(1)    =       *(0.1)  ==",
            "=(3)",
        ),
        *("CQUAD4,1,1,11,12,22,21", "=,*1,=,*1,*(1),*1,*1", "=2"),
    ]
    texts = ("\n".join([*head, *both[0], *both[1], ""]), "\n".join([*head, *free, ""]))
    read = []
    for text in texts:
        (tmp_path / "part.bdf").write_text(text, encoding="utf-8")
        read.append(read_mesh(tmp_path / "part.bdf").mesh)
    assert read[0].labels.tolist() == read[1].labels.tolist()
    assert (read[0].positions == read[1].positions).all()
    (one,), (other,) = read[0].blocks, read[1].blocks
    assert one.nodes.tolist() == other.nodes.tolist()
    assert one.labels.tolist() == other.labels.tolist()


@pytest.mark.parametrize(
    "cards",
    [
        ["=,*1,=,*1,=,="],
        ["GRID,1,,0.,0.,0.", "=3"],
        ["GRID,1,,0.,0.,0.", "=,*1,,*x,=,="],
        ["GRID,1,,0.,0.,0.", "=,*1,,*1.,=,=", "=0"],
        ["RBE3,9,,1,123,1.,123,2,3", ",4", "=,*1,=,=,=,=,=,=,="],
    ],
)
def test_replication_of_nothing_is_refused(cards: list[str], tmp_path: Path) -> None:
    path = tmp_path / "part.bdf"
    path.write_text("\n".join(["BEGIN BULK", *cards, ""]), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        read_mesh(path)
    assert caught.value.place == f"line {len(cards) + 1}"
