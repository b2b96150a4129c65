"""Coefficients of Radau IIA, and what a run keeps between its steps.

Source: E. Hairer, G. Wanner, "Solving Ordinary Differential Equations II", IV.5 and
IV.8.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from sidtool.formats.sid import Array

from ...compiler.tables import Table, TableType
from ...space.layout import Complexes, Reals, Reals2

if TYPE_CHECKING:
    from ...system.scene import System


class Method(Table):
    """A Radau IIA method with s stages.

    c : (s,) nodes
    T, TI : (s, s) transformation of the stages that makes A^-1 block diagonal: one
        real eigenvalue first, then pairs of rows for complex ones, and its inverse
    real_eigenvalue, complex_eigenvalues : of A^-1, (pairs,)
    error : (s,) weights of the stages in the error estimate
    weights : (s,) of the stages in an integral over the step
    slope : (s,) of the stages in the slope at the end
    """

    c: Reals
    T: Reals2
    TI: Reals2
    real_eigenvalue: float
    complex_eigenvalues: Complexes
    error: Reals
    weights: Reals
    slope: Reals


METHOD = TableType(Method)


class Stages(Table):
    """The method; stage increments Z, their transforms W, slopes F; scratch vectors.

    last_Z : the increments of the last accepted step
    """

    method: Method
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


STAGES = TableType(Stages)


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


def stages(system: System, s: int) -> Callable[[], Stages]:
    """Makes the storage of runs with s stages."""
    n, m = system.n_positions, system.n_velocities
    stage_z = dict.fromkeys(("Zz", "Wz", "Fz", "old_Zz", "last_Zz"), (s, n))
    stage_v = dict.fromkeys(("Zv", "Wv", "Fv", "old_Zv", "last_Zv"), (s, m))
    z = dict.fromkeys(("rate0", "z1", "rz", "crz"), (n,))
    v = dict.fromkeys(("acc0", "v1", "rv", "crv"), (m,))
    return Stages.maker(method=method(s), **stage_z, **stage_v, **z, **v)
