"""Coefficients of generalised-alpha, and what it keeps between steps."""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import Array

from ...compiler.tables import Table, TableType
from ...space.layout import (
    R_NEWTON,
    S_OFFSET,
    S_ROW,
    Integers,
    Reals,
    System,
)

#: What rounding leaves of positions, relative to their size.
ROUNDED = 2e-16


class Weights(Table):
    """Of the method, see `coefficients`."""

    alpha_m: float
    alpha_f: float
    beta: float
    gamma: float
    position_error: float
    velocity_error: float
    force_error: float
    curvature: float


WEIGHTS = TableType(Weights)


class Alpha(Table):
    """Coefficients, the state between steps, and scratch vectors.

    place : row of each constraint in the Newton matrix, -1 for none, and behind them
        of each joint with friction
    a, v, kept : accelerations, velocities and z_II' that the last step left
    old_a : a one step before
    a0, v0, acc : the same at the beginning of this step
    rate0, acc0 : z_I' and z_II' at the beginning of the step, on the constraints
    jerk, snap : slope of acc0 and its own, from steps before
    lam, old_lam : lambda, and behind it the forces of friction, at the beginning of
        this step and one before
    lam1 : at the end of the step
    a1, z1, v1, acc1 : at the end of the step
    dx : motion during the step, in the tangent space
    rz : scratch like z_I
    nz, nv : parts of tangent vectors that the constraints impose
    p : right-hand side and solution of a correction
    wish : tolerated errors of tangent vectors
    scale, pace : what is told from rounding of these, and of velocities
    trend_x, trend_v : errors of positions and velocities, mean of the last steps
    sum_x, sum_v : their integrals over time
    floor : what rounding makes of positions, as tangent vectors
    """

    place: Integers
    weights: Weights
    a: Reals
    v: Reals
    acc: Reals
    old_a: Reals
    a0: Reals
    v0: Reals
    rate0: Reals
    acc0: Reals
    jerk: Reals
    kept: Reals
    snap: Reals
    lam: Reals
    old_lam: Reals
    lam1: Reals
    a1: Reals
    z1: Reals
    v1: Reals
    acc1: Reals
    dx: Reals
    dv: Reals
    rz: Reals
    nz: Reals
    nv: Reals
    p: Reals
    wish: Reals
    scale: Reals
    pace: Reals
    trend_x: Reals
    trend_v: Reals
    sum_x: Reals
    sum_v: Reals
    floor: Reals


ALPHA = TableType(Alpha)


def coefficients(rho: float) -> Weights:
    """Weights for a spectral radius rho at infinite frequency, 0 to 1.

    The errors are those of one step with the exact acceleration z_II' + (alpha_m -
    alpha_f) h z_II'' + ... as a: h^3 z_II'' times `position_error` and h^3 z_II'''
    times `velocity_error`. Where constraints prescribe z_I, z_II' is off by h^2
    z_II''' times `curvature`.
    """
    alpha_m, alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    shift = alpha_m - alpha_f
    gamma = 0.5 - shift
    beta = 0.25 * (gamma + 0.5) ** 2
    bend = 0.5 * (1.0 - alpha_f) - (1.0 - alpha_m) * (0.5 + shift)
    return Weights(
        alpha_m=alpha_m,
        alpha_f=alpha_f,
        beta=beta,
        gamma=gamma,
        position_error=beta + 0.5 * shift - 1.0 / 6.0,
        velocity_error=bend + gamma * (0.5 + shift) - 1.0 / 6.0,
        force_error=1.0 / 6.0 + 0.5 * shift + 0.25 * shift**2 - (1.0 - alpha_f) * shift,
        curvature=shift**2 + 1.0 / 12.0 - beta - 0.5 * shift,
    )


def new_alpha(system: System, rho: float, sizes: Array) -> Alpha:
    """Storage for a run; `sizes` are those of tangent vectors."""
    n, m = system.n_pos, system.n_vel
    rows = system.n_rows + len(system.friction)
    vectors = dict.fromkeys(Alpha.kind.fields, (m,))
    vectors |= dict.fromkeys(("rate0", "z1", "rz"), (n,))
    vectors |= dict.fromkeys(("lam", "old_lam", "lam1"), (rows,))
    given = {
        "place": newton_places(system),
        "weights": coefficients(rho),
        "floor": ROUNDED * sizes,
    }
    return Alpha.zeros(**(vectors | given))


def newton_places(system: System) -> np.ndarray:
    """Row of each constraint in the Newton matrix, -1 for none, and behind them of each
    joint with friction, (rows + frictions,)."""
    places = np.full(system.n_rows, -1, np.int64)
    newton_row = dict(system.newton.segment[:, [S_OFFSET, S_ROW]].tolist())
    for row, offset in system.segment[:, [S_ROW, S_OFFSET]].tolist():
        places[row] = newton_row[offset]
    return np.append(places, system.friction[:, R_NEWTON])
