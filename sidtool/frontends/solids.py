"""Mass and stiffness of meshes of solid elements."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from formats.errors import InputError
from formats.model import Material

from .continuum import Continuum, continuum_of
from .elements import (
    ElementBatch,
    assembled,
    elasticity,
    element_stiffness,
    mapped_batch,
)
from .mesh import ElementBlock, Mesh
from .reference_elements import reference_element

Array = NDArray[np.float64]

#: Entries of the largest array of one batch of elements, which fits the cache.
_BATCH_ENTRIES = 200_000
#: From this Poisson's ratio on, elements that lock in volume are refused.
_NEARLY_INCOMPRESSIBLE = 0.49


def mesh_matrices(
    mesh: Mesh,
    materials: Mapping[str | None, Material],
    state: str,
    *,
    thickness: float = 1.0,
    incompatible_modes: bool = False,
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Scalar mass (n, n) and stiffness (d n, d n), by Gauss quadrature.

    Parameters
    ----------
    materials : by the names in the blocks of the mesh
    state : "plane_stress", "plane_strain" or "solid"
    thickness : of a plane body [m]
    incompatible_modes : whether quad4 and hex8 get the internal modes of Taylor,
        Beresford & Wilson (1976)

    Raises
    ------
    InputError : an element is folded, or would lock in volume.
    """
    n, d = mesh.positions.shape
    mass = sp.csr_matrix((n, n))
    stiffness = sp.csr_matrix((d * n, d * n))
    for block in mesh.blocks:
        material = materials[block.material]
        extra = incompatible_modes and block.kind in ("quad4", "hex8")
        check_locking(block.kind, material, state, extra)
        m, k = assembled(
            _batches(mesh, block),
            n,
            dimension=d,
            density=material.density * thickness,
            law=elasticity(material, state) * thickness,
            stiffness=partial(
                _condensed_stiffness, positions=mesh.positions, kind=block.kind
            )
            if extra
            else element_stiffness,
        )
        mass, stiffness = mass + m, stiffness + k
    return sp.csr_matrix(mass), sp.csr_matrix(stiffness)


def mesh_continua(
    mesh: Mesh,
    materials: Mapping[str | None, Material],
    state: str,
    *,
    thickness: float = 1.0,
) -> tuple[Continuum, ...]:
    """The material of every block; the parameters are those of `mesh_matrices`."""
    return tuple(
        continuum_of(
            partial(_batches, mesh, block), materials[block.material], state, thickness
        )
        for block in mesh.blocks
    )


def check_locking(kind: str, material: Material, state: str, relieved: bool) -> None:
    """Whether elements of this kind can deform at constant volume.

    Raises
    ------
    InputError : the material is nearly incompressible, and they cannot.
    """
    if state == "plane_stress" or relieved:
        return
    linear = kind in ("tri3", "tet4", "quad4", "hex8", "wedge6")
    if linear and material.poissons_ratio > _NEARLY_INCOMPRESSIBLE:
        raise InputError(
            f"{material.poissons_ratio} makes {kind} elements lock: they cannot bend "
            "at constant volume",
            place="material.poissons_ratio",
            expected='quadratic elements, IGA or formulation = "incompatible_modes" '
            f"above {_NEARLY_INCOMPRESSIBLE}",
        )


def _batches(mesh: Mesh, block: ElementBlock) -> Iterator[ElementBatch]:
    element = reference_element(block.kind)
    size = element.gradients.size * 3 * (mesh.dimension + 1)
    step = max(1, _BATCH_ENTRIES // size)
    for start in range(0, len(block.nodes), step):
        yield mapped_batch(
            block.nodes[start : start + step],
            mesh.positions,
            element.values[None],
            element.gradients[None],
            element.weights,
        )


def _condensed_stiffness(
    batch: ElementBatch, law: Array, *, positions: Array, kind: str
) -> Array:
    """The internal modes xi (1 - xi) of each direction, condensed.

    They are differentiated with the Jacobian at the centre, scaled by the ratio of
    determinants, so that their strains vanish in the mean and the patch test is
    passed.
    """
    element = reference_element(kind)
    d = element.dimension
    _, centre = element.at(np.full((1, d), 0.5))
    jacobians = np.swapaxes(positions[batch.nodes], 1, 2) @ centre[0]
    slopes = np.zeros((len(element.points), d, d))
    slopes[:, range(d), range(d)] = 1 - 2 * element.points
    ratio = np.linalg.det(jacobians)[:, None] * element.weights / batch.measures
    internal = slopes @ np.linalg.inv(jacobians)[:, None] * ratio[..., None, None]
    gradients = np.concatenate([batch.gradients, internal], axis=2)
    full = element_stiffness(replace(batch, gradients=gradients), law)
    own = d * element.nodes.shape[0]
    coupling = full[:, own:, :own]
    return full[:, :own, :own] - np.swapaxes(coupling, 1, 2) @ np.linalg.solve(
        full[:, own:, own:], coupling
    )
