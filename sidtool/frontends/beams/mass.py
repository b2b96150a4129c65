"""The mass and the centre of a beam by integrals along its axis."""

from __future__ import annotations

import numpy as np

from sidtool.formats.model.beams import BeamGeometry, GeneralSection

from ..geometry_mass import GeometryMass
from .axis import Axis
from .section import section_at, side
from .stations import Profile, profile

#: Degree of the area up to which elements of any length have the exact moments.
EXACT = 6
#: Gauss points of a panel of an axis, and the least number of panels.
_POINTS, _PANELS = 16, 32


def beam_mass(geometry: BeamGeometry, axis: Axis, density: float) -> GeometryMass:
    """Of the area over the length, and lumped masses."""
    area, first = _area(geometry), np.zeros(3)
    mass = density * axis.length * area.integral()
    x, w = np.polynomial.legendre.leggauss(_POINTS)
    edges = np.union1d(np.linspace(0.0, 1.0, _PANELS + 1), area.edges)
    sizes = np.diff(edges)[:, None]
    at = (edges[:-1, None] + sizes * (x + 1) / 2).ravel()
    weights = density * axis.length * (sizes * w / 2).ravel()
    frames = axis.at(at)
    first = (weights * area(at)) @ frames.places
    for i, fraction in enumerate(at if not axis.straight else ()):
        section = section_at(geometry, fraction)
        arm = section.centre(frames.curvatures[i])
        first += weights[i] * section.area * arm @ frames.axes[i]
    for lump in geometry.masses:
        mass += lump.mass
        first += lump.mass * axis.at(np.array([lump.at])).places[0]
    sampled = not axis.straight or area.degree > EXACT
    return GeometryMass(mass, first, sampled=sampled)


def _area(geometry: BeamGeometry) -> Profile:
    """The cross-section over the fraction of the length."""
    section = geometry.section
    if isinstance(section, GeneralSection):
        return profile(section.area, "linear")
    return side(geometry, "height") * side(geometry, "width")
