"""The field of NURBS patches: points at equal steps of the parameters, evaluated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..frontends.elements.continuum import Continuum, stress_from_gradient, stress_six
from ..frontends.finite_element_model import FiniteElementModel
from ..frontends.iga import sampled_batch
from ..frontends.q4 import quadrilaterals
from ..frontends.sampled_volume import box_corners
from ..geometry.bspline import breakpoints
from ..geometry.patch import NurbsPatch
from .mesh_field import surface
from .sampled import Sampled

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Points of one patch at most.
_MOST = 200_000
#: Slopes are taken this far inside the patch, where degenerate edges have some.
_INSIDE = 1e-7


def patch_field(
    body: FiniteElementModel, patch: NurbsPatch, numbers: Indices, continuum: Continuum
) -> Sampled:
    """One patch of a body.

    numbers : (n,) nodes of the body that its control points are
    """
    axes = _axes(patch)
    shape = tuple(len(axis) for axis in axes)
    inner = tuple(np.clip(axis, _INSIDE, 1 - _INSIDE) for axis in axes)
    nodes, values, slopes = sampled_batch(patch, axes, inner)
    table = body.table[numbers[nodes], : len(shape)]
    points = np.einsum("pm,pmd->pd", values, patch.points[nodes])

    def displacement(fields: Array) -> Array:
        moved = np.einsum("pm,pmdk->pdk", values, fields[table], optimize=True)
        return np.pad(moved, ((0, 0), (0, 3 - len(shape)), (0, 0)))

    def stress(fields: Array) -> Array:
        gradient = np.einsum("pmb,pmck->pkcb", slopes, fields[table], optimize=True)
        tensor = stress_from_gradient(gradient, continuum.law)
        return np.moveaxis(stress_six(tensor, continuum.transverse), 1, 2)

    plane = len(shape) == 2
    cells = quadrilaterals(shape) if plane else _boxes(*shape)
    kind = "quad4" if plane else "hex8"
    return Sampled(
        positions=np.pad(points, ((0, 0), (0, 3 - len(shape)))),
        triangles=surface([(kind, cells)], np.arange(len(points)), plane),
        displacement=displacement,
        cells={kind: cells},
        thickness=continuum.thickness if plane else 0.0,
        stress=stress,
        transverse=np.full(len(points), continuum.transverse),
    )


def _axes(patch: NurbsPatch) -> tuple[Array, ...]:
    """Parameters: as many to a knot span as its degree, fewer of large patches."""
    counts = list(patch.degrees)
    while True:
        axes = tuple(
            _steps(breakpoints(knots), count)
            for knots, count in zip(patch.knots, counts, strict=True)
        )
        if np.prod([len(axis) for axis in axes]) <= _MOST or max(counts) == 1:
            return axes
        counts = [max(1, count - 1) for count in counts]


def _steps(ends: Array, count: int) -> Array:
    shares = np.arange(count) / count
    inner = (ends[:-1, None] + np.diff(ends)[:, None] * shares).ravel()
    return np.append(inner, ends[-1])


def _boxes(i: int, j: int, k: int) -> Indices:
    return box_corners((i - 1, j - 1, k - 1))
