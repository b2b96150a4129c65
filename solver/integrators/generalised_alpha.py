"""Generalised-alpha on the equations of index 3, fixed or variable step.

Sources: J. Chung, G. M. Hulbert, "A time integration algorithm for structural dynamics
with improved numerical dissipation: the generalized-alpha method", Journal of Applied
Mechanics 60 (1993), for the coefficients; M. Arnold, O. Bruels, "Convergence of the
generalized-alpha scheme for constrained mechanical systems", Multibody System Dynamics
18 (2007), for constraints; O. Bruels, A. Cardona, M. Arnold, "Lie group generalized-
alpha time integration of constrained flexible multibody systems", Mechanism and Machine
Theory 48 (2012), for frames whose velocities are resolved in them. Positions and
velocities are brought onto the constraints after every step.

A step finds accelerations with M z_II' - C^T lambda = f and c = 0 at its end, where

    z_I   = z_I0 moved with h z_II0 + h^2 ((1/2 - beta) a0 + beta a1) for one unit,
    z_II  = z_II0 + h ((1 - gamma) a0 + gamma a1),
    (1 - alpha_m) a1 + alpha_m a0 = (1 - alpha_f) z_II' + alpha_f z_II0'.
"""

from __future__ import annotations

import math

import numpy as np
from numba import float64, int64, types

from formats.sid import Array

from ..kernels.compiling import inner
from ..kernels.coordinates import chords, follow_chords
from ..kernels.index3 import (
    add_mass_times,
    index3_factor,
    index3_residual,
    index3_solve,
)
from ..kernels.layout import (
    C_RATE,
    C_VALUE,
    F1,
    I1,
    N_POS,
    N_ROWS,
    N_VEL,
    NP,
    NQ,
    NV,
    PLANAR,
    POS,
    RD,
    S_BODY,
    S_OFFSET,
    S_ROW,
    SYSTEM,
    VEL,
    WORK,
    System,
)
from ..kernels.newton import (
    EVALUATIONS,
    ITERATIONS,
    KERNELS,
    MEMORY,
)
from ..kernels.saddle import REGULARISATION
from ..kernels.tables import Table, TableType
from .implicit import step_loop
from .landing import close_step
from .singular import FAR, SINGULAR_START, SOFT
from .stepping import (
    BEGIN,
    CLEAREST,
    CONTROL,
    CROSSING,
    DECLINE,
    FIXED_STEP,
    INDEPENDENCE,
    MISSED,
    OLD_STEP,
    PERIOD,
    REQUEST,
    SINGULAR,
    STEP,
    STOP,
    STUB,
    TIME,
    TOLERANCE,
    UNTURNED,
    accelerate,
    copy,
    count_turns,
    fade_contraction,
    judge,
    keep_step,
    move,
    newton_limit,
    note_drift,
    scaled_norm,
    write_cubic,
)

#: A Jacobian is kept while Newton's iteration contracts the error this much.
JACOBIAN_SERVES = 0.1
#: After a break, part of the step before it.
FIRST_STEP = 0.3
#: The first jerk is a difference over this part of the first step.
GLANCE = 0.01
#: What Newton's iteration may leave of the tolerance.
NEWTON_GOAL = 0.03
#: What rounding leaves of positions, relative to their size.
ROUNDED = 2e-16
#: Errors are told from rounding above so many times as much.
MARGIN = 15.0
#: Corrections that no longer shrink are rounding below so many times as much, where
#: constraints are independent.
STAGNANT = 100.0
#: Steps that tell what of the error estimate is not rounding.
TREND = 8.0
#: Part of the run in which motions may still become much larger.
EARLY = 0.5

# Entries of Alpha.weights
ALPHA_M, ALPHA_F, BETA, GAMMA, POSITION_ERROR, VELOCITY_ERROR = range(6)
FORCE_ERROR, CURVATURE = 6, 7


class Alpha(Table):
    """Coefficients, the state between steps, and scratch vectors.

    place : row of each constraint in the Newton matrix, -1 for none
    weights : see the entries above
    a, v, kept : accelerations, velocities and z_II' that the last step left
    old_a : a one step before
    a0, v0, acc : the same at the beginning of this step
    rate0, acc0 : z_I' and z_II' at the beginning of the step, on the constraints
    jerk, snap : slope of acc0 and its own, from steps before
    lam, old_lam : lambda at the beginning of this step and one before
    lam1 : at the end of the step
    a1, z1, v1, acc1 : at the end of the step
    dx : motion during the step, in the tangent space
    rz : scratch like z_I
    nz, nv : parts of tangent vectors that the constraints impose
    p, g : right-hand side and solution of a correction
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
    g: Array
    wish: Array
    scale: Array
    pace: Array
    trend_x: Array
    trend_v: Array
    sum_x: Array
    sum_v: Array
    floor: Array


ALPHA = TableType(Alpha, [I1] + [F1] * 34)


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
    rows, newton_rows = int(system.dims[N_ROWS]), int(system.newton.dims[N_ROWS])
    lengths = [m] * 6 + [n] + [m] * 4 + [rows] * 3 + [m, n, m, m, m, m, n, m, m, m]
    vectors = [np.zeros(length) for length in (*lengths, newton_rows, *[m] * 7)]
    floor = ROUNDED * sizes
    return Alpha(newton_places(system), coefficients(rho), *vectors, floor)


def newton_places(system: System) -> np.ndarray:
    """Row of each constraint in the Newton matrix, (rows,), -1 for none."""
    places = np.full(int(system.dims[N_ROWS]), -1, np.int64)
    newton_row = dict(system.newton.segment[:, [S_OFFSET, S_ROW]].tolist())
    for row, offset in system.segment[:, [S_ROW, S_OFFSET]].tolist():
        places[row] = newton_row[offset]
    return places


@inner(types.void(SYSTEM, WORK, F1, int64))
def _rates_of_rows(system, work, x, column):
    """C x into a column of the rows."""
    for i in range(system.dims[N_ROWS]):
        work.row[i, column] = 0.0
    for k in range(len(system.segment)):
        row, at = system.segment[k, S_ROW], system.segment[k, S_OFFSET]
        b = system.segment[k, S_BODY]
        first = system.body[b, VEL]
        for i in range(system.body[b, NV]):
            work.row[row, column] += work.C[at + i] * x[first + i]


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, ALPHA, F1, F1))
def _split(kernels, system, work, memory, alpha, x, y):
    """Moves from tangent vectors x and y to nz and nv what constraints impose on them.

    In the metric of projections: the rigid motion bears it, not the deformation.
    """
    _rates_of_rows(system, work, x, C_VALUE)
    _rates_of_rows(system, work, y, C_RATE)
    nz, nv = alpha.nz, alpha.nv
    status = kernels.project_once(system, work, memory, REGULARISATION, nz, nv)
    for i in range(len(x)):
        x[i] += nz[i]
        y[i] += nv[i]
    return status


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA))
def _begin_step(kernels, system, work, memory, control, alpha):
    """Slopes at the beginning."""
    old = control.real[OLD_STEP]
    kernels.rate(system, control.z, control.v, alpha.rate0)
    if old > 0.0:
        for i in range(len(alpha.acc0)):
            jerk = (memory.acceleration[i] - alpha.acc0[i]) / old
            alpha.snap[i] = (jerk - alpha.jerk[i]) / old
            alpha.jerk[i] = jerk
    copy(memory.acceleration, alpha.acc0)
    if old == 0.0:
        _glance(kernels, system, work, memory, control, alpha)


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA))
def _glance(kernels, system, work, memory, control, alpha):
    """The slope of the acceleration after a break, and the slope of that."""
    t, glance = control.real[TIME], GLANCE * control.real[STEP]
    copy(control.z, alpha.z1)
    copy(control.v, alpha.v1)
    for _ in range(2):
        kernels.rate(system, alpha.z1, alpha.v1, alpha.rz)
        for i in range(len(alpha.v1)):
            stiff = (glance * control.frequency[i]) ** 2
            gain = glance * memory.acceleration[i] / (1.0 + stiff)
            alpha.dx[i] = alpha.v1[i] + 0.5 * gain
            alpha.v1[i] += gain
            alpha.p[i] = memory.acceleration[i]
        kernels.rate(system, alpha.z1, alpha.dx, alpha.rz)
        for i in range(len(alpha.z1)):
            alpha.z1[i] += glance * alpha.rz[i]
        t += glance
        accelerate(kernels, system, work, memory, t, alpha.z1, alpha.v1)
        for i in range(len(alpha.acc0)):
            jerk = (memory.acceleration[i] - alpha.p[i]) / glance
            alpha.snap[i] = (jerk - alpha.jerk[i]) / glance
            alpha.jerk[i] = jerk
    for i in range(len(alpha.jerk)):
        alpha.jerk[i] -= 1.5 * glance * alpha.snap[i]
    t = control.real[TIME]
    accelerate(kernels, system, work, memory, t, control.z, control.v)
    copy(memory.multiplier, alpha.lam)
    copy(memory.multiplier, alpha.old_lam)


@inner(types.void(KERNELS, SYSTEM, CONTROL, ALPHA, float64))
def _place(kernels, system, control, alpha, h):
    """z_I, z_II and z_II' at the end of the step from a1.

    Frames follow the screw that dx is, the exponential map.
    """
    w = alpha.weights
    beta, gamma, am, af = w[BETA], w[GAMMA], w[ALPHA_M], w[ALPHA_F]
    for i in range(len(alpha.a1)):
        a0, a1, v0 = alpha.a0[i], alpha.a1[i], alpha.v0[i]
        alpha.dx[i] = h * (v0 + h * ((0.5 - beta) * a0 + beta * a1))
        alpha.v1[i] = v0 + h * ((1.0 - gamma) * a0 + gamma * a1)
        change = (1.0 - am) * a1 + am * a0 - af * alpha.acc[i]
        alpha.acc1[i] = change / (1.0 - af)
    chords(system, alpha.dx, alpha.p)
    kernels.rate(system, control.z, alpha.p, alpha.rz)
    follow_chords(system, control.z, alpha.dx, alpha.rz, alpha.z1)


@inner(float64(ALPHA))
def _inertia(alpha):
    """h^2 beta'."""
    w = alpha.weights
    return (1.0 - w[ALPHA_M]) / (w[BETA] * (1.0 - w[ALPHA_F]))


@inner(types.void(SYSTEM, MEMORY, ALPHA, F1))
def _filter(system, memory, alpha, x):
    """Passes a tangent vector through the Newton matrix, into p."""
    for i in range(len(alpha.p)):
        alpha.p[i] = 0.0
    for i in range(len(alpha.g)):
        alpha.g[i] = 0.0
    add_mass_times(system, memory.M, x, _inertia(alpha), alpha.p)
    index3_solve(system, memory, alpha.p, alpha.g)


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _fit_to_step(kernels, system, work, memory, control, alpha, h):
    """The algorithm's a and v for the step ahead, and a first guess of a1 and lambda.

    While the step stays, a and v go on. Where it changes they start anew as they are in
    a smooth motion: what constraints leave of rounding in a and v is a part of it that
    would grow with the steps.
    """
    old, w = control.real[OLD_STEP], alpha.weights
    ratio = h / old if old > 0.0 else 0.0
    for i in range(len(alpha.lam)):
        alpha.lam1[i] = alpha.lam[i] + ratio * (alpha.lam[i] - alpha.old_lam[i])
    if abs(ratio - 1.0) <= STUB:
        copy(alpha.kept, alpha.acc)
        copy(alpha.v, alpha.v0)
        for i in range(len(alpha.a)):
            alpha.a0[i] = alpha.a[i]
            alpha.a1[i] = 2.0 * alpha.a[i] - alpha.old_a[i]
        return
    x, y = alpha.dx, alpha.dv
    for i in range(len(x)):
        x[i] = h * (alpha.jerk[i] + 0.5 * old * alpha.snap[i])
        y[i] = h * h * alpha.snap[i]
    _split(kernels, system, work, memory, alpha, x, y)
    _filter(system, memory, alpha, x)
    for i in range(len(x)):
        x[i] = alpha.p[i] - alpha.nz[i]
    _filter(system, memory, alpha, y)
    for i in range(len(y)):
        y[i] = alpha.p[i] - alpha.nv[i]
    _filter(system, memory, alpha, y)
    lag = w[ALPHA_M] - w[ALPHA_F]
    for i in range(len(alpha.a)):
        alpha.acc[i] = alpha.acc0[i] - w[FORCE_ERROR] * (y[i] - alpha.p[i])
        alpha.a0[i] = alpha.acc[i] + (w[FORCE_ERROR] + w[CURVATURE]) * y[i] + lag * x[i]
        alpha.a1[i] = alpha.a0[i] + x[i] + (0.5 + lag) * y[i]
    copy(control.v, alpha.v0)
    _place(kernels, system, control, alpha, h)
    kernels.evaluate(system, work, control.real[TIME] + h, alpha.z1, alpha.v1)
    memory.counters[EVALUATIONS] += 1
    soft = REGULARISATION
    if control.whole[CROSSING] != FAR:
        soft = SOFT / control.real[REQUEST]
    kernels.project_once(system, work, memory, soft, alpha.nz, alpha.nv)
    for i in range(len(alpha.v0)):
        alpha.v0[i] += alpha.nz[i] / h


@inner(float64(SYSTEM, CONTROL, ALPHA, float64))
def _tolerate(system, control, alpha, h):
    """Tolerated errors of tangent vectors, not below rounding; velocities are
    differences of positions.

    Returns what Newton's iteration may leave, in units of rounding: constraints make
    errors of large motions errors of small deformations.
    """
    goal, rate = math.inf, alpha.weights[BETA] * h / alpha.weights[GAMMA]
    for b in range(len(system.body)):
        row = system.body[b]
        rd, nq, u, p = row[RD], row[NQ], row[VEL], row[POS]
        for k in range(rd):
            alpha.wish[u + k] = control.scale_z[p + k]
        for k in range(nq):
            alpha.wish[u + rd + k] = control.scale_z[p + row[NP] - nq + k]
    for i in range(len(alpha.floor)):
        least = MARGIN * alpha.floor[i]
        alpha.scale[i] = max(alpha.wish[i], least)
        alpha.pace[i] = max(control.scale_v[i], least / h)
        tolerated = min(alpha.scale[i], rate * alpha.pace[i])
        goal = min(goal, tolerated / alpha.floor[i])
    return goal


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, ALPHA, float64))
def _factor(kernels, system, work, memory, alpha, h):
    damping = h * alpha.weights[GAMMA] / alpha.weights[BETA]
    return index3_factor(system, work, memory, _inertia(alpha), damping, h * h)


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _newton(kernels, system, work, memory, control, alpha, h):
    """Finds a1 and lambda; iterations used, or 0 without convergence."""
    real = control.real
    h2 = h * h
    by_a = 1.0 / (alpha.weights[BETA] * h2)
    goal = _tolerate(system, control, alpha, h)
    _fit_to_step(kernels, system, work, memory, control, alpha, h)
    fade_contraction(control)
    blunt = STAGNANT / max(real[INDEPENDENCE], SINGULAR_START)
    old_norm = 0.0
    for iteration in range(newton_limit(control)):
        _place(kernels, system, control, alpha, h)
        kernels.evaluate(system, work, real[TIME] + h, alpha.z1, alpha.v1)
        memory.counters[EVALUATIONS] += 1
        index3_residual(
            system,
            work,
            alpha.place,
            alpha.acc1,
            alpha.lam1,
            h2,
            alpha.p,
            alpha.g,
        )
        index3_solve(system, memory, alpha.p, alpha.g)
        memory.counters[ITERATIONS] += 1
        norm = 0.0
        for i in range(len(alpha.p)):
            alpha.a1[i] += by_a * alpha.p[i]
            norm = max(norm, abs(alpha.p[i]) / alpha.floor[i])
        for i in range(len(alpha.place)):
            if alpha.place[i] >= 0:
                alpha.lam1[i] += alpha.g[alpha.place[i]] / h2
        verdict = judge(control, NEWTON_GOAL, iteration, norm / goal, old_norm / goal)
        if verdict == 1 or norm < 1.0 or (verdict < 0 and norm < blunt):
            _place(kernels, system, control, alpha, h)
            return iteration + 1
        if verdict < 0:
            return 0
        old_norm = norm
    return 0


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _error(kernels, system, work, memory, control, alpha, h):
    """Norm of the local error, passed through Newton's matrix for stiff coordinates.

    Position: h^3 z_II'', velocity: h^3 z_II''', from accelerations that the constraints
    allow: differences of a are full of rounding. What constraints impose of both is no
    error of deformations: positions meet them, and the algorithm's v makes up for it.
    The step ends on the constraints with that, and only has to be accepted.
    """
    real = control.real
    singular, independence = real[SINGULAR], real[INDEPENDENCE]
    clearest, decline, unturned = real[CLEAREST], real[DECLINE], real[UNTURNED]
    error = math.inf
    copy(alpha.v1, alpha.v0)
    z1, v1, x, y = alpha.z1, alpha.v1, alpha.dx, alpha.dv
    if close_step(kernels, system, work, memory, control, h, z1, v1, x, y) == 0:
        error = _free_error(kernels, system, work, memory, control, alpha, h)
    if not error < 1.0:
        real[SINGULAR], real[INDEPENDENCE] = singular, independence
        real[CLEAREST], real[DECLINE], real[UNTURNED] = clearest, decline, unturned
    return error


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _free_error(kernels, system, work, memory, control, alpha, h):
    """The estimate, after the end of the step was brought onto the constraints."""
    w, x, y, old = alpha.weights, alpha.dx, alpha.dv, control.real[OLD_STEP]
    for i in range(len(x)):
        jerk = (memory.acceleration[i] - alpha.acc0[i]) / h
        x[i] = w[POSITION_ERROR] * h * h * h * jerk
        y[i] = (
            w[VELOCITY_ERROR] * h * h * h * (jerk - alpha.jerk[i]) / (0.5 * (h + old))
        )
    if _split(kernels, system, work, memory, alpha, x, y) != 0:
        return math.inf
    _filter(system, memory, alpha, x)
    copy(alpha.p, x)
    _filter(system, memory, alpha, y)
    if control.whole[CROSSING] == FAR:
        for b in range(len(system.body)):
            first = system.body[b, VEL]
            for i in range(first, first + system.body[b, RD]):
                x[i] -= alpha.nz[i]
                alpha.p[i] -= alpha.nv[i]
    error = scaled_norm(x, alpha.p, alpha.scale, alpha.pace)
    return max(error, _turning_error(system, control, h))


@inner(types.void(CONTROL, ALPHA, float64))
def _note_error(control, alpha, h):
    """Keeps the mean error of a step so far in units of the tolerated one.

    It is larger than one where that cannot be told from rounding. What rounding makes
    of the estimate changes its sign from step to step. Not judged before the largest
    motions are known.
    """
    real = control.real
    sum_x, sum_v = alpha.sum_x, alpha.sum_v
    for i in range(len(sum_x)):
        alpha.trend_x[i] += (alpha.dx[i] - alpha.trend_x[i]) / TREND
        alpha.trend_v[i] += (alpha.p[i] - alpha.trend_v[i]) / TREND
        sum_x[i] += h * abs(alpha.trend_x[i])
        sum_v[i] += h * abs(alpha.trend_v[i])
    if real[TIME] - real[BEGIN] > EARLY * real[PERIOD]:
        total = scaled_norm(sum_x, sum_v, alpha.wish, control.scale_v)
        real[MISSED] = total / real[PERIOD]


@inner(float64(SYSTEM, CONTROL, float64))
def _turning_error(system, control, h):
    """What dense output misses of frames that turn steadily, which steps do exactly.

    A cubic misses y'''' / 384 in the middle of a step of one: of positions speed times
    (angular velocity)^3, of quaternions (angular velocity / 2)^4. It does not add up.
    """
    worst, v = 0.0, control.v
    for b in range(len(system.body)):
        row = system.body[b]
        rd, u, p = row[RD], row[VEL], row[POS]
        if rd == 6:
            way = h * math.sqrt(v[u] * v[u] + v[u + 1] * v[u + 1] + v[u + 2] * v[u + 2])
            x, y, z = v[u + 3], v[u + 4], v[u + 5]
            turn = h * math.sqrt(x * x + y * y + z * z)
            worst = max(worst, (0.5 * turn) ** 4 / control.scale_z[p + 3])
        elif rd == 3 and system.dims[PLANAR] == 1:
            way = h * math.sqrt(v[u] * v[u] + v[u + 1] * v[u + 1])
            turn = h * abs(v[u + 2])
        else:
            continue
        worst = max(worst, way * turn**3 / control.scale_z[p])
    return worst / 384.0 * control.real[TOLERANCE] / control.real[REQUEST]


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _accept(kernels, system, work, memory, control, alpha, h):
    """Moves to the end of the step, and the algorithm with it; 0 on success.

    With error control the end is on the constraints of position and velocity already.
    Fixed steps leave it as the algorithm does, with its own acceleration, but for the
    end of an interval: steps of one length need no projection, and recorded states are
    projected anyway.
    """
    real, z1, v1 = control.real, alpha.z1, alpha.v1
    if control.whole[FIXED_STEP] == 1:
        copy(v1, alpha.v0)
        if real[TIME] + 1.5 * h < real[STOP]:
            status = count_turns(system, work, control, h, z1)
            copy(alpha.acc1, memory.acceleration)
            note_drift(system, work, control)
        else:
            x, y = alpha.dx, alpha.dv
            status = close_step(kernels, system, work, memory, control, h, z1, v1, x, y)
        if status != 0:
            return status
    else:
        _note_error(control, alpha, h)
    copy(alpha.lam1, memory.multiplier)
    write_cubic(
        kernels,
        system,
        memory,
        control,
        h,
        z1,
        v1,
        alpha.rate0,
        alpha.acc0,
        alpha.rz,
    )
    move(control, h, z1, v1)
    copy(alpha.v0, alpha.v)
    copy(alpha.a0, alpha.old_a)
    copy(alpha.a1, alpha.a)
    copy(alpha.acc1, alpha.kept)
    copy(alpha.lam, alpha.old_lam)
    copy(alpha.lam1, alpha.lam)
    return 0


@inner(int64(ALPHA))
def _order(alpha):
    return 2


@inner(types.void(KERNELS, SYSTEM, CONTROL, ALPHA, float64))
def _foretell(kernels, system, control, alpha, h):
    """The end of the step if accelerations stay as they are; `a` may be off."""
    for i in range(len(alpha.v1)):
        alpha.v1[i] = control.v[i] + 0.5 * h * alpha.acc0[i]
    kernels.rate(system, control.z, alpha.v1, alpha.rz)
    for i in range(len(alpha.z1)):
        alpha.z1[i] = control.z[i] + h * alpha.rz[i]
    for i in range(len(alpha.v1)):
        alpha.v1[i] += 0.5 * h * alpha.acc0[i]


advance = step_loop(
    "generalised_alpha",
    ALPHA,
    _begin_step,
    _factor,
    _newton,
    _error,
    _accept,
    _order,
    _foretell,
    JACOBIAN_SERVES,
    FIRST_STEP,
    finish=keep_step,
)
