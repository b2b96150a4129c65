"""Pins, bars that resist one bending only, and sections that stand askew."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.discretisation.bar_elements import bar_of_deck
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import SID
from sidtool.importers.nastran.bar_sections import section_of
from sidtool.importers.nastran.bulk_data import read_bdf
from sidtool.mesh.unit_systems import unit_system
from sidtool.pipeline.model_to_sid import sid_from_model
from tests.codes import only

from ..decks import frequencies
from .decks import AREA, IY, IZ, MATERIAL, RHO, TORSION, E, body, bulk, grids, model

pytestmark = pytest.mark.filterwarnings("ignore")

PINNED, CLAMPED = np.pi**2, 22.3733
#: The corners of a triangle of sides 1 and how many bars make a side.
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0.5, np.sqrt(0.75), 0]])
SIDES, COUNT = ((0, 1), (1, 2), (2, 0)), 6
#: Rotations that turn its plane out of the axes of the model.
TILT = np.linalg.qr(np.array([[0.9, 0.2, -0.3], [0.1, 0.8, 0.5], [0.4, -0.3, 0.8]]))[0]


def bernoulli(factor: float, second_moment: float, length: float = 1.0) -> float:
    stiff = np.sqrt(E * second_moment / (RHO * AREA))
    return float(factor / (2 * np.pi * length**2) * stiff)


#: Of what holds the corners.
STIFF = f"PBAR,2,1,{4 * AREA!r},{16 * IZ!r},{16 * IY!r},{16 * TORSION!r}"


def triangle(
    pbar: str, pins: tuple[str, str], turn: Any = None, *, stubs: bool = False
) -> str:
    """Bars whose y axis is the normal of the plane, pinned at the corners.

    Parameters
    ----------
    stubs : whether short bars along the normal lead from the corners to a triangle of
        bars without pins
    """
    turn = np.eye(3) if turn is None else turn
    places, cards = list(CORNERS), list[str]()
    up = ",".join(map(repr, (turn @ [0.0, 0.0, 1.0]).tolist()))
    for a, b in SIDES:
        numbers = [a + 1]
        for k in range(1, COUNT):
            places.append(CORNERS[a] + (CORNERS[b] - CORNERS[a]) * k / COUNT)
            numbers.append(len(places))
        numbers.append(b + 1)
        for k, (first, last) in enumerate(zip(numbers, numbers[1:], strict=False)):
            ends = (pins[0] * (k == 0), pins[1] * (k == COUNT - 1))
            label = len(cards) + 1
            cards.append(f"CBAR,{label},1,{first},{last},{up}\n,{ends[0]},{ends[1]}")
    for corner in range(3 if stubs else 0):
        places.append(CORNERS[corner] + [0.0, 0.0, 1e-3])
        label = len(cards) + 1
        cards.append(f"CBAR,{label},2,{corner + 1},{len(places)},1.,0.,0.")
    for a, b in SIDES if stubs else ():
        first = len(places) - 2
        cards.append(f"CBAR,{len(cards) + 1},2,{first + a},{first + b},{up}")
    return bulk(*grids(np.array(places) @ turn.T), *cards, pbar, STIFF, MATERIAL)


def held(folder: Path, text: str, modes: int) -> SID:
    """The body with its three stubs fixed."""
    first = 3 + 3 * (COUNT - 1)
    markers = {
        name: {"node": k, "mesh_node": first + k} for k, name in enumerate("abc", 1)
    }
    reduction: dict[str, Any] = {"method": "modal", "modes": modes, "fix": list("abc")}
    frame = {"type": "tangent", "marker": "a"}
    return sid_from_model(
        model(folder, text, markers=markers, reduction=reduction, frame=frame)
    )


#: The y axis is the normal: plane 1 is out of the plane, I1 for it; plane 2 in it.
PBAR = f"PBAR,1,1,{AREA!r},{IZ!r},{IY!r},{TORSION!r}"


@pytest.mark.parametrize(
    ("pins", "out_of_plane"),
    [(("5", "5"), CLAMPED), (("56", "56"), PINNED), (("456", "56"), PINNED)],
)
def test_pinned_sides_of_a_triangle_vibrate_as_pinned_beams(
    tmp_path: Path, pins: tuple[str, str], out_of_plane: float
) -> None:
    """In the plane pi^2, out of it 22.37, or pi^2 where both rotations are pinned."""
    sid = held(tmp_path, triangle(PBAR, pins, stubs=True), 6)
    pairs = ((PINNED, IY), (out_of_plane, IZ))
    expected = np.sort([bernoulli(f, i) for f, i in pairs for _ in range(3)])
    assert_allclose(frequencies(sid), expected, rtol=3e-3)


def test_pins_do_not_depend_on_the_axes_of_the_model(tmp_path: Path) -> None:
    """The free triangle, whose corner rotations no bar resists, tilted in space."""
    markers = {"p": {"node": 1, "mesh_node": 5}}
    straight, tilted = (
        sid_from_model(
            model(tmp_path, triangle(PBAR, ("5", "5"), turn), markers=markers)
        )
        for turn in (None, TILT)
    )
    assert_allclose(frequencies(tilted), frequencies(straight), rtol=1e-5)
    assert frequencies(straight)[0] > 0.3 * bernoulli(PINNED, IY)


def test_coupling_in_some_directions_is_a_hinge(tmp_path: Path) -> None:
    """RBE2 without the rotation about the normal, between nodes at one place: a pin."""
    markers = {"p": {"node": 1, "mesh_node": 5}}
    pinned = triangle(PBAR, ("", "5"))
    text, cards = triangle(PBAR, ("", "")), []
    for a, b in SIDES:
        last = (COUNT - 1) * (a + 1) + 3
        label, copy = COUNT * (a + 1), 900 + b
        row = next(x for x in text.splitlines() if x.startswith(f"CBAR,{label},"))
        text = text.replace(
            row, row.replace(f",1,{last},{b + 1},", f",1,{last},{copy},")
        )
        place = ",".join(map(repr, CORNERS[b].tolist()))
        cards += [f"GRID,{copy},,{place}", f"RBE2,{copy},{b + 1},12345,{copy}"]
    text = text.replace("ENDDATA", "\n".join([*cards, "ENDDATA"]))
    found, expected = (
        frequencies(sid_from_model(model(tmp_path, t, markers=markers)))
        for t in (text, pinned)
    )
    assert_allclose(found, expected, rtol=1e-5)


def test_ball_joint_at_an_arm(tmp_path: Path) -> None:
    """RBE2 of displacements over a distance: a rigid arm with a ball at its end."""
    places = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0.3), (0.2, 0.1, 0.0)]
    bars = [
        f"CBAR,{k},1,{a},{b},0.3,0.1,0.9"
        for k, (a, b) in enumerate(((1, 2), (2, 3), (3, 4), (4, 5)), 1)
    ]
    single = [*grids(places), *bars, "RBE2,9,1,123,5"]
    copy = [*grids([*places, places[4]]), *bars]
    double = [*copy, "RBE2,8,1,123456,6", "RBE2,9,6,123,5"]
    found, expected = (
        frequencies(sid_from_model(model(tmp_path, bulk(*cards, PBAR, MATERIAL))))
        for cards in (single, double)
    )
    assert_allclose(found, expected, rtol=1e-6)
    rigid = [*grids(places), *bars, "RBE2,9,1,123456,5"]
    stiffer = frequencies(sid_from_model(model(tmp_path, bulk(*rigid, PBAR, MATERIAL))))
    assert (found <= stiffer * (1 + 1e-9)).all()
    assert found[0] < 0.99 * stiffer[0]


def test_bar_without_stiffness_about_an_axis_is_a_tie_in_that_plane(
    tmp_path: Path,
) -> None:
    """A triangle of one bar a side: in its plane it stretches alone, as three rods."""
    up = "0.,0.,1."
    bars = [f"CBAR,{k},1,{a + 1},{b + 1},{up}" for k, (a, b) in enumerate(SIDES, 1)]
    stiff = 1e-9
    soft = f"PBAR,1,1,{AREA!r},{stiff!r},,{stiff!r}"
    text = bulk(*grids(CORNERS), *bars, soft, MATERIAL)
    sid = sid_from_model(model(tmp_path, text, modes=9))
    # Reference: three rods in the plane with consistent mass, assembled here.
    k, m = np.zeros((6, 6)), np.zeros((6, 6))
    for a, b in SIDES:
        x = CORNERS[b, :2] - CORNERS[a, :2]
        pull = np.concatenate([-x, x])
        dofs = [2 * a, 2 * a + 1, 2 * b, 2 * b + 1]
        k[np.ix_(dofs, dofs)] += E * AREA * np.outer(pull, pull)
        mass = np.kron([[2, 1], [1, 2]], np.eye(2)) * RHO * AREA / 6
        m[np.ix_(dofs, dofs)] += mass
    values = np.linalg.eigvals(np.linalg.solve(m, k)).real
    expected = np.sqrt(np.sort(values)[3:]) / (2 * np.pi)
    found = frequencies(sid)
    for f in expected:
        assert np.abs(found / f - 1).min() < 2e-3


def askew(folder: Path, product: float) -> SID:
    """A clamped beam along x of a section with I12."""
    count = 10
    places = [(k / count, 0.0, 0.0) for k in range(count + 1)]
    bars = [f"CBAR,{k},1,{k},{k + 1},0.,1.,0." for k in range(1, count + 1)]
    pbar = f"PBAR,1,1,{AREA!r},{IZ!r},{IY!r},{TORSION!r}\n,\n,,,{product!r}"
    markers = {
        "a": {"node": 1, "mesh_node": 1},
        "b": {"node": 2, "mesh_node": count + 1},
    }
    reduction = {"method": "modal", "modes": 4, "fix": ["a"]}
    frame = {"type": "tangent", "marker": "a"}
    text = bulk(*grids(places), *bars, pbar, MATERIAL)
    path = model(folder, text, markers=markers, reduction=reduction, frame=frame)
    return sid_from_model(path)


@pytest.mark.parametrize("product", [2e-13, -2e-13, 1e-14])
def test_section_with_a_product_of_inertia_bends_about_its_principal_axes(
    tmp_path: Path, product: float
) -> None:
    """Frequencies by the principal moments, and where the softest one bends to."""
    tensor = np.array([[IZ, product], [product, IY]])
    moments, axes = np.linalg.eigh(tensor)
    sid = askew(tmp_path, product)
    factors = np.array([1.875104, 4.694091]) ** 2
    expected = np.sort([bernoulli(f, i) for f in factors for i in moments])
    assert_allclose(frequencies(sid), expected, rtol=2e-3)
    tip = sid.nodes[1].phi.m0[1:, 0]
    along = axes[:, 0]  # where the section is thin
    assert abs(tip @ along) == pytest.approx(np.linalg.norm(tip), rel=1e-6)


#: Type of section, sizes, and the plates (width along z, height along y, y, z) of it.
SHAPES: dict[str, tuple[list[float], list[tuple[float, float, float, float]]]] = {
    "I": ([10, 6, 4, 1, 2, 1.5], [(6, 2, 1, 0), (1, 6.5, 5.25, 0), (4, 1.5, 9.25, 0)]),
    "I1": ([4, 1, 6, 10], [(5, 2, 4, 0), (1, 6, 0, 0), (5, 2, -4, 0)]),
    "T": ([8, 10, 2, 1], [(8, 2, 9, 0), (1, 8, 4, 0)]),
    "T1": ([8, 6, 2, 1], [(2, 8, 0, 1), (6, 1, 0, 5)]),
    "T2": ([8, 10, 2, 1], [(8, 2, 1, 0), (1, 8, 6, 0)]),
    "CHAN": ([5, 10, 1, 2], [(1, 10, 0, 0.5), (4, 2, 4, 3), (4, 2, -4, 3)]),
    "CHAN1": ([4, 1, 6, 10], [(1, 10, 0, 0.5), (4, 2, 4, 3), (4, 2, -4, 3)]),
    "CHAN2": ([1, 2, 10, 8], [(8, 2, 1, 0), (1, 8, 6, 3.5), (1, 8, 6, -3.5)]),
    "H": ([6, 4, 10, 1], [(2, 10, 0, 4), (2, 10, 0, -4), (6, 1, 0, 0)]),
    "CROSS": ([6, 2, 10, 1], [(2, 10, 0, 0), (3, 1, 0, 2.5), (3, 1, 0, -2.5)]),
    "BOX1": (
        [8, 10, 1, 2, 0.5, 1.5],
        [(8, 1, 9.5, 0), (8, 2, 1, 0), (0.5, 7, 5.5, -3.75), (1.5, 7, 5.5, 3.25)],
    ),
    "HAT": (
        [10, 1, 8, 3],
        [
            (8, 1, 9.5, 0),
            (1, 8, 5, 3.5),
            (1, 8, 5, -3.5),
            (4, 1, 0.5, 5),
            (4, 1, 0.5, -5),
        ],
    ),
}


@pytest.mark.parametrize("kind", SHAPES)
def test_sections_of_plates_have_the_moments_of_their_area(kind: str) -> None:
    """By summing over a fine raster of the drawn section."""
    sizes, plates = SHAPES[kind]
    step = 0.05
    cells = []
    for w, h, y, z in plates:
        across = np.arange(z - w / 2 + step / 2, z + w / 2, step)
        up = np.arange(y - h / 2 + step / 2, y + h / 2, step)
        cells.append(np.array(np.meshgrid(up, across)).reshape(2, -1))
    y, z = np.hstack(cells)
    found = section_of(kind, sizes)
    area = step**2 * len(y)
    assert found.area == pytest.approx(area, rel=1e-6)
    assert found.iz == pytest.approx(step**2 * ((y - y.mean()) ** 2).sum(), rel=2e-3)
    assert found.iy == pytest.approx(step**2 * ((z - z.mean()) ** 2).sum(), rel=2e-3)
    if kind != "BOX1":
        thin = sum(max(w, h) * min(w, h) ** 3 / 3 for w, h, _, _ in plates)
        assert found.torsion == pytest.approx(thin)
    else:  # Bredt: 4 A^2 / sum of s / t
        around = 7 / 1 + 7 / 2 + 8.5 / 0.5 + 8.5 / 1.5
        assert found.torsion == pytest.approx(4 * (7 * 8.5) ** 2 / around)


def test_pins_are_about_the_axes_of_the_bar_and_not_of_its_section(
    tmp_path: Path,
) -> None:
    """A bar along x whose y axis is y: a hinge about z passes on no moment about z."""
    product = 2e-13
    pbar = f"PBAR,1,1,{AREA!r},{IZ!r},{IY!r},{TORSION!r}\n,\n,,,{product!r}"
    bar = "CBAR,1,1,1,2,0.,1.,0.\n,,6"
    (tmp_path / "part.bdf").write_text(
        bulk(*grids([(0, 0, 0), (1, 0, 0)]), bar, pbar, MATERIAL), encoding="utf-8"
    )
    (raw,) = read_bdf(tmp_path / "part.bdf").bars
    found = bar_of_deck(raw, np.array([[0, 0, 0], [1, 0, 0]]), unit_system("SI"))
    stiffness = found.element(np.eye(12)).stiffness()
    assert_allclose(stiffness[11], 0.0, atol=1e-9 * E * IZ)
    # A moment about y bends both ways: curvature My I1 / (E (I1 I2 - I12^2)).
    tip = np.linalg.inv(stiffness[6:11, 6:11])
    expected = IZ / (E * (IY * IZ - product**2))
    assert tip[4, 4] == pytest.approx(expected, rel=1e-9)


def test_pins_beside_a_hinge_about_a_principal_axis_are_refused(tmp_path: Path) -> None:
    """I12 squared is I1 times I2: no stiffness about an axis between y and z."""
    pbar = f"PBAR,1,1,{AREA!r},{IZ!r},{IZ!r},{TORSION!r}\n,\n,,,{IZ!r}"
    bar = "CBAR,1,1,1,2,0.,1.,0.\n,,6"
    (tmp_path / "part.bdf").write_text(
        bulk(*grids([(0, 0, 0), (1, 0, 0)]), bar, pbar, MATERIAL), encoding="utf-8"
    )
    with pytest.raises(InputError, match="CBAR 1"):
        read_bdf(tmp_path / "part.bdf")


@pytest.mark.parametrize("axis", [(0.3, -0.5, 0.8), (1.0, 0.0, 0.0)])
def test_bars_on_one_line_without_torsion_turn_about_it_as_one(
    axis: tuple[float, float, float], tmp_path: Path
) -> None:
    """They bend as those with torsion do, and have the same inertia."""
    places = np.outer([0.0, 0.3, 0.7, 1.0], axis)
    bars = [f"CBAR,{k},1,{k},{k + 1},0.1,0.9,0." for k in (1, 2, 3)]
    pbar = f"PBAR,1,1,{AREA!r},{IZ!r},{IY!r}"
    cards = [*grids(places), *bars, MATERIAL]
    rigid, twisted = (
        body(tmp_path, bulk(*cards, pbar + end)) for end in ("", f",{TORSION!r}")
    )
    assert "J = 0" in str(only(rigid, "N112").data)
    size = np.abs(twisted.J.m0).max()
    assert_allclose(rigid.J.m0, twisted.J.m0, atol=1e-12 * size)
    assert_allclose(frequencies(rigid)[:4], frequencies(twisted)[:4], rtol=1e-9)
