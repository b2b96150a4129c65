"""Parameters of given points of a patch, and volume and centre of a patch.

Volume and centre follow from the surface by the divergence theorem. The rule is
independent of the quadrature of the elements, to check that one.
"""

from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sidtool.formats.base.complex_step import numbers
from sidtool.formats.base.errors import InputError
from sidtool.formats.base.sid import Array

from .nurbs_patch import (
    NurbsPatch,
    evaluate_grid,
    evaluate_points,
    gauss_points,
    local_basis,
    scattered_basis,
)

_GRID = 33
#: Pairs of points and targets of which all are compared.
_FEW_PAIRS = 30_000
_ITERATIONS = 50
#: Distance to the patch, relative to its size, that still counts as on it.
_TOLERANCE = 1e-9

#: Gauss points per knot span, tried until two agree to `_CONVERGENCE_TOLERANCE`.
_GAUSS_POINT_COUNTS = (8, 16, 32, 64, 128)
_CONVERGENCE_TOLERANCE = 1e-12


def locate(patch: NurbsPatch, position: ArrayLike) -> Array:
    """The parameters (k,) at which the patch passes through `position`.

    Raises
    ------
    InputError : the position lies outside the patch; the nearest point is named.
    """
    target = numbers(position)
    parameters, nearest = nearest_parameters(patch, target[None])
    size = float(np.ptp(patch.real.points, axis=0).max())
    if np.linalg.norm(nearest[0] - target) > _TOLERANCE * size:
        place, near = (", ".join(f"{x:.6g}" for x in p) for p in (target, nearest[0]))
        raise InputError(
            f"({place}) lies outside the geometry",
            expected=f"a point of the body; near by is ({near})",
        )
    return np.asarray(parameters[0])


def may_be_inside(patch: NurbsPatch, points: Array) -> NDArray[np.bool_]:
    """Which points (n, d) are not too far from a coarse grid to be in the patch (n,).

    What is inside is at most half a cell from a point of the grid; a whole one is
    allowed for, as cells of curved patches are not even.
    """
    axes = tuple(np.linspace(0, 1, _GRID) for _ in patch.degrees)
    grid = evaluate_grid(patch, axes)
    distances, _ = _NearestPoints(grid.reshape(-1, grid.shape[-1])).query(points)
    return np.asarray(distances <= _cell_size(grid))


def _cell_size(grid: Array) -> float:
    """Sum over the directions of the longest distance between neighbours of a grid
    (m_1, ..., m_k, d).
    """
    lengths = (np.diff(grid, axis=i) for i in range(grid.ndim - 1))
    return float(sum(np.linalg.norm(x, axis=-1).max(initial=0.0) for x in lengths))


def nearest_parameters(
    patch: NurbsPatch,
    targets: Array,
    side: tuple[int, int] | None = None,
    reach: float = np.inf,
) -> tuple[Array, Array]:
    """Return the parameters (n, k) of the nearest points of the patch, and these
    points.

    Gauss-Newton with the parameters limited to [0, 1], from the nearest point of a
    coarse grid.

    Parameters
    ----------
    targets : (n, d)
    side : direction and end of the side that the points are on, if they are on one
    reach : for targets that are farther away than this, any point of the patch farther
        away is enough
    """
    count = len(patch.degrees)
    free = np.array([i for i in range(count) if side is None or i != side[0]])
    starts, grid, cell = _coarse_grid(patch, side)
    distances, numbers = grid.query(targets)
    parameters = starts[numbers]
    # no point of the patch is farther from the grid than a cell
    moving = np.flatnonzero(distances <= reach + cell)
    for _ in range(_ITERATIONS):
        if not moving.size:
            break
        basis = scattered_basis(patch, parameters[moving])
        corners = patch.points[basis.nodes]
        miss = targets[moving] - np.einsum("nm,nmd->nd", basis.values, corners)
        jacobian = np.einsum("nmd,nmk->ndk", corners, basis.gradients[..., free])
        step = np.einsum("nkd,nd->nk", np.linalg.pinv(jacobian), miss)
        before = parameters[np.ix_(moving, free)]
        after = np.clip(before + step, 0, 1)
        parameters[np.ix_(moving, free)] = after
        moving = moving[np.abs(after - before).max(axis=1) > 1e-15]
    return parameters, evaluate_points(patch, parameters)


class _NearestPoints:
    """Search for the nearest one of points (m, d).

    Few pairs are compared all: the import of `scipy.spatial` takes 50 ms.
    """

    def __init__(self, points: Array) -> None:
        self._points = points

    def query(self, targets: Array) -> tuple[Array, NDArray[np.int64]]:
        """Distances to the nearest points, and their numbers, for targets (n, d)."""
        if len(self._points) * len(targets) > _FEW_PAIRS:
            distances, numbers = self._tree.query(targets)
            return distances, numbers
        gaps = np.linalg.norm(targets[:, None] - self._points, axis=-1)
        return gaps.min(axis=1), gaps.argmin(axis=1)

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import cKDTree

        return cKDTree(self._points)


@lru_cache(maxsize=8)
def _coarse_grid(
    patch: NurbsPatch, side: tuple[int, int] | None
) -> tuple[Array, _NearestPoints, float]:
    """Parameters (m, k) of a coarse grid of a patch or a side, its points and the size
    of a cell. The sides of a patch are compared in pairs.
    """
    axes = [np.linspace(0, 1, _GRID) for _ in patch.degrees]
    if side is not None:
        axes[side[0]] = np.array([float(side[1])])
    grid = evaluate_grid(patch, tuple(axes))
    starts = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(axes))
    points = _NearestPoints(grid.reshape(-1, grid.shape[-1]))
    return starts, points, _cell_size(grid)


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
    for count in _GAUSS_POINT_COUNTS:
        moments = sum(
            _side_moments(patch, direction, end, count)
            for direction in range(len(patch.degrees))
            for end in (0, 1)
        )
        result = np.asarray(moments, float)
        if before is not None and _is_converged(patch, result, before):
            break
        before = result
    return float(result[0]), result[1:]


def _is_converged(patch: NurbsPatch, integrals: Array, before: Array) -> bool:
    reach = np.abs(patch.points).max()
    scale = abs(integrals[0]) * np.array(
        [1, *[max(reach, 1e-300)] * (len(integrals) - 1)]
    )
    return bool((np.abs(integrals - before) <= _CONVERGENCE_TOLERANCE * scale).all())


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
