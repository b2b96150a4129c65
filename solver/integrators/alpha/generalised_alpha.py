"""Generalised-alpha on the equations of index 3, fixed or variable step: eq. (21).

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

from numba import float64, int64, types

from ...compiler.compiling import inner
from ...linear.index3 import index3_factor, index3_residual
from ...linear.memory import KERNELS, MEMORY
from ...linear.saddle import REGULARISATION, saddle_solve
from ...space.coordinates import chords, follow_chords
from ...space.layout import SYSTEM, WORK
from ..implicit import step_loop
from ..landing import close_step
from ..newton_steps import fade_contraction, judge, newton_limit
from ..passing import check_ways
from ..projection import accelerate, count_turns, note_drift
from ..recording import move, write_cubic
from ..singular import FAR, SINGULAR_START, SOFT
from ..step_sizes import keep_step
from ..stepping import CONTROL, STUB, copy
from .error import error_of, inertia, note_error, pass_through, split, tolerate
from .table import ALPHA

#: A Jacobian is kept while Newton's iteration contracts the error this much.
JACOBIAN_SERVES = 0.1
#: After a break, part of the step before it.
FIRST_STEP = 0.3
#: The first jerk is a difference over this part of the first step.
GLANCE = 0.01
#: What Newton's iteration may leave of the tolerance.
NEWTON_GOAL = 0.03
#: Corrections that no longer shrink are rounding below so many times as much, where
#: constraints are independent.
STAGNANT = 100.0


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA))
def _begin_step(kernels, system, work, memory, control, alpha):
    """Slopes at the beginning."""
    old = control.old_step
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
    t, glance = control.time, GLANCE * control.step
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
    t = control.time
    accelerate(kernels, system, work, memory, t, control.z, control.v)
    copy(memory.multiplier, alpha.lam)
    first = len(memory.multiplier)
    for j in range(len(system.friction)):
        alpha.lam[first + j] = work.rub[j]
    copy(alpha.lam, alpha.old_lam)


@inner(types.void(KERNELS, SYSTEM, CONTROL, ALPHA, float64))
def _place(kernels, system, control, alpha, h):
    """z_I, z_II and z_II' at the end of the step from a1.

    Frames follow the screw that dx is, the exponential map.
    """
    w = alpha.weights
    beta, gamma, am, af = w.beta, w.gamma, w.alpha_m, w.alpha_f
    for i in range(len(alpha.a1)):
        a0, a1, v0 = alpha.a0[i], alpha.a1[i], alpha.v0[i]
        alpha.dx[i] = h * (v0 + h * ((0.5 - beta) * a0 + beta * a1))
        alpha.v1[i] = v0 + h * ((1.0 - gamma) * a0 + gamma * a1)
        change = (1.0 - am) * a1 + am * a0 - af * alpha.acc[i]
        alpha.acc1[i] = change / (1.0 - af)
    chords(system, alpha.dx, alpha.p)
    kernels.rate(system, control.z, alpha.p, alpha.rz)
    follow_chords(system, control.z, alpha.dx, alpha.rz, alpha.z1)


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _fit_to_step(kernels, system, work, memory, control, alpha, h):
    """The algorithm's a and v for the step ahead, and a first guess of a1 and lambda.

    While the step stays, a and v go on. Where it changes they start anew as they are in
    a smooth motion: what constraints leave of rounding in a and v is a part of it that
    would grow with the steps.
    """
    old, w = control.old_step, alpha.weights
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
    split(kernels, system, work, memory, alpha, x, y)
    pass_through(system, memory, alpha, x)
    for i in range(len(x)):
        x[i] = alpha.p[i] - alpha.nz[i]
    pass_through(system, memory, alpha, y)
    for i in range(len(y)):
        y[i] = alpha.p[i] - alpha.nv[i]
    pass_through(system, memory, alpha, y)
    lag = w.alpha_m - w.alpha_f
    for i in range(len(alpha.a)):
        alpha.acc[i] = alpha.acc0[i] - w.force_error * (y[i] - alpha.p[i])
        alpha.a0[i] = alpha.acc[i] + (w.force_error + w.curvature) * y[i] + lag * x[i]
        alpha.a1[i] = alpha.a0[i] + x[i] + (0.5 + lag) * y[i]
    copy(control.v, alpha.v0)
    _place(kernels, system, control, alpha, h)
    kernels.evaluate(system, work, control.time + h, alpha.z1, alpha.v1)
    memory.evaluations += 1
    soft = REGULARISATION
    if control.crossing != FAR:
        soft = SOFT / control.tolerance
    kernels.project_once(system, work, memory, soft, alpha.nz, alpha.nv)
    for i in range(len(alpha.v0)):
        alpha.v0[i] += alpha.nz[i] / h


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, ALPHA, float64))
def _factor(kernels, system, work, memory, alpha, h):
    damping = h * alpha.weights.gamma / alpha.weights.beta
    return index3_factor(system, work, memory, inertia(alpha), damping, h * h)


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _newton(kernels, system, work, memory, control, alpha, h):
    """Finds a1 and lambda; iterations used, or 0 without convergence."""
    h2 = h * h
    by_a = 1.0 / (alpha.weights.beta * h2)
    goal = tolerate(system, control, alpha, h)
    _fit_to_step(kernels, system, work, memory, control, alpha, h)
    fade_contraction(control)
    blunt = STAGNANT / max(control.independence, SINGULAR_START)
    old_size = 0.0
    for iteration in range(newton_limit(control)):
        _place(kernels, system, control, alpha, h)
        kernels.evaluate(system, work, control.time + h, alpha.z1, alpha.v1)
        memory.evaluations += 1
        p, g, lam1 = alpha.p, memory.real.g, alpha.lam1
        index3_residual(system, work, alpha.place, alpha.acc1, lam1, h2, p, g)
        saddle_solve(system.newton, memory.real, 0, p, g)
        memory.newton_iterations += 1
        norm = size = 0.0
        for i in range(len(p)):
            alpha.a1[i] += by_a * p[i]
            norm = max(norm, abs(p[i]) / alpha.floor[i])
            size = max(size, abs(p[i]) / alpha.scale[i])
        if control.fixed_step == 0:
            size = norm / goal
        for i in range(len(alpha.place)):
            if alpha.place[i] >= 0:
                lam1[i] += g[alpha.place[i]] / h2
        verdict = judge(control, NEWTON_GOAL, iteration, size, old_size)
        if verdict == 1 or norm < 1.0 or (verdict < 0 and norm < blunt):
            _place(kernels, system, control, alpha, h)
            return iteration + 1
        if verdict < 0:
            return 0
        old_size = size
    return 0


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, ALPHA, float64))
def _accept(kernels, system, work, memory, control, alpha, h):
    """Moves to the end of the step, and the algorithm with it; 0 on success.

    With error control the end is on the constraints of position and velocity already.
    Fixed steps leave it as the algorithm does, with its own acceleration, but for the
    end of an interval: steps of one length need no projection, and recorded states are
    projected anyway. Friction is looked at in every end, whether it has a solution.
    """
    z1, v1 = alpha.z1, alpha.v1
    if control.fixed_step == 1:
        copy(v1, alpha.v0)
        if control.time + 1.5 * h < control.stop and len(system.friction) == 0:
            status = count_turns(system, work, control, h, z1)
            if status == 0:
                status = check_ways(work, control, h)
            copy(alpha.acc1, memory.acceleration)
            note_drift(system, work, control)
        else:
            x, y = alpha.dx, alpha.dv
            status = close_step(kernels, system, work, memory, control, h, z1, v1, x, y)
        if status != 0:
            return status
    else:
        note_error(control, alpha)
    first = len(memory.multiplier)
    for i in range(first):
        memory.multiplier[i] = alpha.lam1[i]
    for j in range(len(system.friction)):
        work.rub[j] = alpha.lam1[first + j]
    write_cubic(
        kernels, system, memory, control, h, z1, v1, alpha.rate0, alpha.acc0, alpha.rz
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
    """Of the error estimate over the length of the step."""
    return 1


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
    error_of,
    _accept,
    _order,
    _foretell,
    JACOBIAN_SERVES,
    FIRST_STEP,
    finish=keep_step,
)
