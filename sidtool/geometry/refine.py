"""Degree elevation and knot insertion: more functions, the same geometry."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

from sidtool.formats.errors import InputError

from .bspline import breakpoints, collocation, greville_points
from .patch import NurbsPatch

Array = NDArray[np.float64]


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


def check_holds(
    knots: Array, degree: int, target: Array, target_degree: int, place: str
) -> None:
    """Whether the splines on `target` hold those on `knots`.

    Raises
    ------
    InputError : the degree is lower, or an inner knot is missing or too smooth.
    """
    if target_degree < degree:
        raise InputError(
            f"degree {target_degree} cannot represent the geometry",
            place=place,
            expected=f"a degree of at least {degree}, that of the geometry",
        )
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
