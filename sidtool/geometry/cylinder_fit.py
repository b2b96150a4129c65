"""Least-squares circle or circular cylinder through points."""

from dataclasses import dataclass

import numpy as np

from sidtool.formats.base.complex_step import analytic_norm, analytic_pinv
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

#: Points of a cylinder lie this close to it, of its radius.
_CYLINDER_TOLERANCE = 1e-2
#: Points on less than this share of a circle do not determine its centre.
_MIN_ARC = 1 / 6
_AXIS_CYCLES = ([0, 1, 2], [1, 2, 0], [2, 0, 1])


@dataclass(frozen=True)
class Cylinder:
    """A circle or cylinder, of the extent of the points that it was fitted to.

    Attributes
    ----------
    centre : (d,) on the axis, midway between its ends [m]
    radius : [m]
    arc : angle that the points cover [rad]
    miss : distance of the farthest point [m]
    """

    centre: Array
    radius: float
    arc: float
    miss: float


def fitted_cylinder(points: Array, normals: Array) -> Cylinder:
    """The circle (d = 2) or cylinder (d = 3) through points, by least squares.

    Parameters
    ----------
    points : (k, d)
    normals : (3, 3) sum of the products of normals to the surface, zero if unknown; the
        search begins along their null direction and along the principal axes

    Raises
    ------
    InputError : the points lie on no cylinder, or on too small a part of one.
    """
    middle, size = points.mean(axis=0), float(np.ptp(points.real, axis=0).max())
    if size == 0 or len(points) < 3:
        raise _no_cylinder("they are too few")
    scaled, turn = (points - middle) / size, np.eye(2)
    if points.shape[1] == 2:
        centre, radius = _fit_circle(scaled)
    else:
        plain = scaled.real
        turn, centre, radius = _refine_cylinder(plain, _initial_axis(plain, normals))
        if np.iscomplexobj(scaled):
            turn, centre = _cylinder_with_step(scaled, turn, centre, radius)
    arms = scaled @ turn[:, :2] - centre
    arc, miss = _checked_arc(arms.real, np.real(radius), size)
    heights = scaled @ turn[:, 2:]
    ends = [heights[fun(heights.real, axis=0)] for fun in (np.argmax, np.argmin)]
    amid = np.diagonal(sum(ends)) / 2
    place = turn[:, :2] @ centre + turn[:, 2:] @ amid
    return Cylinder(middle + size * place, size * float(np.real(radius)), arc, miss)


def _checked_arc(arms: Array, radius: float, size: float) -> tuple[float, float]:
    """The angle over which there are points, and how far they miss the circle [m]."""
    off = np.abs(np.linalg.norm(arms, axis=1) - radius).max()
    if not off <= _CYLINDER_TOLERANCE * radius:
        raise _no_cylinder(
            f"the nearest has a radius of {size * radius:.4g} m, and they lie up to "
            f"{size * off:.2g} m off it"
        )
    angles = np.sort(np.arctan2(arms[:, 1], arms[:, 0]))
    gap = float(np.diff(angles, append=angles[0] + 2 * np.pi).max())
    if gap > 2 * np.pi * (1 - _MIN_ARC):
        raise _no_cylinder("they lie on less than a sixth of a circle")
    return 2 * np.pi - gap, size * float(off)


def _no_cylinder(why: str) -> InputError:
    return InputError(
        f"the nodes do not determine a cylinder: {why}",
        place="at",
        expected="nodes on a cylinder, in the plane on a circle; otherwise a position",
    )


def _fit_circle(points: Array) -> tuple[Array, float]:
    """Centre and radius: |x|^2 = 2 c . x + r^2 - |c|^2, linear in the unknowns."""
    rows = np.column_stack([2 * points, np.ones(len(points))])
    a, b, c = analytic_pinv(rows) @ (points**2).sum(axis=1)
    square = (c + a * a + b * b).real
    return np.array([a, b]), float(np.sqrt(max(square, 0.0)))


def _initial_axis(points: Array, normals: Array) -> Array:
    """(3, 3) axes, the last along the candidate that a cylinder fits best."""
    frames = [np.linalg.eigh(points.T @ points)[1]]
    if np.any(normals):
        frames.append(np.linalg.eigh(normals)[1][:, [1, 2, 0]])
    turns = [frame[:, order] for frame in frames for order in _AXIS_CYCLES]

    def misfit(turn: Array) -> float:
        flat = points @ turn[:, :2]
        centre, radius = _fit_circle(flat)
        return float(np.linalg.norm(np.linalg.norm(flat - centre, axis=1) - radius))

    return min(turns, key=misfit)


def _refine_cylinder(points: Array, turn: Array) -> tuple[Array, Array, float]:
    """Axes with the last along the axis, centre across it, and radius."""

    def turned(tilt: Array) -> Array:
        frame = turn.copy()
        frame[:, 2] += turn[:, :2] @ tilt
        frame[:, 2] /= np.linalg.norm(frame[:, 2])
        frame[:, 0] -= (frame[:, 0] @ frame[:, 2]) * frame[:, 2]
        frame[:, 0] /= np.linalg.norm(frame[:, 0])
        frame[:, 1] = np.cross(frame[:, 2], frame[:, 0])
        return frame

    def gaps(unknowns: Array) -> Array:
        flat = points @ turned(unknowns[:2])[:, :2]
        distances: Array = np.linalg.norm(flat - unknowns[2:4], axis=1) - unknowns[4]
        return distances

    from scipy.optimize import least_squares

    centre, radius = _fit_circle(points @ turned(np.zeros(2))[:, :2])
    start = np.array([0, 0, *centre, radius])
    unknowns = start
    if np.abs(gaps(start)).max() > 1e-12:
        unknowns = least_squares(gaps, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    return turned(unknowns[:2]), unknowns[2:4], float(unknowns[4])


def _cylinder_with_step(
    points: Array, turn: Array, centre: Array, radius: float
) -> tuple[Array, Array]:
    """Return axes and centre of a cylinder through points that carry a step.

    One step of Gauss and Newton, which is exact where the points lie on the cylinder.
    """
    arms = points @ turn[:, :2] - centre
    gaps = analytic_norm(arms, axis=1) - radius
    along = arms.real / np.linalg.norm(arms.real, axis=1, keepdims=True)
    heights = points.real @ turn[:, 2:]
    slopes = np.hstack([-heights * along, -along, -np.ones((len(points), 1))])
    change = -1j * np.linalg.lstsq(slopes, gaps.imag, rcond=None)[0]
    tilt = change[:2]
    moved = turn.astype(complex)
    moved[:, 2] += turn[:, :2] @ tilt
    moved[:, :2] -= turn[:, 2:] * tilt
    return moved, centre + change[2:4]
