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
    F1,
    I1,
    N_POS,
    N_ROWS,
    N_VEL,
    NP,
    NQ,
    PLANAR,
    POS,
    RD,
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
from ..kernels.tables import Table, TableType
from .implicit import step_loop
from .landing import land
from .singular import FAR, keep_free_part
from .stepping import (
    CONTROL,
    CROSSING,
    FAILURES,
    FIXED_STEP,
    OLD_STEP,
    STOP,
    TIME,
    TOLERANCE,
    copy,
    count_turns,
    fade_contraction,
    judge,
    move,
    newton_limit,
    note_drift,
    scaled_norm,
    write_cubic,
)

#: A Jacobian is kept while Newton's iteration contracts the error this much.
JACOBIAN_SERVES = 0.1
#: For what errors of the multipliers, left out here, do to elastic coordinates.
CAUTION = 2.0
#: After a break, part of the step before it: the lag of a is not known yet.
FIRST_STEP = 0.05
#: What Newton's iteration may leave of the tolerance.
NEWTON_GOAL = 0.03
#: Displacements below this part of the size of the mechanism are rounding, however fast
#: they are in a short step.
ROUNDING = 1e-14

# Entries of Alpha.weights
ALPHA_M, ALPHA_F, BETA, GAMMA, POSITION_ERROR, VELOCITY_ERROR, N_WEIGHTS = range(7)


class Alpha(Table):
    """Coefficients, the state between steps, and scratch vectors.

    place : row of each constraint in the Newton matrix, -1 for none
    weights : see the entries above
    a, v, acc : accelerations, velocities and z_II' of the algorithm
    old_a : a one step before
    a0, v0 : a and v as they are for the length of the step ahead
    rate0, acc0 : z_I' and z_II' at the beginning of the step, on the constraints
    lam, old_lam : lambda at the beginning of this step and one before
    lam1 : at the end of the step
    a1, z1, v1, acc1 : at the end of the step
    dx : motion during the step, in the tangent space
    rz : scratch like z_I
    p, g : right-hand side and solution of a correction
    scale : tolerated error of tangent vectors
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
    lam: Array
    old_lam: Array
    lam1: Array
    a1: Array
    z1: Array
    v1: Array
    acc1: Array
    dx: Array
    rz: Array
    p: Array
    g: Array
    scale: Array


ALPHA = TableType(Alpha, [I1] + [F1] * 21)


def coefficients(rho: float) -> Array:
    """Weights for a spectral radius rho at infinite frequency, 0 to 1.

    The errors are those of one step with the exact acceleration z_II' + (alpha_m -
    alpha_f) h z_II'' + ... as a: h^3 z_II'' and h^3 z_II''' times the last two.
    """
    alpha_m, alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
    shift = alpha_m - alpha_f
    gamma = 0.5 - shift
    beta = 0.25 * (gamma + 0.5) ** 2
    bend = 0.5 * (1.0 - alpha_f) - (1.0 - alpha_m) * (0.5 + shift)
    position = beta + 0.5 * shift - 1.0 / 6.0
    velocity = bend + gamma * (0.5 + shift) - 1.0 / 6.0
    return np.array([alpha_m, alpha_f, beta, gamma, position, velocity])


def new_alpha(system: System, rho: float) -> Alpha:
    """Storage for a run."""
    n, m = int(system.dims[N_POS]), int(system.dims[N_VEL])
    rows, newton_rows = int(system.dims[N_ROWS]), int(system.newton.dims[N_ROWS])
    sizes = [m] * 6 + [n, m, rows, rows, rows, m, n, m, m, m, n, m, newton_rows, m]
    vectors = (np.zeros(size) for size in sizes)
    return Alpha(newton_places(system), coefficients(rho), *vectors)


def newton_places(system: System) -> np.ndarray:
    """Row of each constraint in the Newton matrix, (rows,), -1 for none."""
    places = np.full(int(system.dims[N_ROWS]), -1, np.int64)
    newton_row = dict(system.newton.segment[:, [S_OFFSET, S_ROW]].tolist())
    for row, offset in system.segment[:, [S_ROW, S_OFFSET]].tolist():
        places[row] = newton_row[offset]
    return places


@inner(types.void(KERNELS, SYSTEM, MEMORY, CONTROL, ALPHA))
def _begin_step(kernels, system, memory, control, alpha):
    """Slopes at the beginning; after a break the algorithm starts anew."""
    kernels.rate(system, control.z, control.v, alpha.rate0)
    copy(memory.acceleration, alpha.acc0)
    if control.real[OLD_STEP] == 0.0:
        copy(memory.acceleration, alpha.a)
        copy(memory.acceleration, alpha.old_a)
        copy(memory.acceleration, alpha.acc)
        copy(control.v, alpha.v)
        copy(memory.multiplier, alpha.lam)
        copy(memory.multiplier, alpha.old_lam)
    for b in range(len(system.body)):
        row = system.body[b]
        rd, nq, u, p = row[RD], row[NQ], row[VEL], row[POS]
        for k in range(rd):
            alpha.scale[u + k] = control.scale_z[p + k]
        for k in range(nq):
            alpha.scale[u + rd + k] = control.scale_z[p + row[NP] - nq + k]


@inner(types.void(CONTROL, ALPHA, float64))
def _fit_to_step(control, alpha, h):
    """What the algorithm's a and v are off grows with h and h^2: a step that changes.

    The lag of a is a part of the step ahead; v meets the constraints to second order.
    Also the first guess of a1 and lambda: they go on as they changed so far, or, where
    that did not do, a1 takes the bodies where their true motion does.
    """
    old = control.real[OLD_STEP]
    ratio = h / old if old > 0.0 else 1.0
    beta = alpha.weights[BETA]
    for i in range(len(alpha.a)):
        alpha.a0[i] = alpha.acc[i] + ratio * (alpha.a[i] - alpha.acc[i])
        alpha.v0[i] = control.v[i] + ratio * ratio * (alpha.v[i] - control.v[i])
        alpha.a1[i] = alpha.a0[i] + ratio * (alpha.a[i] - alpha.old_a[i])
        if control.whole[FAILURES] > 0:
            off = (control.v[i] - alpha.v0[i]) / h + 0.5 * alpha.acc0[i]
            alpha.a1[i] = (off - (0.5 - beta) * alpha.a0[i]) / beta
    for i in range(len(alpha.lam)):
        alpha.lam1[i] = alpha.lam[i] + ratio * (alpha.lam[i] - alpha.old_lam[i])


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


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, ALPHA, float64))
def _factor(kernels, system, work, memory, alpha, h):
    damping = h * alpha.weights[GAMMA] / alpha.weights[BETA]
    return index3_factor(system, work, memory, _inertia(alpha), damping, h * h)


@inner(float64(ALPHA))
def _displacement(alpha):
    """The last correction relative to the tolerated error."""
    return scaled_norm(alpha.p, alpha.p, alpha.scale, alpha.scale)


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _newton(kernels, system, work, memory, control, alpha, h):
    """Finds a1 and lambda; iterations used, or 0 without convergence."""
    real = control.real
    h2 = h * h
    by_a = 1.0 / (alpha.weights[BETA] * h2)
    _fit_to_step(control, alpha, h)
    fade_contraction(control)
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
        by_v = alpha.weights[GAMMA] * h * by_a
        for i in range(len(alpha.p)):
            alpha.a1[i] += by_a * alpha.p[i]
            alpha.v1[i] = by_v * alpha.p[i]
        for i in range(len(alpha.place)):
            if alpha.place[i] >= 0:
                alpha.lam1[i] += alpha.g[alpha.place[i]] / h2
        norm = scaled_norm(alpha.p, alpha.v1, alpha.scale, control.scale_v)
        verdict = judge(control, NEWTON_GOAL, iteration, norm, old_norm)
        if verdict < 0 and real[TOLERANCE] * _displacement(alpha) < ROUNDING:
            verdict = 1
        if verdict < 0:
            return 0
        if verdict == 1:
            _place(kernels, system, control, alpha, h)
            return iteration + 1
        old_norm = norm
    return 0


@inner(types.void(SYSTEM, MEMORY, ALPHA))
def _filter(system, memory, alpha):
    """Passes the tangent vector v1 through the Newton matrix, into p."""
    for i in range(len(alpha.p)):
        alpha.p[i] = 0.0
    for i in range(len(alpha.g)):
        alpha.g[i] = 0.0
    add_mass_times(system, memory.M, alpha.v1, _inertia(alpha), alpha.p)
    index3_solve(system, memory, alpha.p, alpha.g)


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _error(kernels, system, work, memory, control, alpha, h):
    """Norm of the local error, passed through Newton's matrix for stiff coordinates.

    Position: h^3 z_II'' from the change of a. Velocity: h^3 z_II''' from its second
    divided difference; in a first step h z_II''' counts as z_II''.
    """
    old, w = control.real[OLD_STEP], alpha.weights
    n = len(alpha.p)
    for i in range(n):
        change = alpha.a1[i] - alpha.a0[i]
        alpha.v1[i] = w[POSITION_ERROR] * h * h * change
    _filter(system, memory, alpha)
    copy(alpha.p, alpha.dx)
    for i in range(n):
        change = alpha.a1[i] - alpha.a0[i]
        if old > 0.0:
            before = (alpha.a[i] - alpha.old_a[i]) * h / old
            change = 2.0 * h * (change - before) / (h + old)
        alpha.v1[i] = w[VELOCITY_ERROR] * h * change
    _filter(system, memory, alpha)
    if control.whole[CROSSING] != FAR:
        at = control.real[TIME] + h
        for error in (alpha.dx, alpha.p):
            keep_free_part(
                kernels,
                system,
                work,
                memory,
                at,
                alpha.z1,
                control.v,
                error,
                memory.dx,
                alpha.v1,
            )
    error = CAUTION * scaled_norm(alpha.dx, alpha.p, alpha.scale, control.scale_v)
    return max(error, _turning_error(system, control, h))


@inner(float64(SYSTEM, CONTROL, float64))
def _turning_error(system, control, h):
    """What dense output misses of frames that turn steadily, which steps do exactly.

    A cubic misses y'''' / 384 in the middle of a step of one: of positions speed times
    (angular velocity)^3, of quaternions (angular velocity / 2)^4.
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
    return worst / 384.0


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _land(kernels, system, work, memory, control, alpha, h):
    """Ends a step; 0 on success.

    With error control, and at the end of an interval, on the constraints of position
    and velocity. Otherwise as the algorithm leaves it, with its own acceleration:
    steps of one length need no projection, and recorded states are projected anyway.
    """
    real = control.real
    if control.whole[FIXED_STEP] == 1 and real[TIME] + 1.5 * h < real[STOP]:
        status = count_turns(system, work, control, h, alpha.z1)
        if status != 0:
            return status
        copy(alpha.acc1, memory.acceleration)
        copy(alpha.lam1, memory.multiplier)
        note_drift(system, work, control)
        write_cubic(
            kernels,
            system,
            memory,
            control,
            h,
            alpha.z1,
            alpha.v1,
            alpha.rate0,
            alpha.acc0,
            alpha.rz,
        )
        move(control, h, alpha.z1, alpha.v1)
        return 0
    return land(
        kernels,
        system,
        work,
        memory,
        control,
        h,
        alpha.z1,
        alpha.v1,
        alpha.rate0,
        alpha.acc0,
        alpha.rz,
        alpha.dx,
        alpha.p,
    )


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _accept(kernels, system, work, memory, control, alpha, h):
    """Moves to the end of the step, and the algorithm with it; 0 on success."""
    _place(kernels, system, control, alpha, h)
    copy(alpha.v1, alpha.v0)
    status = _land(kernels, system, work, memory, control, alpha, h)
    if status == 0:
        copy(alpha.v0, alpha.v)
        copy(alpha.a0, alpha.old_a)
        copy(alpha.a1, alpha.a)
        copy(alpha.acc1, alpha.acc)
        copy(alpha.lam, alpha.old_lam)
        copy(alpha.lam1, alpha.lam)
    return status


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
)
