"""What a step of generalised-alpha errs, told from rounding."""

from __future__ import annotations

import math

from numba import boolean, float64, int64, types

from ...compiler.compiling import inner
from ...linear.friction import solvability
from ...linear.index3 import add_mass_times
from ...linear.memory import KERNELS, MEMORY
from ...linear.saddle import REGULARISATION, saddle_solve
from ...space.layout import (
    C_RATE,
    C_VALUE,
    F1,
    SYSTEM,
    WORK,
)
from ..landing import close_step
from ..projection import rates_of_rows
from ..singular import FAR
from ..step_sizes import scaled_norm
from ..stepping import CONTROL, copy
from .table import ALPHA

#: Errors are told from rounding above so many times as much.
MARGIN = 15.0
#: Steps that tell what of the error estimate is not rounding.
TREND = 8.0
#: Determinant of the equations of friction, 1 without it, below which they hardly have
#: a solution.
HARDLY_SOLVABLE = 0.1
#: Part of the run in which motions may still become much larger.
EARLY = 0.5


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, ALPHA, F1, F1))
def split(kernels, system, work, memory, alpha, x, y):
    """Moves from tangent vectors x and y to nz and nv what constraints impose on them.

    In the metric of projections: the rigid motion bears it, not the deformation.
    """
    for x_, column in ((x, C_VALUE), (y, C_RATE)):
        rates_of_rows(system, work, x_, column)
        rates_of_rows(system.sliding, work.sliding, x_, column)
    nz, nv = alpha.nz, alpha.nv
    status = kernels.project_once(system, work, memory, REGULARISATION, nz, nv)
    for i in range(len(x)):
        x[i] += nz[i]
        y[i] += nv[i]
    return status


@inner(float64(ALPHA))
def inertia(alpha):
    """h^2 beta'."""
    w = alpha.weights
    return (1.0 - w.alpha_m) / (w.beta * (1.0 - w.alpha_f))


@inner(types.void(SYSTEM, MEMORY, ALPHA, F1))
def pass_through(system, memory, alpha, x):
    """Passes a tangent vector through the Newton matrix, into p."""
    for i in range(len(alpha.p)):
        alpha.p[i] = 0.0
    g = memory.real.g
    for i in range(len(g)):
        g[i] = 0.0
    add_mass_times(system, memory.M, x, inertia(alpha), alpha.p)
    saddle_solve(system.newton, memory.real, 0, alpha.p, g)


@inner(float64(SYSTEM, CONTROL, ALPHA, float64))
def tolerate(system, control, alpha, h):
    """Tolerated errors of tangent vectors, not below rounding; velocities are
    differences of positions.

    Returns what Newton's iteration may leave, in units of rounding: constraints make
    errors of large motions errors of small deformations.
    """
    goal, rate = math.inf, alpha.weights.beta * h / alpha.weights.gamma
    for b in range(len(system.body)):
        row = system.body[b]
        rd, nq, u, p = row.rd, row.nq, row.vel, row.pos
        for k in range(rd):
            alpha.wish[u + k] = control.scale_z[p + k]
        for k in range(nq):
            alpha.wish[u + rd + k] = control.scale_z[p + row.np - nq + k]
    for i in range(len(alpha.floor)):
        least = MARGIN * alpha.floor[i]
        alpha.scale[i] = max(alpha.wish[i], least)
        alpha.pace[i] = max(control.scale_v[i], least / h)
        tolerated = min(alpha.scale[i], rate * alpha.pace[i])
        goal = min(goal, tolerated / alpha.floor[i])
    return goal


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def error_of(kernels, system, work, memory, control, alpha, h):
    """Norm of the local error, passed through Newton's matrix for stiff coordinates.

    Position: h^3 z_II'', velocity: h^3 z_II''', from accelerations that the constraints
    allow: differences of a are full of rounding. What constraints impose of both is no
    error of deformations: positions meet them, and the algorithm's v makes up for it.
    The step ends on the constraints with that, and only has to be accepted.
    """
    singular, independence = control.singular, control.independence
    clearest, decline, unturned = control.clearest, control.decline, control.unturned
    error = math.inf
    copy(alpha.v1, alpha.v0)
    z1, v1, x, y = alpha.z1, alpha.v1, alpha.dx, alpha.dv
    status = close_step(kernels, system, work, memory, control, h, z1, v1, x, y)
    if status == 0 and not _jams(system, memory, control, alpha):
        error = _free_error(kernels, system, work, memory, control, alpha, h)
    if not error < 1.0:
        control.singular, control.independence = singular, independence
        control.clearest, control.decline, control.unturned = (
            clearest,
            decline,
            unturned,
        )
    return error


@inner(boolean(SYSTEM, MEMORY, CONTROL, ALPHA))
def _jams(system, memory, control, alpha):
    """Whether friction has hardly a solution, and velocities are rounding already.

    Loads grow without bound there, and steps of rounding would lead past it.
    """
    if len(system.friction) == 0:
        return False
    if solvability(memory.rub_A, memory.rub_pivots) > HARDLY_SOLVABLE:
        return False
    rounded = 0
    for i in range(len(alpha.pace)):
        if alpha.pace[i] > control.scale_v[i]:
            rounded += 1
    return rounded > 0


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _free_error(kernels, system, work, memory, control, alpha, h):
    """The estimate, after the end of the step was brought onto the constraints."""
    w, x, y, old = alpha.weights, alpha.dx, alpha.dv, control.old_step
    for i in range(len(x)):
        jerk = (memory.acceleration[i] - alpha.acc0[i]) / h
        x[i] = w.position_error * h * h * h * jerk
        y[i] = w.velocity_error * h * h * h * (jerk - alpha.jerk[i]) / (0.5 * (h + old))
    if split(kernels, system, work, memory, alpha, x, y) != 0:
        return math.inf
    pass_through(system, memory, alpha, x)
    copy(alpha.p, x)
    pass_through(system, memory, alpha, y)
    if control.crossing == FAR:
        for b in range(len(system.body)):
            first = system.body[b].vel
            for i in range(first, first + system.body[b].rd):
                x[i] -= alpha.nz[i]
                alpha.p[i] -= alpha.nv[i]
    error = scaled_norm(x, alpha.p, alpha.scale, alpha.pace)
    return max(error, _turning_error(system, control, h))


@inner(types.void(CONTROL, ALPHA))
def note_error(control, alpha):
    """Keeps the errors of steps so far in units of what all together may err.

    It is larger than one where that cannot be told from rounding. What rounding makes
    of the estimate changes its sign from step to step. Not judged before the largest
    motions are known.
    """
    sum_x, sum_v = alpha.sum_x, alpha.sum_v
    for i in range(len(sum_x)):
        alpha.trend_x[i] += (alpha.dx[i] - alpha.trend_x[i]) / TREND
        alpha.trend_v[i] += (alpha.p[i] - alpha.trend_v[i]) / TREND
        sum_x[i] += abs(alpha.trend_x[i])
        sum_v[i] += abs(alpha.trend_v[i])
    if control.time - control.begin > EARLY * control.period:
        total = scaled_norm(sum_x, sum_v, alpha.wish, control.scale_v)
        control.missed = total * control.part


@inner(float64(SYSTEM, CONTROL, float64))
def _turning_error(system, control, h):
    """What dense output misses of frames that turn steadily, which steps do exactly.

    A cubic misses y'''' / 384 in the middle of a step of one: of positions speed times
    (angular velocity)^3, of quaternions (angular velocity / 2)^4. It does not add up.
    """
    worst, v = 0.0, control.v
    for b in range(len(system.body)):
        row = system.body[b]
        rd, u, p = row.rd, row.vel, row.pos
        if rd == 6:
            way = h * math.sqrt(v[u] * v[u] + v[u + 1] * v[u + 1] + v[u + 2] * v[u + 2])
            x, y, z = v[u + 3], v[u + 4], v[u + 5]
            turn = h * math.sqrt(x * x + y * y + z * z)
            worst = max(worst, (0.5 * turn) ** 4 / control.scale_z[p + 3])
        elif rd == 3 and system.planar == 1:
            way = h * math.sqrt(v[u] * v[u] + v[u + 1] * v[u + 1])
            turn = h * abs(v[u + 2])
        else:
            continue
        worst = max(worst, way * turn**3 / control.scale_z[p])
    return worst / 384.0 * control.part
