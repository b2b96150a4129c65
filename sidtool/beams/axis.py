"""The axis of a beam: a straight line, or a cubic spline through points."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.complex_step import analytic_norm, numbers
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model.beams import BeamGeometry
from sidtool.formats.sid_mass import cross

from ..mesh.reference_elements import gauss_legendre
from .cross_section import Profile, profile, section_turn

#: Sines of angles below this count as zero.
_PARALLEL_TOLERANCE = 1e-9
#: Pieces of every span of a spline, and Gauss points of each, for its length and
#: the direction of its cross-sections.
_PIECES, _POINTS = 32, 8


@dataclass(frozen=True, eq=False)
class AxisFrames:
    """Frames at positions of an axis.

    Attributes
    ----------
    places : (n, 3) [m]
    axes : (n, 3, 3) rows: the tangent and the principal axes y, z of the cross-section
    section_axes : (n, 3, 3) likewise with the axes that the model gives the section
    curvatures : (n, 3) rotation of the axes per length, in the axes: twist, and the
        curvatures about y and z [rad/m]
    """

    places: Array
    axes: Array
    section_axes: Array
    curvatures: Array


@dataclass(frozen=True, eq=False)
class Axis:
    """Axis of a beam, by the fraction of its length.

    The y axis at the start is transported without a rotation about the tangent; the
    cross-sections are rotated from it by the twist, positive from y to z.

    Attributes
    ----------
    length : [m]
    straight : whether it is a straight line
    parameters : fractions (n,) -> (n,) of the curve, the argument of the next three
    place : (n, 3) positions
    tangents : (n, 3) unit tangents, (n, 3) their changes per length
    transported_y : (n, 3) the y axis before the twist
    twist : angle of the principal axes over the fraction [rad]
    turn : angle of the principal axes from those that the model gives the section,
        from y to z [rad]
    """

    length: float
    straight: bool
    parameters: Callable[[Array], Array]
    place: Callable[[Array], Array]
    tangents: Callable[[Array], tuple[Array, Array]]
    transported_y: Callable[[Array], Array]
    twist: Profile
    turn: float = 0.0

    def at(self, fractions: Array) -> AxisFrames:
        """The frames at fractions (n,) of the length."""
        fractions = numbers(fractions)
        parameters = self.parameters(fractions)
        tangent, change = self.tangents(parameters)
        angle = self.twist(fractions)
        rate = self.twist.derivative(fractions) / self.length
        y = self.transported_y(parameters)
        if not self.twist.is_zero:
            across = np.sin(angle)[:, None] * cross(tangent, y)
            y = np.cos(angle)[:, None] * y + across
        axes = np.stack([tangent, y, cross(tangent, y)], axis=1)
        turning = cross(tangent, change) + np.multiply(rate[:, None], tangent)
        curvatures = np.einsum("nab,nb->na", axes, turning)
        section_axes = axes
        if self.turn:
            c, s = np.cos(self.turn), np.sin(self.turn)
            section_axes = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ axes
        return AxisFrames(self.place(parameters), axes, section_axes, curvatures)

    def nearest(self, point: Array) -> tuple[float, float]:
        """The fraction of the length nearest to a point, and the distance [m]."""

        if self.straight:
            start, end = self.place(np.array([0.0, 1.0]))
            along = (point - start) @ (end - start) / self.length**2
            best = along if 0 < along.real < 1 else float(along.real >= 1)
            place = self.place(np.array([best]))
            return best, float(np.linalg.norm(place - point))
        grid = np.linspace(0, 1, 2001)
        arms = self.place(self.parameters(grid)) - point
        best = grid[np.linalg.norm(arms, axis=1).argmin()]
        for _ in range(50):  # Newton's method for (r - point) . r' = 0
            parameter = self.parameters(np.array([best]))
            tangent, change = self.tangents(parameter)
            arm = self.place(parameter) - point
            slope: Any = 1 + (arm * change).sum()
            slope = slope if slope.real > 0.1 else 0.1
            after = best - (arm * tangent).sum() / self.length / slope
            former = best
            best = after if 0 < after.real < 1 else np.clip(after.real, 0, 1)
            if abs(best - former) < 1e-15:
                break
        place = self.place(self.parameters(np.array([best])))
        return best.item(), float(np.linalg.norm(place - point))


def beam_axis(geometry: BeamGeometry) -> Axis:
    """The axis of a beam, without the twist of `sections`.

    Raises
    ------
    InputError : it has no length, or the y axis is parallel to it at the start.
    """
    points = numbers([geometry.start, *geometry.through, geometry.end])
    steps = analytic_norm(np.diff(points, axis=0), axis=1)
    if steps.real.min() == 0:
        alone = len(points) == 2
        raise InputError(
            "start and end are the same" if alone else "two points in a row are equal",
            place="geometry.end" if alone else "geometry.through",
            expected="a beam with a length" if alone else "different points",
        )
    turn = section_turn(geometry)
    given = geometry.twist if isinstance(geometry.twist, tuple) else (geometry.twist,)
    twist = profile(tuple(x + turn for x in given), geometry.interpolation)
    if len(points) == 2:
        return straight_axis(points[0], points[1], geometry.y_axis, twist, turn)
    return _spline_axis(points, steps, geometry.y_axis, twist, turn)


def straight_axis(
    start: Array,
    end: Array,
    y_axis: Any,
    twist: Profile | None = None,
    turn: float = 0.0,
) -> Axis:
    """A straight axis between two places that differ.

    The y axis is by default y, or -x along y. `turn` is a part of the twist, as in
    `Axis`.

    Raises
    ------
    InputError : the y axis is parallel to it.
    """
    length = analytic_norm(end - start).item()
    x = (end - start) / length
    y = y_direction(y_axis, x)
    return Axis(
        length,
        True,
        lambda f: f,
        lambda f: start + np.multiply.outer(f * length, x),
        lambda f: (np.tile(x, (len(f), 1)), np.zeros((len(f), 3))),
        lambda f: np.tile(y, (len(f), 1)),
        twist or profile(turn, "linear"),
        turn,
    )


def _spline_axis(
    points: Array, steps: Array, y_axis: Any, twist: Profile, turn: float
) -> Axis:
    """A cubic spline through points, whose parameter runs with their distances."""
    knots = np.concatenate([[0], np.cumsum(steps)])
    spline = _CubicSpline(knots, points)
    first, second = partial(spline, order=1), partial(spline, order=2)
    parts = np.linspace(0, 1, _PIECES, endpoint=False)
    inner = knots[:-1, None] + np.diff(knots)[:, None] * parts
    marks = np.append(inner.ravel(), knots[-1])

    def lengths(start: Array, end: Array) -> Array:
        at, weights = _gauss_points(start, end)
        return np.asarray((analytic_norm(first(at), axis=-1) * weights).sum(axis=1))

    covered = np.concatenate([[0], np.cumsum(lengths(marks[:-1], marks[1:]))])
    length = covered[-1].item()

    def parameters(fractions: Array) -> Array:
        wanted = np.clip(fractions, 0, 1) * length
        piece = np.searchsorted(covered.real, wanted.real) - 1
        piece = np.clip(piece, 0, len(marks) - 2)
        guess: Array = np.interp(wanted.real, covered.real, marks.real)
        for _ in range(4):  # Newton's method
            excess = covered[piece] + lengths(marks[piece], guess) - wanted
            guess = guess - excess / analytic_norm(first(guess), axis=-1)
        return np.asarray(guess)

    def bent(parameter: Array) -> tuple[Array, Array]:
        velocity, turning = first(parameter), second(parameter)
        speed = analytic_norm(velocity, axis=-1, keepdims=True)
        tangent = velocity / speed
        along = (tangent * turning).sum(axis=-1, keepdims=True)
        return tangent, (turning - along * tangent) / speed**2

    begin = y_direction(y_axis, bent(np.zeros(1))[0][0])
    transported_y = _Transport(marks, first, bent, begin)
    return Axis(length, False, parameters, spline, bent, transported_y, twist, turn)


class _Transport:
    """A direction y across a curve that does not turn about its tangent.

    It is seen in axes a, b across the tangent t; a is a fixed direction r made
    perpendicular to t. It turns from a to b at the rate
    (r . t) (t' . t x r) / |t x r|^2.

    Parameters
    ----------
    marks : (n,) parameters between which r is fixed: of the directions of space the one
        most across the curve
    velocity : derivatives (..., 3) of places at parameters (...)
    bent : tangents and their changes per length at parameters
    begin : y at the first mark
    """

    def __init__(
        self,
        marks: Array,
        velocity: Callable[[Array], Array],
        bent: Callable[[Array], tuple[Array, Array]],
        begin: Array,
    ) -> None:
        self._marks, self._velocity, self._bent = marks, velocity, bent
        middles = bent((marks[1:] + marks[:-1]) / 2)[0]
        self._fixed = np.eye(3)[np.abs(middles.real).argmin(axis=1)]
        every = np.arange(len(marks) - 1)
        parts = zip(*self._turns(every, marks[1:]), strict=True)
        transported = [begin]
        for part in parts:
            transported.append(_turned(transported[-1], *part))
        self._at_marks = np.array(transported)

    def __call__(self, parameters: Array) -> Array:
        """y (n, 3) at parameters (n,)."""
        pieces = np.searchsorted(self._marks.real, parameters.real, side="right") - 1
        pieces = np.clip(pieces, 0, len(self._marks) - 2)
        return _turned(self._at_marks[pieces], *self._turns(pieces, parameters))

    def _turns(
        self, pieces: NDArray[np.intp], ends: Array
    ) -> tuple[Array, Array, Array]:
        """Axes (n, 2, 3) at the starts of pieces and at their ends, angles between."""
        r, starts = self._fixed[pieces], self._marks[pieces]
        at, weights = _gauss_points(starts, ends)
        tangent, change = self._bent(at)
        beside = np.cross(tangent, r[:, None])
        rate = (r[:, None] * tangent).sum(axis=-1) * (change * beside).sum(axis=-1)
        rate = rate * analytic_norm(self._velocity(at), axis=-1)
        angles = (rate / (beside**2).sum(axis=-1) * weights).sum(axis=1)
        return self._axes(starts, r), self._axes(ends, r), angles

    def _axes(self, parameters: Array, r: Array) -> Array:
        """The axes a and b, (n, 2, 3)."""
        tangent = self._bent(parameters)[0]
        b = np.cross(tangent, r)
        b = b / analytic_norm(b, axis=-1, keepdims=True)
        return np.stack([np.cross(b, tangent), b], axis=-2)


def _gauss_points(starts: Array, ends: Array) -> tuple[Array, Array]:
    """Points and weights (n, p) of intervals (n,)."""
    x, w = gauss_legendre(_POINTS)
    half = (ends - starts)[:, None] / 2
    return starts[:, None] + half * (1 + x), half * w


def _turned(y: Array, begin: Array, end: Array, angle: Array) -> Array:
    """y (..., 3) after a turn by an angle (...), from axes (..., 2, 3) to others."""
    along, beside = np.moveaxis((begin * y[..., None, :]).sum(axis=-1), -1, 0)
    c, s = np.cos(angle), np.sin(angle)
    turned = np.stack([along * c - beside * s, along * s + beside * c], axis=-1)
    return np.asarray((turned[..., None] * end).sum(axis=-2))


class _CubicSpline:
    """A cubic spline through points (n, d) at n knots, not-a-knot at its ends.

    Through three points it is a parabola.

    Source: C. de Boor, A Practical Guide to Splines, chapter 4.
    """

    def __init__(self, knots: Array, points: Array) -> None:
        self._knots = knots
        h = np.diff(knots)[:, None]
        chords = np.diff(points, axis=0) / h
        slopes = np.linalg.solve(*self._equations(h[:, 0], chords))
        bend = (slopes[:-1] + slopes[1:] - 2 * chords) / h
        self._terms = (
            points[:-1],
            slopes[:-1],
            (chords - slopes[:-1]) / h - bend,
            bend / h,
        )

    @staticmethod
    def _equations(h: Array, chords: Array) -> tuple[Array, Array]:
        """Matrix (n, n) and right side (n, d) of the slopes at the knots."""
        n = len(h) + 1
        matrix = np.zeros((n, n), h.dtype)
        right = np.zeros((n, chords.shape[1]), chords.dtype)
        for i in range(1, n - 1):
            before, after = h[i - 1], h[i]
            matrix[i, i - 1 : i + 2] = after, 2 * (before + after), before
            right[i] = 3 * (after * chords[i - 1] + before * chords[i])
        if n == 3:
            matrix[0, :2] = matrix[2, 1:] = 1.0
            right[0], right[2] = 2 * chords[0], 2 * chords[1]
            return matrix, right
        for row, a, b in ((0, 0, 1), (-1, -1, -2)):
            both = h[a] + h[b]
            matrix[row, a], matrix[row, b] = h[b], both
            outer = (h[a] + 2 * both) * h[b] * chords[a]
            right[row] = (outer + h[a] ** 2 * chords[b]) / both
        return matrix, right

    def __call__(self, at: Array, order: int = 0) -> Array:
        """Values (..., d) at parameters (...), or their first or second derivatives."""
        at = np.asarray(at)
        piece = np.searchsorted(self._knots.real, at.real, side="right") - 1
        piece = np.clip(piece, 0, len(self._knots) - 2)
        t = (at - self._knots[piece])[..., None]
        value, slope, square, cube = (term[piece] for term in self._terms)
        if order == 0:
            return np.asarray(((cube * t + square) * t + slope) * t + value)
        if order == 1:
            return np.asarray((3 * cube * t + 2 * square) * t + slope)
        return np.asarray(6 * cube * t + 2 * square)


def y_direction(y_axis: Any, x: Array) -> Array:
    """The y axis made perpendicular to a tangent x; by default y, or -x along y.

    Raises
    ------
    InputError : it is parallel to the tangent.
    """
    if y_axis is None:
        along_y = np.hypot(x[0].real, x[2].real) <= _PARALLEL_TOLERANCE
        y_axis = (-1.0, 0.0, 0.0) if along_y else (0.0, 1.0, 0.0)
    y = numbers(y_axis)
    across = y - x * (x @ y)
    if np.linalg.norm(across) <= _PARALLEL_TOLERANCE * np.linalg.norm(y):
        raise InputError(
            "is parallel to the beam",
            place="geometry.y_axis",
            expected="a direction across the beam at its start",
        )
    return np.asarray(across / analytic_norm(across))
