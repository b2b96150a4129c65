"""Mass and stiffness of meshes of solid elements."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import scipy.sparse as sp

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.taylor import Array

from ..mesh.materials import AnisotropicMaterial, ElasticMaterial, laws_of_material
from ..mesh.mesh import ElementBlock, Mesh
from ..mesh.reference_elements import LINEAR_KINDS, reference_element
from .locking_remedies import (
    KINDS_ALWAYS_INCOMPATIBLE,
    KINDS_WITH_INCOMPATIBLE_MODES,
    with_reduced_integration,
)
from .locking_remedies import with_incompatible_modes as with_modes
from .material_points import Continuum, make_continuum
from .solid_elements import ElementBatch, assemble_body, elasticity, mapped_batch

#: Entries of the largest array of one batch of elements, which fits the cache.
_BATCH_ENTRIES = 200_000
#: From this Poisson's ratio on, elements that lock in volume are refused.
_NEARLY_INCOMPRESSIBLE = 0.49
_FORMULATIONS = ("full_integration", "incompatible_modes")


def mesh_matrices(
    mesh: Mesh,
    materials: Mapping[str | None, ElasticMaterial],
    state: str,
    *,
    thickness: float = 1.0,
    incompatible_modes: bool = False,
    same_points: bool = False,
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Scalar mass (n, n) and stiffness (d n, d n), by Gauss quadrature.

    Parameters
    ----------
    materials : by the names in the blocks of the mesh
    state : "plane_stress", "plane_strain" or "solid"
    thickness : of plane elements whose block has no thickness [m]
    incompatible_modes : whether quad4 and hex8 get the internal modes of Taylor,
        Beresford & Wilson (1976), unless their block specifies it; their contribution
        to the mass is `internal_inertia`
    same_points : whether the mass is integrated at the points of stresses, which is
        cheaper, and exact where edges are straight and the Jacobian is constant

    Raises
    ------
    InputError : an element is folded, or would lock in volume.
    """
    n, d = mesh.positions.shape
    mass = sp.csr_matrix((n, n))
    stiffness = sp.csr_matrix((d * n, d * n))
    for block in mesh.blocks:
        material = materials[block.material]
        extra = has_internal_modes(block, incompatible_modes)
        depth = block.thickness or thickness
        check_volumetric_locking(block.kind, material, state, extra)
        m, k = assemble_body(
            element_batches(
                mesh, block, relieved=extra, laws=laws_of_material(material)
            ),
            n,
            dimension=d,
            density=material.density * depth,
            law=elasticity(material, state) * depth,
            mass_batches=element_batches(
                mesh, block, "stress" if same_points else "mass"
            ),
        )
        mass, stiffness = mass + m, stiffness + k
    return sp.csr_matrix(mass), sp.csr_matrix(stiffness)


def mesh_continua(
    mesh: Mesh,
    materials: Mapping[str | None, ElasticMaterial],
    state: str,
    *,
    thickness: float = 1.0,
    incompatible_modes: bool = False,
) -> tuple[Continuum, ...]:
    """The material of every block; the parameters are those of `mesh_matrices`."""
    continua = []
    for block in mesh.blocks:
        extra = has_internal_modes(block, incompatible_modes)
        material, depth = materials[block.material], block.thickness or thickness
        settings: Any = {"relieved": extra, "laws": laws_of_material(material)}
        batches = partial(element_batches, mesh, block, "stress", **settings)
        continua.append(
            make_continuum(batches, material, state, depth, internal_modes=extra)
        )
    return tuple(continua)


def has_internal_modes(block: ElementBlock, otherwise: bool) -> bool:
    """Return whether the elements of a block have internal modes."""
    if block.kind not in KINDS_WITH_INCOMPATIBLE_MODES:
        return block.kind in KINDS_ALWAYS_INCOMPATIBLE
    return (block.formulation or _FORMULATIONS[otherwise]) == _FORMULATIONS[True]


def check_volumetric_locking(
    kind: str, material: ElasticMaterial, state: str, relieved: bool
) -> None:
    """Check that elements of this kind can deform at constant volume.

    Raises
    ------
    InputError : the material is nearly incompressible, and the elements cannot.
    """
    if isinstance(material, AnisotropicMaterial):
        return
    if state == "plane_stress" or (relieved and kind in KINDS_WITH_INCOMPATIBLE_MODES):
        return
    if kind in LINEAR_KINDS and material.poissons_ratio > _NEARLY_INCOMPRESSIBLE:
        raise InputError(
            f"{material.poissons_ratio} makes {kind} elements lock: they cannot bend "
            "at constant volume",
            place="material.poissons_ratio",
            expected='quadratic elements, IGA or formulation = "incompatible_modes" '
            f"above {_NEARLY_INCOMPRESSIBLE}",
        )


def element_batches(
    mesh: Mesh,
    block: ElementBlock,
    integral: str = "stiffness",
    *,
    relieved: bool = False,
    laws: Callable[[Array], Array] | None = None,
) -> Iterator[ElementBatch]:
    """The elements of a block at the quadrature points of an integral.

    Parameters
    ----------
    integral : "stiffness", "stress" or "mass"; stresses come at all points that exact
        integrals of the stiffness need
    relieved : True if the elements have internal modes
    laws : of a material with varying axes, see `laws_of_material`
    """
    element = reference_element(block.kind, integral)
    size = element.gradients.size * 3 * (mesh.dimension + 1)
    step = max(1, _BATCH_ENTRIES // size)
    for start in range(0, len(block.nodes), step):
        batch = mapped_batch(
            block.nodes[start : start + step],
            mesh.positions,
            element.values[None],
            element.gradients[None],
            element.weights,
        )
        if relieved:
            batch = with_modes(batch, mesh.positions, element)
        elif integral == "stiffness":
            batch = with_reduced_integration(batch, mesh.positions, element)
        if laws is not None and integral != "mass":
            places = batch.values @ mesh.positions[batch.nodes]
            batch = replace(batch, laws=laws(places))
        yield batch
