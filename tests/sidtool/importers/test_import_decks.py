"""Decks whose elements make no body: what is wrong with them is said."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.pipeline.model_to_sid import sid_from_model

from .mesh_files import mesh_model

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
    (folder / "part.inp").write_text(text, encoding="utf-8")
    frame = {"type": "tangent", "marker": "p", "clamp": "HELD"}
    path = mesh_model(
        folder,
        "part.inp",
        frame=frame if held else {"type": "buckens"},
        markers={"p": {"node": 1, "mesh_node": 1}},
        reduction={"method": "modal", "modes": 3},
    )
    data = json.loads(path.read_text(encoding="utf-8"))
    del data["material"]
    data["discretisation"]["state"] = "plane_stress" if "CPS" in text else None
    data["geometry"]["thickness"] = 0.1 if "CPS" in text else None
    path.write_text(json.dumps(data), encoding="utf-8")
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
    "inverted": (deck(CUBE, "C3D8", [[*BRICK[4:], *BRICK[:4]]]), "is inverted"),
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
        deck(
            CUBE,
            "C3D8",
            [BRICK],
            [
                *("*INITIAL CONDITIONS, TYPE=TEMPERATURE", "1, 0.", "2, 9."),
                *(*MATERIAL[:3], "1e11, 0.3, 500.", *MATERIAL[3:]),
            ],
        ),
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


def test_unused_content_changes_nothing(tmp_path: Path) -> None:
    """A free node, and a material that no section names, however wrong."""
    plain = sid_from_model(deck_model(tmp_path, deck(CUBE, "C3D8", [BRICK])))
    other = ["*MATERIAL, NAME=X", "*ELASTIC", "-1e5, 0.3", "*DENSITY", "1.", *MATERIAL]
    more = deck([*CUBE, (5, 5, 5)], "C3D8", [BRICK], other)
    sid = sid_from_model(deck_model(tmp_path, more))
    assert sid.mass == plain.mass
    assert_allclose(sid.Ke.m0, plain.Ke.m0)
