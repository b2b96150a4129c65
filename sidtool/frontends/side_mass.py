"""Integrals over the sides of a patch, when somebody asks for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import reduce

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..geometry.bspline import LocalBasis, gauss_points, local_basis
from ..geometry.patch import NurbsPatch, side_nodes

Array = NDArray[np.float64]


class SideMasses(Mapping[str, sp.csr_matrix]):
    """Name of an edge or face -> (n, n) integral of N_i N_j over it [m or m^2].

    Computed when it is looked up: most bodies need none of them.
    """

    def __init__(self, names: Mapping[str, tuple[int, int]], patch: NurbsPatch) -> None:
        self._names, self._patch = names, patch

    def __getitem__(self, name: str) -> sp.csr_matrix:
        return side_mass(self._patch, *self._names[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def side_mass(patch: NurbsPatch, direction: int, end: int) -> sp.csr_matrix:
    """(n, n) integral of N_i N_j over the side where a parameter is 0 or 1."""
    nodes = side_nodes(patch, direction, end)
    along = [i for i in range(len(patch.degrees)) if i != direction]
    values, slopes, weights = [], [], []
    for i in along:
        points, rule = gauss_points(patch.knots[i], patch.degrees[i] + 1)
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
    t = np.stack(tangents, axis=1)
    measure = np.sqrt(np.linalg.det(t @ np.swapaxes(t, 1, 2)))
    for i, rule in enumerate(weights):
        before = int(np.prod([len(w) for w in weights[:i]]))
        after = len(measure) // (before * len(rule))
        measure *= np.tile(np.repeat(rule, after), before)
    scaled = sp.diags_array(np.sqrt(measure) / total) @ rows @ sp.diags_array(w)
    entries = sp.coo_matrix(scaled.T @ scaled)
    shape = (patch.weights.size,) * 2
    index = (nodes[entries.row], nodes[entries.col])
    return sp.csr_matrix((entries.data, index), shape=shape)


def _matrix(basis: LocalBasis, entries: Array, count: int) -> sp.csr_matrix:
    points, width = entries.shape
    columns = (basis.first[:, None] + np.arange(width)).ravel()
    index = (np.repeat(np.arange(points), width), columns)
    return sp.csr_matrix((entries.ravel(), index), shape=(points, count))


def _product(factors: list[sp.csr_matrix]) -> sp.csr_matrix:
    return reduce(lambda a, b: sp.csr_matrix(sp.kron(a, b)), factors)
