"""Radau IIA collocation of order 2 s - 1 with variable step, on the index-1 equations.

Source: E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II", section
IV.8 (simplified Newton iteration in transformed variables, error estimate, step size
control), here with the Jacobian kept in saddle-point form and with a projection of
positions and velocities after every accepted step.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numba import boolean, float64, int64, types

from formats.sid import Array

from ..kernels.compiling import inner
from ..kernels.layout import (
    C1,
    F1,
    F2,
    SYSTEM,
    WORK,
)
from ..kernels.newton import (
    ITERATIONS,
    KERNELS,
    MEMORY,
)
from ..kernels.tables import Table, TableType
from .implicit import step_loop
from .stepping import (
    CONTRACTION,
    CONTROL,
    CROSSING,
    FAILURES,
    FAR,
    NEAR,
    OLD_STEP,
    PREDICT,
    STAGE_STEP,
    TIME,
    accelerate,
    close_step,
    copy,
    factor_real,
    judge,
    keep_free_part,
    move,
    newton_goal,
    newton_limit,
    output_due,
    scaled_norm,
    share_of_step,
    solve_real,
)

#: A Jacobian is kept while Newton's iteration contracts the error this much.
JACOBIAN_SERVES = 1e-2
#: Past a singular position a step rests on slopes of the one before: they reach so far.
REACH = 0.3
#: Largest correction of a step past a singular position, relative to the tolerated
#: error, and the largest one of its free motion that may be left out.
LARGEST_CORRECTION, LEFT_ALONE = 10.0, 0.1


class Method(Table):
    """A Radau IIA method with s stages.

    c : (s,) nodes
    T, TI : (s, s) transformation of the stages that makes A^-1 block diagonal: one
        real eigenvalue first, then pairs of rows for complex ones, and its inverse
    real_eigenvalue : (1,)
    complex_eigenvalues : (pairs,)
    error : (s,) weights of the stages in the error estimate
    weights : (s,) of the stages in an integral over the step
    slope : (s,) of the stages in the slope at the end
    """

    c: Array
    T: Array
    TI: Array
    real_eigenvalue: Array
    complex_eigenvalues: np.ndarray
    error: Array
    weights: Array
    slope: Array


METHOD = TableType(Method, [F1, F2, F2, F1, C1] + [F1] * 3)


class Stages(Table):
    """The method; stage increments Z, their transforms W, slopes F; scratch vectors.

    last_Z : the increments of the last accepted step
    """

    method: Method
    Zz: Array
    Zv: Array
    Wz: Array
    Wv: Array
    Fz: Array
    Fv: Array
    rate0: Array
    acc0: Array
    z1: Array
    v1: Array
    rz: Array
    rv: Array
    x: Array
    p: Array
    g: Array
    crz: np.ndarray
    crv: np.ndarray
    cx: np.ndarray
    cp: np.ndarray
    cg: np.ndarray
    old_Zz: Array
    old_Zv: Array
    last_Zz: Array
    last_Zv: Array


STAGES = TableType(Stages, [METHOD] + [F2] * 6 + [F1] * 9 + [C1] * 5 + [F2] * 4)


@cache
def method(stages: int) -> Method:
    """Coefficients of Radau IIA, from the zeros of its node polynomial.

    Raises
    ------
    ValueError : the number of stages is not odd; even ones have no real eigenvalue.
    """
    if stages % 2 == 0:
        raise ValueError("Radau IIA is used with an odd number of stages")
    c = _radau_nodes(stages)
    powers = np.vander(c, stages, increasing=True)
    A = (powers * c[:, None] / np.arange(1, stages + 1)) @ np.linalg.inv(powers)
    eigenvalues, vectors = np.linalg.eig(np.linalg.inv(A))
    real = int(np.argmin(abs(eigenvalues.imag)))
    pairs = [k for k in np.argsort(eigenvalues.imag) if eigenvalues[k].imag > 1e-9]
    columns = [vectors[:, real].real]
    for k in pairs:
        columns += [vectors[:, k].real, vectors[:, k].imag]
    T = np.column_stack(columns)
    gamma = float(eigenvalues[real].real)
    return Method(
        c=c,
        T=np.ascontiguousarray(T),
        TI=np.ascontiguousarray(np.linalg.inv(T)),
        real_eigenvalue=np.array([gamma]),
        complex_eigenvalues=np.conj(eigenvalues[pairs]),
        error=_error_weights(A, c, gamma),
        weights=A[-1].copy(),
        slope=np.linalg.inv(A)[-1].copy(),
    )


def _radau_nodes(stages: int) -> Array:
    """Zeros of P_s - P_{s-1} (Legendre, shifted to [0, 1])."""
    series = np.zeros(stages + 1)
    series[stages], series[stages - 1] = 1.0, -1.0
    nodes = np.sort(np.polynomial.legendre.legroots(series).real)
    nodes[-1] = 1.0
    return 0.5 * (nodes + 1.0)


def _error_weights(A: Array, c: Array, gamma: float) -> Array:
    """Weights e of the error estimate (gamma/h - J)^-1 (f(y0) + sum_i e_i Z_i / h).

    The embedded formula y0 + h (f(y0) / gamma + sum b_i f(Y_i)) has order s; the
    estimate is its difference to the collocation solution, times gamma / h.
    """
    s = len(c)
    right = 1.0 / np.arange(1, s + 1)
    right[0] -= 1.0 / gamma
    embedded = np.linalg.solve(np.vander(c, s, increasing=True).T, right)
    return gamma * (embedded - A[-1]) @ np.linalg.inv(A)


def new_stages(s: int, n_positions: int, n_velocities: int, n_rows: int) -> Stages:
    """Storage for a run with s stages."""
    n, m = n_positions, n_velocities
    shapes = [(s, n), (s, m)] * 3 + [n, m, n, m, n, m, m, m, n_rows]
    complex_shapes = [n, m, m, m, n_rows]
    arrays: list[Any] = [np.zeros(shape) for shape in shapes]
    arrays += [np.zeros(shape, complex) for shape in complex_shapes]
    arrays += [np.zeros(shape) for shape in [(s, n), (s, m)] * 2]
    return Stages(method(s), *arrays)


@inner(types.void(CONTROL, STAGES, float64))
def _predict(control, stages, h):
    """First guess of Z from the last collocation polynomial.

    It is continued after an accepted step, and shortened after a rejected one.
    """
    method = stages.method
    s = len(method.c)
    for i in range(s):
        copy(stages.Zz[i], stages.old_Zz[i])
        copy(stages.Zv[i], stages.old_Zv[i])
        for n in range(stages.Zz.shape[1]):
            stages.Zz[i, n] = 0.0
        for n in range(stages.Zv.shape[1]):
            stages.Zv[i, n] = 0.0
    if control.whole[PREDICT] == 0:
        return
    ratio = h / control.real[STAGE_STEP]
    begin = 1.0 if control.whole[PREDICT] == 1 else 0.0
    for i in range(s):
        at = begin + method.c[i] * ratio
        for j in range(s):
            weight = at / method.c[j]
            for k in range(s):
                if k != j:
                    weight *= (at - method.c[k]) / (method.c[j] - method.c[k])
            if j == s - 1:
                weight -= begin
            for n in range(stages.Zz.shape[1]):
                stages.Zz[i, n] += weight * stages.old_Zz[j, n]
            for n in range(stages.Zv.shape[1]):
                stages.Zv[i, n] += weight * stages.old_Zv[j, n]


@inner(types.void(F2, F2, F2))
def _transform(matrix, source, out):
    """out = matrix source for small matrices."""
    s, n = source.shape
    for i in range(s):
        for k in range(n):
            total = 0.0
            for j in range(s):
                total += matrix[i, j] * source[j, k]
            out[i, k] = total


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, STAGES, float64))
def _factor(kernels, system, work, memory, stages, h):
    """Factors the Newton matrices of all eigenvalues for the step h."""
    method = stages.method
    mu = method.real_eigenvalue[0] / h
    status = factor_real(kernels, system, work, memory, mu)
    for k in range(len(method.complex_eigenvalues)):
        if status != 0:
            return status
        status = kernels.factor_complex(
            system,
            work,
            memory,
            memory.complex_lapack,
            method.complex_eigenvalues[k] / h,
            memory.complex_A[k],
            memory.complex_G[k],
            memory.complex_Y[k],
            memory.complex_S[k],
            memory.complex_pivots[k],
            memory.complex_row_pivots[k],
        )
    return status


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, STAGES, float64))
def _solve_real(kernels, system, work, memory, stages, mu):
    """Solves (mu - J) x = (rz, rv) in place."""
    solve_real(
        kernels,
        system,
        work,
        memory,
        mu,
        stages.rz,
        stages.rv,
        stages.x,
        stages.p,
        stages.g,
    )


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, STAGES, float64))
def _correct(kernels, system, work, memory, stages, h):
    """One Newton correction of W, left in F (which held the transformed slopes)."""
    method = stages.method
    mu = method.real_eigenvalue[0] / h
    for i in range(len(stages.rz)):
        stages.rz[i] = stages.Fz[0, i] - mu * stages.Wz[0, i]
    for i in range(len(stages.rv)):
        stages.rv[i] = stages.Fv[0, i] - mu * stages.Wv[0, i]
    _solve_real(kernels, system, work, memory, stages, mu)
    copy(stages.rz, stages.Fz[0])
    copy(stages.rv, stages.Fv[0])
    for k in range(len(method.complex_eigenvalues)):
        nu = method.complex_eigenvalues[k] / h
        a, b = 1 + 2 * k, 2 + 2 * k
        for i in range(len(stages.crz)):
            w = complex(stages.Wz[a, i], stages.Wz[b, i])
            stages.crz[i] = complex(stages.Fz[a, i], stages.Fz[b, i]) - nu * w
        for i in range(len(stages.crv)):
            w = complex(stages.Wv[a, i], stages.Wv[b, i])
            stages.crv[i] = complex(stages.Fv[a, i], stages.Fv[b, i]) - nu * w
        kernels.solve_complex(
            system,
            work,
            memory,
            memory.complex_lapack,
            nu,
            memory.complex_A[k],
            memory.complex_G[k],
            memory.complex_Y[k],
            memory.complex_S[k],
            memory.complex_pivots[k],
            memory.complex_row_pivots[k],
            stages.crz,
            stages.crv,
            stages.cx,
            stages.cp,
            stages.cg,
        )
        for i in range(len(stages.crz)):
            stages.Fz[a, i] = stages.crz[i].real
            stages.Fz[b, i] = stages.crz[i].imag
        for i in range(len(stages.crv)):
            stages.Fv[a, i] = stages.crv[i].real
            stages.Fv[b, i] = stages.crv[i].imag


@inner(boolean(CONTROL))
def _is_beside(control):
    """Whether a singular position is near and a step before is known."""
    return control.whole[CROSSING] == NEAR and control.real[OLD_STEP] > 0.0


@inner(float64(METHOD, float64, float64))
def _bend(method, ratio, at):
    """q(at): q(0) = 0, q'(1) = 1, q' = 0 at the stages of a step before.

    It ended where this one, `ratio` times as long, begins.
    """
    total = 0.0
    for j in range(len(method.c)):
        slope = method.weights[j] * at
        for c in method.c:
            start = (c - 1.0) / ratio
            slope *= (at * method.c[j] - start) / (1.0 - start)
        total += slope
    return total


@inner(types.void(CONTROL, STAGES, float64))
def _continue(control, stages, h):
    """Z as the polynomial of the last accepted step goes on."""
    for i in range(len(stages.Zz)):
        copy(stages.last_Zz[i], stages.Zz[i])
        copy(stages.last_Zv[i], stages.Zv[i])
    control.whole[PREDICT] = 1
    control.real[STAGE_STEP] = control.real[OLD_STEP]
    _predict(control, stages, h)


@inner(types.void(KERNELS, SYSTEM, CONTROL, STAGES, float64))
def _foretell(kernels, system, control, stages, h):
    """The end of the step as the last one goes on, or as slopes are where there is none."""
    if control.real[OLD_STEP] > 0.0:
        _continue(control, stages, h)
        _take_end(control, stages)
        return
    for i in range(len(stages.z1)):
        stages.z1[i] = control.z[i] + h * stages.rate0[i]
    for i in range(len(stages.v1)):
        stages.v1[i] = control.v[i] + h * stages.acc0[i]


@inner(types.void(CONTROL, STAGES))
def _take_end(control, stages):
    """The last stage, into z1 and v1."""
    s = len(stages.method.c)
    for i in range(len(stages.z1)):
        stages.z1[i] = control.z[i] + stages.Zz[s - 1, i]
    for i in range(len(stages.v1)):
        stages.v1[i] = control.v[i] + stages.Zv[s - 1, i]


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _pass(kernels, system, work, memory, control, stages, h):
    """A step past a singular position; iterations used, or 0 without convergence.

    Newton's iteration for stages on both sides of it diverges. Here slopes are those of
    the stages of the last step and the one at the end of this step, an Adams formula of
    order s + 1: the polynomial E of the last step goes on as E + d q, see `_bend`.
    """
    method, real = stages.method, control.real
    s = len(method.c)
    ratio = h / real[OLD_STEP]
    _continue(control, stages, h)
    bend = _bend(method, ratio, 1.0)
    mu = 1.0 / (bend * h)
    status = factor_real(kernels, system, work, memory, mu)
    z1, v1, dz, dv = stages.z1, stages.v1, stages.Wz[0], stages.Wv[0]
    old_norm, verdict, iteration = 0.0, 0, 0
    _take_end(control, stages)
    for k in range(len(z1)):
        dz[k] = 0.0
    for k in range(len(v1)):
        dv[k] = 0.0
    while status == 0 and verdict == 0 and iteration < newton_limit(control):
        at = real[TIME] + h
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
        _solve_real(kernels, system, work, memory, stages, mu)
        memory.counters[ITERATIONS] += 1
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
    mu = method.real_eigenvalue[0] / h
    return iteration if factor_real(kernels, system, work, memory, mu) == 0 else 0


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _sweep(kernels, system, work, memory, control, stages, h):
    """The next correction of W, in F; its norm, infinite where there is no slope."""
    method = stages.method
    s = len(method.c)
    for i in range(s):
        for k in range(len(stages.z1)):
            stages.z1[k] = control.z[k] + stages.Zz[i, k]
        for k in range(len(stages.v1)):
            stages.v1[k] = control.v[k] + stages.Zv[i, k]
        at = control.real[TIME] + method.c[i] * h
        if accelerate(kernels, system, work, memory, at, stages.z1, stages.v1) != 0:
            return math.inf
        kernels.rate(system, stages.z1, stages.v1, stages.old_Zz[i])
        copy(memory.acceleration, stages.old_Zv[i])
    _transform(method.TI, stages.old_Zz, stages.Fz)
    _transform(method.TI, stages.old_Zv, stages.Fv)
    _correct(kernels, system, work, memory, stages, h)
    memory.counters[ITERATIONS] += 1
    norm = 0.0
    for i in range(s):
        size = scaled_norm(stages.Fz[i], stages.Fv[i], control.scale_z, control.scale_v)
        norm += size * size / s
    return math.sqrt(norm)


@inner(types.void(STAGES))
def _take_correction(stages):
    """Adds F to W."""
    for i in range(len(stages.Wz)):
        for k in range(len(stages.z1)):
            stages.Wz[i, k] += stages.Fz[i, k]
        for k in range(len(stages.v1)):
            stages.Wv[i, k] += stages.Fv[i, k]
    _transform(stages.method.T, stages.Wz, stages.Zz)
    _transform(stages.method.T, stages.Wv, stages.Zv)


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _newton(kernels, system, work, memory, control, stages, h):
    """Solves the collocation equations; iterations used, or 0 without convergence."""
    method = stages.method
    control.real[CONTRACTION] = 1.0
    if _is_beside(control):
        return _pass(kernels, system, work, memory, control, stages, h)
    _predict(control, stages, h)
    _transform(method.TI, stages.Zz, stages.Wz)
    _transform(method.TI, stages.Zv, stages.Wv)
    old_norm = 0.0
    for iteration in range(newton_limit(control)):
        norm = _sweep(kernels, system, work, memory, control, stages, h)
        verdict = judge(control, newton_goal(control), iteration, norm, old_norm)
        if verdict < 0:
            return 0
        _take_correction(stages)
        if verdict == 1:
            return iteration + 1
        old_norm = norm
    return 0


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _keep_free_part(kernels, system, work, memory, control, stages, h):
    """Takes from the error what projection takes from the end of the step."""
    t, z, v = control.real[TIME] + h, stages.z1, stages.v1
    _take_end(control, stages)
    error, dz, dv = stages.rv, stages.x, stages.p
    keep_free_part(kernels, system, work, memory, t, z, v, error, dz, dv)


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _error(kernels, system, work, memory, control, stages, h):
    """Norm of the error estimate, made anew where it first seems too large."""
    method = stages.method
    cautious = control.whole[FAILURES] > 0 or control.real[OLD_STEP] == 0.0
    s = len(method.c)
    mu = method.real_eigenvalue[0] / h
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
        _solve_real(kernels, system, work, memory, stages, mu)
        if control.whole[CROSSING] != FAR:
            _keep_free_part(kernels, system, work, memory, control, stages, h)
        error = scaled_norm(stages.rz, stages.rv, control.scale_z, control.scale_v)
        if error < 1.0 or not cautious or attempt == 1:
            return error
        for k in range(len(stages.rz)):
            stages.z1[k] = control.z[k] + stages.rz[k]
        for k in range(len(stages.rv)):
            stages.v1[k] = control.v[k] + stages.rv[k]
        t = control.real[TIME]
        if accelerate(kernels, system, work, memory, t, stages.z1, stages.v1) != 0:
            return error
    return error


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
def _refine(kernels, system, work, memory, control, stages, h):
    """A correction of the collocation equations after `_pass`; 0 if it is not too large.

    A stage very close to the singular position may spoil it: then what it changes of
    the free motion, at the end of the step, tells whether the step is good without it.
    """
    method, s = stages.method, len(stages.method.c)
    _transform(method.TI, stages.Zz, stages.Wz)
    _transform(method.TI, stages.Zv, stages.Wv)
    if not math.isfinite(_sweep(kernels, system, work, memory, control, stages, h)):
        return 1
    dz, dv, size = stages.old_Zz, stages.old_Zv, 0.0
    _transform(method.T, stages.Fz, dz)
    _transform(method.T, stages.Fv, dv)
    for i in range(s):
        size = max(size, scaled_norm(dz[i], dv[i], control.scale_z, control.scale_v))
    if size < LARGEST_CORRECTION:
        _take_correction(stages)
        return 0
    for k in range(len(stages.rz)):
        stages.rz[k] = 0.0
    copy(dv[s - 1], stages.rv)
    _keep_free_part(kernels, system, work, memory, control, stages, h)
    error = scaled_norm(stages.rz, stages.rv, control.scale_z, control.scale_v)
    return 0 if error < LEFT_ALONE else 1


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def _accept(kernels, system, work, memory, control, stages, h):
    """Moves to the end of the step, projected onto the constraints; 0 on success.

    A step near a singular position still lacks a correction of the collocation
    equations, which takes away most of its error.
    """
    s = len(stages.method.c)
    if _is_beside(control):
        if _refine(kernels, system, work, memory, control, stages, h) != 0:
            return 1
    _take_end(control, stages)
    z1, v1, dz, dv = stages.z1, stages.v1, stages.x, stages.p
    status = close_step(kernels, system, work, memory, control, h, z1, v1, dz, dv)
    if status != 0:
        return status
    for i in range(s):
        copy(stages.Zz[i], stages.last_Zz[i])
        copy(stages.Zv[i], stages.last_Zv[i])
    _write_outputs(control, stages, h)
    move(control, h, stages.z1, stages.v1)
    return 0


@inner(types.void(KERNELS, SYSTEM, MEMORY, CONTROL, STAGES))
def _begin_step(kernels, system, memory, control, stages):
    """Slopes at the beginning of the step."""
    kernels.rate(system, control.z, control.v, stages.rate0)
    copy(memory.acceleration, stages.acc0)


@inner(int64(STAGES))
def _order(stages):
    return len(stages.method.c)


advance = step_loop(
    "radau",
    STAGES,
    _begin_step,
    _factor,
    _newton,
    _error,
    _accept,
    _order,
    _foretell,
    JACOBIAN_SERVES,
    reach=REACH,
)
