"""Bilinear quadrilaterals that sample a patch."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from formats.model import ModelFile, Q4Discretisation
from formats.model_geometry import NurbsGeometry

from ..geometry.bspline import open_uniform_knots
from ..geometry.patch import NurbsPatch, evaluate_grid, patch_from_model
from .continuum import continuum_of
from .elements import (
    ElementBatch,
    assembled,
    check_orientation,
    element_stiffness,
    mapped_batch,
)
from .finite_element_model import FiniteElementModel
from .patch_markers import edge_masses, edge_sets, marker_rows
from .solids import check_locking

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], float)
_GAUSS = _CORNERS / np.sqrt(3)
#: Elements that are integrated at a time: their arrays fit the cache.
_BATCH = 2_000


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
        partial(_batches, mesh.points, quads), material, settings.state, thickness
    )
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
        node_sets=edge_sets(geometry, mesh),
        markers=marker_rows(model, exact, mesh),
        continua=(continuum,),
        edge_mass=edge_masses(geometry, mesh),
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
    incompatible_modes : whether to add the internal modes of QM6

    Raises
    ------
    InputError : an element is folded, mirrored or has no area.
    """
    check_orientation(_corner_determinants(positions[quads]), positions[quads], -1e-9)
    return assembled(
        _batches(positions, quads),
        len(positions),
        density=density,
        law=law,
        stiffness=partial(_condensed_stiffness, positions=positions)
        if incompatible_modes
        else element_stiffness,
    )


def _batches(positions: Array, quads: Indices) -> Iterator[ElementBatch]:
    values, gradients = _bilinear(_GAUSS)
    for start in range(0, len(quads), _BATCH):
        part = quads[start : start + _BATCH]
        yield mapped_batch(part, positions, values[None], gradients[None], np.ones(4))


def _bilinear(points: Array) -> tuple[Array, Array]:
    """Values (ng, 4) and reference gradients (ng, 4, 2)."""
    factors = 1 + points[:, None, :] * _CORNERS
    slopes = _CORNERS * factors[..., ::-1] / 4
    return factors.prod(-1) / 4, slopes


def _corner_determinants(corners: Array) -> Array:
    """(ne, 4) Jacobian determinant at each corner, times 4."""
    ahead = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, 1, axis=1) - corners
    return ahead[..., 0] * back[..., 1] - ahead[..., 1] * back[..., 0]


def _condensed_stiffness(batch: ElementBatch, law: Array, *, positions: Array) -> Array:
    """QM6 of Taylor, Beresford & Wilson (1976), int. J. numer. methods eng. 10.

    The internal modes 1 - xi^2 and 1 - eta^2 are differentiated with the Jacobian at
    the centre, scaled by the ratio of determinants, so that their strains vanish in
    the mean and the patch test is passed; then they are condensed.
    """
    _, centre = _bilinear(np.zeros((1, 2)))
    jacobians = np.swapaxes(positions[batch.nodes], 1, 2) @ centre[0]
    slopes = np.zeros((4, 2, 2))
    slopes[:, [0, 1], [0, 1]] = -2 * _GAUSS
    ratio = np.linalg.det(jacobians)[:, None] / batch.measures
    internal = slopes @ np.linalg.inv(jacobians)[:, None] * ratio[..., None, None]
    gradients = np.concatenate([batch.gradients, internal], axis=2)
    full = element_stiffness(replace(batch, gradients=gradients), law)
    coupling = full[:, 8:, :8]
    return full[:, :8, :8] - np.swapaxes(coupling, 1, 2) @ np.linalg.solve(
        full[:, 8:, 8:], coupling
    )
