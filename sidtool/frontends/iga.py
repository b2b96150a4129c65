"""Isogeometric analysis: the patch itself, refined, is the basis.

Source: Hughes, Cottrell & Bazilevs 2005, Comput. Methods Appl. Mech. Engrg. 194.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from formats.errors import InputError
from formats.model import IgaDiscretisation, ModelFile
from formats.model_checks import check_knots
from formats.model_geometry import NurbsGeometry, VolumeGeometry

from ..geometry.bspline import (
    LocalBasis,
    gauss_points,
    local_basis,
    open_uniform_knots,
)
from ..geometry.patch import NurbsPatch, patch_from_model, rational
from ..geometry.refine import refined
from .continuum import Continuum, continuum_of
from .elements import ElementBatch, assembled, mapped_batch
from .finite_element_model import FiniteElementModel
from .patch_markers import edge_masses, edge_sets, marker_rows

Array = NDArray[np.float64]

#: Entries of the largest array of one batch of knot spans.
_BATCH_ENTRIES = 4_000_000


def iga_model(model: ModelFile) -> FiniteElementModel:
    """The body of a model file in its own refined NURBS basis.

    Raises
    ------
    InputError : the refined knots do not hold the geometry, the geometry folds, or a
        marker lies outside.
    """
    geometry = model.geometry
    assert isinstance(geometry, NurbsGeometry | VolumeGeometry)
    exact = patch_from_model(geometry)
    patch = refined_for(model, exact)
    mass, stiffness = patch_matrices(model, exact, patch)
    return FiniteElementModel(
        positions=patch.points,
        scalar_mass=mass,
        stiffness=stiffness,
        node_sets=edge_sets(geometry, patch),
        markers=marker_rows(model, exact, patch),
        continua=(patch_continuum(model, exact, patch),),
        edge_mass=edge_masses(geometry, patch),
    )


def patch_continuum(
    model: ModelFile, exact: NurbsPatch, patch: NurbsPatch
) -> Continuum:
    """The material of one refined patch of a model, at its Gauss points."""
    settings, material = model.discretisation, model.material
    assert isinstance(settings, IgaDiscretisation) and material is not None
    plane = len(patch.degrees) == 2
    thickness = getattr(model.geometry, "thickness", None) if plane else 1.0
    if thickness is None:
        raise InputError(
            "is missing", place="geometry.thickness", expected="that of plane patches"
        )
    points = quadrature_points(exact.degrees, patch.degrees)
    batches = partial(knot_span_batches, patch, points)
    state = settings.state if plane else "solid"
    return continuum_of(batches, material, state, thickness)


def patch_matrices(
    model: ModelFile, exact: NurbsPatch, patch: NurbsPatch
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Scalar mass and stiffness of one refined patch of a model."""
    assert model.material is not None
    continuum = patch_continuum(model, exact, patch)
    return assembled(
        continuum.batches(),
        len(patch.points),
        dimension=len(patch.degrees),
        density=model.material.density * continuum.thickness,
        law=continuum.law * continuum.thickness,
    )


def target_knots(settings: IgaDiscretisation) -> tuple[Array, ...]:
    """The knot vectors on [0, 1] that a discretisation asks for.

    Raises
    ------
    InputError : they do not fit the degrees.
    """
    return tuple(_target(settings, i) for i in range(len(settings.degrees)))


def _target(settings: IgaDiscretisation, i: int) -> Array:
    degree = settings.degrees[i]
    if settings.knots is not None:
        knots = settings.knots[i]
        place = f"discretisation.knots[{i}]"
        check_knots(knots, degree, len(knots) - degree - 1, place)
        array = np.array(knots, float)
        return (array - array[0]) / (array[-1] - array[0])
    if settings.elements is not None:
        return open_uniform_knots(degree, settings.elements[i])
    assert settings.functions is not None
    count = settings.functions[i]
    if count <= degree:
        raise InputError(
            f"{count} functions do not fit degree {degree}",
            place=f"discretisation.functions[{i}]",
            expected=f"at least {degree + 1} functions",
        )
    return open_uniform_knots(degree, count - degree)


def refined_for(model: ModelFile, exact: NurbsPatch) -> NurbsPatch:
    """A patch refined as the model asks.

    Raises
    ------
    InputError : the refined basis does not hold the geometry.
    """
    settings = model.discretisation
    assert isinstance(settings, IgaDiscretisation)
    if len(settings.degrees) != len(exact.degrees):
        raise InputError(
            f"has {len(settings.degrees)} entries",
            place="discretisation.degrees",
            expected=f"{len(exact.degrees)}, one per direction of the geometry",
        )
    knots = target_knots(settings)
    try:
        return refined(exact, settings.degrees, knots)
    except InputError as error:
        place = f"discretisation, {error.place}"
        raise InputError(error.problem, place=place, expected=error.expected) from None


def quadrature_points(
    geometry_degrees: tuple[int, ...], degrees: tuple[int, ...]
) -> tuple[int, ...]:
    """Gauss points per knot span and direction that integrate the mass exactly.

    For weights of 1, N_i N_j has degree 2 p and the determinant of the Jacobian at
    most d p_geometry - 1 in each direction.
    """
    d = len(degrees)
    return tuple(
        (2 * p + d * g - 1) // 2 + 1
        for g, p in zip(geometry_degrees, degrees, strict=True)
    )


def knot_span_batches(
    patch: NurbsPatch, points: tuple[int, ...]
) -> Iterator[ElementBatch]:
    """All non-empty knot spans of a patch at their Gauss points.

    Raises
    ------
    InputError : the geometry folds.
    """
    tables, weights = _tables(patch, points)
    spans = [len(w) for w in weights]
    per_slice = int(
        np.prod(spans[1:]) * np.prod([t.values.shape[-1] for t in tables])
    ) * int(np.prod(points))
    step = max(1, _BATCH_ENTRIES // per_slice)
    for start in range(0, spans[0], step):
        part = slice(start, start + step)
        first = LocalBasis(
            tables[0].first[part], tables[0].values[part], tables[0].derivatives[part]
        )
        yield _batch(patch, [first, *tables[1:]], [weights[0][part], *weights[1:]])


def _tables(
    patch: NurbsPatch, points: tuple[int, ...]
) -> tuple[list[LocalBasis], list[Array]]:
    """Per direction: basis (nspans, ng, p + 1) and Gauss weights (nspans, ng)."""
    tables, weights = [], []
    for knots, degree, count in zip(patch.knots, patch.degrees, points, strict=True):
        x, w = gauss_points(knots, count)
        flat = local_basis(knots, degree, x.ravel())
        shape = (*x.shape, degree + 1)
        tables.append(
            LocalBasis(
                flat.first.reshape(x.shape)[:, 0],
                flat.values.reshape(shape),
                flat.derivatives.reshape(shape),
            )
        )
        weights.append(w)
    return tables, weights


def _batch(
    patch: NurbsPatch, tables: list[LocalBasis], weights: list[Array]
) -> ElementBatch:
    index = [
        t.first[:, None] + np.arange(t.values.shape[-1], dtype=np.int64) for t in tables
    ]
    strides = np.cumprod([1, *patch.shape[:0:-1]])[::-1]
    nodes = index[0] * strides[0]
    for columns, stride in zip(index[1:], strides[1:], strict=True):
        sums = nodes[:, None, :, None] + columns[None, :, None, :] * stride
        nodes = sums.reshape(len(nodes) * len(columns), -1)
    values = _tensor([t.values for t in tables])
    gradients = [
        _tensor([t.derivatives if i == k else t.values for i, t in enumerate(tables)])
        for k in range(len(tables))
    ]
    measures = _tensor([w[..., None] for w in weights])[..., 0]
    values, slopes = rational(
        values, np.stack(gradients, -1), patch.weights.ravel()[nodes][:, None]
    )
    return mapped_batch(nodes, patch.points, values, slopes, measures)


def _tensor(factors: list[Array]) -> Array:
    """Products of (spans, points, functions) arrays over all directions."""
    product = factors[0]
    for factor in factors[1:]:
        e, g, b = (x * y for x, y in zip(product.shape, factor.shape, strict=True))
        product = np.einsum("agi,bhj->abghij", product, factor).reshape(e, g, b)
    return product
