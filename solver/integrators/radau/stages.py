"""The stages of a Radau IIA method, and Newton's corrections of them."""

from __future__ import annotations

import math

from numba import complex128, float64, int64, types

from ...compiler.compiling import inner
from ...linear.memory import KERNELS, MEMORY
from ...space.layout import F1, F2, SYSTEM, WORK
from ..projection import accelerate
from ..step_sizes import scaled_norm
from ..stepping import CONTROL, copy
from .table import METHOD, STAGES


@inner(types.void(CONTROL, STAGES, float64))
def predict(control, stages, h):
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
    if control.predict == 0:
        return
    ratio = h / control.stage_step
    begin = 1.0 if control.predict == 1 else 0.0
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
def transform(matrix, source, out):
    """out = matrix source for small matrices."""
    s, n = source.shape
    for i in range(s):
        for k in range(n):
            total = 0.0
            for j in range(s):
                total += matrix[i, j] * source[j, k]
            out[i, k] = total


@inner(complex128(METHOD, int64, float64))
def _eigenvalue(method, k, h):
    """A complex one over the step; written out, which takes less to compile."""
    nu = method.complex_eigenvalues[k]
    return complex(nu.real / h, nu.imag / h)


@inner(types.void(complex128, F1, F1, F1, F1))
def _subtract(nu, w_real, w_imag, f_real, f_imag):
    """f -= nu w, in real and imaginary parts."""
    for i in range(len(f_real)):
        f_real[i] -= nu.real * w_real[i] - nu.imag * w_imag[i]
        f_imag[i] -= nu.real * w_imag[i] + nu.imag * w_real[i]


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, STAGES, float64))
def factor(kernels, system, work, memory, stages, h):
    """Factors the Newton matrices of all eigenvalues for the step h."""
    method = stages.method
    mu = method.real_eigenvalue / h
    status = kernels.factor_real(system, work, memory, memory.real, 0, mu)
    for k in range(len(method.complex_eigenvalues)):
        if status != 0:
            return status
        nu = _eigenvalue(method, k, h)
        status = kernels.factor_complex(system, work, memory, memory.complex, k, nu)
    return status


@inner(types.void(KERNELS, SYSTEM, WORK, MEMORY, STAGES, float64))
def correct(kernels, system, work, memory, stages, h):
    """One Newton correction of W, left in F (which held the transformed slopes)."""
    method = stages.method
    mu = method.real_eigenvalue / h
    for i in range(len(stages.rz)):
        stages.rz[i] = stages.Fz[0, i] - mu * stages.Wz[0, i]
    for i in range(len(stages.rv)):
        stages.rv[i] = stages.Fv[0, i] - mu * stages.Wv[0, i]
    rz, rv = stages.rz, stages.rv
    kernels.solve_real(system, work, memory, memory.real, 0, mu, rz, rv)
    copy(stages.rz, stages.Fz[0])
    copy(stages.rv, stages.Fv[0])
    for k in range(len(method.complex_eigenvalues)):
        nu = _eigenvalue(method, k, h)
        a, b = 1 + 2 * k, 2 + 2 * k
        _subtract(nu, stages.Wz[a], stages.Wz[b], stages.Fz[a], stages.Fz[b])
        _subtract(nu, stages.Wv[a], stages.Wv[b], stages.Fv[a], stages.Fv[b])
        for i in range(len(stages.crz)):
            stages.crz[i] = complex(stages.Fz[a, i], stages.Fz[b, i])
        for i in range(len(stages.crv)):
            stages.crv[i] = complex(stages.Fv[a, i], stages.Fv[b, i])
        rz, rv = stages.crz, stages.crv
        kernels.solve_complex(system, work, memory, memory.complex, k, nu, rz, rv)
        for i in range(len(stages.crz)):
            stages.Fz[a, i] = stages.crz[i].real
            stages.Fz[b, i] = stages.crz[i].imag
        for i in range(len(stages.crv)):
            stages.Fv[a, i] = stages.crv[i].real
            stages.Fv[b, i] = stages.crv[i].imag


@inner(types.void(CONTROL, STAGES))
def take_end(control, stages):
    """The last stage, into z1 and v1."""
    s = len(stages.method.c)
    for i in range(len(stages.z1)):
        stages.z1[i] = control.z[i] + stages.Zz[s - 1, i]
    for i in range(len(stages.v1)):
        stages.v1[i] = control.v[i] + stages.Zv[s - 1, i]


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def sweep(kernels, system, work, memory, control, stages, h):
    """The next correction of W, in F; its norm, infinite where there is no slope."""
    method = stages.method
    s = len(method.c)
    for i in range(s):
        for k in range(len(stages.z1)):
            stages.z1[k] = control.z[k] + stages.Zz[i, k]
        for k in range(len(stages.v1)):
            stages.v1[k] = control.v[k] + stages.Zv[i, k]
        at = control.time + method.c[i] * h
        if accelerate(kernels, system, work, memory, at, stages.z1, stages.v1) != 0:
            return math.inf
        kernels.rate(system, stages.z1, stages.v1, stages.old_Zz[i])
        copy(memory.acceleration, stages.old_Zv[i])
    transform(method.TI, stages.old_Zz, stages.Fz)
    transform(method.TI, stages.old_Zv, stages.Fv)
    correct(kernels, system, work, memory, stages, h)
    memory.newton_iterations += 1
    norm = 0.0
    for i in range(s):
        size = scaled_norm(stages.Fz[i], stages.Fv[i], control.scale_z, control.scale_v)
        norm += size * size / s
    return math.sqrt(norm)


@inner(types.void(STAGES))
def take_correction(stages):
    """Adds F to W."""
    for i in range(len(stages.Wz)):
        for k in range(len(stages.z1)):
            stages.Wz[i, k] += stages.Fz[i, k]
        for k in range(len(stages.v1)):
            stages.Wv[i, k] += stages.Fv[i, k]
    transform(stages.method.T, stages.Wz, stages.Zz)
    transform(stages.method.T, stages.Wv, stages.Zv)


@inner(types.void(CONTROL, STAGES, float64))
def go_on(control, stages, h):
    """Z as the polynomial of the last accepted step goes on."""
    for i in range(len(stages.Zz)):
        copy(stages.last_Zz[i], stages.Zz[i])
        copy(stages.last_Zv[i], stages.Zv[i])
    control.predict = 1
    control.stage_step = control.old_step
    predict(control, stages, h)


@inner(types.void(KERNELS, SYSTEM, CONTROL, STAGES, float64))
def foretell(kernels, system, control, stages, h):
    """The end of the step as the last one goes on; without one, as slopes are."""
    if control.old_step > 0.0:
        go_on(control, stages, h)
        take_end(control, stages)
        return
    for i in range(len(stages.z1)):
        stages.z1[i] = control.z[i] + h * stages.rate0[i]
    for i in range(len(stages.v1)):
        stages.v1[i] = control.v[i] + h * stages.acc0[i]
