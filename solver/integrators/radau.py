"""Radau IIA collocation of order 2 s - 1 with variable step, index 1, eq. (19).

References
----------
E. Hairer, G. Wanner: Solving Ordinary Differential Equations II, section IV.8.
"""

import math
from typing import Any

from ..compiler.kernels import inner
from ..compiler.types import boolean, float64, int64, void
from ..linear.factor_storage import KERNELS, MEMORY
from ..spatial.system_arrays import SYSTEM, WORK
from .implicit_loop import step_loop
from .loop_state import CONTROL, copy
from .newton_iteration import check_convergence, newton_goal, newton_limit
from .output_sampling import advance_state, next_output_row, step_fraction
from .projection import evaluate_accelerations
from .radau_stages import (
    RADAU_TABLEAU,
    STAGES,
    apply_correction,
    factor_newton_matrices,
    newton_correction,
    predict_from_last_polynomial,
    predict_stages,
    predict_step_end,
    set_end_state,
    transform,
)
from .singular_configurations import (
    NEAR_SINGULAR,
    project_step_end,
    project_velocity_error,
)
from .step_size import scaled_norm

#: A Jacobian is kept while Newton's iteration contracts the error this much.
JACOBIAN_CONTRACTION = 1e-2

#: Largest correction, relative to the tolerated error, and the largest one of the free
#: motion that may be left out.
MAX_CORRECTION, IGNORED_CORRECTION = 10.0, 0.3


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def radau_newton(kernels, system, work, memory, control, stages, h):
    """Solves the collocation equations; iterations used, or 0 without convergence."""
    method = stages.tableau
    control.contraction = 1.0
    predict_stages(control, stages, h)
    transform(method.TI, stages.Zz, stages.Wz)
    transform(method.TI, stages.Zv, stages.Wv)
    old_norm = 0.0
    for iteration in range(newton_limit(control)):
        norm = newton_correction(kernels, system, work, memory, control, stages, h)
        convergence = check_convergence(
            control, newton_goal(control), iteration, norm, old_norm
        )
        if convergence < 0:
            return 0
        apply_correction(stages)
        if convergence == 1:
            return iteration + 1
        old_norm = norm
    return 0


@inner(void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _keep_full_error(kernels, system, work, memory, control, stages, h):
    """Far from singular configurations all of an error counts."""


def error_estimate(filter_error: Any) -> Any:
    """The error estimate; `filter_error` leaves in (rz, rv) what counts of it."""

    def error(kernels, system, work, memory, control, stages, h):
        """Norm of the error estimate, made anew where it first seems too large."""
        method = stages.tableau
        repeats = control.step_failures > 0 or control.old_step == 0.0
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
            filter_error(kernels, system, work, memory, control, stages, h)
            error = scaled_norm(stages.rz, stages.rv, control.scale_z, control.scale_v)
            if error < 1.0 or not repeats or attempt == 1:
                return error
            for k in range(len(stages.rz)):
                stages.z1[k] = control.z[k] + stages.rz[k]
            for k in range(len(stages.rv)):
                stages.v1[k] = control.v[k] + stages.rv[k]
            t = control.time
            if (
                evaluate_accelerations(
                    kernels, system, work, memory, t, stages.z1, stages.v1
                )
                != 0
            ):
                return error
        return error

    signature = float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64)
    return inner(signature)(error)


@inner(void(CONTROL, STAGES, float64))
def _write_outputs(control, stages, h):
    """Dense output: the collocation polynomial at the output times inside the step."""
    method = stages.tableau
    s = len(method.c)
    while True:
        k = next_output_row(control, h)
        if k < 0:
            return
        at = step_fraction(control, k, h)
        for n in range(len(control.z)):
            control.output_z[k, n] = control.z[n]
        for n in range(len(control.v)):
            control.output_v[k, n] = control.v[n]
        for i in range(s):
            weight = at / method.c[i]
            for j in range(s):
                if j != i:
                    weight *= (at - method.c[j]) / (method.c[i] - method.c[j])
            for n in range(len(control.z)):
                control.output_z[k, n] += weight * stages.Zz[i, n]
            for n in range(len(control.v)):
                control.output_v[k, n] += weight * stages.Zv[i, n]


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def radau_accept(kernels, system, work, memory, control, stages, h):
    """Moves to the end of the step, projected onto the constraints; 0 on success."""
    set_end_state(control, stages)
    z1, v1, dz, dv = stages.z1, stages.v1, memory.real.x, memory.real.p
    status = project_step_end(kernels, system, work, memory, control, h, z1, v1, dz, dv)
    if status != 0:
        return status
    for i in range(len(stages.Zz)):
        copy(stages.Zz[i], stages.last_Zz[i])
        copy(stages.Zv[i], stages.last_Zv[i])
    _write_outputs(control, stages, h)
    advance_state(control, h, stages.z1, stages.v1)
    return 0


@inner(void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES))
def radau_begin_step(kernels, system, work, memory, control, stages):
    """Slopes at the beginning of the step."""
    kernels.rate(system, control.z, control.v, stages.rate0)
    copy(memory.acceleration, stages.acc0)


@inner(int64(STAGES))
def radau_error_order(stages):
    """Of the error estimate."""
    return len(stages.tableau.c)


advance = step_loop(
    "radau",
    STAGES,
    radau_begin_step,
    factor_newton_matrices,
    radau_newton,
    error_estimate(_keep_full_error),
    radau_accept,
    radau_error_order,
    predict_step_end,
    JACOBIAN_CONTRACTION,
    returns_near_singular=True,
)


#: Slopes of a step reach so far into the next one, relative to its length.
ADAMS_REACH = 0.3


@inner(boolean(CONTROL))
def _is_near_singularity(control):
    """True if a singular configuration is near and a step before is known."""
    return control.singular_proximity == NEAR_SINGULAR and control.old_step > 0.0


@inner(float64(RADAU_TABLEAU, float64, float64))
def _correction_polynomial(method, ratio, at):
    """Polynomial q with q(0) = 0, q'(1) = 1 and q' = 0 at the stages of the step
    before.

    That step ended where this one, `ratio` times as long, begins.
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
def _adams_step(kernels, system, work, memory, control, stages, h):
    """A step past a singular configuration; iterations used, or 0 without convergence.

    Newton's iteration for stages on both sides of it diverges. Here slopes are those of
    the stages of the last step and the one at the end of this step, an Adams formula of
    order s + 1: the polynomial E of the last step goes on as E + d q, see
    `_correction_polynomial`.
    """
    method = stages.tableau
    s = len(method.c)
    ratio = h / control.old_step
    predict_from_last_polynomial(control, stages, h)
    correction_scale = _correction_polynomial(method, ratio, 1.0)
    mu = 1.0 / (correction_scale * h)
    status = kernels.factor_real(system, work, memory, memory.real, 0, mu)
    z1, v1, dz, dv = stages.z1, stages.v1, stages.Wz[0], stages.Wv[0]
    old_norm, convergence, iteration = 0.0, 0, 0
    set_end_state(control, stages)
    for k in range(len(z1)):
        dz[k] = 0.0
    for k in range(len(v1)):
        dv[k] = 0.0
    while status == 0 and convergence == 0 and iteration < newton_limit(control):
        at = control.time + h
        status = evaluate_accelerations(kernels, system, work, memory, at, z1, v1)
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
        convergence = check_convergence(
            control, newton_goal(control), iteration, norm, old_norm
        )
        for k in range(len(z1)):
            z1[k] += stages.rz[k]
            dz[k] += stages.rz[k] / correction_scale
        for k in range(len(v1)):
            v1[k] += stages.rv[k]
            dv[k] += stages.rv[k] / correction_scale
        old_norm = norm
        iteration += 1
    if status != 0 or convergence != 1:
        return 0
    for i in range(s):
        correction_scale = _correction_polynomial(method, ratio, method.c[i])
        for k in range(len(z1)):
            stages.Zz[i, k] += correction_scale * dz[k]
        for k in range(len(v1)):
            stages.Zv[i, k] += correction_scale * dv[k]
    mu = method.real_eigenvalue / h
    status = kernels.factor_real(system, work, memory, memory.real, 0, mu)
    return iteration if status == 0 else 0


@inner(void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _keep_free_error(kernels, system, work, memory, control, stages, h):
    """Remove from the error what the projection removes from the end of the step."""
    set_end_state(control, stages)
    z1, v1, rv, x, p = stages.z1, stages.v1, stages.rv, memory.real.x, memory.real.p
    project_velocity_error(kernels, system, work, memory, control, h, z1, v1, rv, x, p)


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _correct_collocation(kernels, system, work, memory, control, stages, h):
    """A correction of the collocation equations; 0 if it is not too large.

    A stage very close to the singular configuration may spoil it: then what it changes
    of the free motion, at the end of the step, shows whether the step is good without
    it.
    """
    method, s = stages.tableau, len(stages.tableau.c)
    transform(method.TI, stages.Zz, stages.Wz)
    transform(method.TI, stages.Zv, stages.Wv)
    if not math.isfinite(
        newton_correction(kernels, system, work, memory, control, stages, h)
    ):
        return 1
    dz, dv, size = stages.old_Zz, stages.old_Zv, 0.0
    transform(method.T, stages.Fz, dz)
    transform(method.T, stages.Fv, dv)
    for i in range(s):
        size = max(size, scaled_norm(dz[i], dv[i], control.scale_z, control.scale_v))
    if size < MAX_CORRECTION:
        apply_correction(stages)
        return 0
    for k in range(len(stages.rz)):
        stages.rz[k] = 0.0
    copy(dv[s - 1], stages.rv)
    _keep_free_error(kernels, system, work, memory, control, stages, h)
    error = scaled_norm(stages.rz, stages.rv, control.scale_z, control.scale_v)
    return 0 if error < IGNORED_CORRECTION else 1


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _solve_near_singularity(kernels, system, work, memory, control, stages, h):
    """The stages of a step; iterations used, or 0 without convergence."""
    if not _is_near_singularity(control):
        return radau_newton(kernels, system, work, memory, control, stages, h)
    control.contraction = 1.0
    return _adams_step(kernels, system, work, memory, control, stages, h)


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _accept_near_singularity(kernels, system, work, memory, control, stages, h):
    """`radau_accept`, after what a step past a singular configuration still lacks."""
    if _is_near_singularity(control):
        status = _correct_collocation(kernels, system, work, memory, control, stages, h)
        if status != 0:
            return status
    return radau_accept(kernels, system, work, memory, control, stages, h)


advance_past_singularity = step_loop(
    "radau_passing",
    STAGES,
    radau_begin_step,
    factor_newton_matrices,
    _solve_near_singularity,
    error_estimate(_keep_free_error),
    _accept_near_singularity,
    radau_error_order,
    predict_step_end,
    JACOBIAN_CONTRACTION,
    reach=ADAMS_REACH,
)
