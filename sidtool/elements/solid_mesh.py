"""Mesh of solid elements with everything that its matrices depend on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..mesh.materials import ElasticMaterial
from ..mesh.mesh import ElementBlock, Mesh
from ..mesh.reference_elements import LINEAR_KINDS, edge_nodes, quadratic_kind
from .internal_inertia import InternalInertia, internal_inertia
from .locking_remedies import KINDS_WITH_INCOMPATIBLE_MODES
from .solid_matrices import has_internal_modes, mesh_matrices


@dataclass(frozen=True, eq=False)
class SolidMesh:
    """Elements, their materials and their formulation; see `mesh_matrices`."""

    mesh: Mesh
    materials: Mapping[str | None, ElasticMaterial]
    state: str
    thickness: float = 1.0
    incompatible_modes: bool = False

    @property
    def kinds_with_locking(self) -> tuple[str, ...]:
        """Return the linear elements that bend too stiffly. These include prisms, whose
        internal modes help along their axis only.
        """
        plain = (
            block.kind
            for block in self.mesh.blocks
            if block.kind in LINEAR_KINDS
            and not (
                block.kind in KINDS_WITH_INCOMPATIBLE_MODES
                and has_internal_modes(block, self.incompatible_modes)
            )
        )
        return tuple(dict.fromkeys(plain))

    def matrices(self) -> tuple[sp.csr_matrix, sp.csr_matrix]:
        """Mass and stiffness (d n, d n), the mass by the points of the stiffness."""
        mass, stiffness = mesh_matrices(
            self.mesh,
            self.materials,
            self.state,
            thickness=self.thickness,
            incompatible_modes=self.incompatible_modes,
            same_points=True,
        )
        spread = sp.kron(mass, sp.eye_array(self.mesh.dimension))
        inner = self.internal_inertia()
        total = spread if inner is None else spread + inner.added
        return sp.csr_matrix(total), stiffness

    def internal_inertia(self) -> InternalInertia | None:
        """Return the inertia of the internal modes of its elements, or None."""
        return internal_inertia(
            self.mesh,
            self.materials,
            self.state,
            thickness=self.thickness,
            incompatible_modes=self.incompatible_modes,
        )


def with_internal_modes(solids: SolidMesh) -> SolidMesh:
    """Return the mesh with the internal modes of all elements that can have them."""
    blocks = tuple(
        replace(block, formulation="incompatible_modes") for block in solids.mesh.blocks
    )
    return replace(solids, mesh=replace(solids.mesh, blocks=blocks))


def to_quadratic(solids: SolidMesh) -> tuple[SolidMesh, sp.csr_matrix]:
    """Return the mesh with mid-side nodes on straight edges of linear elements.

    Returns
    -------
    the mesh, and the (n', n) matrix that interpolates a field linearly on it
    """
    mesh = solids.mesh
    n = len(mesh.positions)
    linear = [block for block in mesh.blocks if block.kind in LINEAR_KINDS]
    pairs = [_block_edges(block) for block in linear]
    edges, numbers = np.unique(np.concatenate(pairs), axis=0, return_inverse=True)
    counts = np.cumsum([len(ends) for ends in pairs])[:-1]
    middles = dict(zip(map(id, linear), np.split(numbers.ravel(), counts), strict=True))
    blocks = []
    for block in mesh.blocks:
        if block.kind in LINEAR_KINDS:
            own = n + middles[id(block)].reshape(len(block.nodes), -1)
            nodes = np.hstack([block.nodes, own])
            block = replace(block, kind=quadratic_kind(block.kind), nodes=nodes)
        blocks.append(block)
    rows = np.repeat(np.arange(len(edges)), 2)
    means = sp.csr_matrix(
        (np.full(len(rows), 0.5), (rows, edges.ravel())), shape=(len(edges), n)
    )
    between = sp.csr_matrix(sp.vstack([sp.eye_array(n), means]))
    finer = Mesh(between @ mesh.positions, tuple(blocks))
    return replace(solids, mesh=finer), between


def _block_edges(block: ElementBlock) -> NDArray[np.int64]:
    """(edges of all elements, 2) corners, the smaller number first."""
    corners = block.nodes[:, np.array(edge_nodes(quadratic_kind(block.kind)))]
    return np.sort(corners.reshape(-1, 2), axis=1)
