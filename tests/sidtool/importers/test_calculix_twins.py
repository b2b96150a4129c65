"""Every element beside its twin in CalculiX, on parts as engineers draw them.

`benchmarks/elements.py` has all elements on all parts, finer, with converged values.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.elements.solid_elements import (
    elasticity,
    element_stiffness,
    mapped_batch,
    with_incompatible_modes,
)
from sidtool.elements.solid_mesh import SolidMesh
from sidtool.mesh.mesh import ElementBlock, Mesh
from sidtool.mesh.reference_elements import reference_element
from tests.metamorphic.parts.meshes import STEEL

from ..elements.drawn_parts import Part, drawn_part
from .decks import MATERIAL, STEEL as STEEL_OF_DECK, body, calculix, frequencies, listed
from .twins import ELEMENTS, by_calculix, by_sidtool, calculix_matrices

CASES = [
    ("bracket", "tet4"),
    ("bracket", "hex8 full"),
    ("rod", "hex20"),
    ("rod", "wedge15"),
    ("arm", "tet10"),
    ("arm", "wedge15"),
    ("thin arm", "tet10"),
    ("thin arm", "wedge15"),
]
#: Where CalculiX extrapolates stresses in another way, one or the other is nearer.
OTHER_STRESS = ("hex8 full",)


@pytest.mark.needs("ccx")
@pytest.mark.parametrize(("part", "element"), CASES)
def test_no_element_is_stiffer_than_its_twin(
    tmp_path: Path, part: str, element: str
) -> None:
    """tet10 and wedge15 were up to 2.5 % stiffer.

    CalculiX' masses of simplices and prisms are integrated by few points, so that its
    moments of inertia and its higher frequencies may be off.
    """
    drawing = drawn_part(part, ELEMENTS[element][0], 1)
    own, twin = by_sidtool(drawing, element), by_calculix(drawing, element, tmp_path)
    assert own.mass == pytest.approx(twin.mass, rel=1e-9)
    assert (own.frequencies < 1.001 * twin.frequencies).all()
    assert own.deflection == pytest.approx(twin.deflection, rel=1e-3)
    assert own.frequencies[0] == pytest.approx(twin.frequencies[0], rel=0.01)
    if element not in OTHER_STRESS:
        assert own.von_mises == pytest.approx(twin.von_mises, rel=1e-3)


@pytest.mark.needs("ccx")
@pytest.mark.parametrize("part", ["rod", "arm", "thin arm"])
def test_linear_prisms_are_nearer_to_hex20_than_their_twin(
    tmp_path: Path, part: str
) -> None:
    """C3D6 has two points, so that a single one twists freely; ours bend and twist."""
    drawing = drawn_part(part, "wedge6", 1)
    own, twin = by_sidtool(drawing, "wedge6"), by_calculix(drawing, "wedge6", tmp_path)
    best = by_sidtool(drawn_part(part, "hex20", 2), "hex20")
    mine, theirs = (x.frequencies / best.frequencies for x in (own, twin))
    assert own.mass == pytest.approx(twin.mass, rel=1e-9)
    assert (mine > 1).all() and (mine < theirs + 0.015).all()
    assert mine.mean() < theirs.mean()


@pytest.mark.needs("ccx")
@pytest.mark.parametrize(
    ("part", "element"), [("rod", "tet4"), ("rod", "tet10"), ("bracket", "wedge15")]
)
def test_what_is_left_is_the_mass_by_few_points(
    tmp_path: Path, part: str, element: str
) -> None:
    """Frequencies of public decks of C3D10 and C3D15 were 1.2e-1 and 4.1e-3 off, and
    not explained. CalculiX integrates their mass by the points of their stiffness,
    which makes rods of few elements lighter in rotation; masses here are exact."""
    drawing = drawn_part(part, ELEMENTS[element][0], 1)
    twin = by_calculix(drawing, element, tmp_path)
    exact, few = by_sidtool(drawing, element), by_sidtool(drawing, element, few=True)
    assert_allclose(few.frequencies, twin.frequencies, rtol=3e-5)
    assert_allclose(few.inertia, twin.inertia, rtol=1e-6)
    assert np.abs(exact.frequencies / twin.frequencies - 1).max() > 1e-4


@pytest.mark.needs("ccx")
@pytest.mark.parametrize("part", ["rod", "bracket", "arm", "thin arm"])
def test_incompatible_modes_on_drawn_parts(tmp_path: Path, part: str) -> None:
    """None further from hex20 than C3D8I, but for the deflection of the bracket and the
    mode that goes with it, which C3D8I overrates by 5 %, too: they cross the converged
    value with finer cells. With three internal modes f1 of the rod was 3 % and the
    deflection of the thin arm 10 % off."""
    drawing = drawn_part(part, "hex8", 1)
    own, twin = by_sidtool(drawing, "hex8"), by_calculix(drawing, "hex8", tmp_path)
    best = by_sidtool(drawn_part(part, "hex20", 4 if part == "bracket" else 2), "hex20")
    values = [np.append(x.frequencies, x.deflection) for x in (own, twin, best)]
    mine, theirs = (np.abs(x / values[2] - 1) for x in values[:2])
    crossing = [2, 6] if part == "bracket" else []
    assert (np.delete(mine - theirs, crossing) < 1e-3).all()
    assert (mine[crossing] < theirs[crossing] + 6.5e-3).all()
    assert own.von_mises == pytest.approx(twin.von_mises, rel=1e-2)
    assert_allclose(own.inertia, twin.inertia, rtol=1e-9)
    if part in ("rod", "thin arm"):
        wrong = {"rod": (0, 0.02), "thin arm": (6, 0.06)}[part]
        assert mine[wrong[0]] < wrong[1] < theirs[wrong[0]]


@pytest.mark.needs("ccx")
@pytest.mark.parametrize("seed", [1, 2])
def test_what_c3d8i_does_otherwise(seed: int, tmp_path: Path) -> None:
    """It has three internal modes and leaves the mean in their slopes, so that uniform
    stress does work on them. Of one skewed element; reference: its own matrices."""
    cube = reference_element("hex8")
    shift = np.random.default_rng(seed).uniform(-0.15, 0.15, cube.nodes.shape)
    positions = cube.nodes + shift
    whole, _ = calculix_matrices(_alone(positions), "hex8", tmp_path)
    inner = np.linalg.solve(whole[24:, 24:], whole[24:, :24])
    theirs = whole[:24, :24] - whole[:24, 24:] @ inner
    full, _ = calculix_matrices(_alone(positions), "hex8 full", tmp_path)

    nodes, basis = np.arange(8)[None], (cube.values[None], cube.gradients[None])
    batch = mapped_batch(nodes, positions, *basis, cube.weights)
    own = with_incompatible_modes(batch, positions, cube)
    centre = np.linalg.inv(positions.T @ cube.at(np.full((1, 3), 0.5))[1][0])
    with_mean = (1 - 2 * cube.points)[None, :, :, None] * centre
    other = replace(own, internal=with_mean, directions=np.eye(9)[None])
    law, size = elasticity(STEEL, "solid"), np.abs(full).max()
    linear = (positions @ np.random.default_rng(seed).normal(size=(3, 3))).ravel()
    (found,) = element_stiffness(own, law)
    assert_allclose(found @ linear, full @ linear, atol=1e-9 * size)
    (found,) = element_stiffness(other, law)
    assert_allclose(found, theirs, atol=1e-9 * size)
    forces = np.linalg.norm(full @ linear)
    assert np.linalg.norm((theirs - full) @ linear) > 1e-3 * forces


@pytest.mark.needs("ccx")
@pytest.mark.parametrize("seed", [3, 4])
def test_inertia_of_internal_modes(seed: int, tmp_path: Path) -> None:
    """Of one sheared box: C3D8I's mass with its internal modes condensed statically.

    Its rule of two points makes 4/9 of the mean of (1 - xi^2)^2, which is 8/15.
    """
    cube = reference_element("hex8")
    shear = np.random.default_rng(seed).uniform(-0.3, 0.3, (3, 3))
    positions = cube.nodes @ (np.eye(3) + shear)
    part = _alone(positions)
    stiffness, mass = calculix_matrices(part, "hex8", tmp_path)
    mass[range(24, 33), range(24, 33)] *= 6 / 5
    inner = -np.linalg.solve(stiffness[24:, 24:], stiffness[24:, :24])
    follow = np.vstack([np.eye(24), inner])
    solids = SolidMesh(part.mesh, {None: STEEL}, "solid", incompatible_modes=True)
    expected = follow.T @ mass @ follow
    own, _ = solids.matrices()
    assert_allclose(own.toarray(), expected, atol=1e-9 * np.abs(expected).max())


def _alone(positions: np.ndarray) -> Part:
    """One hexahedron."""
    nodes, none = np.arange(8)[None], np.zeros(0, np.int64)
    mesh = Mesh(positions, (ElementBlock("hex8", nodes, np.array([1])),))
    return Part(mesh, none, none, 0, np.zeros(3))


def test_inertia_is_that_of_the_geometry() -> None:
    """A ring of rectangular section about its own axis, on elements of every kind."""
    inner, outer, depth, turn = 0.108, 0.132, 0.012, 0.75 * np.pi
    expected = 7850 * depth * turn * (outer**4 - inner**4) / 4
    for element in ("tet10", "wedge15", "hex20"):
        own = by_sidtool(drawn_part("arm", ELEMENTS[element][0], 1), element)
        assert_allclose(own.inertia[2], expected, rtol=1e-4)


def plate8(thickness: float) -> str:
    """Eight by four CPS8 of plane stress, held on its left."""
    n, m, size = 16, 8, 0.005
    places = [(i, j) for j in range(m + 1) for i in range(n + 1) if i * j % 2 == 0]
    number = {place: k for k, place in enumerate(places, 1)}
    ring = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]
    rows = [
        [number[i + a, j + b] for a, b in ring]
        for j in range(0, m, 2)
        for i in range(0, n, 2)
    ]
    nodes = "".join(f"{k}, {size * i}, {size * j}\n" for (i, j), k in number.items())
    elements = "".join(
        ", ".join(map(str, [k, *row])) + "\n" for k, row in enumerate(rows, 1)
    )
    return (
        f"*NODE\n{nodes}*ELEMENT, TYPE=CPS8, ELSET=E\n{elements}"
        + listed("LEFT", [k for (i, _), k in number.items() if i == 0])
        + MATERIAL.format(**STEEL_OF_DECK)
        + f"*SOLID SECTION, ELSET=E, MATERIAL=S\n{thickness}\n"
    )


@pytest.mark.needs("ccx")
def test_plane_stress_is_that_of_thin_solids(tmp_path: Path) -> None:
    """CalculiX makes solids of plane elements, whose thickness moves: what differs
    goes with the thickness, and is no property of plane stress."""
    differences = []
    for thickness in (0.02, 0.005, 0.00125):
        text = plate8(thickness)
        own = frequencies(body(tmp_path, text, held="LEFT"))[:3]
        found = calculix(tmp_path, text, "LEFT")[:3]
        differences.append(np.abs(found / own - 1).max())
    assert differences[0] > 3e-3
    assert differences[1] < 0.15 * differences[0]
    assert differences[2] < 0.2 * differences[1]
