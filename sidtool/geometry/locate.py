"""The parameters of points that are given by their positions."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sidtool.formats.errors import InputError

from .patch import NurbsPatch, evaluate_grid, evaluate_points, scattered_basis

Array = NDArray[np.float64]

_GRID = 33
_ITERATIONS = 50
#: Distance to the patch, relative to its size, that still counts as on it.
_TOLERANCE = 1e-9


def locate(patch: NurbsPatch, position: ArrayLike) -> Array:
    """The parameters (k,) at which the patch passes through `position`.

    Raises
    ------
    InputError : the position lies outside the patch; the nearest point is named.
    """
    target = np.asarray(position, float)
    parameters, nearest = nearest_parameters(patch, target[None])
    size = float(np.ptp(patch.points, axis=0).max())
    if np.linalg.norm(nearest[0] - target) > _TOLERANCE * size:
        place, near = (", ".join(f"{x:.6g}" for x in p) for p in (target, nearest[0]))
        raise InputError(
            f"({place}) lies outside the geometry",
            expected=f"a point of the body; near by is ({near})",
        )
    return np.asarray(parameters[0], float)


def may_be_inside(patch: NurbsPatch, points: Array) -> NDArray[np.bool_]:
    """Which points (n, d) are not too far from a coarse grid to be in the patch (n,).

    What is inside is at most half a cell from a point of the grid; a whole one is
    allowed for, as cells of curved patches are not even.
    """
    from scipy.spatial import cKDTree

    axes = tuple(np.linspace(0, 1, _GRID) for _ in patch.degrees)
    grid = evaluate_grid(patch, axes)
    cell = sum(
        np.linalg.norm(np.diff(grid, axis=i), axis=-1).max() for i in range(len(axes))
    )
    distances, _ = cKDTree(grid.reshape(-1, grid.shape[-1])).query(points)
    return np.asarray(distances <= cell)


def nearest_parameters(
    patch: NurbsPatch, targets: Array, side: tuple[int, int] | None = None
) -> tuple[Array, Array]:
    """The parameters (n, k) of points of the patch near to others, and these points.

    Gauss-Newton with the parameters kept inside [0, 1], from the nearest point of a
    coarse grid.

    Parameters
    ----------
    targets : (n, d)
    side : direction and end of the side that the points are on, if they are on one
    """
    from scipy.spatial import cKDTree

    axes = [np.linspace(0, 1, _GRID) for _ in patch.degrees]
    if side is not None:
        axes[side[0]] = np.array([float(side[1])])
    free = np.flatnonzero([len(axis) > 1 for axis in axes])
    grid = evaluate_grid(patch, tuple(axes)).reshape(-1, targets.shape[1])
    starts = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(len(grid), -1)
    parameters = starts[cKDTree(grid).query(targets)[1]]
    moving = np.arange(len(targets))
    for _ in range(_ITERATIONS):
        basis = scattered_basis(patch, parameters[moving])
        corners = patch.points[basis.nodes]
        miss = targets[moving] - np.einsum("nm,nmd->nd", basis.values, corners)
        jacobian = np.einsum("nmd,nmk->ndk", corners, basis.gradients[..., free])
        step = np.einsum("nkd,nd->nk", np.linalg.pinv(jacobian), miss)
        before = parameters[np.ix_(moving, free)]
        after = np.clip(before + step, 0, 1)
        parameters[np.ix_(moving, free)] = after
        moving = moving[np.abs(after - before).max(axis=1) > 1e-15]
        if not moving.size:
            break
    return parameters, evaluate_points(patch, parameters)
