"""A tight bar as a string: the regression case BeamModes of the FEDEM solver.

FEDEM lengthens the bar by its axial force, has no bending stiffness and lumps its mass.
Its Young's modulus is not printed in our source; 2.1e11 Pa, that of steel, explains its
frequencies to 1e-5, in all five.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.testing import assert_allclose

from sidtool.formats.base.sid import Array

from .slender import BOTH_ENDS, beam, hertz

LENGTH, RADIUS, MASS, TENSION = 100.0, 0.15, 556.580, 54.6e6  # m, m, kg/m, N
YOUNG, AREA = 2.1e11, np.pi * RADIUS**2
NUMBERS = np.arange(1, 6)
STRING = NUMBERS / (2 * LENGTH) * np.sqrt(TENSION / MASS)
FEDEM = (1.56311560, 3.12584543, 4.68780422, 6.24860620, 7.80786610)
#: A second moment of area without effect, of the circle [m^4].
LIMP, ROUND = 1e-7, np.pi * RADIUS**4 / 4


@cache
def tight(second: float, stretched: bool, mass: str) -> Array:
    """Five frequencies of the bar under its axial force, both ends held across [Hz]."""
    longer = 1 + TENSION / (YOUNG * AREA) if stretched else 1.0
    density = MASS / AREA / longer
    section = {"area": AREA, "iy": second, "iz": second}
    pulled = {"end": [TENSION, 0.0, 0.0], "start": [-TENSION, 0.0, 0.0]}
    ends = {"method": "craig_bampton", "interfaces": ["start", "end"], "modes": 26}
    none = dict.fromkeys(("acceleration", "angular_acceleration", "centrifugal"), False)
    sid = beam(
        LENGTH * longer,
        section,
        (YOUNG, 0.3, density),
        100,
        {
            "frame": BOTH_ENDS,
            "reduction": ends,
            "stiffening": none | {"markers": [], "prestress": {"forces": pulled}},
        },
        mass=mass,
    )
    return hertz(sid)[: 2 * len(NUMBERS) : 2]


def with_bending() -> Array:
    """Of a simply supported bar under tension [Hz]."""
    share = np.pi**2 * YOUNG * ROUND / (TENSION * LENGTH**2)
    return np.asarray(STRING * np.sqrt(1 + NUMBERS**2 * share))


def test_a_limp_bar_is_a_string() -> None:
    assert_allclose(tight(LIMP, False, "consistent"), STRING, rtol=2e-5)


def test_bending_raises_its_frequencies() -> None:
    assert_allclose(tight(ROUND, False, "consistent"), with_bending(), rtol=2e-5)


def test_the_stretched_bar_of_particles_is_that_of_fedem() -> None:
    assert_allclose(tight(LIMP, True, "lumped"), FEDEM, rtol=1e-5)
