"""The axis of a beam: a straight line, or a cubic spline through points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sidtool.formats.base.complex_step import analytic_norm, numbers
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.taylor import Array
from sidtool.formats.model.beams import BeamGeometry

from .cross_section import Profile, profile, section_turn

#: Sines of angles below this count as zero.
_PARALLEL_TOLERANCE = 1e-9
#: Pieces of every span of a spline, and Gauss points of each, for its length.
_PIECES, _POINTS = 8, 8


@dataclass(frozen=True, eq=False)
class AxisFrames:
    """Frames at positions of an axis.

    Attributes
    ----------
    places : (n, 3) [m]
    axes : (n, 3, 3) rows: the tangent and the axes y, z of the cross-section
    curvatures : (n, 3) rotation of the axes per length, in the axes: twist, and the
        curvatures about y and z [rad/m]
    """

    places: Array
    axes: Array
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
    twist : angle over the fraction [rad]
    """

    length: float
    straight: bool
    parameters: Callable[[Array], Array]
    place: Callable[[Array], Array]
    tangents: Callable[[Array], tuple[Array, Array]]
    transported_y: Callable[[Array], Array]
    twist: Profile

    def at(self, fractions: Array) -> AxisFrames:
        """The frames at fractions (n,) of the length."""
        fractions = numbers(fractions)
        parameters = self.parameters(fractions)
        tangent, change = self.tangents(parameters)
        angle = self.twist(fractions)
        rate = self.twist.derivative(fractions) / self.length
        y = self.transported_y(parameters)
        if not self.twist.is_zero:
            across = np.sin(angle)[:, None] * np.cross(tangent, y)
            y = np.cos(angle)[:, None] * y + across
        axes = np.stack([tangent, y, np.cross(tangent, y)], axis=1)
        turning = np.cross(tangent, change) + np.multiply(rate[:, None], tangent)
        curvatures = np.einsum("nab,nb->na", axes, turning)
        return AxisFrames(self.place(parameters), axes, curvatures)

    def nearest(self, point: Array) -> tuple[float, float]:
        """The fraction of the length nearest to a point, and the distance [m]."""

        if self.straight:
            start, end = self.place(np.array([0.0, 1.0]))
            along = (point - start) @ (end - start) / self.length**2
            best = along if 0 < along.real < 1 else float(along.real >= 1)
            place = self.place(np.array([best]))
            return best, float(np.linalg.norm(place - point))
        point = point.real
        grid = np.linspace(0, 1, 2001)
        arms = self.place(self.parameters(grid)) - point
        best = float(grid[np.linalg.norm(arms, axis=1).argmin()])
        for _ in range(50):  # Newton's method for (r - point) . r' = 0
            parameter = self.parameters(np.array([best]))
            tangent, change = self.tangents(parameter)
            arm = self.place(parameter) - point
            slope = 1 + float(np.vdot(arm, change))
            step = float(np.vdot(arm, tangent)) / self.length / max(slope, 0.1)
            best, former = float(np.clip(best - step, 0, 1)), best
            if abs(best - former) < 1e-15:
                break
        place = self.place(self.parameters(np.array([best])))
        return best, float(np.linalg.norm(place - point))


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
        return straight_axis(points[0], points[1], geometry.y_axis, twist)
    if np.iscomplexobj(points) or np.iscomplexobj(numbers(geometry.y_axis)):
        raise InputError(
            "has no derivative by its points",
            place="geometry.through",
            expected="a straight beam, or variables of section and material",
        )
    return _spline_axis(points, steps, geometry.y_axis, twist)


def straight_axis(
    start: Array, end: Array, y_axis: Any, twist: Profile | None = None
) -> Axis:
    """A straight axis between two places that differ.

    Raises
    ------
    InputError : the y axis is parallel to it.
    """
    length = analytic_norm(end - start).item()
    x = (end - start) / length
    y = _perpendicular_part(numbers(y_axis), x)
    return Axis(
        length,
        True,
        lambda f: f,
        lambda f: start + np.multiply.outer(f * length, x),
        lambda f: (np.tile(x, (len(f), 1)), np.zeros((len(f), 3))),
        lambda f: np.tile(y, (len(f), 1)),
        twist or profile(0.0, "linear"),
    )


def _spline_axis(points: Array, steps: Array, y_axis: Any, twist: Profile) -> Axis:
    """A cubic spline through points, whose parameter runs with their distances."""
    from scipy.integrate import solve_ivp
    from scipy.interpolate import CubicSpline

    knots = np.concatenate([[0], np.cumsum(steps)])
    spline = CubicSpline(knots, points)
    first, second = spline.derivative(), spline.derivative(2)
    marks = _refine_knots(knots)
    x, w = np.polynomial.legendre.leggauss(_POINTS)

    def lengths(start: Array, end: Array) -> Array:
        half = (end - start)[:, None] / 2
        at = start[:, None] + half * (1 + x)
        return np.linalg.norm(first(at), axis=-1) @ w * half[:, 0]

    covered = np.concatenate([[0], np.cumsum(lengths(marks[:-1], marks[1:]))])
    length = float(covered[-1])

    def parameters(fractions: Array) -> Array:
        wanted = np.clip(fractions, 0, 1) * length
        piece = np.clip(np.searchsorted(covered, wanted) - 1, 0, len(marks) - 2)
        guess = np.interp(wanted, covered, marks)
        for _ in range(4):  # Newton's method
            excess = covered[piece] + lengths(marks[piece], guess) - wanted
            guess = guess - excess / np.linalg.norm(first(guess), axis=-1)
        return np.asarray(guess)

    def bent(parameter: Array) -> tuple[Array, Array]:
        velocity, turning = first(parameter), second(parameter)
        speed = np.linalg.norm(velocity, axis=-1, keepdims=True)
        tangent = velocity / speed
        along = (tangent * turning).sum(axis=-1, keepdims=True)
        return tangent, (turning - along * tangent) / speed**2

    def carry(parameter: float, y: Array) -> Array:
        tangent, change = bent(np.array([parameter]))
        speed = np.linalg.norm(first(parameter))
        return np.asarray(-(change[0] @ y) * speed * tangent[0])

    begin = _perpendicular_part(np.array(y_axis, float), bent(np.zeros(1))[0][0])
    run_along = solve_ivp(
        carry,
        (0, knots[-1]),
        begin,
        method="DOP853",
        rtol=1e-10,
        atol=1e-12,
        dense_output=True,
    ).sol

    def transported_y(parameter: Array) -> Array:
        tangent, y = bent(parameter)[0], run_along(parameter).T
        y = y - (y * tangent).sum(axis=1, keepdims=True) * tangent
        return np.asarray(y / np.linalg.norm(y, axis=1, keepdims=True))

    return Axis(length, False, parameters, spline, bent, transported_y, twist)


def _refine_knots(knots: Array) -> Array:
    parts = np.linspace(0, 1, _PIECES, endpoint=False)
    inner = knots[:-1, None] + np.diff(knots)[:, None] * parts
    return np.append(inner.ravel(), knots[-1])


def _perpendicular_part(y: Array, x: Array) -> Array:
    across = y - x * (x @ y)
    if np.linalg.norm(across) <= _PARALLEL_TOLERANCE * np.linalg.norm(y):
        raise InputError(
            "is parallel to the beam",
            place="geometry.y_axis",
            expected="a direction across the beam at its start",
        )
    return np.asarray(across / analytic_norm(across))
