"""B-spline bases of one parametric direction.

Values by the recursion of Cox and de Boor, derivatives from the values of one degree
less (Piegl & Tiller, The NURBS Book, eq. 2.5 and 2.7).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from sidtool.formats.base.complex_step import numbers
from sidtool.formats.base.taylor import Array

from ..mesh.quadrature_rules import gauss_legendre

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class LocalBasis:
    """The degree + 1 functions that do not vanish at each of some points.

    Attributes
    ----------
    first : (npoints,) number of the first of them
    values, derivatives : (npoints, degree + 1)
    """

    first: Indices
    values: Array
    derivatives: Array


def local_basis(knots: Array, degree: int, points: ArrayLike) -> LocalBasis:
    """Values and first derivatives; at a knot, those of the span to its right.

    Parameters
    ----------
    knots : open knot vector
    points : (npoints,) inside the range of the knots
    """
    x = numbers(points)[:, None]
    last = len(knots) - degree - 2
    span = np.searchsorted(knots, x[:, 0].real, side="right") - 1
    span = np.clip(span, degree, last)[:, None]
    values = derivatives = np.ones((len(x), 1))
    for p in range(1, degree + 1):
        start = span + np.arange(1 - p, 1)
        left, right = knots[start], knots[start + p]
        share = values / (right - left)
        values, derivatives = np.zeros((2, len(x), p + 1), x.dtype)
        values[:, 1:] += (x - left) * share
        values[:, :-1] += (right - x) * share
        derivatives[:, 1:] += p * share
        derivatives[:, :-1] -= p * share
    return LocalBasis(span[:, 0] - degree, values, derivatives)


def collocation(knots: Array, degree: int, points: ArrayLike) -> sp.csr_matrix:
    """(npoints, n) values of all functions."""
    basis = local_basis(knots, degree, points)
    columns = basis.first[:, None] + np.arange(degree + 1)
    starts = np.arange(0, columns.size + 1, degree + 1)
    shape = (len(columns), len(knots) - degree - 1)
    return sp.csr_matrix((basis.values.ravel(), columns.ravel(), starts), shape=shape)


def local_basis_from_left(knots: Array, degree: int, points: ArrayLike) -> LocalBasis:
    """Return the basis as `local_basis`; at a knot, the limit from the span to its
    left.
    """
    total = knots[0] + knots[-1]
    mirrored = local_basis(total - knots[::-1], degree, total - np.asarray(points))
    count = len(knots) - degree - 1
    return LocalBasis(
        count - 1 - degree - mirrored.first,
        mirrored.values[:, ::-1],
        -mirrored.derivatives[:, ::-1],
    )


def breakpoints(knots: Array) -> Array:
    """The distinct knots: the ends of the knot spans."""
    return np.unique(knots)


def gauss_points(knots: Array, count: int) -> tuple[Array, Array]:
    """Gauss-Legendre points and weights, (nspans, count) each, in every knot span."""
    reference, weights = gauss_legendre(count)
    ends = breakpoints(knots)
    half = np.diff(ends)[:, None] / 2
    middle = ((ends[:-1] + ends[1:]) / 2)[:, None]
    return middle + half * reference, half * weights


def open_uniform_knots(degree: int, spans: int) -> Array:
    """Open knot vector on [0, 1] with equal spans and single inner knots."""
    inner = np.arange(1, spans) / spans
    return np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])


def greville_points(knots: Array, degree: int) -> Array:
    """Averages of `degree` consecutive knots, one per basis function."""
    windows = np.lib.stride_tricks.sliding_window_view(knots[1:-1], degree)
    return np.clip(windows.mean(axis=1), knots[0], knots[-1])
