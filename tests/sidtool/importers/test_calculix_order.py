"""Linear elements through CalculiX: raised on the same mesh, or judged against that.

References: frequencies of the completely free square plate for nu = 0.3 (A. W. Leissa,
J. Sound Vib. 31, 1973, as improved by K. M. Liew, Y. Xiang, S. Kitipornchai, Comput.
Struct. 49, 1993), and of one held at an edge (Leissa, NASA SP-160, 1969, table 4.49).
"""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.importers.calculix_quadratic import quadratic_deck
from sidtool.importers.mesh_files import DeckNames
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.codes import only, with_code

from .decks import MATERIAL, STEEL, Block, deck, frequencies

E, NU, RHO = STEEL["e"], STEEL["nu"], STEEL["rho"]
#: omega a^2 sqrt(rho h / D).
FREE = np.array([13.468, 19.596, 24.270, 34.801, 34.801, 61.093])
CLAMPED = np.array([3.4917, 8.5246, 21.429, 27.331])


def exact(factors: np.ndarray, side: float, depth: float) -> np.ndarray:
    rigidity = E * depth**3 / (12 * (1 - NU**2))
    return factors / side**2 * np.sqrt(rigidity / (RHO * depth)) / (2 * np.pi)


def plate(count: int, kind: str, distorted: float = 0.0) -> tuple[Any, Any]:
    """Places and elements of a unit square of quadrilaterals or triangles."""
    noise, h = random.Random(2), 1 / count
    places = []
    for j in range(count + 1):
        for i in range(count + 1):
            inside = 0 < i < count and 0 < j < count
            dx, dy = ((noise.random() - 0.5) * distorted * inside for _ in range(2))
            places.append(((i + dx) * h, (j + dy) * h))
    elements = []
    for j in range(count):
        for i in range(count):
            a = j * (count + 1) + i + 1
            b, c, d = a + 1, a + count + 2, a + count + 1
            elements += [(a, b, c, d)] if kind == "quad" else [(a, b, c), (a, c, d)]
    return places, elements


def bdf(count: int, kind: str, depth: float, distorted: float = 0.0) -> str:
    places, elements = plate(count, kind, distorted)
    card = "CQUAD4" if kind == "quad" else "CTRIA3"
    lines = ["BEGIN BULK", f"MAT1,1,{E:.6E},,{NU},{RHO}", f"PSHELL,1,1,{depth},1,,1"]
    lines += [f"GRID,{k},,{x:.8f},{y:.8f},0." for k, (x, y) in enumerate(places, 1)]
    for k, nodes in enumerate(elements, 1):
        lines.append(f"{card},{k},1," + ",".join(map(str, nodes)))
    left = [k for k, (x, _) in enumerate(places, 1) if x == 0]
    return "\n".join([*lines, *(f"SPC1,7,123456,{k}" for k in left), "ENDDATA", ""])


def inp(count: int, kind: str, depth: float, distorted: float = 0.0) -> str:
    places, elements = plate(count, "quad" if kind[1] == "4" else "tri", distorted)
    nodes = "".join(f"{k}, {x!r}, {y!r}, 0.\n" for k, (x, y) in enumerate(places, 1))
    rows = "".join(
        f"{k}, {', '.join(map(str, own))}\n" for k, own in enumerate(elements, 1)
    )
    left = "".join(f"{k},\n" for k, (x, _) in enumerate(places, 1) if x == 0)
    return (
        f"*NODE\n{nodes}*Element, elset=E, Type = {kind}\n{rows}"
        f"*NSET, NSET=LEFT\n{left}"
        f"{MATERIAL.format(**STEEL)}*SHELL SECTION, ELSET=E, MATERIAL=S\n{depth!r}\n"
    )


def converted(
    folder: Path, name: str, text: str, held: str | None = None, **geometry: Any
) -> SID:
    """The SID, free or held at a set."""
    (folder / name).write_text(text, encoding="utf-8")
    frame: dict[str, Any] = {"type": "buckens"}
    if held:
        frame = {"type": "tangent", "marker": "p", "clamp": held}
    data = {
        "format": "sidtool model",
        "version": 1,
        "geometry": {"type": "mesh", "file": name, "engine": "calculix", **geometry},
        "discretisation": {"type": "mesh"},
        "frame": frame,
        "markers": {"p": {"node": 1, "mesh_node": 1}},
        "reduction": {"method": "modal", "modes": 6},
    }
    (folder / "model.json").write_text(json.dumps(data), encoding="utf-8")
    return sid_from_model(folder / "model.json")


@pytest.mark.needs("ccx")
@pytest.mark.parametrize("depth", [0.01, 0.002])
@pytest.mark.parametrize(
    ("kind", "distorted"), [("quad", 0.0), ("quad", 0.5), ("tri", 0.0)]
)
def test_thin_shells_of_bulk_data_do_not_lock(
    tmp_path: Path, kind: str, distorted: float, depth: float
) -> None:
    """They were 1.2 to 4.4 times too high at 1/100, up to 22 times at 1/500."""
    sid = converted(tmp_path, "p.bdf", bdf(10, kind, depth, distorted))
    assert sid.mass == pytest.approx(RHO * depth, rel=1e-9)
    found = frequencies(sid)[:6] / exact(FREE, 1.0, depth)
    assert_allclose(found, 1, atol=0.05)
    assert not with_code(sid, "N140")


@pytest.mark.needs("ccx")
@pytest.mark.parametrize(
    ("kind", "distorted"), [("S3", 0.0), ("S4R", 0.0), ("S4", 0.5)]
)
def test_locking_shells_of_a_deck_are_judged_and_raised_on_request(
    tmp_path: Path, kind: str, distorted: float
) -> None:
    text = inp(8, kind, 0.01, distorted)
    sid = converted(tmp_path, "p.inp", text)
    own = frequencies(sid)[:6] / exact(FREE, 1.0, 0.01) - 1
    shares = np.array(only(sid, "N140").data["differences"])
    assert own.max() > 0.3  # what the note has to say
    assert_allclose(shares, own, atol=0.04 * (1 + own.max()))
    raised = converted(tmp_path, "p.inp", text, order=2)
    assert_allclose(frequencies(raised)[:6], exact(FREE, 1.0, 0.01), rtol=0.04)
    assert not with_code(raised, "N140")


@pytest.mark.needs("ccx")
@pytest.mark.parametrize("name", ["p.inp", "p.bdf"])
def test_a_held_edge_holds_the_nodes_between(tmp_path: Path, name: str) -> None:
    """A set of both ends of an edge holds its middle, or the edge would be hinged."""
    text = inp(12, "S4", 0.01) if name == "p.inp" else bdf(12, "quad", 0.01)
    held = "LEFT" if name == "p.inp" else "SPC7"
    sid = converted(tmp_path, name, text, held=held, order=2)
    assert_allclose(frequencies(sid)[:4], exact(CLAMPED, 1.0, 0.01), rtol=0.01)


@pytest.mark.needs("ccx")
def test_shells_of_bulk_data_stay_linear_on_request(tmp_path: Path) -> None:
    sid = converted(tmp_path, "p.bdf", bdf(6, "tri", 0.01), order=1)
    assert frequencies(sid)[0] > 1.5 * exact(FREE, 1.0, 0.01)[0]
    assert with_code(sid, "N140")


@pytest.mark.needs("ccx")
def test_distorted_s4r_that_resists_rotation_names_the_remedy(tmp_path: Path) -> None:
    text = inp(6, "S4R", 0.01, 0.5)
    with pytest.raises(InputError, match=r"geometry\.order = 2"):
        converted(tmp_path, "p.inp", text)
    sid = converted(tmp_path, "p.inp", text, order=2)
    assert_allclose(frequencies(sid)[:6], exact(FREE, 1.0, 0.01), rtol=0.03)


#: A block of 8 x 1 x 1 cells in tetrahedra and prisms by the corners of a cell.
CELLS = {
    "C3D8R": ((0, 1, 2, 3, 4, 5, 6, 7),),
    "C3D6": ((0, 1, 2, 4, 5, 6), (0, 2, 3, 4, 6, 7)),
    "C3D4": ((0, 1, 3, 4), (1, 2, 3, 6), (1, 3, 4, 6), (1, 4, 5, 6), (3, 4, 6, 7)),
}


@pytest.mark.needs("ccx")
@pytest.mark.parametrize("kind", CELLS)
def test_raised_solids_bend_as_a_beam(tmp_path: Path, kind: str) -> None:
    """A free bar: the first pair of bending modes (Euler, 22.3733, less its shear)."""
    block = Block((12, 1, 1), (1.2, 0.05, 0.05))
    cells = CELLS[kind]
    block.elements = [[e[k] for k in own] for e in block.elements for own in cells]
    if kind == "C3D4":  # neighbours are mirrored, so that their diagonals meet
        mirrored = {0: (0, 1, 2, 3, 4, 5, 6, 7), 1: (1, 0, 3, 2, 5, 4, 7, 6)}
        bricks = Block((12, 1, 1), (1.2, 0.05, 0.05)).elements
        block.elements = []
        for k, e in enumerate(bricks):
            for own in cells:
                nodes = [e[mirrored[k % 2][j]] for j in own]
                block.elements.append(nodes if k % 2 == 0 else _turned(nodes))
    sid = converted(tmp_path, "p.inp", deck(block, kind), order=2)
    (raised,) = only(sid, "N139").data["kinds"]
    assert str(raised).startswith(f"{kind} to ")
    assert sid.mass == pytest.approx(RHO * 1.2 * 0.05**2, rel=1e-9)
    wave = 22.3733 / (2 * np.pi * 1.2**2) * np.sqrt(E * 0.05**2 / (12 * RHO))
    assert_allclose(frequencies(sid)[:2], wave, rtol=0.02)
    assert not with_code(sid, "N140")


def _turned(nodes: list[int]) -> list[int]:
    return [nodes[k] for k in (1, 0, 2, 3)]


@pytest.mark.needs("ccx")
def test_raised_beams_bend_as_beams(tmp_path: Path) -> None:
    """B31, whose solids lock, of a free beam (Euler, 22.3733) about both axes."""
    count, length, depth, width = 10, 1.2, 0.012, 0.02
    nodes = "".join(f"{k + 1}, {length * k / count!r}, 0., 0.\n" for k in range(11))
    rows = "".join(f"{k}, {k}, {k + 1}\n" for k in range(1, count + 1))
    text = (
        f"*NODE\n{nodes}*ELEMENT, TYPE=B31, ELSET=E\n{rows}"
        f"{MATERIAL.format(**STEEL)}*BEAM SECTION, ELSET=E, MATERIAL=S, SECTION=RECT\n"
        f"{depth!r}, {width!r}\n0., 1., 0.\n"
    )
    sid = converted(tmp_path, "p.inp", text, order=2)
    wave = 22.3733 / (2 * np.pi * length**2) * np.sqrt(E / (12 * RHO))
    assert_allclose(frequencies(sid)[:2], wave * np.array([depth, width]), rtol=2e-3)


def test_order_is_for_the_engine_alone(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"geometry\.order"):
        text = deck(Block((2, 1, 1), (0.2, 0.1, 0.1)), "C3D8I")
        converted(tmp_path, "p.inp", text, engine=None, order=2)


@pytest.mark.needs("ccx")
def test_strip_of_one_element_has_six_rigid_motions(tmp_path: Path) -> None:
    """S8R has motions without energy there: the free beam of Euler, 22.3733."""
    length, width, depth, count = 1.0, 0.05, 0.01, 10
    grids = [
        f"GRID,{2 * i + k + 1},,{length * i / count:.6f},{width * k:.6f},0."
        for i in range(count + 1)
        for k in range(2)
    ]
    cells = [
        f"CQUAD4,{i + 1},1,{2 * i + 1},{2 * i + 3},{2 * i + 4},{2 * i + 2}"
        for i in range(count)
    ]
    head = ["BEGIN BULK", f"MAT1,1,{E:.6E},,{NU},{RHO}", f"PSHELL,1,1,{depth},1,,1"]
    text = "\n".join([*head, *grids, *cells, "ENDDATA", ""])
    sid = converted(tmp_path, "p.bdf", text)
    wave = 22.3733 / (2 * np.pi * length**2) * np.sqrt(E * depth**2 / (12 * RHO))
    assert frequencies(sid)[0] == pytest.approx(wave, rel=0.02)


def test_middles_have_no_more_characters_than_calculix_reads() -> None:
    """It cuts numbers of more than twenty characters, and then refuses the line."""
    places = {1: (0.1, -1.2345678901234567e-07, 0.0), 2: (0.3, -3.1e-17, 1 / 3)}
    places |= {3: (0.2, 1.0, 0.1)}
    names = DeckNames(places, {}, 1, (), {})
    lines = ["*ELEMENT, TYPE=S3, ELSET=E", "1, 1, 2, 3"]
    deck = quadratic_deck(lines, names)
    rows = deck.lines[deck.lines.index("*NODE") + 1 :]
    assert len(rows) == 3
    assert max(len(word.strip()) for row in rows for word in row.split(",")) <= 20
