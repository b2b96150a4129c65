"""Every element beside its twin in CalculiX, on parts as engineers draw them.

`benchmarks/elements.py` has all elements on all parts, finer, with converged values.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from sidtool.frontends.elements.internal_modes import internal_slopes
from sidtool.frontends.elements.reference import reference_element
from sidtool.frontends.elements.solid import (
    elasticity,
    element_stiffness,
    mapped_batch,
)
from sidtool.frontends.mesh.data import ElementBlock, Mesh

from ...metamorphic.parts import STEEL
from ..frontends.drawn_parts import Part, drawn
from .twins import ELEMENTS, by_calculix, by_sidtool, calculix_matrices

CASES = [
    ("bracket", "tet4"),
    ("bracket", "hex8 full"),
    ("rod", "hex20"),
    ("rod", "wedge6"),
    ("rod", "wedge15"),
    ("arm", "tet10"),
    ("arm", "wedge15"),
    ("thin arm", "tet10"),
    ("thin arm", "wedge6"),
    ("thin arm", "wedge15"),
]
#: Where CalculiX extrapolates stresses in another way, one or the other is nearer.
OTHER_STRESS = ("hex8 full", "wedge6")


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
@pytest.mark.parametrize(("part", "element"), CASES)
def test_no_element_is_stiffer_than_its_twin(
    tmp_path: Path, part: str, element: str
) -> None:
    """tet10 and wedge15 were up to 2.5 % stiffer, wedge6 up to 20 %.

    CalculiX' masses of simplices and prisms are integrated by few points, so that its
    moments of inertia and its higher frequencies may be off.
    """
    drawing = drawn(part, ELEMENTS[element][0], 1)
    own, twin = by_sidtool(drawing, element), by_calculix(drawing, element, tmp_path)
    assert own.mass == pytest.approx(twin.mass, rel=1e-9)
    assert (own.frequencies < 1.001 * twin.frequencies).all()
    assert own.deflection == pytest.approx(twin.deflection, rel=1e-3)
    assert own.frequencies[0] == pytest.approx(twin.frequencies[0], rel=0.01)
    if element not in OTHER_STRESS:
        assert own.von_mises == pytest.approx(twin.von_mises, rel=1e-3)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
@pytest.mark.parametrize("seed", [1, 2])
def test_what_c3d8i_does_otherwise(seed: int, tmp_path: Path) -> None:
    """It takes the slopes of the internal modes by the Jacobian at the centre alone,
    without the ratio of determinants that makes uniform stress do no work on them, and
    gives them inertia. Of one skewed element; reference: its own matrices."""
    cube = reference_element("hex8")
    shift = np.random.default_rng(seed).uniform(-0.15, 0.15, cube.nodes.shape)
    positions, nodes = cube.nodes + shift, np.arange(8)[None]
    mesh = Mesh(positions, (ElementBlock("hex8", nodes, np.array([1])),))
    none, probe = np.zeros(0, np.int64), np.zeros(3)
    part = Part(mesh, none, none, 0, probe)
    whole, mass = calculix_matrices(part, "hex8", tmp_path)
    inner = np.linalg.solve(whole[24:, 24:], whole[24:, :24])
    theirs = whole[:24, :24] - whole[:24, 24:] @ inner
    full, _ = calculix_matrices(part, "hex8 full", tmp_path)
    assert np.abs(mass[24:, 24:]).max() > 0.1 * np.abs(mass[:24, :24]).max()

    basis = cube.values[None], cube.gradients[None]
    batch = mapped_batch(nodes, positions, *basis, cube.weights)
    determinants = batch.measures / cube.weights
    slopes = internal_slopes(cube, positions[nodes], cube.points, determinants)
    centre = np.linalg.det(positions.T @ cube.at(np.full((1, 3), 0.5))[1][0])
    unscaled = slopes * (determinants / centre)[..., None, None]
    law, size = elasticity(STEEL, "solid"), np.abs(full).max()
    linear = (positions @ np.random.default_rng(seed).normal(size=(3, 3))).ravel()
    for used, expected in ((slopes, full @ linear), (unscaled, theirs @ linear)):
        (own,) = element_stiffness(replace(batch, internal=used), law)
        assert_allclose(own @ linear, expected, atol=1e-9 * size)
    assert_allclose(own, theirs, atol=1e-9 * size)
    forces = np.linalg.norm(full @ linear)
    assert np.linalg.norm((theirs - full) @ linear) > 1e-3 * forces


def test_inertia_is_that_of_the_geometry() -> None:
    """A ring of rectangular section about its own axis, on elements of every kind."""
    inner, outer, depth, turn = 0.108, 0.132, 0.012, 0.75 * np.pi
    expected = 7850 * depth * turn * (outer**4 - inner**4) / 4
    for element in ("tet10", "wedge15", "hex20"):
        own = by_sidtool(drawn("arm", ELEMENTS[element][0], 1), element)
        assert_allclose(own.inertia[2], expected, rtol=1e-4)
