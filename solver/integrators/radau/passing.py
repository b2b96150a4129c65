"""Steps of Radau methods near a singular position, see `singular`.

Newton's iteration for stages on both sides of it diverges. So such a step starts from
an Adams formula, implicit at the end of the step only, with slopes at the stages of the
step before: E. Hairer, S. P. Norsett, G. Wanner, "Solving Ordinary Differential
Equations I", section III.1. One correction of the collocation equations follows.
"""

from __future__ import annotations

import math

from numba import boolean, float64, int64, types

from ...compiler.compiling import inner
from ...linear.memory import KERNELS, MEMORY
from ...space.layout import SYSTEM, WORK
from ..implicit import step_loop
from ..newton_steps import judge, newton_goal, newton_limit
from ..projection import accelerate
from ..singular import NEAR, keep_free_part
from ..step_sizes import scaled_norm
from ..stepping import CONTROL, copy
from .method import JACOBIAN_SERVES, accept, begin_step, error_of, newton, order
from .stages import (
    factor,
    foretell,
    go_on,
    sweep,
    take_correction,
    take_end,
    transform,
)
from .table import METHOD, STAGES

#: Slopes of a step reach so far into the next one, relative to its length.
REACH = 0.3
#: Largest correction, relative to the tolerated error, and the largest one of the free
#: motion that may be left out.
LARGEST_CORRECTION, LEFT_ALONE = 10.0, 0.3


@inner(boolean(CONTROL))
def _is_beside(control):
    """Whether a singular position is near and a step before is known."""
    return control.crossing == NEAR and control.old_step > 0.0


@inner(float64(METHOD, float64, float64))
def _bend(method, ratio, at):
    """q(at): q(0) = 0, q'(1) = 1, q' = 0 at the stages of a step before.

    It ended where this one, `ratio` times as long, begins.
    """
    total = 0.0
    for j in range(len(method.c)):
        slope = method.weights[j] * at
        for k in range(len(method.c)):
            start = (method.c[k] - 1.0) / ratio
            slope *= (at * method.c[j] - start) / (1.0 - start)
        total += slope
    return total


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _pass(kernels, system, work, memory, control, stages, h):
    """A step past a singular position; iterations used, or 0 without convergence.

    Newton's iteration for stages on both sides of it diverges. Here slopes are those of
    the stages of the last step and the one at the end of this step, an Adams formula of
    order s + 1: the polynomial E of the last step goes on as E + d q, see `_bend`.
    """
    method = stages.method
    s = len(method.c)
    ratio = h / control.old_step
    go_on(control, stages, h)
    bend = _bend(method, ratio, 1.0)
    mu = 1.0 / (bend * h)
    status = kernels.factor_real(system, work, memory, memory.real, 0, mu)
    z1, v1, dz, dv = stages.z1, stages.v1, stages.Wz[0], stages.Wv[0]
    old_norm, verdict, iteration = 0.0, 0, 0
    take_end(control, stages)
    for k in range(len(z1)):
        dz[k] = 0.0
    for k in range(len(v1)):
        dv[k] = 0.0
    while status == 0 and verdict == 0 and iteration < newton_limit(control):
        at = control.time + h
        status = accelerate(kernels, system, work, memory, at, z1, v1)
        kernels.rate(system, z1, v1, stages.rz)
        for k in range(len(z1)):
            stages.rz[k] -= dz[k] / h
            for i in range(s):
                stages.rz[k] -= method.slope[i] / h * stages.Zz[i, k]
        for k in range(len(v1)):
            stages.rv[k] = memory.acceleration[k] - dv[k] / h
            for i in range(s):
                stages.rv[k] -= method.slope[i] / h * stages.Zv[i, k]
        rz, rv = stages.rz, stages.rv
        kernels.solve_real(system, work, memory, memory.real, 0, mu, rz, rv)
        memory.newton_iterations += 1
        norm = scaled_norm(stages.rz, stages.rv, control.scale_z, control.scale_v)
        verdict = judge(control, newton_goal(control), iteration, norm, old_norm)
        for k in range(len(z1)):
            z1[k] += stages.rz[k]
            dz[k] += stages.rz[k] / bend
        for k in range(len(v1)):
            v1[k] += stages.rv[k]
            dv[k] += stages.rv[k] / bend
        old_norm = norm
        iteration += 1
    if status != 0 or verdict != 1:
        return 0
    for i in range(s):
        bend = _bend(method, ratio, method.c[i])
        for k in range(len(z1)):
            stages.Zz[i, k] += bend * dz[k]
        for k in range(len(v1)):
            stages.Zv[i, k] += bend * dv[k]
    mu = method.real_eigenvalue / h
    status = kernels.factor_real(system, work, memory, memory.real, 0, mu)
    return iteration if status == 0 else 0


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _keep_free(kernels, system, work, memory, control, stages, h):
    """Takes from the error what projection takes from the end of the step."""
    take_end(control, stages)
    z1, v1, rv, x, p = stages.z1, stages.v1, stages.rv, memory.real.x, memory.real.p
    keep_free_part(kernels, system, work, memory, control, h, z1, v1, rv, x, p)


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _refine(kernels, system, work, memory, control, stages, h):
    """A correction of the collocation equations; 0 if it is not too large.

    A stage very close to the singular position may spoil it: then what it changes of
    the free motion, at the end of the step, tells whether the step is good without it.
    """
    method, s = stages.method, len(stages.method.c)
    transform(method.TI, stages.Zz, stages.Wz)
    transform(method.TI, stages.Zv, stages.Wv)
    if not math.isfinite(sweep(kernels, system, work, memory, control, stages, h)):
        return 1
    dz, dv, size = stages.old_Zz, stages.old_Zv, 0.0
    transform(method.T, stages.Fz, dz)
    transform(method.T, stages.Fv, dv)
    for i in range(s):
        size = max(size, scaled_norm(dz[i], dv[i], control.scale_z, control.scale_v))
    if size < LARGEST_CORRECTION:
        take_correction(stages)
        return 0
    for k in range(len(stages.rz)):
        stages.rz[k] = 0.0
    copy(dv[s - 1], stages.rv)
    _keep_free(kernels, system, work, memory, control, stages, h)
    error = scaled_norm(stages.rz, stages.rv, control.scale_z, control.scale_v)
    return 0 if error < LEFT_ALONE else 1


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _solve(kernels, system, work, memory, control, stages, h):
    """The stages of a step; iterations used, or 0 without convergence."""
    if not _is_beside(control):
        return newton(kernels, system, work, memory, control, stages, h)
    control.contraction = 1.0
    return _pass(kernels, system, work, memory, control, stages, h)


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _accept(kernels, system, work, memory, control, stages, h):
    """`accept`, after what a step past a singular position still lacks."""
    if _is_beside(control):
        status = _refine(kernels, system, work, memory, control, stages, h)
        if status != 0:
            return status
    return accept(kernels, system, work, memory, control, stages, h)


advance = step_loop(
    "radau_passing",
    STAGES,
    begin_step,
    factor,
    _solve,
    error_of(_keep_free),
    _accept,
    order,
    foretell,
    JACOBIAN_SERVES,
    reach=REACH,
)
