"""Shells of corner nodes of an .inp on elements of sidtool: textbook references."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.codes import with_code

from .decks import STEEL, Block, deck, frequencies, listed

pytestmark = pytest.mark.filterwarnings("ignore")

E, NU, RHO = STEEL["e"], STEEL["nu"], STEEL["rho"]
#: Free square plates of nu = 0.3: a^2 omega sqrt(rho h/D) (A. W. Leissa, "Vibration of
#: plates", NASA SP-160, 1969).
LEISSA = (13.489, 19.789, 24.432)
LENGTH, WIDTH, DEPTH = 1.0, 0.05, 0.005


def model(folder: Path, text: str, node: int = 1, **changes: Any) -> Path:
    (folder / "part.inp").write_text(text, encoding="utf-8")
    data = {
        "format": "sidtool model",
        "version": 1,
        "geometry": {"type": "mesh", "file": "part.inp"} | changes.pop("geometry", {}),
        "discretisation": {"type": "mesh"},
        "frame": {"type": "buckens"},
        "markers": {"p": {"node": 1, "mesh_node": node}},
        "reduction": {"method": "modal", "modes": 4},
        **changes,
    }
    (folder / "model.json").write_text(json.dumps(data), encoding="utf-8")
    return folder / "model.json"


def body(folder: Path, text: str, node: int = 1, **changes: Any) -> SID:
    return sid_from_model(model(folder, text, node, **changes))


def plate(block: Block, kind: str, thickness: float, options: str = "") -> str:
    """A plate in the plane z = 0, of triangles for S3."""
    if kind.startswith("S3"):
        rows = block.elements
        block.elements = [t for a, b, c, d in rows for t in ([a, b, c], [a, c, d])]
    text = deck(block, kind, section=repr(thickness))
    head = "SECTION, ELSET=E, MATERIAL=S"
    return text.replace(f"*SOLID {head}", f"*SHELL {head}{options}")


def strip_hertz(root: float, thickness: float) -> float:
    """A strip as a beam of Euler and Bernoulli."""
    value = root**2 / LENGTH**2 * thickness * np.sqrt(E / RHO / 12)
    return float(value / (2 * np.pi))


@pytest.mark.parametrize("kind", ["S3", "S4R"])
def test_a_free_plate_has_the_frequencies_of_leissa(kind: str, tmp_path: Path) -> None:
    side, depth = 0.4, 0.004
    sid = body(tmp_path, plate(Block((10, 10), (side, side)), kind, depth))
    assert sid.mass == pytest.approx(RHO * side**2 * depth, rel=1e-12)
    rigidity = E * depth**3 / 12 / (1 - NU**2)
    own = frequencies(sid)[:3] * 2 * np.pi * side**2 * np.sqrt(RHO * depth / rigidity)
    assert_allclose(own, LEISSA, rtol=0.015)


def test_two_offset_layers_are_a_plate_of_both(tmp_path: Path) -> None:
    """OFFSET = 0.5 has the nodes on top, SNEG at the bottom: the layers meet there."""
    block = Block((20, 1), (LENGTH, WIDTH))
    text = plate(block, "S4", DEPTH, ", OFFSET=0.5")
    block.elements = [[n + 100 for n in e] for e in block.elements]
    rows = [
        f"{i}, {', '.join(str(n - 100) for n in e)}\n"
        for i, e in enumerate(block.elements, 101)
    ]
    text += "*ELEMENT, TYPE=S4, ELSET=U\n" + "".join(rows)
    text += f"*SHELL SECTION, ELSET=U, MATERIAL=S, OFFSET=SNEG\n{DEPTH!r}\n"
    sid = body(tmp_path, text)
    assert sid.mass == pytest.approx(RHO * LENGTH * WIDTH * 2 * DEPTH, rel=1e-12)
    closest = frequencies(sid)[0] / strip_hertz(4.730041, 2 * DEPTH) - 1
    assert abs(closest) < 0.01


def test_an_offset_lowers_the_shell_from_its_nodes(tmp_path: Path) -> None:
    text = plate(Block((2, 1), (LENGTH, WIDTH)), "S4", DEPTH, ", OFFSET=SPOS")
    sid = body(tmp_path, text, frame={"type": "tangent", "marker": "p"})
    centre = sid.mdCM.m0.ravel() / sid.mass
    assert_allclose(centre, [LENGTH / 2, WIDTH / 2, -DEPTH / 2], atol=1e-12)


@pytest.mark.parametrize(
    ("nodes", "root"), [("TIE NSET", 4.730041), ("PIN NSET", np.pi)]
)
def test_a_rigid_body_clamps_or_hinges_the_nodes_of_shells(
    nodes: str, root: float, tmp_path: Path
) -> None:
    """Both ends of a strip in a heavy rigid body."""
    block = Block((32, 1), (LENGTH, WIDTH))
    text = plate(block, "S4", DEPTH) + listed("END", block.left + block.right)
    heavy = 1e7
    text += (
        f"*NODE\n900, 0., {WIDTH / 2!r}, 0.\n"
        f"*RIGID BODY, {nodes}=END, REF NODE=900\n"
        "*ELEMENT, TYPE=MASS, ELSET=M\n901, 900\n"
        "*ELEMENT, TYPE=ROTARYI, ELSET=I\n902, 900\n"
        f"*MASS, ELSET=M\n{heavy!r}\n*ROTARY INERTIA, ELSET=I\n1e5, 1e5, 1e5\n"
    )
    found = frequencies(body(tmp_path, text, 900))
    assert np.abs(found / strip_hertz(root, DEPTH) - 1).min() < 0.01


@pytest.mark.parametrize(("kind", "left"), [("S4", "1, E4"), ("S3", "2, E3")])
def test_edges_of_shells_in_a_heavy_body_are_clamped(
    kind: str, left: str, tmp_path: Path
) -> None:
    """Both ends of a strip by edges k from node k to k + 1, the last one to node 1."""
    text = plate(Block((32, 1), (LENGTH, WIDTH)), kind, DEPTH)
    right = "63, E2" if kind == "S3" else "32, E2"
    text += (
        f"*NODE\n900, 0., {WIDTH / 2!r}, 0.\n"
        f"*SURFACE, NAME=ENDS\n{left}\n{right}\n"
        "*COUPLING, CONSTRAINT NAME=C, REF NODE=900, SURFACE=ENDS\n*KINEMATIC\n"
        "*ELEMENT, TYPE=MASS, ELSET=M\n901, 900\n"
        "*ELEMENT, TYPE=ROTARYI, ELSET=I\n902, 900\n"
        "*MASS, ELSET=M\n1e7\n*ROTARY INERTIA, ELSET=I\n1e5, 1e5, 1e5\n"
    )
    found = frequencies(body(tmp_path, text, 900))
    assert np.abs(found / strip_hertz(4.730041, DEPTH) - 1).min() < 0.01
    beyond = text.replace(left, "1, E5")
    with pytest.raises(InputError, match=r"element 1 has no edge E5.*E1 to E[34]"):
        body(tmp_path, beyond, 900)


def test_a_turned_instance_with_a_surface_is_the_flat_deck(tmp_path: Path) -> None:
    """The end of a strip on a rigid coupling to a mass: as nodes, and as shells."""
    block = Block((6, 2), (0.3, 0.1))
    text = plate(block, "S4", DEPTH)
    last = [i for i, e in enumerate(block.elements, 1) if set(block.right) & set(e)]
    held = [n for i in last for n in block.elements[i - 1]]
    sets = (
        listed("END", sorted(set(held))) + f"*ELSET, ELSET=LAST\n{last[0]}, {last[1]}\n"
    )
    mass = "*ELEMENT, TYPE=MASS, ELSET=M\n901, 900\n*MASS, ELSET=M\n1.\n"
    head, tail = text.split("*MATERIAL")
    tail, section = ("*MATERIAL" + tail).split("*SHELL")
    found = []
    for kind, place in (
        ("NODE\nEND", ""),
        ("ELEMENT\nLAST, SPOS", "0., 0., 0.\n0., 0., 0., 1., 2., 3., 40.\n"),
    ):
        own, _, line = kind.partition("\n")
        surface = f"*SURFACE, NAME=F, TYPE={own}\n{line}\n"
        node = "*NODE, NSET=R\n900, 0.3, 0.05, 0.\n"
        coupling = "*COUPLING, CONSTRAINT NAME=C, REF NODE=900, SURFACE=F\n*KINEMATIC\n"
        body_ = head + sets + "*SHELL" + section + node + surface + coupling + mass
        if place:
            body_ = (
                f"*PART, NAME=P\n{body_}*END PART\n*ASSEMBLY, NAME=A\n"
                f"*INSTANCE, NAME=I, PART=P\n{place}*END INSTANCE\n*END ASSEMBLY\n"
            )
        sid = body(tmp_path, body_ + tail)
        found.append((sid.mass, *frequencies(sid)))
    assert_allclose(found[1], found[0], rtol=1e-7)


def linked_halves(links: str) -> str:
    """A strip of two halves, whose nodes A in the middle have twins B."""
    block, cut = Block((16, 1), (LENGTH, WIDTH)), LENGTH / 2
    middle = [n for n, x in enumerate(block.points, 1) if abs(x[0] - cut) < 1e-9]
    block.elements = [
        [n + 100 if n in middle and min(e) in middle else n for n in e]
        for e in block.elements
    ]
    twins = "".join(
        f"{n + 100}, {cut!r}, {block.points[n - 1][1]!r}, 0.\n" for n in middle
    )
    text = plate(block, "S4", DEPTH).replace("*ELEMENT", f"{twins}*ELEMENT", 1)
    sets = listed("A", middle) + listed("B", [n + 100 for n in middle])
    return text + sets + links


@pytest.mark.parametrize(
    ("links", "root"),
    [
        ("*MPC\nTIE, A, B\n", 4.730041),
        (
            "*EQUATION\n"
            + "".join(f"2\nA, {d}, 1., B, {d}, -1.\n" for d in range(1, 7)),
            4.730041,
        ),
        ("*MPC\nPIN, A, B\n*EQUATION\n2\nA, 4, 1., B, 4, -1.\n", None),
    ],
)
def test_equations_hold_the_rotations_of_shells(
    links: str, root: float | None, tmp_path: Path
) -> None:
    """One beam, or two on a hinge, which is a mechanism."""
    if root is None:
        with pytest.raises(InputError, match="mechanism"):
            body(tmp_path, linked_halves(links))
        return
    found = frequencies(body(tmp_path, linked_halves(links)))
    assert found[0] == pytest.approx(strip_hertz(root, DEPTH), rel=0.02)


@pytest.mark.needs("ccx")
def test_shells_that_meet_in_an_edge_need_no_calculix(tmp_path: Path) -> None:
    """CalculiX joins three shells by equations, which its matrices leave out."""
    block = Block((4, 2), (0.4, 0.2))
    text = plate(block, "S4", DEPTH)
    middle = [n for n, x in enumerate(block.points, 1) if abs(x[1] - 0.1) < 1e-9]
    text += "*NODE\n" + "".join(
        f"{n + 500}, {block.points[n - 1][0]!r}, 0.1, 0.1\n" for n in middle
    )
    text += "*ELEMENT, TYPE=S4, ELSET=E\n" + "".join(
        f"{700 + i}, {a}, {b}, {b + 500}, {a + 500}\n"
        for i, (a, b) in enumerate(zip(middle[:-1], middle[1:], strict=True))
    )
    own = body(tmp_path, text)
    other = body(tmp_path, text, geometry={"engine": "calculix"})
    assert len(with_code(other, "N132")) == 1
    assert_allclose(frequencies(other), frequencies(own), rtol=1e-9)


@pytest.mark.needs("ccx")
def test_a_node_that_calculix_places_at_the_origin_is_refused(tmp_path: Path) -> None:
    text = (
        "*NODE\n2, 1., 0., 0.\n3, .5, 0., 0.\n4, 2., 0., 0.\n5, 1.5, 0., 0.\n"
        "*ELEMENT, TYPE=B32, ELSET=E\n1, 1, 3, 2\n2, 2, 5, 4\n"
        "*MATERIAL, NAME=S\n*ELASTIC\n2.1e11, .3\n*DENSITY\n7850.\n"
        "*BEAM SECTION, ELSET=E, MATERIAL=S, SECTION=RECT\n.05, .08\n0., 1., 0.\n"
    )
    path = model(tmp_path, text, 2, geometry={"engine": "calculix"})
    with pytest.raises(InputError, match="node 1, which is not defined"):
        sid_from_model(path)


def test_a_deck_without_elements_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no solid element"):
        body(tmp_path, "*NODE\n1, 0., 0., 0.\n2, 1., 0., 0.\n")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("MATERIAL=S\n0.005", "COMPOSITE\n0.005,,S"),
        ("MATERIAL=S\n0.005", "MATERIAL=S\n0."),
        ("MATERIAL=S\n0.005", "MATERIAL=S, NODAL THICKNESS\n0.005"),
        ("*DENSITY\n7850.0\n", ""),
        ("*ELASTIC\n210000000000.0, 0.3", "*ELASTIC, TYPE=LAMINA\n1e11,1e10,.3,5e9"),
        ("*SHELL SECTION", "*EQUATION\n2\n1,2,1.,2,2,-1.\n*SHELL SECTION"),
        ("*SHELL SECTION", "*MPC\nTIE,1,2\n*SHELL SECTION"),
        ("*SHELL SECTION", "*EQUATION\n2\n1,7,1.,2,7,-1.\n*SHELL SECTION"),
        ("TYPE=S4", "TYPE=CPS4"),
    ],
)
def test_what_the_shells_do_not_have_is_refused(
    old: str, new: str, tmp_path: Path
) -> None:
    text = plate(Block((2, 1), (LENGTH, WIDTH)), "S4", DEPTH)
    assert old in text
    with pytest.raises(InputError):
        body(tmp_path, text.replace(old, new))
