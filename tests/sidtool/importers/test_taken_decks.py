"""Sound decks that were refused: clockwise, collapsed, without middles, in pieces."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.pipeline.model_to_sid import sid_from_model

from .decks import MATERIAL, STEEL, Block, deck as inp_deck, frequencies
from .mesh_files import mesh_model

BLOCK = Block((4, 1, 1), (0.4, 0.1, 0.1))
PLATE = Block((4, 2), (0.4, 0.2))


def converted(folder: Path, name: str, text: str, **changes: Any) -> SID:
    (folder / name).write_text(text, encoding="utf-8")
    path = mesh_model(
        folder,
        name,
        frame={"type": "buckens"},
        markers={"p": {"node": 1, "mesh_node": 1}},
        reduction={"method": "modal", "modes": 4},
    )
    data = json.loads(path.read_text(encoding="utf-8"))
    del data["material"]
    data["discretisation"].update(changes.pop("discretisation", {}))
    data["geometry"].update(changes)
    path.write_text(json.dumps(data), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return sid_from_model(path)


def same(first: SID, second: SID, tolerance: float = 1e-9) -> None:
    assert first.mass == pytest.approx(second.mass, rel=tolerance)
    assert_allclose(frequencies(first), frequencies(second), rtol=tolerance)


def turned(elements: list[list[int]], corners: int) -> list[list[int]]:
    """Every second element the other way round."""
    order = [0, *range(corners - 1, 0, -1)]
    order += [2 * corners - 1 - k for k in range(len(elements[0]) - corners)]
    return [[e[k] for k in order] if i % 2 else e for i, e in enumerate(elements)]


def plane_bdf(elements: list[list[int]], points: Any, card: str) -> str:
    grids = [f"GRID,{i},,{x!r},{y!r},0." for i, (x, y) in enumerate(points, 1)]
    rows = []
    for i, nodes in enumerate(elements, 1):
        words = [card, str(i), "1", *(str(n) if n else "" for n in nodes)]
        more = "\n," + ",".join(words[9:]) if words[9:] else ""
        rows.append(",".join(words[:9]) + more)
    tail = ["PSHELL,1,1,0.01", "MAT1,1,2.1+11,,0.3,7850.", "ENDDATA", ""]
    return "\n".join(["BEGIN BULK", *grids, *rows, *tail])


STATE = {"discretisation": {"state": "plane_stress"}}


@pytest.mark.parametrize("ending", ["bdf", "inp"])
def test_clockwise_plane_elements_are_turned_round(tmp_path: Path, ending: str) -> None:
    other = turned(PLATE.elements, 4)
    if ending == "bdf":
        texts = [plane_bdf(e, PLATE.points, "CQUAD4") for e in (PLATE.elements, other)]
    else:
        texts = [inp_deck(PLATE, "CPS4", section="0.01")]
        PLATE.elements, retained = other, PLATE.elements
        texts.append(inp_deck(PLATE, "CPS4", section="0.01"))
        PLATE.elements = retained
    same(*(converted(tmp_path, f"p.{ending}", t, **STATE) for t in texts))


def quadratic_plate() -> tuple[list[list[int]], list[tuple[float, ...]]]:
    """PLATE with nodes in the middle of all edges."""
    points, middles, elements = list(PLATE.points), {}, []
    for corners in PLATE.elements:
        own = list(corners)
        for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
            key = frozenset((a, b))
            if key not in middles:
                ends = zip(points[a - 1], points[b - 1], strict=True)
                points.append(tuple((u + v) / 2 for u, v in ends))
                middles[key] = len(points)
            own.append(middles[key])
        elements.append(own)
    return elements, points


def test_clockwise_quadratic_elements_are_turned_round(tmp_path: Path) -> None:
    elements, points = quadratic_plate()
    texts = [plane_bdf(e, points, "CQUAD8") for e in (elements, turned(elements, 4))]
    same(*(converted(tmp_path, "p.bdf", text, **STATE) for text in texts))


def test_quad8_without_middles_is_quad4(tmp_path: Path) -> None:
    texts = [plane_bdf(PLATE.elements, PLATE.points, c) for c in ("CQUAD8", "CQUAD4")]
    same(*(converted(tmp_path, "p.bdf", text, **STATE) for text in texts))


def test_edge_without_its_middle_stays_straight(tmp_path: Path) -> None:
    """A left-out middle is the mean of its ends: the same with nodes and MPC."""
    elements, points = quadratic_plate()
    missing = {elements[0][4], elements[5][6]}
    plain = [[0 if n in missing else n for n in e] for e in elements]
    found = converted(tmp_path, "a.bdf", plane_bdf(plain, points, "CQUAD8"), **STATE)
    ties = []
    for n in missing:
        e = next(e for e in elements if n in e)
        k = e.index(n) - 4
        a, b = e[k], e[(k + 1) % 4]
        ties += [f"MPC,1,{n},{d},1.,{a},{d},-.5\n,,{b},{d},-.5" for d in (1, 2)]
    text = plane_bdf(elements, points, "CQUAD8")
    text = text.replace("PSHELL", "\n".join([*ties, "PSHELL"]))
    same(found, converted(tmp_path, "b.bdf", text, **STATE))
    whole = plane_bdf(elements, points, "CQUAD8")
    other = converted(tmp_path, "c.bdf", whole, **STATE)
    assert frequencies(found)[0] > 1.0001 * frequencies(other)[0]


CUBE_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)]
CUBE_EDGES += [(0, 4), (1, 5), (2, 6), (3, 7)]


def cdb(*, mixed: bool) -> str:
    """Two cubes: SOLID186 beside SOLID186, or beside SOLID185 without the middles
    of the face between them."""
    block = Block((2, 1, 1), (0.2, 0.1, 0.1))
    points, middles, rows = list(block.points), dict[frozenset[int], int](), []
    for k, corners in enumerate(block.elements):
        own = list(corners)
        for a, b in CUBE_EDGES if k == 0 or not mixed else ():
            ends = frozenset((corners[a], corners[b]))
            between = {points[n - 1][0] for n in ends} == {0.1}
            if mixed and between:
                own.append(0)
                continue
            if ends not in middles:
                pair = [np.array(points[n - 1]) for n in ends]
                points.append(tuple(((pair[0] + pair[1]) / 2).tolist()))
                middles[ends] = len(points)
            own.append(middles[ends])
        rows.append(own)
    lines = ["/PREP7", "ET,1,186 $ KEYOPT,1,2,1 $ ET,2,185 ! two types", "KEYOPT,2,2,3"]
    lines += [f"N,{i},{x!r},{y!r},{z!r}" for i, (x, y, z) in enumerate(points, 1)]
    lines += ["EBLOCK,19,SOLID,2,2", "(19i9)"]
    for i, own in enumerate(rows, 1):
        head = [1, 2 if len(own) == 8 else 1, 1, 1, 0, 0, 0, 0, len(own), 0, i]
        words = [*head, *own]
        lines += ["".join(f"{w:9d}" for w in words[:19])]
        lines += ["".join(f"{w:9d}" for w in words[19:])] if words[19:] else []
    lines += ["-1", "MP,EX,1,2.1E11 $ MP,PRXY,1,0.3 $ MP,DENS,1,7850."]
    return "\n".join([*lines, ""])


def test_middle_node_zero_joins_quadratic_and_linear_bricks(tmp_path: Path) -> None:
    """Masses agree, and frequencies as far as two linear bricks differ from quadratic
    ones."""
    plain = converted(tmp_path, "a.cdb", cdb(mixed=False))
    mixed = converted(tmp_path, "b.cdb", cdb(mixed=True))
    assert mixed.mass == pytest.approx(plain.mass, rel=1e-12)
    assert_allclose(frequencies(mixed), frequencies(plain), rtol=0.2)


def test_parameters_one_of_local_are_those_of_a_circle(tmp_path: Path) -> None:
    text = cdb(mixed=False)
    local = "LOCAL,R5.0,LOC,12,0,0.,0.,0.\nLOCAL,R5.0,ANG,12,0,0.,0.,0.\n"
    local += "LOCAL,R5.0,PRM,12,0,{}\nCSYS,0\n"
    found = converted(tmp_path, "a.cdb", text + local.format("1.,1."))
    same(found, converted(tmp_path, "b.cdb", text))
    with pytest.raises(InputError, match="has parameters"):
        converted(tmp_path, "c.cdb", text + local.format("0.5,1."))


#: How a brick collapses, away from the face 0 3 7 4 that it shares, and what is left
#: of its volume: prisms and a pyramid.
REPEATED = {
    "first edge": ((0, 0, 2, 3, 4, 4, 6, 7), 1 / 2),
    "far edge": ((0, 1, 1, 3, 4, 5, 5, 7), 1 / 2),
    "third edge": ((0, 1, 3, 3, 4, 5, 7, 7), 1 / 2),
    "upright edge": ((0, 1, 2, 3, 4, 1, 2, 7), 1 / 2),
    "upper edge": ((0, 1, 2, 3, 4, 4, 7, 7), 1 / 2),
    "pyramid": ((0, 1, 1, 3, 4, 1, 1, 7), 1 / 3),
}


@pytest.mark.parametrize("case", REPEATED)
def test_bricks_with_repeated_nodes_are_prisms(tmp_path: Path, case: str) -> None:
    """A brick that loses edges, beside a whole one: the mass of both."""
    block = Block((2, 1, 1), (0.2, 0.1, 0.1))
    order, share = REPEATED[case]
    block.elements[1] = [block.elements[1][k] for k in order]
    sid = converted(tmp_path, "p.inp", inp_deck(block, "C3D8I"))
    assert sid.mass == pytest.approx((1 + share) * 7850 * 0.1**3, rel=1e-9)


def test_an_included_file_continues_the_data(tmp_path: Path) -> None:
    """*INCLUDE among the lines of *NODE and of *ELEMENT, and lines behind it."""
    text = inp_deck(BLOCK, "C3D8I")
    lines = text.splitlines()
    at = lines.index(next(x for x in lines if x.startswith("*ELEMENT")))
    (tmp_path / "nodes.inc").write_text("\n".join(lines[4:8]) + "\n", encoding="utf-8")
    (tmp_path / "cells.inc").write_text(
        lines[at + 2] + "\n" + lines[at + 3] + "\n", encoding="utf-8"
    )
    parts = [*lines[:4], "*INCLUDE, INPUT=nodes.inc", *lines[8 : at + 2]]
    parts += ["*INCLUDE, INPUT=cells.inc", *lines[at + 4 :]]
    found = converted(tmp_path, "a.inp", "\n".join([*parts, ""]))
    same(found, converted(tmp_path, "b.inp", text))


def odd_tetrahedron(shift: float) -> str:
    """A unit tetrahedron whose first edge has its middle node away from the middle.

    Along it the Jacobian is 1 - 4 s (L_1 - L_0), so that it is negative at a corner
    for shifts s above 1/4.
    """
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    pairs = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
    middles = np.array([(corners[a] + corners[b]) / 2 for a, b in pairs])
    middles[0, 0] += shift
    nodes = "".join(
        f"{i}, {x!r}, {y!r}, {z!r}\n"
        for i, (x, y, z) in enumerate(np.vstack([corners, middles]).tolist(), 1)
    )
    row = ", ".join(map(str, range(11)[1:]))
    return (
        f"*NODE\n{nodes}*ELEMENT, TYPE=C3D10, ELSET=E\n1, {row}\n"
        f"{MATERIAL.format(**STEEL)}*SOLID SECTION, ELSET=E, MATERIAL=S\n"
    )


def test_tetrahedron_that_is_sound_where_it_is_integrated(tmp_path: Path) -> None:
    """Its Jacobian is negative at a corner alone: taken, as Abaqus and CalculiX do."""
    sound = converted(tmp_path, "a.inp", odd_tetrahedron(0.0))
    odd = converted(tmp_path, "b.inp", odd_tetrahedron(0.27))
    assert odd.mass == pytest.approx(sound.mass, rel=1e-9)  # the same place
    with pytest.raises(InputError, match="is folded"):
        converted(tmp_path, "c.inp", odd_tetrahedron(0.6))
