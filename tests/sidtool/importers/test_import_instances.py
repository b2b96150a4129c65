"""Decks of several parts and instances: one body of all, or the one that is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.formats.diagnostics import WARNING
from sidtool.importers.mesh_files import read_mesh
from tests.codes import only, with_code

from .decks import MATERIAL, STEEL, Block, body, deck, frequencies

SIZE = (0.3, 0.05, 0.04)
SECTION = "*SOLID SECTION, ELSET=E, MATERIAL=S\n\n"


def part(name: str, block: Block) -> str:
    """A part that knows its ends in x as sets and as surfaces."""
    rows, count = range(1, len(block.elements) + 1), len(block.elements)
    across = len([n for n in block.elements if n[0] in block.left])
    low, high = rows[:across], rows[count - across :]
    ends = {"LOW": block.left, "HIGH": block.right}
    sets = "".join(
        f"*NSET, NSET={key}\n" + "".join(f"{n},\n" for n in nodes)
        for key, nodes in ends.items()
    )
    faces = f"*ELSET, ELSET=LOWE\n{', '.join(map(str, low))}\n"
    faces += f"*ELSET, ELSET=HIGHE\n{', '.join(map(str, high))}\n"
    faces += "*SURFACE, NAME=SL\nLOWE, S6\n*SURFACE, NAME=SH\nHIGHE, S4\n"
    return (
        f"*PART, NAME={name}\n*NODE\n{block.node_lines()}"
        f"*ELEMENT, TYPE=C3D8I, ELSET=E\n{block.element_lines()}"
        f"{sets}{faces}{SECTION}*END PART\n"
    )


def assembly(parts: str, instances: list[tuple[str, str, str]], rest: str = "") -> str:
    placed = "".join(
        f"*INSTANCE, NAME={name}, PART={of}\n{where}*END INSTANCE\n"
        for name, of, where in instances
    )
    return f"{parts}*ASSEMBLY, NAME=A\n{placed}{rest}*END ASSEMBLY\n" + MATERIAL.format(
        **STEEL
    )


BLOCK = Block((4, 2, 2), SIZE)
TWICE = [("I-1", "P", ""), ("I-2", "P", f"{SIZE[0]}, 0., 0.\n")]
TIED = "*TIE, NAME=T\nI-1.SH, I-2.SL\n"


def test_two_instances_that_are_tied_are_one_bar(tmp_path: Path) -> None:
    sid = body(tmp_path, assembly(part("P", BLOCK), TWICE, TIED))
    one = Block((8, 2, 2), (2 * SIZE[0], *SIZE[1:]))
    expected = body(tmp_path, deck(one, "C3D8I"))
    assert_allclose(frequencies(sid), frequencies(expected), rtol=1e-7)
    assert_allclose(sid.mass, expected.mass, rtol=1e-12)
    assert_allclose(sid.J.m0, expected.J.m0, rtol=1e-9, atol=1e-12)


def test_an_instance_is_moved_and_turned_before_it_is_tied(tmp_path: Path) -> None:
    """The second one half a turn about the middle of the joint: its far end touches."""
    turned = f"0., 0., 0.\n{SIZE[0]}, 0.025, 0., {SIZE[0]}, 0.025, 1., 180.\n"
    instances = [TWICE[0], ("I-2", "P", turned)]
    text = assembly(part("P", BLOCK), instances, "*TIE, NAME=T\nI-2.SH, I-1.SH\n")
    sid = body(tmp_path, text)
    expected = body(tmp_path, assembly(part("P", BLOCK), TWICE, TIED))
    assert_allclose(frequencies(sid), frequencies(expected), rtol=1e-7)


def test_equations_between_sets_of_instances(tmp_path: Path) -> None:
    rows = "*NSET, NSET=A1, INSTANCE=I-1\nHIGH,\n*NSET, NSET=A2, INSTANCE=I-2\nLOW,\n"
    rows += "*EQUATION\n" + "".join(
        f"2\nA1, {i}, 1.\nA2, {i}, -1.\n" for i in (1, 2, 3)
    )
    sid = body(tmp_path, assembly(part("P", BLOCK), TWICE, rows))
    assert only(sid, "N133").data == {"count": 27, "nodes": 18}
    expected = body(tmp_path, assembly(part("P", BLOCK), TWICE, TIED))
    assert_allclose(frequencies(sid), frequencies(expected), rtol=1e-7)


@pytest.mark.parametrize("kind", ["R", "C"])
def test_transformed_axes_of_a_part_turn_with_its_instance(
    kind: str, tmp_path: Path
) -> None:
    """Direction 1 of the set HIGH in the part: (3, 4, 0) / 5, or from the axis."""
    axes = "3., 4., 0., -4., 3., 0." if kind == "R" else "0.1, 0.5, 0., 0.1, 0.5, 1."
    text = part("P", BLOCK).replace(
        "*SURFACE, NAME=SL",
        f"*TRANSFORM, NSET=HIGH, TYPE={kind}\n{axes}\n*SURFACE, NAME=SL",
    )
    turned = f"{SIZE[0]}, 0., 0.\n0., 0., 0., 0., 0., 1., 30.\n"
    instances = [TWICE[0], ("I-2", "P", turned)]
    rows = "*EQUATION\n2\nI-2.HIGH, 1, 1.\nI-1.HIGH, 1, -1.\n"
    (tmp_path / "part.inp").write_text(
        assembly(text, instances, rows), encoding="utf-8"
    )
    imported = read_mesh(tmp_path / "part.inp")
    mesh = imported.mesh
    place = dict(zip(mesh.labels.tolist(), mesh.positions, strict=True))
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def first(x: np.ndarray) -> np.ndarray:
        arm = np.array([3, 4, 0]) if kind == "R" else x - [0.1, 0.5, x[2]]
        return np.asarray(arm / np.linalg.norm(arm))

    for equation in imported.equations:
        (node, found), (other, former) = equation.terms
        own = turn.T @ place[node] - [SIZE[0], 0.0, 0.0]
        assert_allclose(found, turn @ first(own), atol=1e-12)
        assert_allclose(former, -first(place[other]), atol=1e-12)


def test_sets_of_instances_keep_their_owner(tmp_path: Path) -> None:
    """Sets of the same name and nodes of the same number are distinguished."""
    rest = TIED + "*NODE\n1, 5., 5., 5.\n*NSET, NSET=POINT\n1,\n"
    rest += "*NSET, NSET=END, INSTANCE=I-2\nHIGH,\n*NSET, NSET=ONE, INSTANCE=I-2\n1,\n"
    (tmp_path / "part.inp").write_text(
        assembly(part("P", BLOCK), TWICE, rest), encoding="utf-8"
    )
    imported = read_mesh(tmp_path / "part.inp")
    assert any("I-2" in note.message for note in with_code(imported, "N118"))
    mesh = imported.mesh
    x = {name: mesh.positions[rows][:, 0] for name, rows in mesh.node_sets.items()}
    assert_allclose(x["I-1.HIGH"], SIZE[0])
    assert_allclose(x["I-2.HIGH"], 2 * SIZE[0])
    assert_allclose(x["END"], 2 * SIZE[0])
    assert_allclose(x["ONE"], SIZE[0])
    assert_allclose(x["POINT"], 5.0)


def test_one_instance_is_chosen_by_its_name(tmp_path: Path) -> None:
    text = part("P", BLOCK) + part("Q", Block((3, 1, 1), (0.1, 0.02, 0.03)))
    instances = [TWICE[0], ("J", "Q", "0.3, 0., 0.\n")]
    text = assembly(text, instances, "*TIE\nJ.SL, I-1.SH\n")
    chosen = body(tmp_path, text, part="J")
    assert {note.severity for note in with_code(chosen, "N119")} == {WARNING}
    alone = body(tmp_path, deck(Block((3, 1, 1), (0.1, 0.02, 0.03)), "C3D8I"))
    assert_allclose(chosen.mass, alone.mass, rtol=1e-12)
    assert_allclose(frequencies(chosen), frequencies(alone), rtol=1e-8)
    assert frequencies(body(tmp_path, text, part="I-1"))[0] < frequencies(alone)[0]
    both = body(tmp_path, text)
    assert both.mass == pytest.approx(STEEL["rho"] * (np.prod(SIZE) + 6e-5), rel=1e-9)


def test_a_set_of_elements_is_chosen_by_its_name(tmp_path: Path) -> None:
    text = deck(Block((6, 1, 1), (0.6, 0.05, 0.05)), "C3D8I")
    text += "*ELSET, ELSET=HALF, GENERATE\n1, 3, 1\n"
    sid = body(tmp_path, text, part="half")
    alone = body(tmp_path, deck(Block((3, 1, 1), (0.3, 0.05, 0.05)), "C3D8I"))
    assert_allclose(sid.mass, alone.mass, rtol=1e-12)
    assert_allclose(frequencies(sid), frequencies(alone), rtol=1e-8)


def test_parts_that_nothing_ties_are_refused_with_how_to_choose(tmp_path: Path) -> None:
    apart = [TWICE[0], ("I-2", "P", "0.5, 0., 0.\n")]
    with pytest.raises(InputError, match=r"2 unconnected parts.*geometry\.part"):
        body(tmp_path, assembly(part("P", BLOCK), apart))
    with pytest.raises(InputError, match="no instance and no element set 'K'.*I-1"):
        body(tmp_path, assembly(part("P", BLOCK), apart), part="K")
