"""Degree elevation and knot insertion: more functions, the same geometry."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from sidtool.formats.errors import InputError

from .bspline import breakpoints, collocation, greville_points
from .patch import NurbsPatch

Array = NDArray[np.float64]

#: Relative rounding of the lengths of knot spans.
_ROUNDING = 1e-9


def refined(
    patch: NurbsPatch, degrees: tuple[int, ...], knots: tuple[Array, ...]
) -> NurbsPatch:
    """The same patch in a basis of higher degrees and more knots.

    The new space holds the old one, so that interpolating the homogeneous coordinates
    at the Greville points of the new basis reproduces the geometry exactly.

    Parameters
    ----------
    degrees : of the new basis
    knots : of the new basis, on [0, 1]

    Raises
    ------
    InputError : the new space does not hold the old one.
    """
    w = patch.weights[..., None]
    homogeneous = np.concatenate([patch.control_points * w, w], axis=-1)
    for axis, (degree, target) in enumerate(zip(degrees, knots, strict=True)):
        old = (patch.knots[axis], patch.degrees[axis])
        check_holds(*old, target, degree, f"direction {'uvw'[axis]}")
        change = _change_of_basis(*old, target, degree)
        moved = np.moveaxis(homogeneous, axis, 0)
        homogeneous = np.moveaxis(np.tensordot(change, moved, axes=1), 0, axis)
    weights = homogeneous[..., -1]
    return NurbsPatch(
        degrees=degrees,
        knots=knots,
        control_points=homogeneous[..., :-1] / weights[..., None],
        weights=weights,
    )


def k_refined_knots(knots: Array, degree: int, target_degree: int, spans: int) -> Array:
    """The knots of a basis of higher degree with more knots that holds the old one.

    First the degree is raised, which keeps the continuity of each inner knot, then each
    knot span is divided into equal ones not longer than 1 / `spans` (k-refinement).
    For knots and their mirror image the results are mirror images, so that patches
    that match at a side do so afterwards.

    Parameters
    ----------
    knots, degree : of the old basis, on [0, 1]
    target_degree : not below `degree`

    References
    ----------
    Hughes, Cottrell & Bazilevs 2005, Comput. Methods Appl. Mech. Engrg. 194, sec. 2.
    """
    ends, counts = np.unique(knots, return_counts=True)
    found = [np.zeros(target_degree + 1)]
    for a, b, count in zip(ends[:-1], ends[1:], counts[1:], strict=True):
        pieces = max(1, int(np.ceil((b - a) * spans * (1 - _ROUNDING))))
        found.append(a + (b - a) * np.arange(1, pieces) / pieces)
        found.append(np.full(count + target_degree - degree, b))
    return np.concatenate(found)


def check_degree(degree: int, target_degree: int, place: str) -> None:
    """Whether a degree is at least that of the geometry.

    Raises
    ------
    InputError : it is lower.
    """
    if target_degree < degree:
        raise InputError(
            f"degree {target_degree} cannot represent the geometry",
            place=place,
            expected=f"a degree of at least {degree}, that of the geometry",
        )


def check_holds(
    knots: Array, degree: int, target: Array, target_degree: int, place: str
) -> None:
    """Whether the splines on `target` hold those on `knots`.

    Raises
    ------
    InputError : the degree is lower, or an inner knot is missing or too smooth.
    """
    check_degree(degree, target_degree, place)
    for knot in breakpoints(knots)[1:-1]:
        multiplicity = np.count_nonzero(knots == knot)
        needed = int(multiplicity) + target_degree - degree
        found = np.count_nonzero(np.isclose(target, knot, rtol=0, atol=1e-12))
        if found < needed:
            raise InputError(
                f"the knot vector has the geometry's inner knot {knot:g} {found} times",
                place=place,
                expected=f"it {needed} times, to keep the geometry unchanged",
            )


def _change_of_basis(knots: Array, degree: int, target: Array, new: int) -> Array:
    """(n_new, n_old) coefficients of the old basis functions in the new basis."""
    points = greville_points(target, new)
    old = collocation(knots, degree, points).toarray()
    return splu(collocation(target, new, points).tocsc()).solve(old)
