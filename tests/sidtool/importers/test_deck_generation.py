"""Nodes and elements that a deck makes of others are those of one that lists them."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sidtool.formats.base.errors import InputError
from sidtool.importers.abaqus.deck import Namespace
from sidtool.importers.abaqus.input_file import read_deck

from .decks import Block, body, deck, frequencies, listed

ENDS = "*NODE\n1, 2., 0., 0.\n21, 0., 2., 0.\n99, 0., 0., 0.\n98, 2., 2., 0.\n"


def scope_of(folder: Path, text: str) -> Namespace:
    (folder / "part.inp").write_text(text, encoding="utf-8")
    return read_deck(folder / "part.inp").assembly


def places(scope: Namespace, labels: range) -> np.ndarray:
    return np.array([scope.nodes[n] for n in labels])


def generated(kind: str, size: tuple[float, float, float]) -> str:
    """A block of 3 x 2 x 2 cells of nodes n = 1 + i + 10 j + 100 k."""
    x, y, z = size
    corners = "".join(
        f"{1 + 3 * i + 20 * j + 200 * k}, {i * x}, {j * y}, {k * z}\n"
        for i, j, k in product((0, 1), repeat=3)
    )
    return f"""*NODE
{corners}*NGEN, NSET=LOW
1, 4
*NGEN, NSET=HIGH
21, 24, 1
*NFILL, NSET=BOTTOM
LOW, HIGH, 2, 10
*NGEN, NSET=LOW2
201, 204
*NGEN, NSET=HIGH2
221, 224
*NFILL, NSET=TOP
LOW2, HIGH2, 2, 10
*NFILL
BOTTOM, TOP, 2, 100
*ELEMENT, TYPE={kind}
1, 1, 2, 12, 11, 101, 102, 112, 111
*ELGEN, ELSET=E
1, 3, 1, 1, 2, 10, 10, 2, 100, 100
"""


def test_a_block_is_that_of_its_explicit_deck(tmp_path: Path) -> None:
    size = (0.6, 0.2, 0.1)
    end = deck(Block((3, 2, 2), size), "C3D8").split("*MATERIAL")[1]
    left = listed("LEFT", [1 + 10 * j + 100 * k for j in range(3) for k in range(3)])
    created = body(
        tmp_path, generated("C3D8", size) + left + "*MATERIAL" + end, held="LEFT"
    )
    given = body(tmp_path, deck(Block((3, 2, 2), size), "C3D8"), held="LEFT")
    assert_allclose(created.mass, 7850 * np.prod(size), rtol=1e-12)
    assert_allclose(frequencies(created), frequencies(given), rtol=1e-9)
    scope = scope_of(tmp_path, generated("C3D8", size))
    assert sorted(scope.elements) == sorted(
        1 + i + 10 * j + 100 * k for i, j, k in product(range(3), range(2), range(2))
    )
    corner = [1, 2, 12, 11, 101, 102, 112, 111]
    assert scope.elements[113].nodes == [n + 112 for n in corner]
    for i, j, k in product(range(4), range(3), range(3)):
        expected = np.array(size) * (i / 3, j / 2, k / 2)
        assert_allclose(scope.nodes[1 + i + 10 * j + 100 * k], expected, atol=1e-15)


@pytest.mark.parametrize(
    ("line", "turn"),
    [("1, 21, 5, 99", 90), ("1, 21, 5, , 0., 0., 0., 0., 0., -1.", -270)],
)
def test_an_arc_goes_evenly_round_its_centre(
    tmp_path: Path, line: str, turn: float
) -> None:
    scope = scope_of(tmp_path, f"{ENDS}*NGEN, LINE=C, NSET=A\n{line}\n")
    angle = np.radians(turn * np.arange(5) / 4)
    expected = 2 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    assert_allclose(places(scope, range(1, 22, 5)), expected, atol=1e-14)
    assert [n for _, n in scope.nsets["A"]] == [1, 6, 11, 16, 21]


def test_half_a_turn_takes_a_normal(tmp_path: Path) -> None:
    ends = "*NODE\n1, 0., 1., 2.\n3, 0., 1., 4.\n*NGEN, LINE=C\n1, 3, 1, , 0., 1., 3."
    scope = scope_of(tmp_path, f"{ends}, 1., 0., 0.\n")
    assert_allclose(scope.nodes[2], (0, 2, 3), atol=1e-15)
    with pytest.raises(InputError, match="no arc between its nodes"):
        scope_of(tmp_path, f"{ends}\n")


def test_a_parabola_has_its_third_point_half_way(tmp_path: Path) -> None:
    """Ends (2, 0) and (0, 2), the third point (2, 2) at half the parameter."""
    scope = scope_of(tmp_path, f"{ENDS}*NGEN, LINE=P\n1, 21, 5, 98\n")
    s = np.linspace(0, 1, 5)
    square = np.polyfit([0, 0.5, 1], [[2, 0], [2, 2], [0, 2]], 2)
    expected = s[:, None] ** [2, 1, 0] @ square
    assert_allclose(places(scope, range(1, 22, 5))[:, :2], expected, atol=1e-14)


def test_a_bias_is_the_ratio_of_an_interval_to_the_next(tmp_path: Path) -> None:
    text = "*NODE, NSET=A\n1, 0.\n2, 0., 1.\n*NODE, NSET=B\n41, 1.\n42, 1., 1.\n"
    scope = scope_of(tmp_path, f"{text}*NFILL, BIAS=0.5, NSET=ALL\nA, B, 4, 10\n")
    for n in (1, 2):
        x = places(scope, range(n, 43, 10))
        assert_allclose(np.diff(x[:, 0]) * 15, [1, 2, 4, 8])
        assert_allclose(x[:, 1], n - 1)
    assert sorted(n for _, n in scope.nsets["ALL"]) == sorted(scope.nodes)


def test_nodes_in_cylindrical_coordinates_bound_a_vault(tmp_path: Path) -> None:
    """Radius and degrees; an arc without a third point is about the origin.

    The longer of two sets has a node that is passed over, which is said.
    """
    text = """*NODE, SYSTEM=C
1, 300.
3, 300., 40.
5, 300., 80.
51, 300., , 60.
53, 300., 40., 60.
*NGEN, LINE=C, NSET=WALL
1, 3
3, 5
*NGEN, LINE=C, NSET=TOP
51, 53, 1, , , , 60.
*NFILL
WALL, TOP, 2, 25
"""
    scope = scope_of(tmp_path, text)
    for n, degrees, z in ((2, 20, 0), (4, 60, 0), (52, 20, 60), (27, 20, 30)):
        a = np.radians(degrees)
        expected = (300 * np.cos(a), 300 * np.sin(a), z)
        assert_allclose(scope.nodes[n], expected, atol=1e-12)
    assert 28 in scope.nodes and 29 not in scope.nodes
    (unpaired,) = read_deck(tmp_path / "part.inp").diagnostics
    assert (unpaired.code, unpaired.data["place"]) == ("N120", "*NFILL (line 13)")
    assert unpaired.data["count"] == 2


def test_unsorted_sets_keep_their_order(tmp_path: Path) -> None:
    text = "*NODE\n1, 0., 0.\n2, 0., 1.\n21, 1., 0.\n22, 1., 1.\n*NSET, NSET=A\n2, 1\n"
    fill = "*NSET, NSET=B{}\n22, 21\n*NFILL\nA, B, 2, 10\n"
    assert scope_of(tmp_path, text + fill.format("")).nodes[11] == (0.5, 0, 0)
    crossed = scope_of(tmp_path, text + fill.format(", UNSORTED"))
    assert crossed.nodes[11] == (0.5, 0.5, 0)


def test_copies_are_moved_and_turned(tmp_path: Path) -> None:
    """A quarter of a ring of eight elements by one of them, turned three times."""
    block = Block((1, 1, 1), (1.0, 0.0, 0.5))
    angle = np.radians(22.5)
    rows = [
        f"{n}, {(1 + x) * float(np.cos(a))!r}, {(1 + x) * float(np.sin(a))!r}, {z}"
        for n, (x, _, z) in enumerate(block.points, 1)
        for a in [angle * (n in (3, 4, 7, 8))]
    ]
    text = "*NODE, NSET=N\n" + "\n".join(rows) + "\n*ELEMENT, TYPE=C3D8, ELSET=E\n"
    text += block.element_lines()
    text += "*NCOPY, OLD SET=N, NEW SET=M, CHANGE NUMBER=10, SHIFT, MULTIPLE=3\n"
    text += "0., 0., 0.\n0., 0., -1., 0., 0., 1., 22.5\n"
    for k in (1, 2, 3):
        text += f"*ELCOPY, OLD SET=E, NEW SET=F, ELEMENT SHIFT={k}, "
        text += f"SHIFT NODES={10 * k}\n"
    scope = scope_of(tmp_path, text)
    for k, n in product(range(4), range(1, 9)):
        x, _, z = block.points[n - 1]
        at = angle * (k + (n in (3, 4, 7, 8)))
        expected = ((1 + x) * np.cos(at), (1 + x) * np.sin(at), z)
        assert_allclose(scope.nodes[n + 10 * k], expected, atol=1e-14)
    assert_array_equal(scope.elements[4].nodes, np.array(scope.elements[1].nodes) + 30)
    assert [n for _, n in scope.elsets["F"]] == [2, 3, 4]
    assert len(scope.nsets["M"]) == 24


ODD = {
    "*NGEN, LINE=Q\n1, 21": "LINE=Q is not supported",
    "*NGEN, LINE=C, SYSTEM=C\n1, 21, 5, 99": "parameter SYSTEM",
    "*NGEN\n1, 21, 3": "a step that leads from one to the other",
    "*NGEN\n1, 22": "names node 22, which is not defined",
    "*NGEN\n1,": "first, last, step",
    "*NGEN\n1, 99, 1\n*NGEN\n21, 98, 1": "node 21 is defined twice",
    "*NGEN, LINE=C\n1, 21, 5, 98\n*NGEN, LINE=C\n1, 21, 5, , 5.": "no arc between",
    "*NFILL, TWO STEP\nA, B, 2": "parameter TWO STEP",
    "*NFILL, SINGULAR=1\nA, B, 2": "parameter SINGULAR",
    "*NFILL\nA, B, 2": "'A', which is not defined",
    "*NSET, NSET=A\n1, 99\n*NFILL\nA": r"between sets of \[2\] nodes",
    "*NODE, SYSTEM=S\n5, 1., 90.": "the system S of coordinates",
    "*NFILL\n1, 21, 2, 0": "the step of node numbers",
    "*NFILL\n1, 21, 99999999": "makes 99999999 nodes",
    "*NFILL\n1, 55, 2": "names node 55",
    "*NCOPY, OLD SET=A, CHANGE NUMBER=9, REFLECT=MIRROR": "parameter REFLECT",
    "*NCOPY, OLD SET=A, CHANGE NUMBER=9, POLE": "parameter POLE",
    "*NCOPY, OLD SET=A, CHANGE NUMBER=9": "without SHIFT is not supported",
    "*ELGEN\n1, 3": "copies element 1, which is not defined",
    "*ELEMENT, TYPE=C3D4\n1, 1, 21, 98, 99\n*ELGEN\n1, 3, 1, 0": "element 1 is defined",
    "*ELEMENT, TYPE=C3D4\n1, 1, 21, 98, 99\n*ELGEN\n1, 9999999": "makes 9999999",
    "*ELCOPY, OLD SET=E, REFLECT, ELEMENT SHIFT=1": "parameter REFLECT",
}


@pytest.mark.parametrize("lines", ODD)
def test_unusual_content_is_refused_by_name(tmp_path: Path, lines: str) -> None:
    with pytest.raises(InputError, match=ODD[lines]):
        scope_of(tmp_path, f"{ENDS}{lines}\n")


@pytest.mark.needs("ccx")
def test_calculix_gets_what_it_does_not_know_written_out(tmp_path: Path) -> None:
    """A cantilever of shells; Euler-Bernoulli's first frequency to three per cent."""
    text = """*NODE
1, 0., 0., 0.
21, 1., 0., 0.
201, 0., 0.1, 0.
221, 1., 0.1, 0.
*NGEN, NSET=LOW
1, 21
*NGEN, NSET=HIGH
201, 221
*NFILL
LOW, HIGH, 2, 100
*ELEMENT, TYPE=S8, ELSET=E
1, 1, 3, 203, 201, 2, 103, 202, 101
*ELGEN, ELSET=E
1, 10, 2, 1
*NSET, NSET=LEFT
1, 101, 201
*MATERIAL, NAME=S
*ELASTIC
2.1e11, 0.3
*DENSITY
7850.
*SHELL SECTION, ELSET=E, MATERIAL=S
0.01
"""
    sid = body(tmp_path, text, held="LEFT", engine="calculix")
    assert_allclose(sid.mass, 7850 * 0.1 * 0.01, rtol=1e-6)
    beam = 1.8751**2 / (2 * np.pi) * 0.01 * np.sqrt(2.1e11 / 12 / 7850)
    assert_allclose(frequencies(sid)[0], beam, rtol=0.03)
