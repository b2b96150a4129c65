"""Stages of Radau IIA: coefficients, prediction and Newton corrections.

References
----------
E. Hairer, G. Wanner: Solving Ordinary Differential Equations II, section IV.8.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from sidtool.formats.base.sid import Array

from ..compiler.kernels import inner
from ..compiler.tables import Table, TableType
from ..compiler.types import complex128, float64, int64, void
from ..linear.factor_storage import KERNELS, MEMORY
from ..spatial.system_arrays import F1, F2, SYSTEM, WORK, Complexes, Reals, Reals2
from .loop_state import CONTROL, copy
from .projection import evaluate_accelerations
from .step_size import scaled_norm

if TYPE_CHECKING:
    from ..system.system import System


class RadauTableau(Table):
    """A Radau IIA method with s stages.

    Attributes
    ----------
    c : (s,)
        Nodes.
    T, TI : (s, s)
        Transformation of the stages that makes A^-1 block diagonal: one real eigenvalue
        first, then pairs of rows for complex ones, and its inverse.
    real_eigenvalue, complex_eigenvalues
        Of A^-1, (pairs,).
    error : (s,)
        Weights of the stages in the error estimate.
    weights : (s,)
        The stages in an integral over the step.
    slope : (s,)
        The stages in the slope at the end.
    """

    c: Reals
    T: Reals2
    TI: Reals2
    real_eigenvalue: float
    complex_eigenvalues: Complexes
    error: Reals
    weights: Reals
    slope: Reals


RADAU_TABLEAU = TableType(RadauTableau)


class RadauStages(Table):
    """The method; stage increments Z, their transforms W, slopes F; scratch vectors.

    Attributes
    ----------
    last_Z
        The increments of the last accepted step.
    """

    tableau: RadauTableau
    Zz: Reals2
    Zv: Reals2
    Wz: Reals2
    Wv: Reals2
    Fz: Reals2
    Fv: Reals2
    rate0: Reals
    acc0: Reals
    z1: Reals
    v1: Reals
    rz: Reals
    rv: Reals
    crz: Complexes
    crv: Complexes
    old_Zz: Reals2
    old_Zv: Reals2
    last_Zz: Reals2
    last_Zv: Reals2


STAGES = TableType(RadauStages)


def collocation_matrix(c: Array) -> Array:
    """Coefficients a_ij of collocation with nodes c."""
    powers = np.vander(c, len(c), increasing=True)
    integrals = powers * c[:, None] / np.arange(1, len(c) + 1)
    return np.asarray(integrals @ np.linalg.inv(powers))


@cache
def radau_tableau(stages: int) -> RadauTableau:
    """Coefficients of Radau IIA, from the zeros of its node polynomial.

    Raises
    ------
    ValueError
        The number of stages is not odd; even ones have no real eigenvalue.
    """
    if stages % 2 == 0:
        raise ValueError("Radau IIA is used with an odd number of stages")
    c = _radau_nodes(stages)
    A = collocation_matrix(c)
    eigenvalues, vectors = np.linalg.eig(np.linalg.inv(A))
    real = int(np.argmin(abs(eigenvalues.imag)))
    pairs = [k for k in np.argsort(eigenvalues.imag) if eigenvalues[k].imag > 1e-9]
    columns = [vectors[:, real].real]
    for k in pairs:
        columns += [vectors[:, k].real, vectors[:, k].imag]
    T = np.column_stack(columns)
    gamma = float(eigenvalues[real].real)
    return RadauTableau(
        c=c,
        T=np.ascontiguousarray(T),
        TI=np.ascontiguousarray(np.linalg.inv(T)),
        real_eigenvalue=gamma,
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


def stages_maker(system: System, s: int) -> Callable[[], RadauStages]:
    """Function that makes the storage of runs with s stages."""
    n, m = system.n_positions, system.n_velocities
    stage_z = dict.fromkeys(("Zz", "Wz", "Fz", "old_Zz", "last_Zz"), (s, n))
    stage_v = dict.fromkeys(("Zv", "Wv", "Fv", "old_Zv", "last_Zv"), (s, m))
    z = dict.fromkeys(("rate0", "z1", "rz", "crz"), (n,))
    v = dict.fromkeys(("acc0", "v1", "rv", "crv"), (m,))
    return RadauStages.maker(tableau=radau_tableau(s), **stage_z, **stage_v, **z, **v)


@inner(void(CONTROL, STAGES, float64))
def predict_stages(control, stages, h):
    """Predict Z by the last collocation polynomial.

    It is extrapolated after an accepted step, and shortened after a rejected one.
    """
    method = stages.tableau
    s = len(method.c)
    for i in range(s):
        copy(stages.Zz[i], stages.old_Zz[i])
        copy(stages.Zv[i], stages.old_Zv[i])
        for n in range(stages.Zz.shape[1]):
            stages.Zz[i, n] = 0.0
        for n in range(stages.Zv.shape[1]):
            stages.Zv[i, n] = 0.0
    if control.stage_prediction == 0:
        return
    ratio = h / control.stage_step
    begin = 1.0 if control.stage_prediction == 1 else 0.0
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


@inner(void(F2, F2, F2))
def transform(matrix, source, out):
    """out = matrix source for small matrices."""
    s, n = source.shape
    for i in range(s):
        for k in range(n):
            total = 0.0
            for j in range(s):
                total += matrix[i, j] * source[j, k]
            out[i, k] = total


@inner(complex128(RADAU_TABLEAU, int64, float64))
def _eigenvalue(method, k, h):
    """A complex one over the step; written out, which takes less to compile."""
    nu = method.complex_eigenvalues[k]
    return complex(nu.real / h, nu.imag / h)


@inner(void(complex128, F1, F1, F1, F1))
def _subtract_complex_product(nu, w_real, w_imag, f_real, f_imag):
    """f -= nu w, in real and imaginary parts."""
    for i in range(len(f_real)):
        f_real[i] -= nu.real * w_real[i] - nu.imag * w_imag[i]
        f_imag[i] -= nu.real * w_imag[i] + nu.imag * w_real[i]


@inner(int64(KERNELS, SYSTEM, WORK, MEMORY, STAGES, float64))
def factor_newton_matrices(kernels, system, work, memory, stages, h):
    """Factors the Newton matrices of all eigenvalues for the step h."""
    method = stages.tableau
    mu = method.real_eigenvalue / h
    status = kernels.factor_real(system, work, memory, memory.real, 0, mu)
    for k in range(len(method.complex_eigenvalues)):
        if status != 0:
            return status
        nu = _eigenvalue(method, k, h)
        status = kernels.factor_complex(system, work, memory, memory.complex, k, nu)
    return status


@inner(void(KERNELS, SYSTEM, WORK, MEMORY, STAGES, float64))
def solve_stage_correction(kernels, system, work, memory, stages, h):
    """One Newton correction of W, returned in F, which held the transformed slopes."""
    method = stages.tableau
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
        _subtract_complex_product(
            nu, stages.Wz[a], stages.Wz[b], stages.Fz[a], stages.Fz[b]
        )
        _subtract_complex_product(
            nu, stages.Wv[a], stages.Wv[b], stages.Fv[a], stages.Fv[b]
        )
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


@inner(void(CONTROL, STAGES))
def set_end_state(control, stages):
    """The last stage, into z1 and v1."""
    s = len(stages.tableau.c)
    for i in range(len(stages.z1)):
        stages.z1[i] = control.z[i] + stages.Zz[s - 1, i]
    for i in range(len(stages.v1)):
        stages.v1[i] = control.v[i] + stages.Zv[s - 1, i]


@inner(float64(KERNELS, SYSTEM, WORK, MEMORY, CONTROL, STAGES, float64))
def newton_correction(kernels, system, work, memory, control, stages, h):
    """The next correction of W, in F; its norm, infinite where there is no slope."""
    method = stages.tableau
    s = len(method.c)
    for i in range(s):
        for k in range(len(stages.z1)):
            stages.z1[k] = control.z[k] + stages.Zz[i, k]
        for k in range(len(stages.v1)):
            stages.v1[k] = control.v[k] + stages.Zv[i, k]
        at = control.time + method.c[i] * h
        if (
            evaluate_accelerations(
                kernels, system, work, memory, at, stages.z1, stages.v1
            )
            != 0
        ):
            return math.inf
        kernels.rate(system, stages.z1, stages.v1, stages.old_Zz[i])
        copy(memory.acceleration, stages.old_Zv[i])
    transform(method.TI, stages.old_Zz, stages.Fz)
    transform(method.TI, stages.old_Zv, stages.Fv)
    solve_stage_correction(kernels, system, work, memory, stages, h)
    memory.newton_iterations += 1
    norm = 0.0
    for i in range(s):
        size = scaled_norm(stages.Fz[i], stages.Fv[i], control.scale_z, control.scale_v)
        norm += size * size / s
    return math.sqrt(norm)


@inner(void(STAGES))
def apply_correction(stages):
    """Adds F to W."""
    for i in range(len(stages.Wz)):
        for k in range(len(stages.z1)):
            stages.Wz[i, k] += stages.Fz[i, k]
        for k in range(len(stages.v1)):
            stages.Wv[i, k] += stages.Fv[i, k]
    transform(stages.tableau.T, stages.Wz, stages.Zz)
    transform(stages.tableau.T, stages.Wv, stages.Zv)


@inner(void(CONTROL, STAGES, float64))
def predict_from_last_polynomial(control, stages, h):
    """Predict Z by extrapolation of the polynomial of the last accepted step."""
    for i in range(len(stages.Zz)):
        copy(stages.last_Zz[i], stages.Zz[i])
        copy(stages.last_Zv[i], stages.Zv[i])
    control.stage_prediction = 1
    control.stage_step = control.old_step
    predict_stages(control, stages, h)


@inner(void(KERNELS, SYSTEM, CONTROL, STAGES, float64))
def predict_step_end(kernels, system, control, stages, h):
    """Predict the end of the step from the last step; without one, from the slopes."""
    if control.old_step > 0.0:
        predict_from_last_polynomial(control, stages, h)
        set_end_state(control, stages)
        return
    for i in range(len(stages.z1)):
        stages.z1[i] = control.z[i] + h * stages.rate0[i]
    for i in range(len(stages.v1)):
        stages.v1[i] = control.v[i] + h * stages.acc0[i]
