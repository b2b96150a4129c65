"""Bars and rods between nodes, by the degrees of freedom of their ends."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from sidtool.formats.base.complex_step import number_type
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
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

    def rows_at(self, places: Array, frames: AxisFrames) -> ElementRows:
        """Return the rows by the degrees of freedom of the nodes."""
        centroid_rows = super().rows_at(places, frames)
        return ElementRows(*(part @ self.ends for part in centroid_rows))

    def stiffness(self) -> Array:
        """(k, k) in the axes of the model."""
        return np.asarray(self.ends.T @ super().stiffness() @ self.ends)

    def end_forces(self) -> Array:
        """(12, k) forces and moments on its ends in the axes of the model."""
        return np.asarray(BeamElement.stiffness(self) @ self.ends)


@dataclass(frozen=True, eq=False)
class RodElement(BarElement):
    """A rod: a bar that resists stretch and twist only and stays straight."""

    def rows_at(self, places: Array, frames: AxisFrames) -> ElementRows:
        rows = map(self._rows, places.tolist(), frames.axes[:, 0])
        return ElementRows(*map(np.array, zip(*rows, strict=True)))

    def _rows(self, place: float, x: Array) -> ElementRows:
        """Return the rows (3, k) and (6, k) at one place."""
        section = self.section(place)
        assert isinstance(section, Section)
        share, slope = np.array([1 - place, place]), np.array([-1.0, 1.0]) / self.length
        kind = number_type(x, self.length)
        move, turn, change = np.zeros((3, 3, 12), kind)
        twist = np.zeros(12, kind)
        for k, at in enumerate((0, 6)):
            move[:, at : at + 3] = share[k] * np.eye(3)
            change[:, at : at + 3] = slope[k] * np.eye(3)
            turn[:, at + 3 : at + 6] = share[k] * np.outer(x, x)
            twist[at + 3 : at + 6] = slope[k] * x
        turn += skew(x) @ change
        strains = np.zeros((6, 12), kind)
        strains[0], strains[3] = x @ change, twist
        law = np.zeros(6)
        law[0] = self.beam.e * section.area
        law[3] = self.beam.g * section.torsion
        element_rows = ElementRows(move, turn, strains, law[:, None] * strains)
        return ElementRows(*(rows @ self.ends for rows in element_rows))

    def end_forces(self) -> Array:
        pulled = np.zeros((12, self.ends.shape[1]), number_type(self.ends))
        along = self.frames(np.array([0.5])).axes[0, 0]
        force = np.outer(along, GAUSS_WEIGHTS @ self.gauss_rows.resultants[:, 0])
        pulled[:3], pulled[6:9] = -force, force
        return pulled

    def stiffness(self) -> Array:
        weights, rows = GAUSS_WEIGHTS * self.length, self.gauss_rows
        resultants = weights[:, None, None] * rows.resultants
        return np.asarray((resultants.swapaxes(1, 2) @ rows.strains).sum(axis=0))


@dataclass(frozen=True, eq=False)
class Bar:
    """A part of a beam between two nodes, in SI units.

    Attributes
    ----------
    label : text for messages, as "element 12"
    nodes : labels of the nodes of its ends
    place : of its definition
    ends : (2, 3) of its ends [m], which the nodes hold by rigid arms
    beam, first, last : the beam and the fractions of its length
    density : of its sections [kg/m^3]; without effect on sections at stations
    rod : whether it resists stretch and twist only
    pins : directions 1 to 6 of the axes of its section that are released at either end
    extra : (p,) non-structural masses per length at `GAUSS_POINTS` [kg/m]
    """

    label: str
    nodes: tuple[int, int]
    place: str
    ends: Array
    beam: BeamProperties
    density: float
    first: float = 0.0
    last: float = 1.0
    rod: bool = False
    pins: tuple[tuple[int, ...], tuple[int, ...]] = ((), ())
    extra: Array | None = None

    def element(self, ends: Array) -> BarElement:
        """Return the element by the degrees of freedom of the nodes.

        Parameters
        ----------
        ends : (12, k) as in `BarElement`

        Raises
        ------
        InputError : it moves freely between its pins.
        """
        part = self.beam, self.first, self.last
        if self.rod:
            return RodElement(*part, ends)
        if any(self.pins):
            ends = _release_pins(BeamElement(*part), self) @ ends
        return BarElement(*part, ends)


def bar_of_deck(bar: RawBar, places: Array, units: UnitSystem) -> Bar:
    """Return a bar of a file in SI units.

    Parameters
    ----------
    places : (2, 3) of its nodes [m]

    Raises
    ------
    InputError : the bar has no length, or its y axis is parallel to it.
    """
    stress = units.mass / units.length / units.time**2
    ends = places + units.length * np.array(bar.offsets)
    if not (ends[1] - ends[0]).any():
        raise InputError(
            f"element {bar.label} has no length",
            place=bar.place,
            expected="two places",
        )
    y_axis = bar.y_axis
    if y_axis is None:
        y_axis = tuple(np.eye(3)[np.argmin(np.abs(ends[1] - ends[0]))].tolist())
    try:
        axis = straight_axis(ends[0], ends[1], y_axis, turn=bar.section.turn)
    except InputError:
        raise InputError(
            f"the y axis of element {bar.label} lies along it",
            place=bar.place,
            expected="a direction across it",
        ) from None
    section = bar_section(bar, units.length)
    profile = [evaluate_profile(bar.section.extra, float(at)) for at in GAUSS_POINTS]
    return Bar(
        label=f"element {bar.label}",
        nodes=bar.nodes,
        place=bar.place,
        ends=ends,
        beam=BeamProperties(section, axis, bar.e * stress, bar.g * stress, True),
        density=bar.density * units.mass / units.length**3,
        rod=bar.y_axis is None,
        pins=bar.pins,
        extra=np.array(profile) * units.mass / units.length,
    )


def _release_pins(element: BeamElement, bar: Bar) -> Array:
    """(12, 12) motion of the ends by that of the nodes, which pins do not pass on.

    The released directions follow from the others without forces (static
    condensation): q_r = -K_rr^-1 K_ri q_i.

    Raises
    ------
    InputError : the bar moves freely between its pins.
    """
    first, last = element.frames(np.array([0.0, 1.0])).section_axes
    turn = scipy.linalg.block_diag(first, first, last, last)
    k = turn @ element.stiffness() @ turn.T
    free = [d - 1 + 6 * end for end in (0, 1) for d in bar.pins[end]]
    held = [d for d in range(12) if d not in free]
    inner = k[np.ix_(free, free)]
    size = np.sqrt(inner.diagonal().real)
    if np.linalg.cond(inner / np.outer(size, size)) > 1 / _PIN_STIFFNESS_TOLERANCE:
        raise InputError(
            f"{bar.label} moves freely between its pins "
            f"{' and '.join(''.join(map(str, pins)) or '0' for pins in bar.pins)}",
            place=bar.place,
            expected="ends that hold it",
        )
    follow = np.eye(12, dtype=k.dtype)
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
    motion = np.hstack([rows.displacement, rows.rotation]).reshape(-1, len(dofs))
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
