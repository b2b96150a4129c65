"""States in which constraints that cannot be met are least open.

There the weighted residuals r are balanced, C^T r = 0: all that is open has a part in a
contradiction. That names joints and drives of large scenes, which are too many to be
tried one by one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from sidtool.formats.sid import Array

from ..space.coordinates import retract
from ..system.sizes import coordinate_sizes
from .consistent import State
from .large_scenes import MANY, sparse_jacobian

#: Steps, and the gradient at which they end, relative to the cost.
STEPS, FLAT = 60, 1e-14
#: Damping at the beginning and at the end of rates, that of coordinates at a limit.
DAMPED, LEAST, MOST = 1.0, 1e-9, 1e12


def least_open(state: State, weight: Array) -> None:
    """Moves the state to where the weighted residuals are least.

    Source: K. Levenberg, Quart. Appl. Math. 2 (1944): damped least squares.
    """
    damping = DAMPED
    for _ in range(STEPS):
        r = weight * state.residual
        A, sizes = _scaled(state, weight)
        cost, right = float(r @ r), -(A.T @ r)
        if np.linalg.norm(right) <= FLAT * max(cost, 1.0):
            return
        base, frame = state.z.copy(), state.work.frame.copy()
        while damping < MOST:
            state.z[:] = base
            step = sizes * _solved(A, damping, right)
            retract(state.system.arrays, frame, state.z, step)
            state.evaluate()
            found = weight * state.residual
            if float(found @ found) < cost:
                damping = max(0.2 * damping, LEAST)
                break
            damping *= 4.0
        else:
            state.z[:] = base
            state.evaluate()
            return


def left_of_rates(state: State, rates: Array) -> Array:
    """What remains of rates of the constraints at the velocities that suit them best,
    relative to the sizes of the rows."""
    weight = np.where(state.ignored, 0.0, 1.0 / state.sizes)
    A, _ = _scaled(state, weight)
    r = weight * rates
    return np.asarray(r - A @ _solved(A, LEAST**1.5, A.T @ r))


def _scaled(state: State, weight: Array) -> tuple[Any, Array]:
    """The weighted Jacobian for relative changes of what may move, and their sizes."""
    sizes = coordinate_sizes(state.system) * state.free
    if state.system.n_rows < MANY:
        return weight[:, None] * state.jacobian() * sizes, sizes
    from scipy.sparse import diags_array

    C = sparse_jacobian(state.system, state.work.C)
    used = np.where(state.ignored, 0.0, weight)
    return (diags_array(used) @ C @ diags_array(sizes)).tocsr(), sizes


def _solved(A: Any, damping: float, right: Array) -> Array:
    """x of (A^T A + damping) x = right."""
    if isinstance(A, np.ndarray):
        normal = A.T @ A + damping * np.eye(A.shape[1])
        return np.asarray(np.linalg.solve(normal, right), np.float64)
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import spsolve

    normal = (A.T @ A + damping * eye_array(A.shape[1])).tocsc()
    return np.asarray(spsolve(normal, right), np.float64)
