"""The mass and the centre of a beam from the polynomials of its section."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial

from sidtool.formats.model.geometry import BeamGeometry, GeneralSection

from .geometry_mass import GeometryMass


def beam_mass(geometry: BeamGeometry, density: float) -> GeometryMass:
    """Of the area over the length, integrated term by term, and lumped masses."""
    start, end = np.array(geometry.start), np.array(geometry.end)
    area = _area(geometry)
    weight = density * float(np.linalg.norm(end - start))
    mass, moment = weight * _integral(area), weight * _integral(area * _ALONG)
    for lump in geometry.masses:
        mass, moment = mass + lump.mass, moment + lump.mass * lump.at
    first = mass * start + moment * (end - start)
    return GeometryMass(mass, first, sampled=area.degree() > EXACT)


#: Degree of the area up to which elements of any length have the exact moments.
EXACT = 6
_ALONG = Polynomial([0.0, 1.0])


def _area(geometry: BeamGeometry) -> Polynomial:
    """The cross-section over the fraction of the length."""
    section = geometry.section
    if isinstance(section, GeneralSection):
        return Polynomial([section.area])
    return _run(section.height) * _run(section.width)


def _run(values: float | tuple[float, ...]) -> Polynomial:
    """The polynomial through values at equal distances."""
    if not isinstance(values, tuple):
        return Polynomial([values])
    x = np.linspace(0.0, 1.0, len(values))
    return Polynomial(np.linalg.solve(np.vander(x, increasing=True), values))


def _integral(polynomial: Polynomial) -> float:
    return float(polynomial.integ()(1.0))
