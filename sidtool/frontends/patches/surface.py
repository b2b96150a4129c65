"""Integrals over the sides of a patch."""

from __future__ import annotations

from functools import reduce

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...geometry.bspline import LocalBasis, gauss_points, local_basis
from ...geometry.patch import NurbsPatch, side_nodes
from ..surface import Surface, measures, products_of_normals

Array = NDArray[np.float64]


#: Gauss points per knot span beyond the degree: for curved and rational sides.
_MORE = 4


def patch_surface(patch: NurbsPatch, direction: int, end: int) -> Surface:
    """The side where a parameter is 0 or 1."""
    nodes = side_nodes(patch, direction, end)
    along = [i for i in range(len(patch.degrees)) if i != direction]
    values, slopes, weights = [], [], []
    for i in along:
        points, rule = gauss_points(patch.knots[i], patch.degrees[i] + _MORE)
        basis = local_basis(patch.knots[i], patch.degrees[i], points.ravel())
        count = patch.shape[i]
        values.append(_matrix(basis, basis.values, count))
        slopes.append(_matrix(basis, basis.derivatives, count))
        weights.append(rule.ravel())
    rows = _product(values)
    w = patch.weights.ravel()[nodes]
    weighted = patch.points[nodes] * w[:, None]
    total = rows @ w
    position = (rows @ weighted) / total[:, None]
    tangents = []
    for k in range(len(along)):
        derived = _product(
            [slopes[j] if j == k else values[j] for j in range(len(along))]
        )
        drift = position * (derived @ w)[:, None]
        tangents.append((derived @ weighted - drift) / total[:, None])
    t, rule = np.stack(tangents, axis=2), _ruled(weights)
    measure = rule * measures(t)
    scaled = sp.diags_array(np.sqrt(measure) / total) @ rows @ sp.diags_array(w)
    entries = sp.coo_matrix(scaled.T @ scaled)
    shape = (patch.weights.size,) * 2
    index = (nodes[entries.row], nodes[entries.col])
    mass = sp.csr_matrix((entries.data, index), shape=shape)
    return Surface(mass, position, products_of_normals(t, rule))


def _matrix(basis: LocalBasis, entries: Array, count: int) -> sp.csr_matrix:
    points, width = entries.shape
    columns = (basis.first[:, None] + np.arange(width)).ravel()
    index = (np.repeat(np.arange(points), width), columns)
    return sp.csr_matrix((entries.ravel(), index), shape=(points, count))


def _product(factors: list[sp.csr_matrix]) -> sp.csr_matrix:
    return reduce(lambda a, b: sp.csr_matrix(sp.kron(a, b)), factors)


def _ruled(weights: list[Array]) -> Array:
    """The weights of a product of rules; the last one runs fastest."""
    return reduce(lambda a, b: np.outer(a, b).ravel(), weights)
