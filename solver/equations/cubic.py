"""The first-order term of Ke: elastic forces that are quadratic in q.

Ke(q) = m0 + sum_l m1_l q_l makes the elastic force Ke(q) q. What m1 adds to it is, in
row k, sum_il K1_kil q_i q_l, with the derivative 2 sum_l K1_kil q_l; K1 is the same
under all exchanges of its indices (`system.first_order`), so that this force
is the gradient of the energy sum_kil K1_kil q_k q_i q_l / 3.
"""

from __future__ import annotations

from numba import float64, int64, types

from ..compiler.compiling import inner
from ..space.layout import F1


@inner(types.void(F1, int64, int64, F1, int64, F1, int64))
def add_cubic_force(pool, at, nq, z, q, f, row):
    """Adds the forces on the elastic coordinates z[q:] to f[row:]; K1 is at `at`."""
    for k in range(nq):
        for i in range(nq):
            for j in range(nq):
                f[row + k] -= pool[at + (k * nq + i) * nq + j] * z[q + i] * z[q + j]


@inner(float64(F1, int64, int64, F1, int64))
def cubic_energy(pool, at, nq, z, q):
    """Their energy."""
    total = 0.0
    for k in range(nq):
        for i in range(nq):
            for j in range(nq):
                part = z[q + k] * z[q + i] * z[q + j]
                total += pool[at + (k * nq + i) * nq + j] * part
    return total / 3.0


@inner(types.void(F1, int64, int64, F1, int64, F1, int64, int64))
def add_cubic_stiffness(pool, at, nq, z, q, out, corner, stride):
    """Adds minus the derivative of the forces to the nq x nq block at `corner`."""
    for k in range(nq):
        for i in range(nq):
            for j in range(nq):
                e = at + (k * nq + i) * nq + j
                out[corner + k * stride + i] += 2.0 * pool[e] * z[q + j]
