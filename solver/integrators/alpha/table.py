"""Coefficients of generalised-alpha, and what it keeps between steps."""

from __future__ import annotations

import numpy as np

from sidtool.formats.sid import Array

from ...compiler.tables import Table, TableType
from ...space.layout import (
    F1,
    I1,
    N_POS,
    N_ROWS,
    N_VEL,
    R_NEWTON,
    S_OFFSET,
    S_ROW,
    System,
)

#: What rounding leaves of positions, relative to their size.
ROUNDED = 2e-16

# Entries of Alpha.weights
ALPHA_M, ALPHA_F, BETA, GAMMA, POSITION_ERROR, VELOCITY_ERROR = range(6)
FORCE_ERROR, CURVATURE = 6, 7


class Alpha(Table):
    """Coefficients, the state between steps, and scratch vectors.

    place : row of each constraint in the Newton matrix, -1 for none, and behind them
        of each joint with friction
    weights : see the entries above
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

    place: np.ndarray
    weights: Array
    a: Array
    v: Array
    acc: Array
    old_a: Array
    a0: Array
    v0: Array
    rate0: Array
    acc0: Array
    jerk: Array
    kept: Array
    snap: Array
    lam: Array
    old_lam: Array
    lam1: Array
    a1: Array
    z1: Array
    v1: Array
    acc1: Array
    dx: Array
    dv: Array
    rz: Array
    nz: Array
    nv: Array
    p: Array
    wish: Array
    scale: Array
    pace: Array
    trend_x: Array
    trend_v: Array
    sum_x: Array
    sum_v: Array
    floor: Array


ALPHA = TableType(Alpha, [I1] + [F1] * 33)


def coefficients(rho: float) -> Array:
    """Weights for a spectral radius rho at infinite frequency, 0 to 1.

    The errors are those of one step with the exact acceleration z_II' + (alpha_m -
    alpha_f) h z_II'' + ... as a: h^3 z_II'' and h^3 z_II''' times the last but two.
    Where constraints prescribe z_I, z_II' is off by h^2 z_II''' times the last one.
    """
    alpha_m, alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    shift = alpha_m - alpha_f
    gamma = 0.5 - shift
    beta = 0.25 * (gamma + 0.5) ** 2
    bend = 0.5 * (1.0 - alpha_f) - (1.0 - alpha_m) * (0.5 + shift)
    position = beta + 0.5 * shift - 1.0 / 6.0
    velocity = bend + gamma * (0.5 + shift) - 1.0 / 6.0
    force = 1.0 / 6.0 + 0.5 * shift + 0.25 * shift**2 - (1.0 - alpha_f) * shift
    curvature = shift**2 + 1.0 / 12.0 - beta - 0.5 * shift
    weights = [alpha_m, alpha_f, beta, gamma, position, velocity, force, curvature]
    return np.array(weights)


def new_alpha(system: System, rho: float, sizes: Array) -> Alpha:
    """Storage for a run; `sizes` are those of tangent vectors."""
    n, m = int(system.dims[N_POS]), int(system.dims[N_VEL])
    rows = int(system.dims[N_ROWS]) + len(system.friction)
    lengths = [m] * 6 + [n] + [m] * 4 + [rows] * 3 + [m, n, m, m, m, m, n, m, m, m]
    vectors = [(length,) for length in (*lengths, *[m] * 7)]
    floor = ROUNDED * sizes
    return Alpha.zeros(newton_places(system), coefficients(rho), *vectors, floor)


def newton_places(system: System) -> np.ndarray:
    """Row of each constraint in the Newton matrix, -1 for none, and behind them of each
    joint with friction, (rows + frictions,)."""
    places = np.full(int(system.dims[N_ROWS]), -1, np.int64)
    newton_row = dict(system.newton.segment[:, [S_OFFSET, S_ROW]].tolist())
    for row, offset in system.segment[:, [S_ROW, S_OFFSET]].tolist():
        places[row] = newton_row[offset]
    return np.append(places, system.friction[:, R_NEWTON])
