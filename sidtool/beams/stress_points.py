"""Points of cross-sections at which the stress can be largest, and their stress rows.

Normal stress is that of stretch and bending, shear stress that of torsion. Sources of
the latter: closed form for circles and tubes; Bredt's flow for boxes; T t / J on the
faces of the walls of open sections; for rectangles the largest one, at the middle of
the longer sides (Roark's Formulas for Stress and Strain, 7th edition, table 10.1).
Shear stress of transverse forces is neglected: it vanishes at the outermost fibres.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.model.beams import (
    BeamGeometry,
    BoxSection,
    CircularSection,
    NamedSection,
    RectangularSection,
    TubeSection,
)
from sidtool.formats.sid_mass import skew

from ..elements.finite_element_model import BeamStress
from .cross_section import Section
from .element import BeamElement, ElementRows, Indices, RowCollector
from .section_shapes import named_properties, shape_of_section

#: Points on a circle.
_ANGLES = 16


@dataclass(frozen=True, eq=False)
class SectionPoints:
    """Points of a cross-section in its principal axes.

    Attributes
    ----------
    positions : (p, 2) y, z from the centroid [m]
    shear : (p, 2) shear stress along y, z per unit torque [1/m^3]
    """

    positions: Array
    shear: Array


def section_points(geometry: BeamGeometry, section: Section) -> SectionPoints:
    """Return the points of a section by its shape."""
    shape = geometry.section
    if isinstance(shape, RectangularSection):
        assert section.sides is not None
        return _rectangle_points(*section.sides)
    return _named_points(shape)  # type: ignore[arg-type]


def _rectangle_points(h: Any, w: Any) -> SectionPoints:
    """Corners, and the middles of the longer sides, where torsion has its peak."""
    positions = [(y * h / 2, z * w / 2) for y in (1, -1) for z in (1, -1)]
    shear: list[Any] = [(0.0, 0.0)] * 4
    a, b = (h, w) if h.real >= w.real else (w, h)
    ratio = b / a
    peak = 1 + 0.6095 * ratio + 0.8865 * ratio**2 - 1.8023 * ratio**3 + 0.91 * ratio**4
    peak = 3 / (a * b**2) * peak
    if h.real >= w.real:
        positions += [(0.0, w / 2), (0.0, -w / 2)]
        shear += [(-peak, 0.0), (peak, 0.0)]
    if w.real >= h.real:
        positions += [(h / 2, 0.0), (-h / 2, 0.0)]
        shear += [(0.0, peak), (0.0, -peak)]
    return SectionPoints(np.array(positions), np.array(shear))


@lru_cache(maxsize=64)
def _named_points(section: NamedSection) -> SectionPoints:
    found = named_properties(section, 0.0)
    if isinstance(section, CircularSection | TubeSection):
        angles = 2 * math.pi * np.arange(_ANGLES) / _ANGLES
        unit = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        positions = unit * (section.diameter / 2)
        across = np.stack([-positions[:, 1], positions[:, 0]], axis=1)
        return SectionPoints(positions, across / found.torsion)
    if isinstance(section, BoxSection):
        positions, shear = _box_points(section)
    else:
        positions, shear = _wall_points(section, found.torsion)
    turn = found.turn
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    moved = positions - np.array(found.centroid)
    return SectionPoints(moved @ axes.T, shear @ axes.T)


def _box_points(section: BoxSection) -> tuple[Array, Array]:
    h, w, t = section.height, section.width, section.thickness
    flow = 1 / (2 * (h - t) * (w - t) * t)
    positions = [(y * h / 2, z * w / 2) for y in (1, -1) for z in (1, 0, -1)]
    shear = [(0.0, flow)] * 3 + [(0.0, -flow)] * 3
    positions += [(0.0, w / 2), (0.0, -w / 2)]
    shear += [(-flow, 0.0), (flow, 0.0)]
    return np.array(positions), np.array(shear)


def _wall_points(section: NamedSection, torsion: Any) -> tuple[Array, Array]:
    """Corners of the walls without, and middles of their faces with shear stress."""
    positions: list[Any] = []
    shear: list[Any] = []
    for y, z, h, w in shape_of_section(section).plates:
        for up in (1, -1):
            positions += [(y + up * h / 2, z + side * w / 2) for side in (1, -1)]
            shear += [(0.0, 0.0)] * 2
            if h.real < w.real:
                positions.append((y + up * h / 2, z))
                shear.append((0.0, up * h / torsion))
            else:
                positions.append((y, z + up * w / 2))
                shear.append((-up * w / torsion, 0.0))
    return np.array(positions), np.array(shear)


class StressCollector:
    """Collects stress rows at the ends of elements."""

    def __init__(self, ndof: int) -> None:
        self._positions: list[Array] = []
        self._rows = [RowCollector(ndof) for _ in range(3)]

    def add(self, element: BeamElement, dofs: Indices, geometry: BeamGeometry) -> None:
        """The points of both ends of an element of a beam."""
        places = np.array([0.0, 1.0])
        frames = element.frames(places)
        at_ends = element.rows_at(places, frames)
        for k, rows in enumerate(map(ElementRows, *at_ends)):
            section = element.section(places[k])
            assert isinstance(section, Section)
            points = section_points(geometry, section)
            axes, (_, ky, kz) = frames.axes[k], frames.curvatures[k]
            torque = element.beam.g * section.torsion * rows.strains[3]
            for (y, z), tau in zip(points.positions, points.shear, strict=True):
                arm = y * axes[1] + z * axes[2]
                fibre = rows.strains[0] + z * rows.strains[4] - y * rows.strains[5]
                normal = element.beam.e * fibre / (1 + z * ky - y * kz)
                along = tau[0] * axes[1] + tau[1] * axes[2]
                moved = rows.displacement - skew(arm) @ rows.rotation
                stress = _components(axes[0], along, normal, torque)
                self._positions.append(frames.places[k] + arm)
                for kept, some in zip(
                    self._rows, (moved, rows.rotation, stress), strict=True
                ):
                    kept.add(some, dofs)

    def stress(self) -> BeamStress:
        move, turn, stress = (rows.matrix() for rows in self._rows)
        return BeamStress(np.array(self._positions), move, turn, stress)


def _components(x: Array, along: Array, normal: Array, torque: Array) -> Array:
    """(6, k) xx, yy, zz, xy, yz, xz of a normal stress along x, and a shear stress
    `along` per unit torque.
    """
    pairs = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
    rows = [
        x[a] * x[b] * normal + (x[a] * along[b] + along[a] * x[b]) * torque
        for a, b in pairs
    ]
    return np.array(rows)
