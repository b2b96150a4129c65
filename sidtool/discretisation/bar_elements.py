"""Bars and rods between nodes, by the degrees of freedom of their ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.taylor import Array
from sidtool.formats.sid_mass import skew

from ..beams.axis import AxisFrames, straight_axis
from ..beams.cross_section import Section
from ..beams.element import (
    GAUSS_POINTS,
    GAUSS_WEIGHTS,
    BeamElement,
    BeamProperties,
    ElementRows,
    scatter_rows,
)
from ..elements.finite_element_model import BeamOutline
from ..mesh.connections import RawBar, SectionProfile
from ..mesh.unit_systems import UnitSystem

Indices = NDArray[np.int64]


#: Relative stiffness below which a pinned direction has none.
_PIN_STIFFNESS_TOLERANCE = 1e-11


@dataclass(frozen=True, eq=False)
class BarElement(BeamElement):
    """A straight beam whose ends are fixed to nodes.

    Attributes
    ----------
    ends : (12, k) motion of its ends by the degrees of freedom of the nodes
    """

    ends: Array

    def rows_at(self, places: Array, frames: AxisFrames) -> tuple[ElementRows, ...]:
        """Return the rows by the degrees of freedom of the nodes."""
        centroid_rows = super().rows_at(places, frames)
        return tuple(
            ElementRows(*(part @ self.ends for part in rows)) for rows in centroid_rows
        )

    def stiffness(self) -> Array:
        """(k, k) in the axes of the model."""
        return np.asarray(self.ends.T @ super().stiffness() @ self.ends)


@dataclass(frozen=True, eq=False)
class RodElement(BarElement):
    """A rod: a bar that resists stretch and twist only and stays straight."""

    def rows_at(self, places: Array, frames: AxisFrames) -> tuple[ElementRows, ...]:
        return tuple(map(self._rows, places.tolist(), frames.axes[:, 0]))

    def _rows(self, place: float, x: Array) -> ElementRows:
        section = self.section(place)
        assert isinstance(section, Section)
        share, slope = np.array([1 - place, place]), np.array([-1.0, 1.0]) / self.length
        move, turn = np.zeros((2, 3, 12))
        change, twist = np.zeros((3, 12)), np.zeros(12)
        for k, at in enumerate((0, 6)):
            move[:, at : at + 3] = share[k] * np.eye(3)
            change[:, at : at + 3] = slope[k] * np.eye(3)
            turn[:, at + 3 : at + 6] = share[k] * np.outer(x, x)
            twist[at + 3 : at + 6] = slope[k] * x
        turn += skew(x) @ change
        strains = np.zeros((6, 12))
        strains[0], strains[3] = x @ change, twist
        law = np.zeros(6)
        law[0] = self.beam.e * section.area
        law[3] = self.beam.g * section.torsion
        element_rows = ElementRows(move, turn, strains, law[:, None] * strains)
        return ElementRows(*(rows @ self.ends for rows in element_rows))

    def stiffness(self) -> Array:
        weights = GAUSS_WEIGHTS * self.length
        parts = zip(self.gauss_rows, weights, strict=True)
        total = sum(w * rows.resultants.T @ rows.strains for rows, w in parts)
        return np.asarray(total)


def make_bar_element(
    bar: RawBar, places: Array, ends: Array, units: UnitSystem
) -> BarElement:
    """The element of a bar in SI units.

    Parameters
    ----------
    places : (2, 3) of its ends [m]
    ends : (12, k) as in `BarElement`

    Raises
    ------
    InputError : the bar has no length, or its y axis is parallel to it.
    """
    stress = units.mass / units.length / units.time**2
    size = float(np.linalg.norm(places[1] - places[0]))
    if size == 0:
        raise InputError(
            f"element {bar.label} has no length",
            place=bar.place,
            expected="two places",
        )
    y_axis = bar.y_axis
    if y_axis is None:
        y_axis = tuple(np.eye(3)[np.argmin(np.abs(places[1] - places[0]))].tolist())
    try:
        axis = straight_axis(places[0], places[1], y_axis)
    except InputError:
        raise InputError(
            f"the y axis of element {bar.label} lies along it",
            place=bar.place,
            expected="a direction across it",
        ) from None
    section = bar_section(bar, units.length)
    beam = BeamProperties(section, axis, bar.e * stress, bar.g * stress, True)
    if bar.y_axis is None:
        return RodElement(beam, 0.0, 1.0, ends)
    if any(bar.pins):
        ends = _release_pins(BeamElement(beam, 0.0, 1.0), bar) @ ends
    return BarElement(beam, 0.0, 1.0, ends)


def _release_pins(element: BeamElement, bar: RawBar) -> Array:
    """(12, 12) motion of the ends by that of the nodes, which pins do not pass on.

    The released directions follow from the others without forces (static
    condensation): q_r = -K_rr^-1 K_ri q_i.

    Raises
    ------
    InputError : the bar moves freely between its pins.
    """
    axes = element.frames(np.zeros(1)).axes[0]
    turn = np.kron(np.eye(4), axes)
    k = turn @ element.stiffness() @ turn.T
    free = [d - 1 + 6 * end for end in (0, 1) for d in bar.pins[end]]
    held = [d for d in range(12) if d not in free]
    inner = k[np.ix_(free, free)]
    size = np.sqrt(inner.diagonal())
    if np.linalg.cond(inner / np.outer(size, size)) > 1 / _PIN_STIFFNESS_TOLERANCE:
        raise InputError(
            f"element {bar.label} moves freely between its pins "
            f"{' and '.join(''.join(map(str, pins)) or '0' for pins in bar.pins)}",
            place=bar.place,
            expected="ends that hold it",
        )
    follow = np.eye(12)
    follow[np.ix_(free, free)] = 0.0
    follow[np.ix_(free, held)] = -np.linalg.solve(inner, k[np.ix_(free, held)])
    return np.asarray(turn.T @ follow @ turn)


def bar_outline(
    element: BarElement, dofs: Indices, ndof: int, pieces: int
) -> BeamOutline:
    """The bar in so many pieces, as it bends."""
    places = np.linspace(0.0, 1.0, pieces + 1)
    frames = element.frames(places)
    rows = element.rows_at(places, frames)
    motion = np.concatenate([part for row in rows for part in row[:2]])
    halves = np.array([element.section(place).halves for place in places.tolist()])
    return BeamOutline(
        frames.places, frames.axes[:, 1:], halves, scatter_rows(motion, dofs, ndof)
    )


def bar_section(bar: RawBar, length: float) -> Callable[[float], Section]:
    """The cross-section by the fraction of the length, `length` the unit in m."""
    given = bar.section

    def section(fraction: float) -> Section:
        return Section(
            evaluate_profile(given.area, fraction) * length**2,
            evaluate_profile(given.iy, fraction) * length**4,
            evaluate_profile(given.iz, fraction) * length**4,
            evaluate_profile(given.torsion, fraction) * length**4,
            *given.shear,
        )

    if given.uniform:
        constant = section(0.0)
        return lambda fraction: constant
    return section


def evaluate_profile(profile: SectionProfile, fraction: float) -> float:
    """Return the value of a profile, 0 for an empty one."""
    if not profile:
        return 0.0
    places, values = zip(*profile, strict=True)
    return float(np.interp(fraction, places, values))


def extra_masses(bar: RawBar, element: BarElement, units: UnitSystem) -> Array:
    """Return the non-structural masses (p,) of a bar at `GAUSS_POINTS` [kg]."""
    values = np.array(
        [evaluate_profile(bar.section.extra, float(at)) for at in GAUSS_POINTS]
    )
    return np.asarray(
        GAUSS_WEIGHTS * element.length * values * units.mass / units.length
    )
