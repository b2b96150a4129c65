"""What a tie needs of the side that it holds: how it weighs and where it lies."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Surface:
    """A curve or surface on which the shape functions of some nodes live.

    Attributes
    ----------
    mass : (n, n) sparse, integral of N_i N_j over it [m or m^2]
    points : (k, d) points on the surface itself [m]
    normals : (3, 3) integral of the products of its unit normal, which an axis is
        perpendicular to; zero where there is no normal
    """

    mass: sp.csr_matrix
    points: Array
    normals: Array


def together(surfaces: Iterable[Surface]) -> Surface:
    """Several surfaces as one."""
    return reduce(
        lambda a, b: Surface(
            sp.csr_matrix(a.mass + b.mass),
            np.vstack([a.points, b.points]),
            a.normals + b.normals,
        ),
        surfaces,
    )


def measures(tangents: Array) -> Array:
    """(...) length or area per parameter of tangents (..., d, k)."""
    gram = np.swapaxes(tangents, -1, -2) @ tangents
    size: Array = np.sqrt(np.maximum(np.linalg.det(gram), 0.0))
    return size


def products_of_normals(tangents: Array, weights: Array) -> Array:
    """(3, 3) sum of w |c| n n^T with c = n |c| the cross product of two tangents.

    Parameters
    ----------
    tangents : (p, d, k)
    weights : (p,) of the quadrature
    """
    if tangents.shape[1:] != (3, 2):
        return np.zeros((3, 3))
    c = np.cross(tangents[:, :, 0], tangents[:, :, 1])
    size = np.linalg.norm(c, axis=1)
    scaled = weights * np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    products: Array = np.einsum("p,pa,pb->ab", scaled, c, c)
    return products
