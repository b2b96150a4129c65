"""Quadrature points of a body: displacements and gradients there, averages at nodes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sidtool.formats.base.complex_step import analytic_pinv, number_type
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.progress import report_stage
from sidtool.formats.base.sid import Array

from ..elements.finite_element_model import FiniteElementModel
from ..elements.material_points import Continuum
from ..elements.solid_elements import ElementBatch, internal_amplitudes
from ..mesh.mesh import Mesh

_PROGRESS_TEXT = "going through the elements"

Indices = NDArray[np.int64]
#: Terms of the polynomials that are fitted to the values of an element, by dimension,
#: from the most terms to the constant.
_TERMS = {
    2: ("1 x y xy", "1 x y", "1"),
    3: ("1 x y z xy yz zx", "1 x y z", "1"),
}
#: Relative cut-off of singular values of a fit.
_SINGULAR_VALUE_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class QuadraturePart:
    """Quadrature points of a body in flat arrays.

    Attributes
    ----------
    nodes : (p, m) nodes whose functions reach each point
    values : (p, m) of the functions
    slopes : (p, m, d) of the functions in space [1/m]
    weights : (p,) volume of each point [m^3]
    law : elasticity matrix [Pa]; (p, 6, 6) where its axes turn
    transverse : see `Continuum`
    table : (n, d) degrees of freedom by node
    internal : (p, k, d) slopes of internal modes of the element [1/m]
    inner : (p, d) the first of these modes; the others only strain
    amplitudes : (e, d k, d m) of these by the displacements of the element's nodes
    element : (p,) row of `amplitudes` of every point
    per_element : points of each element, which follow each other
    continuum : number of the continuum of the body
    """

    nodes: NDArray[np.int64]
    values: Array
    slopes: Array
    weights: Array
    law: Array
    transverse: float
    table: NDArray[np.int64]
    internal: Array | None = None
    inner: Array | None = None
    amplitudes: Array | None = None
    element: NDArray[np.int64] | None = None
    per_element: int = 1
    continuum: int = 0

    def single_point(self, row: int) -> QuadraturePart:
        """Return one point without references to the arrays of the others."""
        cut = [row]
        chosen, amplitudes = self.element, self.amplitudes
        if chosen is not None and amplitudes is not None:
            amplitudes, chosen = amplitudes[chosen[cut]], np.zeros(1, np.int64)
        return replace(
            self,
            nodes=self.nodes[cut],
            values=self.values[cut],
            slopes=self.slopes[cut],
            weights=self.weights[cut],
            law=self.law if self.law.ndim == 2 else self.law[cut],
            internal=None if self.internal is None else self.internal[cut],
            inner=None if self.inner is None else self.inner[cut],
            amplitudes=amplitudes,
            element=chosen,
            per_element=1,
        )

    def gradients(self, fields: Array) -> Array:
        """(p, n, d, d) displacement gradients [c, b] = du_c/dx_b of (ndof, n)."""
        at_nodes = fields[self.table][self.nodes]
        result = _gradients_of_functions(self.slopes, at_nodes)
        if self.internal is None:
            return result
        return result + _gradients_of_functions(
            self.internal, self._amplitudes(at_nodes)
        )

    def displacements(self, fields: Array) -> Array:
        """(p, d, n) displacements of (ndof, n)."""
        at_nodes = fields[self.table][self.nodes]
        result = np.einsum("pm,pmdn->pdn", self.values, at_nodes)
        if self.inner is not None:
            moving = self._amplitudes(at_nodes)[:, : self.inner.shape[1]]
            result += np.einsum("pk,pkdn->pdn", self.inner, moving)
        return result

    def _amplitudes(self, at_nodes: Array) -> Array:
        """(p, k, d, n) of the internal modes by displacements (p, m, d, n)."""
        assert self.amplitudes is not None
        p, m, d, n = at_nodes.shape
        own = self.amplitudes[self.element] @ at_nodes.reshape(p, m * d, n)
        return np.asarray(own.reshape(p, -1, d, n))


def _gradients_of_functions(slopes: Array, amplitudes: Array) -> Array:
    """(p, n, d, d) gradients of functions, amplitudes (p, m, d, n)."""
    p, m, d, n = amplitudes.shape
    products = np.swapaxes(slopes, 1, 2) @ amplitudes.reshape(p, m, d * n)
    return np.asarray(products.reshape(p, d, d, n).transpose(0, 3, 2, 1))


def quadrature_parts(body: FiniteElementModel, points: int = 20_000) -> Iterator[Any]:
    """The quadrature points of all elements, at most about `points` at a time.

    Raises
    ------
    InputError : the body came without elements.
    """
    if not body.continua:
        raise InputError(
            "this body came without its elements, so that stresses are not known",
            place="geometry",
            expected="a body from Q4, IGA or another mesh of solid elements",
        )
    d = body.dimension
    for number, continuum in enumerate(body.continua):
        for batch in continuum.batches():
            ne, ng = batch.measures.shape
            step = max(1, points // ng)
            values = np.broadcast_to(batch.values, (ne, *batch.values.shape[1:]))
            for start in range(0, ne, step):
                report_stage(_PROGRESS_TEXT, (number + start / ne) / len(body.continua))
                cut = slice(start, start + step)
                inner = _internal_mode_data(batch, continuum.law, cut)
                yield QuadraturePart(
                    nodes=np.repeat(batch.nodes[cut], ng, axis=0),
                    values=values[cut].reshape(-1, values.shape[2]),
                    slopes=batch.gradients[cut].reshape(-1, values.shape[2], d),
                    weights=batch.measures[cut].ravel() * continuum.thickness,
                    law=_elasticity_at_points(batch, continuum, cut),
                    transverse=continuum.transverse,
                    table=body.table[:, :d],
                    per_element=ng,
                    continuum=number,
                    **inner,
                )


def _elasticity_at_points(
    batch: ElementBatch, continuum: Continuum, cut: slice
) -> Array:
    if batch.laws is None:
        return continuum.law
    return batch.laws[cut].reshape(-1, *batch.laws.shape[2:])


def _internal_mode_data(batch: ElementBatch, law: Array, cut: slice) -> dict[str, Any]:
    """Return the internal modes at the quadrature points of some elements of a
    batch.
    """
    if batch.internal is None or batch.directions is None:
        return {}
    some = replace(
        batch,
        gradients=batch.gradients[cut],
        measures=batch.measures[cut],
        internal=batch.internal[cut],
        directions=batch.directions[cut],
        laws=None if batch.laws is None else batch.laws[cut],
    )
    assert some.internal is not None and some.inner is not None
    ne, ng, k, d = some.internal.shape
    return {
        "internal": some.internal.reshape(-1, k, d),
        "inner": np.tile(some.inner, (ne, 1)),
        "amplitudes": internal_amplitudes(some, law),
        "element": np.repeat(np.arange(ne), ng),
    }


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
        self._total: Array = np.zeros((len(self._used), width))
        self._weight: Array = np.zeros(len(self._used))

    def add(self, part: QuadraturePart, values: Array) -> None:
        """Values (p, width) at the quadrature points of whole elements."""
        g = part.per_element
        nodes = part.nodes[::g]
        corners = self._positions[nodes]
        centre = corners.mean(axis=1, keepdims=True)
        size = np.abs((corners - centre).real).max(axis=(1, 2), keepdims=True)
        points = np.einsum("pm,pmd->pd", part.values, self._positions[part.nodes])
        points = (points.reshape(len(nodes), g, -1) - centre) / size
        terms = _terms(g, self._positions.shape[1])
        fit = analytic_pinv(
            _polynomial_values(points, terms), _SINGULAR_VALUE_TOLERANCE
        )
        volumes = part.weights.reshape(len(nodes), g).sum(axis=1)
        at_nodes = _polynomial_values((corners - centre) / size, terms) @ fit
        nodal = at_nodes * volumes[:, None, None] @ values.reshape(len(nodes), g, -1)
        keys = nodes + self._count * self._owners[part.continuum]
        rows = np.searchsorted(self._used, keys).ravel()
        self._total = self._total.astype(number_type(self._total, nodal), copy=False)
        self._weight = self._weight.astype(
            number_type(self._weight, volumes), copy=False
        )
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
