"""Inertia of incompatible modes, whose amplitudes depend on the nodes as in statics.

The field of an element is N u + b a with a = -Kaa^-1 Kau u, and inertia is that of this
field (R. J. Guyan, AIAA J. 3, 1965; the internal modes are condensed). Uniform strains
and rigid motions leave a at zero, so that mass, centre and moments of inertia are those
of the nodal functions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.taylor import Array

from ..mesh.materials import ElasticMaterial, laws_of_material
from ..mesh.mesh import ElementBlock, Mesh
from ..mesh.reference_elements import reference_element
from .locking_remedies import internal_values
from .solid_elements import (
    ElementBatch,
    MatrixSum,
    elasticity,
    element_mass,
    internal_amplitudes,
)
from .solid_matrices import element_batches, has_internal_modes

Indices = NDArray[np.int64]
_Entries = tuple[Array, Indices, Indices]


@dataclass(frozen=True, eq=False)
class InternalInertia:
    """Displacements b_j a_j inside the elements beside those of the n nodes.

    Attributes
    ----------
    amplitudes : (k d, d n) sparse; a by function and component = amplitudes @ u
    mixed : (n, k) sparse, integral of rho N_i b_j dV [kg]
    own : (k, k) sparse, integral of rho b_i b_j dV [kg]
    added : (d n, d n) sparse, their contribution to the mass matrix [kg]
    """

    amplitudes: sp.csr_matrix
    mixed: sp.csr_matrix
    own: sp.csr_matrix
    added: sp.csr_matrix

    def scalar_mass(self, nodal: sp.csr_matrix) -> sp.csr_matrix:
        """(n + k, n + k) integral of rho times all functions, by that of the nodes."""
        return sp.csr_matrix(
            sp.block_array([[nodal, self.mixed], [self.mixed.T, self.own]])
        )

    def fields(self, vectors: Array, dimension: int) -> Array:
        """(k, d, q) amplitudes of displacements (d n, q)."""
        return np.asarray(self.amplitudes @ vectors, float).reshape(
            -1, dimension, vectors.shape[1]
        )


def internal_inertia(
    mesh: Mesh,
    materials: Mapping[str | None, ElasticMaterial],
    state: str,
    *,
    thickness: float = 1.0,
    incompatible_modes: bool = False,
) -> InternalInertia | None:
    """Return the inertia of all elements with internal modes, or None.

    The parameters are those of `mesh_matrices`.
    """
    n, d = mesh.positions.shape
    added, parts, count = MatrixSum(n, d), [], 0
    for block in mesh.blocks:
        if not has_internal_modes(block, incompatible_modes):
            continue
        material, depth = materials[block.material], block.thickness or thickness
        density, law = material.density * depth, elasticity(material, state)
        for batch, amplitudes in _with_amplitudes(
            mesh, block, law, laws_of_material(material)
        ):
            parts.append(
                _ElementGroup(
                    batch.nodes, amplitudes, *_element_mass(batch, density), count
                )
            )
            added.add(parts[-1].added(d), batch.nodes)
            count += int(np.prod(parts[-1].own.shape[:2]))
    if not parts:
        return None
    shapes = (d * count, d * n), (n, count), (count, count)
    entries = zip(*(part.entries(d) for part in parts), strict=True)
    follow, mixed, own = (_sparse_matrix(*x) for x in zip(entries, shapes, strict=True))
    return InternalInertia(follow, mixed, own, added.total())


def _with_amplitudes(
    mesh: Mesh,
    block: ElementBlock,
    law: Array,
    laws: Callable[[Array], Array] | None,
) -> Iterator[tuple[ElementBatch, Array]]:
    """Elements at the points of the mass, all functions there, and the amplitudes."""
    points = reference_element(block.kind, "mass").points
    inner = internal_values(block.kind, points)[None]
    moving = inner.shape[2] * mesh.dimension
    for batch in element_batches(mesh, block, "mass"):
        some = replace(block, nodes=batch.nodes, labels=np.arange(len(batch.nodes)))
        own = element_batches(mesh, some, relieved=True, laws=laws)
        amplitudes = np.concatenate([internal_amplitudes(b, law) for b in own])[
            :, :moving
        ]
        values = np.concatenate([batch.values, inner], axis=2)
        yield replace(batch, values=values), amplitudes


def _element_mass(batch: ElementBatch, density: float) -> tuple[Array, Array]:
    """(ne, m, k) and (ne, k, k): of nodal with internal functions, and of these."""
    whole, m = element_mass(batch, density), batch.nodes.shape[1]
    return whole[:, :m, m:], whole[:, m:, m:]


@dataclass(frozen=True, eq=False)
class _ElementGroup:
    """Some elements: nodes (ne, m), amplitudes (ne, k d, m d), mixed (ne, m, k), own
    (ne, k, k) masses, and the number of their first function."""

    nodes: Indices
    amplitudes: Array
    mixed: Array
    own: Array
    start: int

    def added(self, d: int) -> Array:
        """(ne, m d, m d)"""
        ne, m, k = self.mixed.shape
        flat = self.amplitudes.reshape(ne, k, -1)
        coupled = (self.mixed @ flat).reshape(ne, m * d, m * d)
        moved = (self.own @ flat).reshape(self.amplitudes.shape)
        square = np.swapaxes(self.amplitudes, 1, 2) @ moved
        return np.asarray(coupled + np.swapaxes(coupled, 1, 2) + square, float)

    def entries(self, d: int) -> tuple[_Entries, _Entries, _Entries]:
        """Values, rows and columns of amplitudes, mixed and own."""
        ne, k = self.own.shape[:2]
        functions = (self.start + np.arange(ne * k)).reshape(ne, k).astype(np.int64)
        rows = (functions[..., None] * d + np.arange(d)).reshape(ne, -1)
        columns = (self.nodes[..., None] * d + np.arange(d)).reshape(ne, -1)
        return (
            _matrix_entries(self.amplitudes, rows, columns),
            _matrix_entries(self.mixed, self.nodes, functions),
            _matrix_entries(self.own, functions, functions),
        )


def _matrix_entries(values: Array, rows: Indices, columns: Indices) -> _Entries:
    """Entries of element matrices (ne, r, c) at their rows (ne, r), columns (ne, c)."""
    first = np.broadcast_to(rows[..., None], values.shape)
    second = np.broadcast_to(columns[:, None], values.shape)
    return values.ravel(), first.ravel(), second.ravel()


def _sparse_matrix(
    parts: tuple[_Entries, ...], shape: tuple[int, int]
) -> sp.csr_matrix:
    values, rows, columns = (np.concatenate(x) for x in zip(*parts, strict=True))
    return sp.csr_matrix((values, (rows, columns)), shape=shape)
