"""Radau IIA collocation of order 2 s - 1 with variable step, index 1: eq. (19).

Source: E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II", section
IV.8 (simplified Newton iteration in transformed variables, error estimate, step size
control), here with the Jacobian kept in saddle-point form and with a projection of
positions and velocities after every accepted step. Near singular positions the loop of
`radau_passing` goes on.
"""

from __future__ import annotations

from typing import Any

from numba import float64, int64, types

from ...compiler.compiling import inner
from ...linear.memory import KERNELS, MEMORY
from ...space.layout import SYSTEM, WORK
from ..implicit import step_loop
from ..landing import close_step
from ..newton_steps import judge, newton_goal, newton_limit
from ..projection import accelerate
from ..recording import move, output_due, share_of_step
from ..step_sizes import scaled_norm
from ..stepping import CONTROL, copy
from .stages import (
    factor,
    foretell,
    predict,
    sweep,
    take_correction,
    take_end,
    transform,
)
from .table import STAGES

#: A Jacobian is kept while Newton's iteration contracts the error this much.
JACOBIAN_SERVES = 1e-2


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def newton(kernels, system, work, memory, control, stages, h):
    """Solves the collocation equations; iterations used, or 0 without convergence."""
    method = stages.method
    control.contraction = 1.0
    predict(control, stages, h)
    transform(method.TI, stages.Zz, stages.Wz)
    transform(method.TI, stages.Zv, stages.Wv)
    old_norm = 0.0
    for iteration in range(newton_limit(control)):
        norm = sweep(kernels, system, work, memory, control, stages, h)
        verdict = judge(control, newton_goal(control), iteration, norm, old_norm)
        if verdict < 0:
            return 0
        take_correction(stages)
        if verdict == 1:
            return iteration + 1
        old_norm = norm
    return 0


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _keep_all(kernels, system, work, memory, control, stages, h):
    """Far from singular positions all of an error counts."""


def error_of(keep: Any) -> Any:
    """The error estimate; `keep` leaves in (rz, rv) what counts of it."""

    def error(kernels, system, work, memory, control, stages, h):
        """Norm of the error estimate, made anew where it first seems too large."""
        method = stages.method
        cautious = control.failures > 0 or control.old_step == 0.0
        s = len(method.c)
        mu = method.real_eigenvalue / h
        for attempt in range(2):
            for k in range(len(stages.rz)):
                stages.rz[k] = stages.rate0[k]
                for i in range(s):
                    stages.rz[k] += method.error[i] / h * stages.Zz[i, k]
            for k in range(len(stages.rv)):
                stages.rv[k] = stages.acc0[k]
                for i in range(s):
                    stages.rv[k] += method.error[i] / h * stages.Zv[i, k]
            if attempt == 1:
                kernels.rate(system, stages.z1, stages.v1, stages.old_Zz[0])
                for k in range(len(stages.rz)):
                    stages.rz[k] += stages.old_Zz[0, k] - stages.rate0[k]
                for k in range(len(stages.rv)):
                    stages.rv[k] += memory.acceleration[k] - stages.acc0[k]
            rz, rv = stages.rz, stages.rv
            kernels.solve_real(system, work, memory, memory.real, 0, mu, rz, rv)
            keep(kernels, system, work, memory, control, stages, h)
            error = scaled_norm(stages.rz, stages.rv, control.scale_z, control.scale_v)
            if error < 1.0 or not cautious or attempt == 1:
                return error
            for k in range(len(stages.rz)):
                stages.z1[k] = control.z[k] + stages.rz[k]
            for k in range(len(stages.rv)):
                stages.v1[k] = control.v[k] + stages.rv[k]
            t = control.time
            if accelerate(kernels, system, work, memory, t, stages.z1, stages.v1) != 0:
                return error
        return error

    signature = float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64)
    return inner(signature)(error)


@inner(types.void(CONTROL, STAGES, float64))
def _write_outputs(control, stages, h):
    """Dense output: the collocation polynomial at the output times inside the step."""
    method = stages.method
    s = len(method.c)
    while True:
        k = output_due(control, h)
        if k < 0:
            return
        at = share_of_step(control, k, h)
        for n in range(len(control.z)):
            control.out_z[k, n] = control.z[n]
        for n in range(len(control.v)):
            control.out_v[k, n] = control.v[n]
        for i in range(s):
            weight = at / method.c[i]
            for j in range(s):
                if j != i:
                    weight *= (at - method.c[j]) / (method.c[i] - method.c[j])
            for n in range(len(control.z)):
                control.out_z[k, n] += weight * stages.Zz[i, n]
            for n in range(len(control.v)):
                control.out_v[k, n] += weight * stages.Zv[i, n]


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def accept(kernels, system, work, memory, control, stages, h):
    """Moves to the end of the step, projected onto the constraints; 0 on success."""
    take_end(control, stages)
    z1, v1, dz, dv = stages.z1, stages.v1, memory.real.x, memory.real.p
    status = close_step(kernels, system, work, memory, control, h, z1, v1, dz, dv)
    if status != 0:
        return status
    for i in range(len(stages.Zz)):
        copy(stages.Zz[i], stages.last_Zz[i])
        copy(stages.Zv[i], stages.last_Zv[i])
    _write_outputs(control, stages, h)
    move(control, h, stages.z1, stages.v1)
    return 0


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES))
def begin_step(kernels, system, work, memory, control, stages):
    """Slopes at the beginning of the step."""
    kernels.rate(system, control.z, control.v, stages.rate0)
    copy(memory.acceleration, stages.acc0)


@inner(int64(STAGES))
def order(stages):
    """Of the error estimate."""
    return len(stages.method.c)


advance = step_loop(
    "radau",
    STAGES,
    begin_step,
    factor,
    newton,
    error_of(_keep_all),
    accept,
    order,
    foretell,
    JACOBIAN_SERVES,
    leaves=True,
)
