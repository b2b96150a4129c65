"""Shells, bars, springs, masses and solids of one deck: textbook references."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from sidtool.discretisation.bars_body import _hinges
from sidtool.formats.base.errors import InputError
from sidtool.formats.model import read_model
from sidtool.importers.nastran import shells
from sidtool.importers.nastran.bulk_data import read_bdf
from sidtool.pipeline.model_to_sid import finite_element_model
from tests.codes import with_code

from .bars.decks import (
    MATERIAL,
    NU,
    RHO,
    E,
    G,
    body,
    bulk,
    model,
)
from .decks import frequencies

pytestmark = pytest.mark.filterwarnings("ignore")

TURN = Rotation.from_euler("zyx", [40.0, 25.0, -70.0], degrees=True).as_matrix()
#: Free square plates of nu = 0.3: a^2 omega sqrt(rho h/D) (A. W. Leissa, "Vibration of
#: plates", NASA SP-160, 1969).
LEISSA = (13.489, 19.789, 24.432)
#: First roots of cos x cosh x = 1, free beams.
BEAM = (4.730041, 7.853205)
LENGTH, WIDTH, DEPTH = 1.0, 0.02, 0.002


def grid(label: int, place: Any, turn: Any = None) -> str:
    x = np.asarray(place, float)
    x = x if turn is None else turn @ x
    return f"GRID,{label},,{','.join(repr(round(v, 13)) for v in x.tolist())}"


def strip(
    count: int,
    rows: int,
    size: tuple[float, float],
    *,
    triangles: bool = False,
    tail: str = "",
    turn: Any = TURN,
    z: float = 0.0,
    first: int = 0,
) -> list[str]:
    """A rectangle of CQUAD4 or CTRIA3 with the property 1."""
    number = {at: first + i + 1 for i, at in enumerate(np.ndindex(count + 1, rows + 1))}
    cards = [
        grid(label, [i / count * size[0], j / rows * size[1], z], turn)
        for (i, j), label in number.items()
    ]
    label = first
    for i, j in np.ndindex(count, rows):
        a, b = number[i, j], number[i + 1, j]
        c, d = number[i + 1, j + 1], number[i, j + 1]
        pieces = [(a, b, c), (a, c, d)] if triangles else [(a, b, c, d)]
        for piece in pieces:
            label += 1
            name = "CTRIA3" if triangles else "CQUAD4"
            cards.append(f"{name},{label},1,{','.join(map(str, piece))}{tail}")
    return cards


def beam_hertz(stiffness: float, mass: float, root: float) -> float:
    """A free beam of Euler-Bernoulli."""
    value = (root / LENGTH) ** 2 * np.sqrt(stiffness / mass) / (2 * np.pi)
    return float(value)


@pytest.mark.parametrize(("triangles", "close"), [(False, 0.015), (True, 0.013)])
def test_a_tilted_plate_has_the_frequencies_of_leissa(
    triangles: bool, close: float, tmp_path: Path
) -> None:
    side, depth = 0.4, 0.004
    text = bulk(
        *strip(10, 10, (side, side), triangles=triangles),
        f"PSHELL,1,1,{depth},1,,1",
        MATERIAL,
    )
    sid = body(tmp_path, text)
    assert sid.mass == pytest.approx(RHO * side**2 * depth, rel=1e-12)
    rigidity = E * depth**3 / 12 / (1 - NU**2)
    own = frequencies(sid)[:3] * 2 * np.pi * side**2 * np.sqrt(RHO * depth / rigidity)
    assert_allclose(own, LEISSA, rtol=close)


def test_a_plate_without_calculix_has_own_shells(tmp_path: Path) -> None:
    """`ccx` is hidden from tests without the mark."""
    side, depth = 0.4, 0.004
    cards = strip(10, 10, (side, side), turn=np.eye(3))
    text = bulk(*cards, f"PSHELL,1,1,{depth},1,,1", MATERIAL)
    sid = body(tmp_path, text, geometry={"engine": "calculix"})
    assert "not installed" in str(with_code(sid, "N132")[0].data["reason"])
    rigidity = E * depth**3 / 12 / (1 - NU**2)
    own = frequencies(sid)[:3] * 2 * np.pi * side**2 * np.sqrt(RHO * depth / rigidity)
    assert_allclose(own, LEISSA, rtol=0.015)


@pytest.mark.parametrize("is_here", [False, True])
def test_bars_alone_with_the_engine_are_own_bars(
    is_here: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """CalculiX gets no bars of a .bdf, whether it is there or not."""
    monkeypatch.setattr(shells, "is_installed", lambda: is_here)
    sid = body(tmp_path, halves(*DIRECT), geometry={"engine": "calculix"})
    expected = [beam_hertz(E * 1e-9, RHO * 1e-4, root) for root in BEAM]
    assert_allclose(frequencies(sid)[[0, 2]], expected, rtol=5e-3)
    assert "bars" in str(with_code(sid, "N132")[0].data["reason"])


def test_a_stiffener_below_a_strip_bends_it_about_their_common_axis(
    tmp_path: Path,
) -> None:
    """Steiner: shells with bars on offset ends (WA, WB)."""
    area, below, count = 1e-5, 0.006, 20
    cards = strip(count, 2, (LENGTH, WIDTH))
    middle = [3 * i + 2 for i in range(count + 1)]
    arm = ",".join(repr(float(x)) for x in TURN @ [0, 0, -below])
    up = ",".join(repr(float(x)) for x in TURN @ [0, 1, 0])
    moment = 1e-11
    cards += [
        f"CBAR,{900 + i},2,{a},{b},{up},,\n,,,{arm},{arm}"
        for i, (a, b) in enumerate(zip(middle[:-1], middle[1:], strict=True))
    ]
    cards += [
        f"PSHELL,1,1,{DEPTH},1,,1",
        f"PBAR,2,1,{area},{moment},{moment},{2 * moment}",
        MATERIAL,
    ]
    sid = body(tmp_path, bulk(*cards))
    assert len(with_code(sid, "N125")) == 2  # bars and shells
    assert not with_code(sid, "N129")
    plate = WIDTH * DEPTH
    axis = below * area / (area + plate)
    bending = WIDTH * DEPTH**3 / 12 + plate * axis**2
    bending += moment + area * (below - axis) ** 2
    heavy = RHO * (plate + area)
    assert sid.mass == pytest.approx(heavy * LENGTH, rel=1e-9)
    expected = beam_hertz(E * bending, heavy, BEAM[0])
    closest = np.abs(frequencies(sid) / expected - 1).min()
    assert closest < 5e-3


def test_layers_bend_by_laminate_theory(tmp_path: Path) -> None:
    """A narrow strip has the stiffness of the inverse of A, B and D."""
    e1, e2, nu, g, rho = 1.4e11, 9e9, 0.3, 5e9, 1600.0
    angles, layer = (0.0, 90.0, 45.0, 0.0), DEPTH / 4
    cards = [
        *strip(30, 2, (LENGTH, WIDTH), tail=",0.0"),
        f"MAT8,1,{e1},{e2},{nu},{g},{g},{g},{rho}",
        "PCOMP,1,,,,,,,",
        *(f",1,{layer},{angles[k]},,1,{layer},{angles[k + 1]}," for k in (0, 2)),
    ]
    sid = body(tmp_path, bulk(*cards))
    share = 1 - nu**2 * e2 / e1
    law = np.array([[e1, nu * e2, 0], [nu * e2, e2, 0], [0, 0, g * share]]) / share
    total = np.zeros((6, 6))
    for k, angle in enumerate(np.radians(angles)):
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array(
            [[c * c, s * s, c * s], [s * s, c * c, -c * s]]
            + [[-2 * c * s, 2 * c * s, c * c - s * s]]
        )
        own, low = turn.T @ law @ turn, -DEPTH / 2 + k * layer
        high = low + layer
        a, b, d = layer, (high**2 - low**2) / 2, (high**3 - low**3) / 3
        total += np.block([[a * own, b * own], [b * own, d * own]])
    bending = WIDTH / np.linalg.inv(total)[3, 3]
    expected = beam_hertz(bending, rho * WIDTH * DEPTH, BEAM[0])
    assert sid.mass == pytest.approx(rho * WIDTH * DEPTH * LENGTH, rel=1e-9)
    assert frequencies(sid)[0] == pytest.approx(expected, rel=1e-2)


def layered_strip(
    count: int, rows: int, width: float, *cards: str, triangles: bool
) -> str:
    """The material axis x is along the strip."""
    axes = (",".join(map(repr, v)) for v in TURN[:, [2, 0]].T.tolist())
    shells = strip(count, rows, (LENGTH, width), triangles=triangles, tail=",5")
    system = "CORD2R,5,,0.,0.,0.," + "\n,".join(axes)
    return bulk(*shells, system, "PCOMP,1,,,,,,,", *cards)


@pytest.mark.parametrize("triangles", [False, True])
def test_a_coarse_sandwich_bends_and_shears_as_a_cantilever(
    triangles: bool, tmp_path: Path
) -> None:
    """P L^3/(3 E I) + P L/(G A) with two skins on a soft core."""
    stiff, skin, core, g, width = 2e11, 0.001, 0.04, 4e7, 0.1
    deck = layered_strip(
        *(10, 1, width, f",1,{skin},,,2,{core},,\n,1,{skin},"),
        f"MAT8,1,{stiff},{stiff},,{stiff / 2},,,1600.",
        f"MAT8,2,100.,100.,,50.,{g},{g},100.",
        triangles=triangles,
    )
    fem = finite_element_model(read_model(model(tmp_path, deck)))
    stiffness, along = fem.stiffness.toarray(), fem.positions @ TURN[:, 0]
    free = fem.dof_table[along > 1e-9].ravel()
    tip = fem.dof_table[along > LENGTH - 1e-9][:, :3]
    load, moved = np.zeros((2, len(stiffness)))
    load[tip] = TURN[:, 2] / len(tip)
    moved[free] = np.linalg.solve(stiffness[np.ix_(free, free)], load[free])
    bending = stiff * skin * (core + skin) ** 2 / 2
    shear = g * (core + skin) ** 2 / core
    expected = (LENGTH**3 / (3 * bending) + LENGTH / shear) / width
    assert load @ moved == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("triangles", [False, True])
def test_stiff_fibres_do_not_lock_a_coarse_plate(
    triangles: bool, tmp_path: Path
) -> None:
    """Free motions w = y g(x) of a square with fibres along y, which they do not
    bend; g by polynomials (Ritz). The shear is rigid (1e15 Pa).
    """
    e, g, depth, rho = 5e9, 2.5e9, 0.004, 1000.0
    law = f"MAT8,1,{40 * e},{e},,{g},1.+15,1.+15,{rho}"
    cards = (f",1,{depth},90.", law)
    sid = body(tmp_path, layered_strip(6, 6, LENGTH, *cards, triangles=triangles))
    x, weights = np.polynomial.legendre.leggauss(12)
    weights = weights / 2
    basis = [np.polynomial.Legendre.basis(k) for k in range(8)]
    shapes, slopes, bends = (
        np.array([2**order * p.deriv(order)(x) for p in basis]) for order in range(3)
    )
    mass = rho * depth / 12 * (weights * shapes) @ shapes.T
    twisted = 4 * g * depth**3 / 12 * (weights * slopes) @ slopes.T
    bent = e * depth**3 / 12 / 12 * (weights * bends) @ bends.T
    values = scipy.linalg.eigh(twisted + bent, mass, eigvals_only=True)
    expected = np.sqrt(values[1:3]) / (2 * np.pi)
    assert_allclose(frequencies(sid)[[0, 2]], expected, rtol=0.06)


def test_where_the_nodes_of_a_plate_lie_does_not_matter(tmp_path: Path) -> None:
    """An offset (ZOFFS), and the same law by MID1, MID2 and MID4."""
    side, depth, offset = 0.4, 0.004, 0.003
    plain = strip(6, 6, (side, side))
    moved = strip(6, 6, (side, side), tail=f",,{offset}")
    simple = f"PSHELL,1,1,{depth},1,,1"
    q = E / (1 - NU**2)
    rows = (q, NU * q, 0.0, q, 0.0, G)
    bend = 1 + 12 * offset**2 / depth**2
    laws = [
        f"MAT2,{k},{','.join(repr(factor * x) for x in rows)},{RHO * (k == 2)}"
        for k, factor in ((2, 1.0), (3, bend), (4, offset / depth))
    ]
    mixed = f"PSHELL,1,2,{depth},3,,1\n,,,4"
    own, away, by_law = (
        body(tmp_path, bulk(*cards, MATERIAL))
        for cards in ([*plain, simple], [*moved, simple], [*plain, mixed, *laws])
    )
    assert_allclose(frequencies(away), frequencies(own), rtol=2e-3)
    assert own.mass == pytest.approx(away.mass, rel=1e-12)
    # the mass of `mixed` stays in the surface of the nodes
    assert_allclose(frequencies(by_law)[:3], frequencies(own)[:3], rtol=3e-3)


def test_skins_on_a_core_of_solids_make_a_sandwich(tmp_path: Path) -> None:
    height, count = 0.02, 24
    steps = (count, 1, 2)
    number = {at: i + 1 for i, at in enumerate(np.ndindex(*(n + 1 for n in steps)))}
    size = np.array([LENGTH, WIDTH, height])
    cards = [grid(n, np.array(at) / steps * size, TURN) for at, n in number.items()]
    around = ((0, 0), (1, 0), (1, 1), (0, 1))
    label = 0
    for i, j, k in np.ndindex(*steps):
        label += 1
        nodes = [number[i + a, j + b, k + c] for c in (0, 1) for a, b in around]
        words = list(map(str, nodes))
        cards.append(f"CHEXA,{label},2,{','.join(words[:6])}\n,{','.join(words[6:])}")
    for i, k in product(range(count), (0, 2)):
        label += 1
        nodes = [number[i + a, b, k] for a, b in around]
        cards.append(f"CQUAD4,{label},1,{','.join(map(str, nodes))}")
    soft, light = E / 10, 500.0
    cards += [
        f"PSHELL,1,1,{DEPTH},1,,1",
        "PSOLID,2,2",
        f"MAT1,2,{soft!r},,0.0,{light}",
        MATERIAL,
    ]
    sid = body(tmp_path, bulk(*cards), modes=4)
    heavy = WIDTH * (light * height + 2 * RHO * DEPTH)
    assert sid.mass == pytest.approx(heavy * LENGTH, rel=1e-9)
    assert not with_code(sid, "N129")
    skin = 2 * WIDTH * (DEPTH * (height / 2) ** 2 + DEPTH**3 / 12)
    upright = E * skin + soft * WIDTH * height**3 / 12
    bending = beam_hertz(upright, heavy, BEAM[0])
    # Timoshenko: 1/f^2 = 1/f_b^2 + 1/f_s^2 to first order, shear of the core alone
    shear = soft / 2 * WIDTH * height
    slender = (BEAM[0] / LENGTH) ** 2 * upright / shear
    expected = bending / np.sqrt(1 + slender)
    closest = np.abs(frequencies(sid) / expected - 1).min()
    assert closest < 1e-2


@pytest.mark.parametrize(
    ("held", "hinged"),
    [(["CQUAD4,9,1,3,7,6,2"], False), (["CBAR,9,3,3,7,0.,1.,0."], True), ([], True)],
)
def test_a_shell_that_ends_at_a_solid_is_hinged_there(
    held: list[str], hinged: bool, tmp_path: Path
) -> None:
    """But not where it continues along the solid; nodes 3 and 2 are its edge."""
    corners = [(0, 0, 0), (0, 1, 0), (0, 1, 1), (0, 0, 1)]
    corners += [(-1, 0, 0), (-1, 1, 0), (-1, 1, 1), (-1, 0, 1)]
    corners += [(1, 1, 0), (1, 1, 1)]
    cards = [grid(n, np.array(at) * 0.1) for n, at in enumerate(corners, 1)]
    cards += ["CHEXA,1,2,1,2,3,4,5,6\n,7,8", "CQUAD4,2,1,2,9,10,3", *held]
    cards += [f"PSHELL,1,1,{DEPTH},1,,1", "PSOLID,2,1", MATERIAL]
    cards += ["PBAR,3,1,1.-4,1.-9,1.-9,2.-9"]
    path = tmp_path / "deck.bdf"
    path.write_text(bulk(*cards), encoding="utf-8")
    found = _hinges(read_bdf(path, bending=True))
    assert [d.data["limit"] for d in found] == [
        f"hinged at {nodes} of solids ({names})"
        for nodes, names in [("1 node", "2") if held else ("2 nodes", "2, 3")]
        if hinged
    ]


def test_two_masses_on_a_bushing_vibrate_as_two_rigid_bodies(tmp_path: Path) -> None:
    stiffness = (1e4, 2e4, 3e4, 40.0, 50.0, 60.0)
    masses = ((2.0, (0.01, 0.02, 0.03)), (3.0, (0.04, 0.03, 0.02)))
    places = np.array([[0.0, 0, 0], [0.1, 0.2, -0.1]])
    cards = [grid(i, place) for i, place in enumerate(places, 1)]
    cards += [
        f"CONM2,{10 + i},{i},,{m},,,,,\n,{a},,{b},,,{c}"
        for i, (m, (a, b, c)) in enumerate(masses, 1)
    ]
    cards += [
        f"PBUSH,5,K,{','.join(map(str, stiffness))}",
        "CBUSH,1,5,1,2,,,,0\n,0.25",
    ]
    sid = body(tmp_path, bulk(*cards), modes=6)
    joint = 0.75 * places[0] + 0.25 * places[1]
    rows = []
    for place, sign in zip(places, (1, -1), strict=True):
        x, y, z = joint - place
        arm = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
        rows.append(sign * np.block([[np.eye(3), arm], [np.zeros((3, 3)), np.eye(3)]]))
    relative = np.hstack(rows)
    k = relative.T @ np.diag(stiffness) @ relative
    m = np.diag([x for mass, own in masses for x in (mass, mass, mass, *own)])
    expected = np.sqrt(scipy.linalg.eigvalsh(k, m)[6:]) / (2 * np.pi)
    assert_allclose(frequencies(sid), expected, rtol=1e-9)


def test_a_mean_motion_is_that_of_the_path_of_solids(tmp_path: Path) -> None:
    """RBE3 with a mass beside a weak spring, and the same without one."""
    steps = (4, 1, 1)
    number = {at: i + 1 for i, at in enumerate(np.ndindex(*(n + 1 for n in steps)))}
    size = np.array([0.4, 0.05, 0.06])
    cards = [grid(n, np.array(at) / steps * size) for at, n in number.items()]
    pieces = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6))
    pieces += ((0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))
    around = ((0, 0), (1, 0), (1, 1), (0, 1))
    for i, piece in product(range(steps[0]), pieces):
        nodes = [number[i + a, b, c] for c in (0, 1) for a, b in around]
        words = ",".join(str(nodes[k]) for k in piece)
        cards.append(f"CTETRA,{len(cards) + 1000},2,{words}")
    face = [str(number[steps[0], b, c]) for b in (0, 1) for c in (0, 1)]
    cards += [
        "PSOLID,2,1",
        grid(900, [0.5, 0.04, 0.02]),
        f"RBE3,901,,900,123456,1.,123,{face[0]},{face[1]}\n,{face[2]},{face[3]}",
        "CONM2,902,900,,3.,0.01,0.02,,\n,0.01,,0.02,,,0.03",
        MATERIAL,
    ]
    weak = f"CELAS2,903,1.-3,{number[0, 0, 0]},1,{number[4, 0, 0]},1"
    own, other = (body(tmp_path, bulk(*cards, *more), modes=6) for more in ([], [weak]))
    assert other.mass == pytest.approx(own.mass, rel=1e-9)
    assert_allclose(frequencies(other)[:3], frequencies(own)[:3], rtol=1e-6)


def test_springs_to_the_ground_name_nodes(tmp_path: Path) -> None:
    cards = [*strip(2, 2, (0.2, 0.2)), f"PSHELL,1,1,{DEPTH},1,,1", MATERIAL]
    plain = body(tmp_path, bulk(*cards))
    held = body(tmp_path, bulk(*cards, "CELAS2,99,1.+6,1,3"))
    assert any("CELAS2_99" in note.line for note in with_code(held, "N112"))
    assert_allclose(frequencies(held), frequencies(plain), rtol=1e-12)


@pytest.mark.parametrize(
    ("cards", "message"),
    [
        (["CELAS2,99,1.+6,1,2,9,2"], "turn or move a free body"),
        (["CBUSH,99,5,1,2"], "has the property 5"),
        (["CQUAD4,98,1,1,2,3,1"], "no area"),
        (["MAT8,7,1.+9,1.+9,0.3", "PCOMP,7\n,7,0.01"], "MAT8 7"),
        (["PSHELL,7,1,0.01,8", "CTRIA3,98,7,1,2,4"], "the material 8"),
        (["PBUSH,7,K,RIGID"], "RIGID"),
        (["PSHELL,7,3,0.01", "MAT1,3,1.+9,,.3", "CTRIA3,98,7,1,2,4"], "no complete"),
    ],
)
def test_unsupported_structures_are_refused(
    cards: list[str], message: str, tmp_path: Path
) -> None:
    plate = [*strip(2, 2, (0.2, 0.2)), f"PSHELL,1,1,{DEPTH},1,,1", MATERIAL]
    with pytest.raises(InputError, match=message):
        body(tmp_path, bulk(*plate, *cards))


def test_elements_with_stiff_normals_are_shells_too(tmp_path: Path) -> None:
    cards = [*strip(2, 2, (0.2, 0.2)), f"PSHELL,1,1,{DEPTH},1,,1", MATERIAL]
    text = bulk(*cards)
    own, other = (
        frequencies(body(tmp_path, t)) for t in (text, text.replace("QUAD4", "QUADR"))
    )
    assert_allclose(other, own, rtol=1e-12)


@pytest.mark.parametrize("triangles", [False, True])
def test_a_corner_may_have_no_thickness(triangles: bool, tmp_path: Path) -> None:
    """Elements whose thickness falls to zero have the mass of its mean."""
    zero = ",,,\n,,,0.0,0.0,0.004" if triangles else ",,\n,,,0.0,0.0,0.004,0.004"
    cards = strip(4, 4, (0.4, 0.4), triangles=triangles, tail=zero)
    sid = body(tmp_path, bulk(*cards, "PSHELL,1,1,0.004,1,,1", MATERIAL))
    mean = 0.004 / 3 if triangles else 0.002
    assert sid.mass == pytest.approx(RHO * 0.4**2 * mean, rel=1e-9)


@pytest.mark.parametrize("zero", ["0.0", "0.", "0"])
def test_corners_without_any_thickness_take_that_of_the_property(
    zero: str, tmp_path: Path
) -> None:
    cards = strip(2, 2, (0.4, 0.4), tail=",,\n,,," + ",".join([zero] * 4))
    sid = body(tmp_path, bulk(*cards, "PSHELL,1,1,0.004,1,,1", MATERIAL))
    assert sid.mass == pytest.approx(RHO * 0.4**2 * 0.004, rel=1e-9)


@pytest.mark.parametrize("count", [4, 12])
def test_a_tiny_stiff_element_makes_no_mechanism_of_a_plate(
    count: int, tmp_path: Path
) -> None:
    """A wire of 0.1 um at its corner leaves a plate its frequencies.

    Its eigenvalues are 1e17 times those of the plate.
    """
    plate = [*strip(count, count, (0.4, 0.4)), "PSHELL,1,1,0.004,1,,1"]
    last = (count + 1) ** 2
    wire = [
        grid(last + 1, [0.4, 0.4, 1e-7], TURN),
        f"CBAR,9999,9,{last},{last + 1},1.,0.,0.",
        "PBAR,9,1,1e-16,1e-33,1e-33,2e-33",
    ]
    without = frequencies(body(tmp_path, bulk(*plate, MATERIAL)))
    assert_allclose(
        frequencies(body(tmp_path, bulk(*plate, *wire, MATERIAL))), without, rtol=1e-6
    )


def test_membranes_resist_no_motion_out_of_their_plane(tmp_path: Path) -> None:
    """A box girder of rods and of membranes (PSHELL with MID1 alone), and the bar with
    its bending and shear stiffness: the webs alone carry the shear.
    """
    count, length, side, area, t = 40, 8.0, 0.2, 4e-4, 1e-3
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    cards = [
        grid(4 * i + k + 1, [length * i / count, side / 2 * y, side / 2 * z], TURN)
        for i in range(count + 1)
        for k, (y, z) in enumerate(corners)
    ]
    label = 0
    for i in range(count + 1):
        ring = [4 * i + k + 1 for k in range(4)]
        label += 1
        cards.append(f"CQUAD4,{label},2,{','.join(map(str, ring))}")
        for a, b in zip(ring, ring[1:] + ring[:1], strict=True) if i < count else ():
            label += 2
            cards.append(f"CQUAD4,{label - 1},1,{a},{b},{b + 4},{a + 4}")
            cards.append(f"CROD,{label},3,{a},{a + 4}")
    cards += [f"PSHELL,1,1,{t}", f"PSHELL,2,2,{t}", f"PROD,3,1,{area}", MATERIAL]
    cards.append(f"MAT1,2,{E!r},,{NU},1.-3")
    box = body(tmp_path, bulk(*cards), modes=2)
    wall = t * side
    inertia = area * side**2 + wall * side**2 / 2 + wall * side**2 / 6
    section = 4 * area + 4 * wall
    share = 2 * wall / section
    bar = [grid(i + 1, [length * i / count, 0, 0]) for i in range(count + 1)]
    bar += [f"CBAR,{i + 1},1,{i + 1},{i + 2},0.,1.,0." for i in range(count)]
    bar += [f"PBAR,1,1,{section!r},{inertia!r},{inertia!r},{2 * inertia!r}"]
    bar += [",,,,,,,,", f",{share!r},{share!r}", MATERIAL]
    line = body(tmp_path, bulk(*bar), modes=2)
    assert_allclose(box.mass, line.mass, rtol=1e-4)
    assert_allclose(frequencies(box), frequencies(line), rtol=5e-3)


def layered_shear(folder: Path, plies: str, *materials: str) -> np.ndarray:
    """Transverse shear stiffness (2, 2) of a square of a PCOMP."""
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    cards = [grid(k, corner) for k, corner in enumerate(corners, 1)]
    cards += ["CQUAD4,1,1,1,2,3,4", f"PCOMP,1{plies}", *materials]
    (folder / "one.bdf").write_text(bulk(*cards), encoding="utf-8")
    (shell,) = read_bdf(folder / "one.bdf", bending=True).shells
    return np.asarray(shell.section.shear)


@pytest.mark.parametrize("bottom", ["", "0.", "-.02"])
def test_plies_of_one_material_shear_like_a_plate(bottom: str, tmp_path: Path) -> None:
    """5/6 G t, of three plies in other directions and wherever the nodes are."""
    plies = f",{bottom},,,,,,,\n,1,.002,,,1,.005,30.,\n,1,.003,90."
    shear = layered_shear(tmp_path, plies, MATERIAL)
    assert_allclose(shear, 5 / 6 * G * 0.01 * np.eye(2), rtol=1e-12, atol=1e-3)


def test_the_core_of_a_sandwich_carries_its_shear(tmp_path: Path) -> None:
    """G d^2/c between thin stiff skins (H. G. Allen, "Analysis and design of
    structural sandwich panels", 1969), with both moduli of a honeycomb.
    """
    skin, core, g1, g2 = 1e-4, 0.02, 4e8, 2e8
    plies = f",,,,,,,,\n,1,{skin},,,2,{core},,\n,1,{skin},"
    honeycomb = f"MAT8,2,1000.,1000.,.25,1000.,{g1!r},{g2!r},72."
    shear = layered_shear(tmp_path, plies, MATERIAL, honeycomb)
    expected = np.diag([g1, g2]) * (core + skin) ** 2 / core
    assert_allclose(shear, expected, rtol=1e-4, atol=1.0)


def test_layers_without_a_membrane_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        layered_shear(tmp_path, ",,,,,,,BEND,\n,1,.01,", MATERIAL)
    assert "BEND" in error.value.problem


def test_a_mechanism_is_refused_with_its_place(tmp_path: Path) -> None:
    """A rod that hangs at a corner of a plate is held along itself alone."""
    text = bulk(
        *strip(4, 4, (0.4, 0.4)),
        grid(900, [0.4, 0.4, 0.3], TURN),
        "CROD,900,2,25,900",
        f"PSHELL,1,1,{DEPTH},1,,1",
        "PROD,2,1,1.-4",
        MATERIAL,
    )
    with pytest.raises(InputError) as error:
        body(tmp_path, text)
    x, y, z = TURN @ [0.4, 0.4, 0.3]
    assert f"({x:.4g}, {y:.4g}, {z:.4g}) m" in error.value.problem


def test_a_plate_without_a_membrane_is_refused_by_name(tmp_path: Path) -> None:
    cards = strip(4, 4, (0.4, 0.4), turn=np.eye(3))
    with pytest.raises(InputError) as error:
        body(tmp_path, bulk(*cards, f"PSHELL,1,,{DEPTH},1", MATERIAL))
    assert "PSHELL 1" in error.value.problem and "MID1" in str(error.value.expected)


def halves(*links: str, gap: float = 0.0, unit: float = 1.0) -> str:
    """Two halves of a beam of CBAR, the second one behind a gap, and their links."""
    count = 8
    step = LENGTH / (2 * count) / unit
    first = [[i * step, 0.0, 0.0] for i in range(count + 1)]
    second = [[LENGTH / 2 / unit + gap + i * step, 0.0, 0.0] for i in range(count + 1)]
    places = np.array([*first, *second]) @ TURN.T
    up = ",".join(repr(float(x)) for x in TURN[:, 2])
    ends = [*range(1, count + 1), *range(count + 2, 2 * count + 2)]
    bars = [f"CBAR,{k},1,{k},{k + 1},{up}" for k in ends]
    cards = [grid(i, x) for i, x in enumerate(places, 1)]
    area, moment = 1e-4 / unit**2, 1e-9 / unit**4
    section = f"PBAR,1,1,{area!r},{moment!r},{moment!r},{2 * moment!r}"
    steel = f"MAT1,1,{E * unit**2!r},,{NU!r},{RHO * unit**4!r}"
    return bulk(*cards, *bars, *links, section, steel if unit != 1 else MATERIAL)


DIRECT = tuple(f"MPC,9,10,{d},1.,9,{d},-1." for d in range(1, 7))


def test_plates_whose_solids_take_minutes_have_own_shells(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """S8R has 21 unknowns by each corner; `order` asks for them."""
    monkeypatch.setattr(shells, "is_installed", lambda: True)
    monkeypatch.setattr(shells, "_LARGEST_MESH", 21 * 6)
    reasons = []
    for count in (2, 3):
        cards = strip(count, 1, (LENGTH, WIDTH), turn=np.eye(3))
        path = tmp_path / "part.bdf"
        path.write_text(bulk(*cards, "PSHELL,1,1,.01,1,,1", MATERIAL), encoding="utf-8")
        reasons += [
            shells.beyond_calculix(path, (), order=order) for order in (None, 2)
        ]
    assert [bool(reason) for reason in reasons] == [False, False, True, False]
    assert str(21 * 8) in reasons[2]
