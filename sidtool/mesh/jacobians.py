"""Jacobian matrices of many elements: columns, determinants, adjugates."""

import numpy as np

from sidtool.formats.base.complex_step import product_with_step
from sidtool.formats.base.sid import Array


def jacobian_columns(corners: Array, gradients: Array) -> Array:
    """(d, d, ne, ng) derivatives of x_a by the reference coordinates xi_k, [k, a].

    Every component is contiguous, for the many small determinants and inverses.
    Positions relative to a node lose no digits far from the origin.

    Parameters
    ----------
    corners : (ne, m, d)
    gradients : (ne or 1, ng, m, d)
    """
    ne, m, d = corners.shape
    corners = corners - corners[:, :1]
    if len(gradients) == 1:
        by_axis = np.ascontiguousarray(np.moveaxis(corners, 2, 0)).reshape(d * ne, m)
        functions = np.ascontiguousarray(np.moveaxis(gradients[0], (2, 1), (0, 1)))
        return product_with_step(by_axis, functions).reshape(d, d, ne, -1)
    jacobians = product_with_step(np.swapaxes(corners, 1, 2)[:, None], gradients)
    return np.ascontiguousarray(np.moveaxis(jacobians, (3, 2), (0, 1)))


def jacobian_determinants(columns: Array) -> Array:
    """Return determinants (...) of matrices by their columns (d, d, ...), without
    LAPACK, which is slow for small ones.
    """
    if len(columns) == 2:
        (a, c), (b, d) = columns
        return np.asarray(a * d - b * c)
    first, second, third = columns
    return np.asarray(
        sum(first[i] * x for i, x in enumerate(_cross_product(second, third)))
    )


def jacobian_adjugates(columns: Array) -> Array:
    """Return inverses times determinants by their rows (d, d, ...), from columns."""
    if len(columns) == 2:
        (a, c), (b, d) = columns
        return np.array([[d, -b], [-c, a]])
    pairs = [(columns[(row + 1) % 3], columns[(row + 2) % 3]) for row in range(3)]
    return np.array([_cross_product(*pair) for pair in pairs])


def _cross_product(a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Return the cross products of vectors (3, ...)."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )
