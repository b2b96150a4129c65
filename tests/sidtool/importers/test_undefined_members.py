"""Every list of nodes or elements in a deck: a member that is not there is refused."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.codes import only

from .decks import Block, deck as inp_deck, frequencies
from .mesh_files import mesh_model

BLOCK = Block((4, 1, 1), (0.4, 0.1, 0.1))
#: The corners of the end; the last of them is the one that decks misspell.
A, B, C, LAST = BLOCK.right
LOST = 9999
CENTRE = (0.5, 0.05, 0.05)


def converted(folder: Path, name: str, text: str, tie: str | None = None) -> SID:
    """The SID of a deck; a second marker is tied to the set `tie`."""
    (folder / name).write_text(text, encoding="utf-8")
    markers: dict[str, Any] = {"p": {"node": 1, "mesh_node": BLOCK.left[0]}}
    if tie is not None:
        held = {"type": "rigid", "to": tie}
        markers["r"] = {"node": 2, "position": [0.4, 0.05, 0.05], "tie": held}
    path = mesh_model(
        folder,
        name,
        frame={"type": "buckens"},
        markers=markers,
        reduction={"method": "modal", "modes": 2},
    )
    data = json.loads(path.read_text(encoding="utf-8"))
    del data["material"]
    path.write_text(json.dumps(data), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return sid_from_model(path)


def bdf(*cards: str) -> str:
    grids = [
        f"GRID,{i},,{x!r},{y!r},{z!r}" for i, (x, y, z) in enumerate(BLOCK.points, 1)
    ]
    solids = [
        f"CHEXA,{i},1,{','.join(map(str, e[:6]))}\n,{e[6]},{e[7]}"
        for i, e in enumerate(BLOCK.elements, 1)
    ]
    material = ["PSOLID,1,1", "MAT1,1,2.1+11,,0.3,7850.", "GRID,100,,0.5,0.05,0.05"]
    own = [card(text) for text in cards]
    lines = ["BEGIN BULK", *grids, *solids, *material, *own, "ENDDATA"]
    return "\n".join([*lines, ""])


def card(text: str) -> str:
    """A card of any length, eight fields to a line."""
    name, *words = text.split(",")
    rows = [words[i : i + 8] for i in range(0, len(words), 8)]
    return "\n".join(
        ",".join([name if k == 0 else "", *row]) for k, row in enumerate(rows)
    )


def inp(*lines: str) -> str:
    place = ", ".join(map(str, CENTRE))
    return "\n".join([inp_deck(BLOCK, "C3D8I"), "*NODE", f"100, {place}", *lines, ""])


def cdb(*lines: str) -> str:
    nodes = [f"N,{i},{x!r},{y!r},{z!r}" for i, (x, y, z) in enumerate(BLOCK.points, 1)]
    solids = [
        f"EN,{i},{','.join(map(str, e))}" for i, e in enumerate(BLOCK.elements, 1)
    ]
    material = ["MP,EX,1,2.1E11", "MP,PRXY,1,0.3", "MP,DENS,1,7850."]
    types = ["/PREP7", "ET,1,185", "KEYOPT,1,2,3"]
    return "\n".join([*types, *nodes, *solids, *material, *lines, ""])


def component(*nodes: int) -> str:
    count = len(nodes)
    return f"CMBLOCK,END,NODE,{count}\n(8i10)\n" + "".join(f"{n:10d}" for n in nodes)


def surface(*lines: str) -> tuple[str, ...]:
    return (
        "*SURFACE, NAME=S, TYPE=NODE",
        *lines,
        "*COUPLING, CONSTRAINT NAME=K, REF NODE=100, SURFACE=S",
    )


MASS = "CONM2,300,100,,3."
ALL = f"{A},{B},{C}"
#: What a list is, ending, deck with one member left open, the set of a tie.
LISTS: dict[str, tuple[str, Any, str | None]] = {
    "RBE2": ("bdf", lambda n: bdf(f"RBE2,200,100,123456,{ALL},{n}", MASS), None),
    "RBE2 GN": ("bdf", lambda n: bdf(f"RBE2,200,{n},123456,{ALL}"), None),
    "RBE3": (
        "bdf",
        lambda n: bdf(f"RBE3,2,,100,123456,1.,123,{A},{B},{n}", MASS),
        None,
    ),
    "RBE3 REFGRID": (
        "bdf",
        lambda n: bdf(f"RBE3,2,,{n},123,1.,123,{A},{B},{C}"),
        None,
    ),
    "RBAR": ("bdf", lambda n: bdf(f"RBAR,200,{n},{A},123456"), None),
    "MPC": ("bdf", lambda n: bdf(f"MPC,1,{n},1,1.,{A},1,-1."), None),
    "CONM2": ("bdf", lambda n: bdf(f"CONM2,300,{n},,3."), None),
    "SET1": ("bdf", lambda n: bdf(f"SET1,5,{ALL},{n}"), "SET5"),
    "SPC": ("bdf", lambda n: bdf(f"SPC,5,{A},123,,{B},123", f"SPC,5,{n},123"), "SPC5"),
    "SPC1": ("bdf", lambda n: bdf(f"SPC1,5,123,{ALL},{n}"), "SPC5"),
    "skin": ("bdf", lambda n: bdf(f"CTRIA3,90,7,{A},{B},{n}"), "SURFACE7"),
    "*NSET": ("inp", lambda n: inp("*NSET, NSET=END", f"{ALL}, {n}"), "END"),
    "*NSET of sets": (
        "inp",
        lambda n: inp("*NSET, NSET=PART", f"{n},", "*NSET, NSET=END", f"{ALL}, PART"),
        "END",
    ),
    "*RIGID BODY": (
        "inp",
        lambda n: inp(
            f"*NSET,NSET=END\n{ALL},{n}\n*RIGID BODY, NSET=END, REF NODE=100"
        ),
        None,
    ),
    "REF NODE": (
        "inp",
        lambda n: inp(f"*NSET, NSET=END\n{ALL}\n*RIGID BODY, NSET=END, REF NODE={n}"),
        None,
    ),
    "*KINEMATIC": (
        "inp",
        lambda n: inp(*surface(f"{A},\n{B},\n{C},\n{n},"), "*KINEMATIC"),
        None,
    ),
    "*DISTRIBUTING": (
        "inp",
        lambda n: inp(*surface(f"{A},\n{B},\n{C},\n{n},"), "*DISTRIBUTING"),
        None,
    ),
    "*KINEMATIC COUPLING": (
        "inp",
        lambda n: inp(
            "*KINEMATIC COUPLING, REF NODE=100",
            f"{A}, 1, 6",
            f"{B}, 1, 6",
            f"{n}, 1, 6",
        ),
        None,
    ),
    "surface as a set": (
        "inp",
        lambda n: inp("*SURFACE,NAME=S,TYPE=NODE", f"{A},\n{B},\n{n},"),
        "S",
    ),
    "*EQUATION": ("inp", lambda n: inp("*EQUATION", "2", f"{n},1,1.,{A},1,-1."), None),
    "*MPC": ("inp", lambda n: inp("*MPC", f"TIE, {n}, {A}"), None),
    "*TRANSFORM": (
        "inp",
        lambda n: inp(f"*NSET,NSET=T\n{A}, {n}\n*TRANSFORM, NSET=T\n1,0,0,0,1,0"),
        None,
    ),
    "*MASS": (
        "inp",
        lambda n: inp(f"*ELEMENT, TYPE=MASS, ELSET=M\n90, {n}\n*MASS, ELSET=M\n3."),
        None,
    ),
    "CMBLOCK": ("cdb", lambda n: cdb(component(A, B, C, n)), "END"),
    "CE": ("cdb", lambda n: cdb(f"CE,1,0,{n},UX,1,{A},UX,-1"), None),
    "CP": ("cdb", lambda n: cdb(f"CP,1,UX,{A},{n}"), None),
}
#: The same for lists of elements; the number left open is that of the last one.
ELEMENTS: dict[str, tuple[str, Any, str | None]] = {
    "*ELSET": ("inp", lambda e: inp("*ELSET, ELSET=END", f"3, {e}"), "END"),
    "*NSET, ELSET": (
        "inp",
        lambda e: inp(f"*ELSET, ELSET=X\n{e},\n*NSET, NSET=END, ELSET=X"),
        None,
    ),
    "*SURFACE": ("inp", lambda e: inp("*SURFACE, NAME=S", f"{e}, S4"), "S"),
    "*MASS": (
        "inp",
        lambda e: inp(
            f"*ELEMENT, TYPE=MASS\n4000, {A}\n*ELSET, ELSET=M\n4000, {e}",
            "*MASS, ELSET=M\n3.",
        ),
        None,
    ),
    "*RIGID BODY": (
        "inp",
        lambda e: inp(f"*ELSET, ELSET=X\n{e},\n*RIGID BODY, ELSET=X, REF NODE=100"),
        None,
    ),
}


@pytest.mark.parametrize("case", LISTS)
def test_node_that_is_not_defined_is_refused_by_name(tmp_path: Path, case: str) -> None:
    ending, text, tie = LISTS[case]
    with pytest.raises(InputError) as caught:
        converted(tmp_path, f"part.{ending}", text(LOST), tie)
    assert str(LOST) in str(caught.value)


#: Those that the last corner makes a support, or a reference of its own.
OTHERWISE = {"MPC", "*EQUATION", "*MPC", "CE", "CP", "RBAR"}
OTHERWISE |= {"RBE2 GN", "RBE3 REFGRID", "REF NODE"}


@pytest.mark.parametrize("case", [name for name in LISTS if name not in OTHERWISE])
def test_same_lists_with_defined_nodes_are_taken(tmp_path: Path, case: str) -> None:
    ending, text, tie = LISTS[case]
    assert converted(tmp_path, f"part.{ending}", text(LAST), tie).mass > 0


@pytest.mark.parametrize("case", ELEMENTS)
def test_element_that_is_not_defined_is_refused_by_name(
    tmp_path: Path, case: str
) -> None:
    ending, text, tie = ELEMENTS[case]
    with pytest.raises(InputError) as caught:
        converted(tmp_path, f"part.{ending}", text(LOST), tie)
    assert str(LOST) in str(caught.value)


def test_ranges_may_pass_over_numbers_that_are_not_defined(tmp_path: Path) -> None:
    """Ranges of Nastran (SPC1) and Abaqus (GENERATE) may have gaps."""
    ends = f"{A},{B},{C},{LAST}"
    single = converted(tmp_path, "a.bdf", bdf(f"SPC1,5,123,{ends}"), "SPC5")
    last = max(BLOCK.right)
    assert last == len(BLOCK.points)
    spans = f"SPC1,5,123,{ends}\nSPC1,5,123,{last},THRU,99"
    found = converted(tmp_path, "b.bdf", bdf(spans), "SPC5")
    np.testing.assert_allclose(frequencies(found), frequencies(single), rtol=1e-12)
    lines = ("*NSET, NSET=END", ends, "*NSET, NSET=END, GENERATE", f"{last}, 90, 1")
    found = converted(tmp_path, "c.inp", inp(*lines), "END")
    np.testing.assert_allclose(frequencies(found), frequencies(single), rtol=1e-9)


def test_an_unused_incomplete_set_is_only_noted(tmp_path: Path) -> None:
    (tmp_path / "part.bdf").write_text(bdf(f"SET1,5,{A},{LOST}"), encoding="utf-8")
    path = mesh_model(
        tmp_path,
        "part.bdf",
        frame={"type": "buckens"},
        markers={"p": {"node": 1, "mesh_node": A}},
        reduction={"method": "modal", "modes": 2},
    )
    sid = sid_from_model(path)
    assert sid.mass > 0
    (named,) = only(sid, "N130").data["sets"]
    assert "SET5" in named and str(LOST) in named


def test_mean_over_a_node_without_an_element_is_refused(tmp_path: Path) -> None:
    """A free node would take its share of the mean with it."""
    with pytest.raises(InputError, match="101"):
        text = bdf(f"RBE3,2,,100,123456,1.,123,{A},{B},{C},101", "GRID,101,,1.,0.,0.")
        converted(tmp_path, "part.bdf", text)


WEIGHTS = {
    "all": f"1,123,{A},1,123,{B},1,123,{C},1,123,{LAST}",
    "first": f"1,123,{A},{B},{C},{LAST}",
    "later": f"1.,123,{A},1,123,{B},1,123,{C},1,123,{LAST}",
}


@pytest.mark.parametrize("case", WEIGHTS)
def test_weight_written_as_a_whole_number_is_refused(tmp_path: Path, case: str) -> None:
    """Nastran distinguishes weights from nodes by their decimal point."""
    grid = "GRID,123,,0.2,0.5,0.5"  # a node whose number is that of the directions
    with pytest.raises(InputError, match="RBE3 2 .*") as caught:
        text = bdf(f"RBE3,2,,100,123456,{WEIGHTS[case]}", grid, MASS)
        converted(tmp_path, "part.bdf", text)
    assert "decimal point" in str(caught.value) or "123" in str(caught.value)


def test_whole_number_as_direction_of_a_bar_is_a_node(tmp_path: Path) -> None:
    """X1 is real: 1, 0, 0 would be the node 1 with fields behind it."""
    head = (
        "BEGIN BULK\nGRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nPBAR,1,1,1.-4,1.-9,4.-9,2.-9\n"
    )
    tail = "MAT1,1,2.1+11,,0.3,7850.\nENDDATA\n"
    with pytest.raises(InputError, match="CBAR 5 .*0, 0, 1"):
        converted(tmp_path, "bar.bdf", f"{head}CBAR,5,1,1,2,0,0,1\n{tail}")


def test_holds_of_other_parts_are_not_those_of_the_chosen_one(tmp_path: Path) -> None:
    """Both parts number their nodes from 1: the mass of the other one stays there."""
    nodes = "*NODE\n" + BLOCK.node_lines() + "*ELEMENT, TYPE=C3D8I, ELSET=E\n"
    solid = nodes + BLOCK.element_lines() + "*SOLID SECTION, ELSET=E, MATERIAL=S\n"
    mass = f"*ELEMENT, TYPE=MASS, ELSET=M\n90, {A}\n*MASS, ELSET=M\n300.\n"
    text = (
        f"*PART, NAME=P\n{solid}*END PART\n*PART, NAME=Q\n{solid}{mass}*END PART\n"
        "*ASSEMBLY, NAME=X\n*INSTANCE, NAME=P1, PART=P\n*END INSTANCE\n"
        "*INSTANCE, NAME=Q1, PART=Q\n1., 0., 0.\n*END INSTANCE\n*END ASSEMBLY\n"
        "*MATERIAL, NAME=S\n*ELASTIC\n2.1E11, 0.3\n*DENSITY\n7850.\n"
    )
    (tmp_path / "two.inp").write_text(text, encoding="utf-8")
    path = mesh_model(
        tmp_path,
        "two.inp",
        frame={"type": "buckens"},
        markers={"p": {"node": 1, "mesh_node": A}},
        reduction={"method": "modal", "modes": 2},
    )
    data = json.loads(path.read_text(encoding="utf-8"))
    data["geometry"]["part"] = "P1"
    del data["material"]
    path.write_text(json.dumps(data), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        sid = sid_from_model(path)
    assert sid.mass == pytest.approx(7850 * 0.4 * 0.1 * 0.1, rel=1e-12)
