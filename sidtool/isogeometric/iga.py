"""Isogeometric analysis: a patch itself, refined, is the basis.

Source: Hughes, Cottrell & Bazilevs 2005, Comput. Methods Appl. Mech. Engrg. 194.
"""

from bisect import bisect_left
from collections.abc import Iterator
from functools import lru_cache, partial
from itertools import product

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.diagnostics import Diagnostic, diagnose
from sidtool.formats.model import IgaDiscretisation, ModelFile
from sidtool.formats.model.tables import check_knots

from ..elements.finite_element_model import GeometryMass
from ..elements.mass_properties import patch_mass
from ..elements.material_points import Continuum, make_continuum
from ..elements.solid_elements import ElementBatch, assemble_body, mapped_batch
from ..geometry.nurbs_patch import (
    LocalBasis,
    NurbsPatch,
    PatchContent,
    breakpoints,
    check_degree,
    gauss_points,
    k_refined_knots,
    local_basis,
    rational_functions,
    refine_patch,
)
from ..geometry.patch_evaluation import map_grid

Indices = NDArray[np.int64]

#: Largest number of Gauss points per knot span, for very different weights; relative
#: tolerance of their integrals; number of lines on which they are checked.
_MAX_GAUSS_POINTS, _RATIONAL_TOLERANCE, _CHECKED_LINES = 64, 1e-10, 7
#: Entries of the largest array of one batch of knot spans, its strains.
_BATCH_ENTRIES = 1_000_000
#: A patch is degenerate where its Jacobian is below this share of its largest; slopes
#: are then evaluated at this distance from its edges, where they exist.
_DEGENERATE_SHARE, _DISTANCE_FROM_EDGES = 1e-6, 1e-7


def expected_mass(model: ModelFile, patches: list[NurbsPatch]) -> GeometryMass:
    """The mass and centre of the patches of a model, from their sides."""
    assert model.material is not None
    plane = len(patches[0].degrees) == 2
    thickness = getattr(model.geometry, "thickness", 1.0) if plane else 1.0
    return patch_mass(patches, model.material.density * float(thickness))


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
    points = quadrature_points(exact.real, patch.real)
    batches = partial(knot_span_batches, patch, points)
    state = settings.state if plane else "solid"
    return make_continuum(batches, material, state, thickness)


def patch_matrices(
    model: ModelFile, exact: NurbsPatch, patch: NurbsPatch
) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Scalar mass and stiffness of one refined patch of a model."""
    assert model.material is not None
    continuum = patch_continuum(model, exact, patch)
    return assemble_body(
        continuum.batches(),
        len(patch.points),
        dimension=len(patch.degrees),
        density=model.material.density * continuum.thickness,
        law=continuum.law * continuum.thickness,
    )


def refine_for_model(model: ModelFile, exact: NurbsPatch) -> NurbsPatch:
    """Return a patch refined according to the model.

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
    try:
        return refine_patch(exact, settings.degrees, target_knots(settings, exact))
    except InputError as error:
        if not (error.place or "").startswith("direction"):
            raise
        place = f"discretisation, {error.place}"
        raise InputError(error.problem, place=place, expected=error.expected) from None


def target_knots(settings: IgaDiscretisation, exact: NurbsPatch) -> tuple[Array, ...]:
    """Return the knot vectors on [0, 1] of a discretisation.

    Raises
    ------
    InputError : they do not fit the degrees, or degrees are below the geometry's.
    """
    return tuple(
        _target_knots(settings, exact, i) for i in range(len(settings.degrees))
    )


def _target_knots(settings: IgaDiscretisation, exact: NurbsPatch, i: int) -> Array:
    degree = settings.degrees[i]
    if settings.knots is not None:
        knots = settings.knots[i]
        place = f"discretisation.knots[{i}]"
        check_knots(knots, degree, len(knots) - degree - 1, place)
        array = np.array(knots, float)
        return (array - array[0]) / (array[-1] - array[0])
    check_degree(exact.degrees[i], degree, f"direction {'uvw'[i]}")
    with_spans = partial(k_refined_knots, exact.knots[i], exact.degrees[i], degree)
    if settings.elements is not None:
        return with_spans(settings.elements[i])
    assert settings.functions is not None
    count = settings.functions[i]
    if count <= degree:
        raise InputError(
            f"{count} functions do not fit degree {degree}",
            place=f"discretisation.functions[{i}]",
            expected=f"at least {degree + 1} functions",
        )
    needed = count + degree + 1
    spans = range(1, count + 1)
    return with_spans(
        spans[bisect_left(spans, needed, key=lambda n: len(with_spans(n)))]
    )


def refinement_notes(
    settings: IgaDiscretisation, fine: NurbsPatch
) -> tuple[Diagnostic, ...]:
    """Note where a refined patch has other numbers of functions or elements than
    requested.
    """
    found = []
    for i, knots in enumerate(fine.knots):
        for key, counts in (
            ("functions", fine.shape[i]),
            ("elements", len(breakpoints(knots)) - 1),
        ):
            requested = getattr(settings, key)
            if requested is not None and requested[i] != counts:
                found.append(
                    diagnose(
                        "N155",
                        f"discretisation.{key}[{i}]",
                        found=counts,
                        requested=requested[i],
                    )
                )
    return tuple(found)


def quadrature_points(exact: NurbsPatch, patch: NurbsPatch) -> tuple[int, ...]:
    """Gauss points per knot span and direction that integrate the mass exactly.

    For weights of 1, N_i N_j has degree 2 p and the determinant of the Jacobian at
    most d p_geometry - 1 in each direction. Other weights W divide the integrand by
    W^2: as many points as det J / W^2 needs then, and p for the polynomials N_i N_j.
    """
    d = len(patch.degrees)
    counts = [
        (2 * p + d * g - 1) // 2 + 1
        for g, p in zip(exact.degrees, patch.degrees, strict=True)
    ]
    if np.ptp(exact.weights) > 1e-12 * exact.weights.max():
        for i, p in enumerate(patch.degrees):
            content, knots = (
                PatchContent.of({"": exact}),
                tuple(patch.knots[i].tolist()),
            )
            counts[i] = max(counts[i], _rational_points(content, knots, i) + p)
    return tuple(counts)


@lru_cache(maxsize=256)
def _rational_points(
    content: PatchContent, knots: tuple[float, ...], direction: int
) -> int:
    """Gauss points with which det J / W^2 is integrated along one direction."""
    exact = content.patches[""]
    axes = [np.linspace(0, 1, _CHECKED_LINES) for _ in exact.degrees]

    def spans(count: int) -> Array:
        x, w = gauss_points(np.array(knots), count)
        axes[direction] = x.ravel()
        _, slopes, weights = map_grid(exact, tuple(axes))
        values = np.moveaxis(np.linalg.det(slopes) / weights**2, direction, -1)
        return np.asarray((values.reshape(*values.shape[:-1], *x.shape) * w).sum(-1))

    fine = spans(_MAX_GAUSS_POINTS)
    scale = _RATIONAL_TOLERANCE * np.maximum(np.abs(fine), 1e-6 * np.abs(fine).max())
    for count in range(2, _MAX_GAUSS_POINTS):
        if (np.abs(spans(count) - fine) <= scale).all():
            return count
    return _MAX_GAUSS_POINTS


def knot_span_batches(
    patch: NurbsPatch, points: tuple[int, ...]
) -> Iterator[ElementBatch]:
    """All non-empty knot spans of a patch at their Gauss points.

    Raises
    ------
    InputError : the geometry folds.
    """
    tables, weights = _basis_tables(patch, points)
    spans = [len(w) for w in weights]
    functions = [t.values.shape[-1] for t in tables]
    d = len(spans)
    strains = d * d * (d + 1) // 2  # For each displacement of each function.
    steps = _batch_steps(spans, strains * int(np.prod(functions) * np.prod(points)))
    ranges = [range(0, n, step) for n, step in zip(spans, steps, strict=True)]
    for starts in product(*ranges):
        parts = [slice(s, s + step) for s, step in zip(starts, steps, strict=True)]
        cut = [
            LocalBasis(t.first[part], t.values[part], t.derivatives[part])
            for t, part in zip(tables, parts, strict=True)
        ]
        yield _element_batch(
            patch, cut, [w[p] for w, p in zip(weights, parts, strict=True)]
        )


def _batch_steps(spans: list[int], per_span: int) -> list[int]:
    """Knot spans per direction whose arrays are not too large together."""
    steps = list(spans)
    for i in range(len(steps)):
        others = per_span * int(np.prod(steps[i + 1 :]))
        steps[i] = max(1, min(spans[i], _BATCH_ENTRIES // others))
        if steps[i] > 1:
            break
    return steps


def _basis_tables(
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


def sampled_batch(
    patch: NurbsPatch, axes: tuple[Array, ...]
) -> tuple[Indices, Array, Array]:
    """Evaluate the functions of a patch at the points of a grid of parameters.

    The slopes of a patch that is degenerate at some of the points are those of points
    inside the patch, close to its edges: at degenerate edges they do not exist.

    Parameters
    ----------
    axes : parameters of each direction

    Returns
    -------
    nodes (p, m) that reach each point, their values (p, m) and slopes (p, m, d) [1/m]
    """
    nodes, values, slopes = _rational_functions(
        patch, _single_point_tables(patch, axes)
    )
    jacobians = np.swapaxes(patch.points[nodes], 1, 2) @ slopes[:, 0]
    sizes = np.abs(np.linalg.det(jacobians))
    inner = axes
    if sizes.min() < _DEGENERATE_SHARE * sizes.max():
        inset = _DISTANCE_FROM_EDGES
        inner = tuple(np.clip(axis, inset, 1 - inset) for axis in axes)
    ones = [np.ones((len(axis), 1)) for axis in inner]
    batch = _element_batch(patch, _single_point_tables(patch, inner), ones)
    assert np.array_equal(nodes, batch.nodes)
    return nodes, values[:, 0], batch.gradients[:, 0]


def _single_point_tables(
    patch: NurbsPatch, axes: tuple[Array, ...]
) -> list[LocalBasis]:
    """Tables of parameters, each as a span with one point."""
    tables = []
    for knots, degree, x in zip(patch.knots, patch.degrees, axes, strict=True):
        flat = local_basis(knots, degree, x)
        tables.append(
            LocalBasis(flat.first, flat.values[:, None], flat.derivatives[:, None])
        )
    return tables


def _element_batch(
    patch: NurbsPatch, tables: list[LocalBasis], weights: list[Array]
) -> ElementBatch:
    nodes, values, slopes = _rational_functions(patch, tables)
    measures = _tensor_product([w[..., None] for w in weights])[..., 0]
    return mapped_batch(nodes, patch.points, values, slopes, measures)


def _rational_functions(
    patch: NurbsPatch, tables: list[LocalBasis]
) -> tuple[Indices, Array, Array]:
    """Numbers (e, m), values (e, g, m) and slopes by the parameters (e, g, m, d)."""
    index = [
        t.first[:, None] + np.arange(t.values.shape[-1], dtype=np.int64) for t in tables
    ]
    strides = np.cumprod([1, *patch.shape[:0:-1]])[::-1]
    nodes = index[0] * strides[0]
    for columns, stride in zip(index[1:], strides[1:], strict=True):
        sums = nodes[:, None, :, None] + columns[None, :, None, :] * stride
        nodes = sums.reshape(len(nodes) * len(columns), -1)
    values = _tensor_product([t.values for t in tables])
    gradients = [
        _tensor_product(
            [t.derivatives if i == k else t.values for i, t in enumerate(tables)]
        )
        for k in range(len(tables))
    ]
    values, slopes = rational_functions(
        values, np.stack(gradients, -1), patch.weights.ravel()[nodes][:, None]
    )
    return nodes, values, slopes


def _tensor_product(factors: list[Array]) -> Array:
    """Products of (spans, points, functions) arrays over all directions."""
    product = factors[0]
    for factor in factors[1:]:
        e, g, b = (x * y for x, y in zip(product.shape, factor.shape, strict=True))
        product = np.einsum("agi,bhj->abghij", product, factor).reshape(e, g, b)
    return product
