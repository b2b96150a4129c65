"""NURBS patches of any number of parametric directions, and their refinement.

B-spline bases of one parametric direction.

Values by the recursion of Cox and de Boor, derivatives from the values of one degree
less (Piegl & Tiller, The NURBS Book, eq. 2.5 and 2.7).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.linalg import splu

from sidtool.formats.base.complex_step import numbers
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array
from sidtool.formats.model.geometry import NurbsGeometry, VolumeGeometry
from sidtool.formats.toml.reading import LARGEST_NUMBER

from ..mesh.reference_elements import gauss_legendre

Indices = NDArray[np.int64]

#: Smallest weight beside the largest.
_MIN_WEIGHT_RATIO = 1e-8
#: Relative rounding of the lengths of knot spans.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class LocalBasis:
    """The degree + 1 functions that do not vanish at each of some points.

    Attributes
    ----------
    first : (npoints,) number of the first of them
    values, derivatives : (npoints, degree + 1)
    """

    first: Indices
    values: Array
    derivatives: Array


def local_basis(knots: Array, degree: int, points: ArrayLike) -> LocalBasis:
    """Values and first derivatives; at a knot, those of the span to its right.

    Parameters
    ----------
    knots : open knot vector
    points : (npoints,) inside the range of the knots
    """
    x = numbers(points)[:, None]
    last = len(knots) - degree - 2
    span = np.searchsorted(knots, x[:, 0].real, side="right") - 1
    span = np.clip(span, degree, last)[:, None]
    values = derivatives = np.ones((len(x), 1))
    for p in range(1, degree + 1):
        start = span + np.arange(1 - p, 1)
        left, right = knots[start], knots[start + p]
        share = values / (right - left)
        values = np.zeros((len(x), p + 1), x.dtype)
        values[:, 1:] = (x - left) * share
        values[:, :-1] += (right - x) * share
        if p == degree:
            derivatives = np.zeros_like(values)
            derivatives[:, 1:] = p * share
            derivatives[:, :-1] -= p * share
    return LocalBasis(span[:, 0] - degree, values, derivatives)


def collocation(knots: Array, degree: int, points: ArrayLike) -> sp.csr_matrix:
    """(npoints, n) values of all functions."""
    basis = local_basis(knots, degree, points)
    columns = basis.first[:, None] + np.arange(degree + 1)
    starts = np.arange(0, columns.size + 1, degree + 1)
    shape = (len(columns), len(knots) - degree - 1)
    return sp.csr_matrix((basis.values.ravel(), columns.ravel(), starts), shape=shape)


def local_basis_from_left(knots: Array, degree: int, points: ArrayLike) -> LocalBasis:
    """Return the basis as `local_basis`; at a knot, the limit from the span to its
    left.
    """
    total = knots[0] + knots[-1]
    mirrored = local_basis(total - knots[::-1], degree, total - np.asarray(points))
    count = len(knots) - degree - 1
    return LocalBasis(
        count - 1 - degree - mirrored.first,
        mirrored.values[:, ::-1],
        -mirrored.derivatives[:, ::-1],
    )


def breakpoints(knots: Array) -> Array:
    """The distinct knots: the ends of the knot spans."""
    return np.unique(knots)


def gauss_points(knots: Array, count: int) -> tuple[Array, Array]:
    """Gauss-Legendre points and weights, (nspans, count) each, in every knot span."""
    reference, weights = gauss_legendre(count)
    ends = breakpoints(knots)
    half = np.diff(ends)[:, None] / 2
    middle = ((ends[:-1] + ends[1:]) / 2)[:, None]
    return middle + half * reference, half * weights


def open_uniform_knots(degree: int, spans: int) -> Array:
    """Open knot vector on [0, 1] with equal spans and single inner knots."""
    inner = np.arange(1, spans) / spans
    return np.concatenate([np.zeros(degree + 1), inner, np.ones(degree + 1)])


def greville_points(knots: Array, degree: int) -> Array:
    """Averages of `degree` consecutive knots, one per basis function."""
    windows = np.lib.stride_tricks.sliding_window_view(knots[1:-1], degree)
    return np.clip(windows.mean(axis=1), knots[0], knots[-1])


@dataclass(frozen=True, eq=False)
class NurbsPatch:
    """A map from parameters in [0, 1]^k to points in d dimensions.

    Attributes
    ----------
    degrees : k degrees
    knots : k open knot vectors on [0, 1]
    control_points : (n_1, ..., n_k, d) [m]
    weights : (n_1, ..., n_k) positive

    Raises
    ------
    InputError : a weight is so small that its function vanishes beside the others, or
        squares of positions overflow.
    """

    degrees: tuple[int, ...]
    knots: tuple[Array, ...]
    control_points: Array
    weights: Array

    def __post_init__(self) -> None:
        sizes = self.weights.real
        if sizes.min() <= _MIN_WEIGHT_RATIO * sizes.max():
            raise InputError(
                f"weights range from {sizes.min():.3g} to {sizes.max():.3g}",
                place="weights",
                expected="positive weights of like size",
            )
        farthest = np.abs(self.control_points.real).max(initial=0.0)
        if not farthest <= LARGEST_NUMBER:
            raise InputError(
                f"a control point is at {farthest:g}",
                place="control_points",
                expected=f"at most {LARGEST_NUMBER:g} in size",
            )

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of functions per parametric direction."""
        return self.weights.shape

    @property
    def real(self) -> NurbsPatch:
        """The patch without imaginary steps, for decisions."""
        if np.isrealobj(self.control_points) and np.isrealobj(self.weights):
            return self
        points, weights = self.control_points.real, self.weights.real
        return replace(self, control_points=points, weights=weights)

    @property
    def points(self) -> Array:
        """(n, d) control points, the last parametric direction running fastest."""
        return self.control_points.reshape(-1, self.control_points.shape[-1])


@dataclass(frozen=True)
class PatchContent:
    """Patches by name as a key of a cache: equal where all their numbers are."""

    digest: bytes
    patches: Mapping[str, NurbsPatch] = field(compare=False)

    @classmethod
    def of(cls, patches: Mapping[str, NurbsPatch]) -> PatchContent:
        """Return the content of patches."""
        sha = hashlib.sha256()
        for name, patch in patches.items():
            sha.update(repr((name, patch.degrees, patch.shape)).encode())
            for part in (*patch.knots, patch.control_points, patch.weights):
                sha.update(np.ascontiguousarray(part).tobytes())
        return cls(sha.digest(), patches)


def patch_from_model(geometry: NurbsGeometry | VolumeGeometry) -> NurbsPatch:
    """The patch of a model file, its parameters scaled to [0, 1]."""
    points = numbers(geometry.control_points)
    weights = geometry.weights
    return NurbsPatch(
        degrees=geometry.degrees,
        knots=tuple(scale_knots(np.array(knots, float)) for knots in geometry.knots),
        control_points=points,
        weights=np.ones(points.shape[:-1]) if weights is None else np.array(weights),
    )


def side_nodes(patch: NurbsPatch, direction: int, end: int) -> Indices:
    """The control points of the side where parameter `direction` is 0 or 1 (`end`)."""
    numbers = np.arange(patch.weights.size).reshape(patch.shape)
    return np.take(numbers, -1 if end else 0, axis=direction).ravel()


def evaluate_grid(patch: NurbsPatch, parameters: tuple[Array, ...]) -> Array:
    """Points of the patch on a tensor grid of parameters, (m_1, ..., m_k, d)."""
    w = patch.weights[..., None]
    homogeneous = np.concatenate([patch.control_points * w, w], axis=-1)
    for axis, (knots, degree, x) in enumerate(
        zip(patch.knots, patch.degrees, parameters, strict=True)
    ):
        basis = local_basis(knots, degree, x)
        columns = basis.first[:, None] + np.arange(degree + 1)
        moved = np.moveaxis(homogeneous, axis, 0)
        new = np.einsum("pb,pb...->p...", basis.values, moved[columns])
        homogeneous = np.moveaxis(new, 0, axis)
    return homogeneous[..., :-1] / homogeneous[..., -1:]


def sampled_patch(patch: NurbsPatch, elements: tuple[int, ...]) -> NurbsPatch:
    """A mesh as a patch of degree 1: points of `patch` at equal parameter steps."""
    axes = tuple(np.linspace(0, 1, count + 1) for count in elements)
    points = evaluate_grid(patch, axes)
    return NurbsPatch(
        degrees=(1,) * len(elements),
        knots=tuple(open_uniform_knots(1, count) for count in elements),
        control_points=points,
        weights=np.ones(points.shape[:-1]),
    )


@dataclass(frozen=True, eq=False)
class PointBasis:
    """The functions that do not vanish at one point of a patch.

    Attributes
    ----------
    nodes : (m,) numbers of their control points
    values : (m,) of the rational functions
    gradients : (m, k) by the parameters
    """

    nodes: Indices
    values: Array
    gradients: Array


def point_basis(
    patch: NurbsPatch, parameters: ArrayLike, from_left: tuple[bool, ...] | None = None
) -> PointBasis:
    """The rational basis at one point.

    Parameters
    ----------
    parameters : (k,) in [0, 1]
    from_left : per direction, whether a derivative at a knot is that of the span to
        its left
    """
    lefts = from_left or (False,) * len(patch.degrees)
    rows = [
        (local_basis_from_left if left else local_basis)(knots, degree, [x])
        for left, knots, degree, x in zip(
            lefts, patch.knots, patch.degrees, np.asarray(parameters), strict=True
        )
    ]
    index = [row.first[0] + np.arange(row.values.shape[1]) for row in rows]
    grid = np.meshgrid(*index, indexing="ij")
    nodes = np.asarray(np.ravel_multi_index(tuple(grid), patch.shape)).ravel()
    gradients = [_outer_product(rows, i) for i in range(len(rows))]
    values, slopes = rational_functions(
        _outer_product(rows, None),
        np.stack(gradients, -1),
        patch.weights.ravel()[nodes],
    )
    return PointBasis(nodes, values, slopes)


def scattered_basis(patch: NurbsPatch, parameters: Array) -> PointBasis:
    """The rational bases at many points (n, k): arrays of `PointBasis` by point.

    At a knot, derivatives are those of the span to its right.
    """
    count = len(parameters)
    nodes = np.zeros((count, 1), np.int64)
    values, slopes = np.ones((count, 1)), np.ones((count, 1, len(patch.degrees)))
    for i, (knots, degree) in enumerate(zip(patch.knots, patch.degrees, strict=True)):
        row = local_basis(knots, degree, parameters[:, i])
        index = row.first[:, None] + np.arange(degree + 1)
        nodes = (nodes[:, :, None] * patch.shape[i] + index[:, None]).reshape(count, -1)
        values = (values[:, :, None] * row.values[:, None]).reshape(count, -1)
        factors = np.repeat(row.values[:, :, None], len(patch.degrees), axis=2)
        factors[:, :, i] = row.derivatives
        slopes = slopes[:, :, None] * factors[:, None]
        slopes = slopes.reshape(count, -1, len(patch.degrees))
    return PointBasis(
        nodes, *rational_functions(values, slopes, patch.weights.ravel()[nodes])
    )


def evaluate_points(patch: NurbsPatch, parameters: Array) -> Array:
    """Points (n, d) of the patch at parameters (n, k)."""
    basis = scattered_basis(patch, parameters)
    points: Array = np.einsum("nm,nmd->nd", basis.values, patch.points[basis.nodes])
    return points


def rational_functions(
    values: Array, gradients: Array, weights: Array
) -> tuple[Array, Array]:
    """Rational functions w N / sum(w N) and their gradients.

    Parameters
    ----------
    values : (..., m) B-spline products N
    gradients : (..., m, k)
    weights : (..., m)
    """
    weighted = values * weights
    slopes = gradients * weights[..., None]
    total = weighted.sum(-1, keepdims=True)
    result = weighted / total
    drift = slopes.sum(-2, keepdims=True)
    return result, (slopes - result[..., None] * drift) / total[..., None]


def _outer_product(rows: list[LocalBasis], derived: int | None) -> Array:
    product = np.ones(1)
    for i, row in enumerate(rows):
        factor = row.derivatives[0] if i == derived else row.values[0]
        product = np.multiply.outer(product, factor).ravel()
    return product


def scale_knots(knots: Array) -> Array:
    """Knots on the range [0, 1]."""
    return (knots - knots[0]) / (knots[-1] - knots[0])


def refine_patch(
    patch: NurbsPatch, degrees: tuple[int, ...], knots: tuple[Array, ...]
) -> NurbsPatch:
    """The same patch in a basis of higher degrees and more knots.

    The new space holds the old one, so that interpolating the homogeneous coordinates
    at the Greville points of the new basis reproduces the geometry exactly.

    Parameters
    ----------
    degrees : of the new basis
    knots : of the new basis, on [0, 1]

    Raises
    ------
    InputError : the new space does not hold the old one.
    """
    w = patch.weights[..., None]
    homogeneous = np.concatenate([patch.control_points * w, w], axis=-1)
    for axis, (degree, target) in enumerate(zip(degrees, knots, strict=True)):
        old = (patch.knots[axis], patch.degrees[axis])
        check_holds(*old, target, degree, f"direction {'uvw'[axis]}")
        change = _change_of_basis(*old, target, degree)
        moved = np.moveaxis(homogeneous, axis, 0)
        homogeneous = np.moveaxis(np.tensordot(change, moved, axes=1), 0, axis)
    weights = homogeneous[..., -1]
    return NurbsPatch(
        degrees=degrees,
        knots=knots,
        control_points=homogeneous[..., :-1] / weights[..., None],
        weights=weights,
    )


def k_refined_knots(knots: Array, degree: int, target_degree: int, spans: int) -> Array:
    """The knots of a basis of higher degree with more knots that holds the old one.

    First the degree is raised, which keeps the continuity of each inner knot, then each
    knot span is divided into equal ones not longer than 1 / `spans` (k-refinement).
    For knots and their mirror image the results are mirror images, so that patches
    that match at a side do so afterwards.

    Parameters
    ----------
    knots, degree : of the old basis, on [0, 1]
    target_degree : not below `degree`

    References
    ----------
    Hughes, Cottrell & Bazilevs 2005, Comput. Methods Appl. Mech. Engrg. 194, sec. 2.
    """
    ends, counts = np.unique(knots, return_counts=True)
    refined = [np.zeros(target_degree + 1)]
    for a, b, count in zip(ends[:-1], ends[1:], counts[1:], strict=True):
        pieces = max(1, int(np.ceil((b - a) * spans * (1 - _ROUNDING))))
        refined.append(a + (b - a) * np.arange(1, pieces) / pieces)
        refined.append(np.full(count + target_degree - degree, b))
    return np.concatenate(refined)


def check_degree(degree: int, target_degree: int, place: str) -> None:
    """Check that a degree is at least that of the geometry.

    Raises
    ------
    InputError : it is lower.
    """
    if target_degree < degree:
        raise InputError(
            f"degree {target_degree} cannot represent the geometry",
            place=place,
            expected=f"a degree of at least {degree}, that of the geometry",
        )


def check_holds(
    knots: Array, degree: int, target: Array, target_degree: int, place: str
) -> None:
    """Check that the splines on `target` contain those on `knots`.

    Raises
    ------
    InputError : the degree is lower, or an inner knot is missing or too smooth.
    """
    check_degree(degree, target_degree, place)
    for knot in breakpoints(knots)[1:-1]:
        multiplicity = np.count_nonzero(knots == knot)
        needed = int(multiplicity) + target_degree - degree
        count = np.count_nonzero(np.isclose(target, knot, rtol=0, atol=1e-12))
        if count < needed:
            raise InputError(
                f"the knot vector has the geometry's inner knot {knot:g} {count} times",
                place=place,
                expected=f"it {needed} times, to keep the geometry unchanged",
            )


def _change_of_basis(knots: Array, degree: int, target: Array, new: int) -> Array:
    """(n_new, n_old) coefficients of the old basis functions in the new basis."""
    points = greville_points(target, new)
    old = collocation(knots, degree, points).toarray()
    return splu(collocation(target, new, points).tocsc()).solve(old)
