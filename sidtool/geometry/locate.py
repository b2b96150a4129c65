"""The parameters of a point that is given by its position."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from formats.errors import InputError

from .patch import NurbsPatch, evaluate_grid, point_basis

Array = NDArray[np.float64]

_GRID = 33
_ITERATIONS = 50
#: Distance to the patch, relative to its size, that still counts as on it.
_TOLERANCE = 1e-9


def locate(patch: NurbsPatch, position: ArrayLike) -> Array:
    """The parameters (k,) at which the patch passes through `position`.

    Gauss-Newton with the parameters kept inside [0, 1], from the nearest point of a
    coarse grid.

    Raises
    ------
    InputError : the position lies outside the patch; the nearest point is named.
    """
    target = np.asarray(position, float)
    axes = tuple(np.linspace(0, 1, _GRID) for _ in patch.degrees)
    grid = evaluate_grid(patch, axes)
    size = float(np.ptp(grid.reshape(-1, grid.shape[-1]), axis=0).max())
    nearest = np.argmin(((grid - target) ** 2).sum(-1))
    start = np.unravel_index(nearest, grid.shape[:-1])
    parameters = np.array([axis[i] for axis, i in zip(axes, start, strict=True)])
    for _ in range(_ITERATIONS):
        point, jacobian = _point(patch, parameters)
        step = np.linalg.lstsq(jacobian, target - point, rcond=None)[0]
        moved = np.clip(parameters + step, 0, 1)
        if np.abs(moved - parameters).max() < 1e-15:
            break
        parameters = moved
    point, _ = _point(patch, parameters)
    if np.linalg.norm(point - target) > _TOLERANCE * size:
        place, near = (", ".join(f"{x:.6g}" for x in p) for p in (target, point))
        raise InputError(
            f"({place}) lies outside the geometry",
            expected=f"a point of the body; near by is ({near})",
        )
    return parameters


def _point(patch: NurbsPatch, parameters: Array) -> tuple[Array, Array]:
    basis = point_basis(patch, parameters)
    nodes = patch.points[basis.nodes]
    return basis.values @ nodes, nodes.T @ basis.gradients
