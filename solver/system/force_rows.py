"""Rows of the force table, eq. (16): the force as a function of its measure.

F = applied(t) - K(g - rest) - D(g') - friction tanh(g' / speed)
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.sid import Array
from sidtool.formats.scene import (
    Characteristic,
    SceneFile,
    marker_names,
    marker_reference,
)

from ..functions.callables import NativeCallable
from ..functions.function_table import RealData
from ..functions.piecewise import (
    NO_FEATURES,
    Features,
    add_corners,
    characteristic_features,
    friction_features,
)
from ..spatial import system_arrays as at
from ..spatial.system_arrays import IntTable
from .build_inputs import MarkerKey
from .joints import joint_primitives

#: The measure that is the coordinate of a primitive constraint.
_MEASURE_OF_PRIMITIVE = {
    at.ANGLE: at.ANGLE_MEASURE,
    at.DISPLACEMENT: at.DISPLACEMENT_MEASURE,
    at.DISTANCE: at.DISTANCE_MEASURE,
}


@dataclass(frozen=True, eq=False)
class ForcePolynomials:
    """A piecewise polynomial: starts (n,) and coefficients (n, terms), lowest first."""

    starts: Array
    terms: Array
    table_points: tuple[Array, Array] | None = None  # points of a table that they join

    def value(self, x: Array) -> Array:
        """Values at x, (nt,)."""
        if len(self.starts) == 0:
            return np.zeros_like(x)
        piece = np.maximum(np.searchsorted(self.starts, x, side="right") - 1, 0)
        total, local = np.zeros(x.shape), x - self.starts[piece]
        for column in self.terms.T[::-1]:
            total = total * local + column[piece]
        return total


NO_FORCE = ForcePolynomials(np.zeros(0), np.zeros((0, 0)))


@dataclass(frozen=True, eq=False)
class ForceLaw:
    """F = applied(t) - K(g - rest) - D(g') - friction tanh(g' / speed)."""

    rest: float = 0.0
    applied: float = 0.0
    friction: float = 0.0
    speed: float = 1.0
    stiffness: ForcePolynomials = NO_FORCE
    damping: ForcePolynomials = NO_FORCE

    def features(self) -> Features:
        """Of the force over the measure, which no step may skip."""
        curve = self.stiffness

        def value(g: Array) -> Array:
            return curve.value(g - self.rest)

        if curve.table_points is None:
            return characteristic_features(value, self.rest + curve.starts)
        x, force = curve.table_points
        known = characteristic_features(value, self.rest + x)
        return add_corners(known, self.rest + x, force)

    def rate_features(self) -> Features:
        """Of the force over the rate of the measure, likewise."""
        if self.friction == 0.0:
            return NO_FEATURES
        return friction_features(self.speed)

    def passive_force(self, g: float, rate: float) -> float:
        """Force of spring, damper and friction at one measure and its rate."""
        spring = self.stiffness.value(np.array([g - self.rest]))[0]
        damper = self.damping.value(np.array([rate]))[0]
        friction = self.friction * math.tanh(rate / self.speed)
        return float(-spring - damper - friction)

    def packed(self) -> Array:
        """Return its numbers in the order of `dynamics.force_law`."""
        sizes = [*self.stiffness.terms.shape, *self.damping.terms.shape]
        head = [self.rest, self.applied, self.friction, self.speed, *sizes]
        parts = [self.stiffness, self.damping]
        rows = [np.concatenate([p.starts, p.terms.ravel()]) for p in parts]
        return np.concatenate([head, *rows])


def polynomial_force(values: tuple[float, ...] | None) -> ForcePolynomials:
    """A polynomial without constant term."""
    if values is None:
        return NO_FORCE
    return ForcePolynomials(np.zeros(1), np.array([[0.0, *values]]))


def tabulated_force(table: Characteristic) -> ForcePolynomials:
    """A table of forces in pieces; the outer ones go on beyond it."""
    if table.interpolation == "linear":
        x, force = np.array(table.deflection), np.array(table.force)
        slopes = np.diff(force) / np.diff(x)
        terms = np.stack([force[:-1], slopes], axis=1)
        return ForcePolynomials(x[:-1], terms, table_points=(x, force))
    from scipy.interpolate import PchipInterpolator

    curve = PchipInterpolator(table.deflection, table.force)
    inside = np.ascontiguousarray(curve.c[::-1].T)
    slopes = curve.derivative()(curve.x[[0, -1]])
    before = [table.force[0], slopes[0], 0.0, 0.0]
    after = [table.force[-1], slopes[1], 0.0, 0.0]
    starts = np.concatenate([curve.x[:1], curve.x])
    return ForcePolynomials(starts, np.vstack([before, inside, after]))


@dataclass(frozen=True, eq=False)
class ControlledForce:
    """The law of a row of the table of forces.

    Attributes
    ----------
    reads
        Of all outputs that it reads: which of its measures, and the output as a
        function of that and its rate.
    natives
        Callables in it, whose addresses its code holds.
    """

    reads: Mapping[str, tuple[int, Callable[[float, float], float]]]
    natives: tuple[NativeCallable, ...]


@dataclass(frozen=True, eq=False)
class ForceRow:
    """One row of the force table.

    Attributes
    ----------
    kind
        See `spatial.system_arrays`.
    a, b
        Markers; a given force has no `a`.
    data
        Direction or components; of a sum of measures their number, then weights.
    function
        Row of its function of time, -1 for none.
    coordinate
        Joint and coordinate that are its measure, if they are.
    rotation_entry
        Row of `rotation_counter` that is its measure, -1 for none.
    code
        Instructions of its law, see `dynamics.control_laws`; empty for none.
    control
        What is known of that law.
    derivative_rows
        Of a drive, how many rows behind it those of its two derivatives are.
    is_measure
        No force, but a measure for the next row that has a law.
    sample_period
        Time between samples of its law [s], 0 for one that acts all the time.
    """

    name: str
    kind: int
    a: MarkerKey | None
    b: MarkerKey
    data: tuple[float, ...]
    law: ForceLaw
    function: int = -1
    coordinate: tuple[str, str] | None = None
    rotation_entry: int = -1
    code: tuple[float, ...] = ()
    control: ControlledForce | None = None
    derivative_rows: tuple[int, int] | None = None
    is_measure: bool = False
    sample_period: float = 0.0

    @property
    def is_force(self) -> bool:
        """True if it is a force on bodies; else a measure, or a law of a state or a
        drive.
        """
        return not self.is_measure and self.kind < at.COORDINATE_MEASURE


def joint_coordinate(scene: SceneFile, joint: str, coordinate: str) -> ForceRow:
    """What measures a coordinate of a joint, without a force."""
    connects = scene.joints[joint]
    parts = joint_primitives(connects, scene.dimension == "planar")
    part = parts.coordinates[coordinate]
    a, b = (marker_reference(text) for text in marker_names(connects))
    if part.swapped:
        a, b = b, a
    data, key = tuple(map(float, part.data)), (joint, coordinate)
    return ForceRow(
        joint, _MEASURE_OF_PRIMITIVE[part.kind], a, b, data, ForceLaw(), coordinate=key
    )


def force_table(
    elements: tuple[ForceRow, ...],
    markers: dict[MarkerKey, int],
    order: Sequence[str],
    real_data: RealData,
) -> IntTable:
    """The table of forces, without their rows in Newton matrices.

    Parameters
    ----------
    order
        Names of bodies, as in their table.
    """
    table = np.full((len(elements), at.N_FORCE), -1, np.int64)
    for k, (row, element) in enumerate(zip(table, elements, strict=True)):
        row[at.F_KIND], row[at.F_SAMPLED] = element.kind, 0
        if element.kind == at.COORDINATE_MEASURE:
            row[at.F_B] = order.index(element.b[0])
            row[at.F_DATA] = int(element.data[0])
        elif element.kind == at.PRESCRIBED_VALUE:
            row[[at.F_A, at.F_B]] = k + np.array(element.derivative_rows or (0, 0))
        else:
            row[at.F_A] = -1 if element.a is None else markers[element.a]
            row[at.F_B] = markers[element.b]
            row[at.F_DATA] = real_data.add(element.data)
        row[at.F_LAW] = real_data.add(element.law.packed())
        row[at.F_TIME] = element.function
        row[at.F_ROTATION] = element.rotation_entry
        if element.kind == at.COMBINED_MEASURE:
            table[k - int(element.data[0]) : k, at.F_OWNER] = k
        if element.code:
            row[at.F_CODE] = real_data.add(element.code)
            read = int(element.code[0])
            table[k - read : k, at.F_OWNER] = k
            row[at.F_SAMPLED] = int(element.sample_period > 0.0)
    return table


def max_measures_read(elements: Sequence[ForceRow]) -> int:
    """The largest number of measures that a law reads."""
    return max((int(e.code[0]) for e in elements if e.code), default=0)
