"""Every element beside its twin in CalculiX, on parts as engineers draw them.

`benchmarks/elements.py` has all elements on all parts, finer, with converged values.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from ..frontends.drawn_parts import drawn
from .twins import ELEMENTS, by_calculix, by_sidtool

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


def test_inertia_is_that_of_the_geometry() -> None:
    """A ring of rectangular section about its own axis, on elements of every kind."""
    inner, outer, depth, turn = 0.108, 0.132, 0.012, 0.75 * np.pi
    expected = 7850 * depth * turn * (outer**4 - inner**4) / 4
    for element in ("tet10", "wedge15", "hex20"):
        own = by_sidtool(drawn("arm", ELEMENTS[element][0], 1), element)
        assert_allclose(own.inertia[2], expected, rtol=1e-4)
