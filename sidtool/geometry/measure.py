"""The volume and the centre of a patch from its surface, by the divergence theorem.

A rule of its own beside the quadrature of elements, to check that one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .bspline import gauss_points, local_basis
from .patch import NurbsPatch

Array = NDArray[np.float64]

#: Gauss points per knot span that are tried, until two agree to `_AGREED`.
_COUNTS = (8, 16, 32, 64, 128)
_AGREED = 1e-12


def map_grid(
    patch: NurbsPatch, parameters: tuple[Array, ...]
) -> tuple[Array, Array, Array]:
    """The map on a tensor grid of parameters (m_1, ..., m_k).

    Returns
    -------
    points (m_1, ..., m_k, d), derivatives by the parameters (..., d, k) and weight
    functions (...)
    """
    w = patch.weights[..., None]
    homogeneous = np.concatenate([patch.control_points * w, w], axis=-1)
    fields = [homogeneous] * (len(parameters) + 1)
    for axis, (knots, degree, x) in enumerate(
        zip(patch.knots, patch.degrees, parameters, strict=True)
    ):
        basis = local_basis(knots, degree, x)
        columns = basis.first[:, None] + np.arange(degree + 1)
        for i, field in enumerate(fields):
            factors = basis.derivatives if i == axis + 1 else basis.values
            moved = np.moveaxis(field, axis, 0)
            new = np.einsum("pb,pb...->p...", factors, moved[columns])
            fields[i] = np.moveaxis(new, 0, axis)
    weights = fields[0][..., -1]
    points = fields[0][..., :-1] / weights[..., None]
    slopes = [
        (f[..., :-1] - points * f[..., -1:]) / weights[..., None] for f in fields[1:]
    ]
    return points, np.stack(slopes, axis=-1), weights


def patch_moments(patch: NurbsPatch) -> tuple[float, Array]:
    """Volume (area in the plane) and first moments (d,), from the sides alone."""
    before = None
    for count in _COUNTS:
        moments = sum(
            _side_moments(patch, direction, end, count)
            for direction in range(len(patch.degrees))
            for end in (0, 1)
        )
        found = np.asarray(moments, float)
        if before is not None and _agree(patch, found, before):
            break
        before = found
    return float(found[0]), found[1:]


def _agree(patch: NurbsPatch, found: Array, before: Array) -> bool:
    reach = np.abs(patch.points).max()
    scale = abs(found[0]) * np.array([1, *[max(reach, 1e-300)] * (len(found) - 1)])
    return bool((np.abs(found - before) <= _AGREED * scale).all())


def _side_moments(patch: NurbsPatch, direction: int, end: int, count: int) -> Array:
    """(1 + d,) shares of one side: x . n / d and x_a^2 n_a / 2, integrated."""
    axes, rules = [], []
    for i, knots in enumerate(patch.knots):
        x, w = gauss_points(knots, count)
        axes.append(np.array([float(end)]) if i == direction else x.ravel())
        rules.append(np.ones(1) if i == direction else w.ravel())
    points, slopes, _ = map_grid(patch, tuple(axes))
    d = points.shape[-1]
    along = [slopes[..., (direction + i) % d] for i in range(1, d)]
    if d == 2:
        tangent = along[0] * (1 if direction == 0 else -1)
        normals = np.stack([tangent[..., 1], -tangent[..., 0]], axis=-1)
    else:
        normals = np.cross(along[0], along[1])
    weights = rules[0]
    for rule in rules[1:]:
        weights = np.multiply.outer(weights, rule)
    flow = normals * (weights * (1 if end else -1))[..., None]
    shares = flow.reshape(-1, d), points.reshape(-1, d)
    volume = np.einsum("na,na->", *shares) / d
    first = np.einsum("na,na->a", shares[0], shares[1] ** 2) / 2
    return np.array([volume, *first])
