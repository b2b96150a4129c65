"""Bilinear quadrilaterals that sample a patch."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.model import ModelFile, Q4Discretisation
from sidtool.formats.model.geometry import NurbsGeometry

from ..geometry.bspline import open_uniform_knots
from ..geometry.patch import NurbsPatch, evaluate_grid, patch_from_model
from .elements.continuum import continuum_of
from .elements.solid import ElementBatch, assembled, check_orientation
from .finite_element_model import FiniteElementModel
from .geometry_mass import patch_mass
from .mesh.data import ElementBlock, Mesh
from .mesh.points import MeshPoints
from .mesh.surface import named_surface
from .patches.markers import edge_sets
from .sampled_volume import sampled_markers
from .solid_mesh import SolidMesh
from .solids import check_locking, element_batches

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def q4_model(model: ModelFile) -> FiniteElementModel:
    """The body of a model file as a regular mesh of quadrilaterals.

    Raises
    ------
    InputError : the geometry folds, or a marker lies outside.
    """
    settings = model.discretisation
    geometry, material = model.geometry, model.material
    assert isinstance(settings, Q4Discretisation) and material is not None
    assert isinstance(geometry, NurbsGeometry)
    relieved = settings.formulation == "incompatible_modes"
    check_locking("quad4", material, settings.state, relieved)
    exact = patch_from_model(geometry)
    mesh = sampled_patch(exact, settings.elements)
    thickness, quads = geometry.thickness, quadrilaterals(mesh.shape)
    continuum = continuum_of(
        partial(_batches, mesh.points, quads, relieved),
        material,
        settings.state,
        thickness,
        internal_modes=relieved,
    )
    elements, sets = _mesh(mesh.points, quads), edge_sets(geometry, mesh)
    solids = SolidMesh(elements, {None: material}, settings.state, thickness, relieved)
    points = MeshPoints(elements, (continuum,))
    mass, stiffness = q4_matrices(
        mesh.points,
        quads,
        density=material.density * thickness,
        law=continuum.law * thickness,
        incompatible_modes=relieved,
    )
    return FiniteElementModel(
        positions=mesh.points,
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


def sampled_patch(patch: NurbsPatch, elements: tuple[int, ...]) -> NurbsPatch:
    """The mesh as a bilinear patch: points of `patch` at equal parameter steps."""
    axes = tuple(np.linspace(0, 1, count + 1) for count in elements)
    points = evaluate_grid(patch, axes)
    return NurbsPatch(
        degrees=(1,) * len(elements),
        knots=tuple(open_uniform_knots(1, count) for count in elements),
        control_points=points,
        weights=np.ones(points.shape[:-1]),
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
