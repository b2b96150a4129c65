"""Bilinear quadrilaterals that sample a patch."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.model import ModelFile, Q4Discretisation
from sidtool.formats.model.geometry import NurbsGeometry

from ..geometry.contact import grid_numbers
from ..geometry.patch import patch_from_model, sampled_patch, side_nodes
from .elements.continuum import continuum_of
from .elements.solid import ElementBatch, assembled, check_orientation
from .finite_element_model import FiniteElementModel
from .geometry_mass import patch_mass
from .mesh.data import ElementBlock, Mesh
from .mesh.points import MeshPoints
from .mesh.surface import named_surface
from .sampled_volume import sampled_markers
from .solid_mesh import SolidMesh
from .solids import check_locking, element_batches

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def q4_model(model: ModelFile) -> FiniteElementModel:
    """The body of a model file as a regular mesh of quadrilaterals.

    At collapsed sides two of their nodes are one: they are triangles there.

    Raises
    ------
    InputError : the geometry folds or touches itself, or a marker lies outside.
    """
    settings = model.discretisation
    geometry, material = model.geometry, model.material
    assert isinstance(settings, Q4Discretisation) and material is not None
    assert isinstance(geometry, NurbsGeometry)
    relieved = settings.formulation == "incompatible_modes"
    check_locking("quad4", material, settings.state, relieved)
    exact = patch_from_model(geometry)
    grid = sampled_patch(exact, settings.elements)
    numbering = grid_numbers(exact, grid)
    numbers = numbering.numbers["geometry"]
    positions = np.zeros((numbering.count, 2))
    positions[numbers] = grid.points
    thickness, quads = geometry.thickness, numbers[quadrilaterals(grid.shape)]
    continuum = continuum_of(
        partial(_batches, positions, quads, relieved),
        material,
        settings.state,
        thickness,
        internal_modes=relieved,
    )
    elements = _mesh(positions, quads)
    sets = {
        name: np.unique(numbers[side_nodes(grid, *side)])
        for name, side in geometry.edge_names.items()
    }
    solids = SolidMesh(elements, {None: material}, settings.state, thickness, relieved)
    points = MeshPoints(elements, (continuum,))
    mass, stiffness = q4_matrices(
        positions,
        quads,
        density=material.density * thickness,
        law=continuum.law * thickness,
        incompatible_modes=relieved,
    )
    return FiniteElementModel(
        positions=positions,
        scalar_mass=mass,
        stiffness=stiffness,
        node_sets=sets,
        markers=sampled_markers(model, exact, points),
        continua=(continuum,),
        internal_inertia=solids.internal_inertia(),
        solids=solids,
        surface=named_surface(elements, sets),
        geometry_mass=lambda: patch_mass(
            [exact], material.density * thickness, sampled=True
        ),
    )


def quadrilaterals(shape: tuple[int, ...]) -> Indices:
    """(ne, 4) node numbers, counter-clockwise, of a grid of nodes."""
    n = np.arange(np.prod(shape)).reshape(shape)
    corners = (n[:-1, :-1], n[1:, :-1], n[1:, 1:], n[:-1, 1:])
    return np.stack(corners, axis=-1).reshape(-1, 4)


def q4_matrices(
    positions: Array,
    quads: Indices,
    *,
    density: float,
    law: Array,
    incompatible_modes: bool = False,
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Scalar mass (n, n) and stiffness (2 n, 2 n), full 2 x 2 integration.

    Parameters
    ----------
    positions : (n, 2) [m]
    quads : (ne, 4) counter-clockwise
    density : mass per area [kg/m^2]
    law : (3, 3) elasticity matrix times thickness [N/m]
    incompatible_modes : whether to add the internal modes

    Raises
    ------
    InputError : an element is folded, mirrored or has no area.
    """
    check_orientation(_corner_determinants(positions[quads]), positions[quads], -1e-9)
    return assembled(
        _batches(positions, quads, incompatible_modes),
        len(positions),
        density=density,
        law=law,
    )


def _batches(
    positions: Array, quads: Indices, relieved: bool
) -> Iterator[ElementBatch]:
    mesh = _mesh(positions, quads)
    return element_batches(mesh, mesh.blocks[0], relieved=relieved)


def _mesh(positions: Array, quads: Indices) -> Mesh:
    labels = np.arange(1, len(quads) + 1)
    return Mesh(positions, (ElementBlock("quad4", quads, labels),))


def _corner_determinants(corners: Array) -> Array:
    """(ne, 4) Jacobian determinant at each corner, times 4."""
    ahead = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, 1, axis=1) - corners
    return ahead[..., 0] * back[..., 1] - ahead[..., 1] * back[..., 0]
