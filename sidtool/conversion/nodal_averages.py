"""Values at quadrature points, extrapolated to nodes and averaged there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.taylor import Array

from ..elements.finite_element_model import FiniteElementModel
from ..mesh.mesh import Mesh
from .quadrature import QuadraturePart

Indices = NDArray[np.int64]

#: Terms of the polynomials that are fitted to the values of an element, by dimension,
#: from the most terms to the constant.
_TERMS = {
    2: ("1 x y xy", "1 x y", "1"),
    3: ("1 x y z xy yz zx", "1 x y z", "1"),
}
#: Relative cut-off of singular values of a fit.
_SINGULAR_VALUE_TOLERANCE = 1e-9


class NodalAverages:
    """Means at nodes of values at quadrature points.

    Values are fitted to the quadrature points of every element by a polynomial of
    first order with mixed terms, and averaged over the elements of one material that
    meet at a node, by their volume (E. Hinton, J. S. Campbell, "Local and global
    smoothing of discontinuous finite element functions", Int. J. Numer. Methods Eng.
    8, 1974).

    Attributes
    ----------
    nodes : (n,) of the mesh; at the border of two materials once for each
    """

    def __init__(self, body: FiniteElementModel, mesh: Mesh, width: int) -> None:
        """width : of the values"""
        names = list(dict.fromkeys(block.material for block in mesh.blocks))
        self._owners = [names.index(block.material) for block in mesh.blocks]
        self._positions, self._count = body.positions, len(mesh.positions)
        keys = [
            block.nodes.ravel() + self._count * owner
            for block, owner in zip(mesh.blocks, self._owners, strict=True)
        ]
        self._used = np.unique(np.concatenate(keys))
        self.nodes = self._used % self._count
        self._total = np.zeros((len(self._used), width))
        self._weight = np.zeros(len(self._used))

    def add(self, part: QuadraturePart, values: Array) -> None:
        """Values (p, width) at the quadrature points of whole elements."""
        g = part.per_element
        nodes = part.nodes[::g]
        corners = self._positions[nodes]
        centre = corners.mean(axis=1, keepdims=True)
        size = np.abs(corners - centre).max(axis=(1, 2), keepdims=True)
        points = np.einsum("pm,pmd->pd", part.values, self._positions[part.nodes])
        points = (points.reshape(len(nodes), g, -1) - centre) / size
        terms = _terms(g, self._positions.shape[1])
        fit = np.linalg.pinv(
            _polynomial_values(points, terms), rcond=_SINGULAR_VALUE_TOLERANCE
        )
        volumes = part.weights.reshape(len(nodes), g).sum(axis=1)
        at_nodes = _polynomial_values((corners - centre) / size, terms) @ fit
        nodal = at_nodes * volumes[:, None, None] @ values.reshape(len(nodes), g, -1)
        keys = nodes + self._count * self._owners[part.continuum]
        rows = np.searchsorted(self._used, keys).ravel()
        np.add.at(self._total, rows, nodal.reshape(len(rows), -1))
        np.add.at(self._weight, rows, np.repeat(volumes, nodes.shape[1]))

    def values(self) -> Array:
        """(n, width)."""
        return self._total / self._weight[:, None]


def _terms(points: int, dimension: int) -> list[str]:
    """Return the polynomial with most terms that the points determine."""
    choices = [text.split() for text in _TERMS[dimension]]
    return next(terms for terms in choices if len(terms) <= points)


def _polynomial_values(points: Array, terms: list[str]) -> Array:
    """(e, g, d) to (e, g, terms)."""
    axes = {"x": 0, "y": 1, "z": 2}
    columns = [
        np.prod([points[..., axes[c]] for c in term], axis=0)
        if term != "1"
        else np.ones(points.shape[:-1])
        for term in terms
    ]
    return np.stack(columns, axis=-1)
