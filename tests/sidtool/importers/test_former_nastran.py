"""Cards of former NASTRAN: the same bodies as by the cards that replaced them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.formats.base.errors import InputError

from .bars.decks import LEGS, MATERIAL, PBAR, PLACES, UP, body, bulk, frame, grids
from .decks import frequencies
from .test_structures import strip

TRIANGULATED = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
EDGES = [(1, 2), (2, 3), (3, 1), (1, 4), (2, 4), (3, 4)]
T = 0.004


def plate(*properties: str, name: str = "", triangles: bool = False) -> str:
    own = "CTRIA3" if triangles else "CQUAD4"
    cards = strip(6, 4, (0.4, 0.3), triangles=triangles)
    elements = [card.replace(own, name or own) for card in cards]
    return bulk(*elements, *properties, MATERIAL, "MAT1,2,7.+10,,.33,2700.")


@pytest.mark.parametrize("triangles", [False, True])
@pytest.mark.parametrize(
    ("kind", "former", "present"),
    [
        ("1", f"P{{}}1,1,1,{T},2,8.-9,2,.003,5.", f"PSHELL,1,1,{T},2,1.5,2,.75,5."),
        ("2", f"P{{}}2,1,1,{T},5.", f"PSHELL,1,1,{T},1,,1,1.,5."),
    ],
)
def test_former_shells_are_present_ones(
    tmp_path: Path, triangles: bool, kind: str, former: str, present: str
) -> None:
    """Membrane, bending and shear have materials and thicknesses of their own."""
    stem = "TRIA" if triangles else "QUAD"
    now = body(tmp_path, plate(present, triangles=triangles))
    text = plate(former.format(stem), name=f"C{stem}{kind}", triangles=triangles)
    before = body(tmp_path, text)
    assert before.mass == pytest.approx((7850 * T + 5) * 0.4 * 0.3, rel=1e-12)
    assert_allclose(frequencies(before), frequencies(now), rtol=1e-9)


def truss(elements: list[str], *properties: str) -> str:
    return bulk(*grids(TRIANGULATED), *elements, *properties, MATERIAL)


def test_tubes_are_rods_of_the_area_of_a_ring(tmp_path: Path) -> None:
    """Two elements on a card, as former decks have them."""
    ends = [f"{k},1,{a},{b}" for k, (a, b) in enumerate(EDGES, 1)]
    pairs = [f"CTUBE,{a},{b}" for a, b in zip(ends[::2], ends[1::2], strict=True)]
    tubes = body(tmp_path, truss(pairs, "PTUBE,1,1,.05,.002,.3"))
    area = np.pi / 4 * (0.05**2 - 0.046**2)
    singles = [f"CROD,{end}" for end in ends]
    rods = body(tmp_path, truss(singles, f"PROD,1,1,{area!r},,,.3"))
    total = 3 + 3 * np.sqrt(2)
    assert tubes.mass == pytest.approx((7850 * area + 0.3) * total, rel=1e-12)
    assert_allclose(frequencies(tubes), frequencies(rods), rtol=1e-9)


def test_tapered_tubes_are_refused(tmp_path: Path) -> None:
    elements = [f"CTUBE,{k},1,{a},{b}" for k, (a, b) in enumerate(EDGES, 1)]
    with pytest.raises(InputError) as error:
        body(tmp_path, truss(elements, "PTUBE,1,1,.05,.002,,.04"))
    assert "OD2" in error.value.problem


def test_the_flag_of_cbar_selects_a_vector_or_a_node(tmp_path: Path) -> None:
    """1 is a vector, also of whole numbers; 2 is a node."""
    now = body(tmp_path, frame(PBAR))
    vector = body(tmp_path, frame(PBAR, tail=",1"))
    assert_allclose(frequencies(vector), frequencies(now), rtol=1e-12)
    whole = [f"CBAR,{k},1,{a + 1},{b + 1},2,-3,9,1" for k, (a, b) in enumerate(LEGS, 1)]
    text = bulk(*grids(PLACES), *whole, PBAR, MATERIAL)
    assert_allclose(frequencies(body(tmp_path, text)), frequencies(now), rtol=1e-9)
    far = [np.add(PLACES[a], UP) for a, _ in LEGS]
    nodes = [card.replace("GRID,", "GRID,1") for card in grids(far)]
    named = [
        f"CBAR,{k + 1},1,{a + 1},{b + 1},{11 + k},,,2" for k, (a, b) in enumerate(LEGS)
    ]
    text = bulk(*grids(PLACES), *nodes, *named, PBAR, MATERIAL)
    assert_allclose(frequencies(body(tmp_path, text)), frequencies(now), rtol=1e-9)


def test_continuations_stand_anywhere_and_numbers_have_blanks(tmp_path: Path) -> None:
    """A continuation begins with the mark at the end of the line before it."""
    text = frame(PBAR)
    plain = bulk(*grids(PLACES), *_bars(), "PBAR,1,1,4.-6,5.-13,3.-13,4.-13", MATERIAL)
    now = body(tmp_path, plain)
    assert_allclose(frequencies(now), frequencies(body(tmp_path, text)), rtol=1e-9)
    apart = bulk(
        "*B      4. E-13         ",
        *grids(PLACES),
        "PBAR   *1               1               4. -6           5.E-13          KB",
        *_bars(),
        MATERIAL,
    ).replace("*B      4. E-13", "*B      3. E -13        4. D-13")
    assert_allclose(frequencies(body(tmp_path, apart)), frequencies(now), rtol=1e-9)


def _bars() -> list[str]:
    up = ",".join(map(repr, UP))
    return [f"CBAR,{k},1,{a + 1},{b + 1},{up}" for k, (a, b) in enumerate(LEGS, 1)]


def test_two_numbers_in_a_field_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        body(tmp_path, frame(PBAR).replace(MATERIAL, "MAT1,1,2.1 3.+11,,.3,7850."))


def test_commas_of_formulas_and_at_ends_separate_no_fields(tmp_path: Path) -> None:
    formula = "DEQATN  1       F(A,B,C,D,E,G,H,O,P,Q,R)=SUM(A,B,C,D,E,G,H,O,P,Q,R)\n"
    formula += "        +MAX(A,B,C,D,E,G,H,O,P,Q,R)"
    plain = body(tmp_path, frame(PBAR))
    more = body(tmp_path, frame(PBAR + ",,,,,,,", formula, "CNGRNT,1,2,3"))
    assert_allclose(frequencies(more), frequencies(plain), rtol=1e-12)


@pytest.mark.parametrize("selected", [False, True])
def test_materials_depend_on_temperatures_that_are_selected(
    tmp_path: Path, selected: bool
) -> None:
    """Without them the constants of MAT1 hold, as in Nastran."""
    control = "SOL 103\nCEND\nMETHOD = 1\n" + "TEMP(INIT) = 3\n" * selected
    heat = ("MATT1,1,7", "TEMPD,3,90.", "TABLEM1,7", ",0.,2.+11,100.,1.+11,ENDT")
    text = control + frame(PBAR, *heat)
    if selected:
        with pytest.raises(InputError) as error:
            body(tmp_path, text)
        assert "MATT1" in error.value.problem
    else:
        plain = frequencies(body(tmp_path, frame(PBAR)))
        assert_allclose(frequencies(body(tmp_path, text)), plain, rtol=1e-12)
