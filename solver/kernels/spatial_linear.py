"""Derivatives of the equations of motion of spatial bodies."""

from __future__ import annotations

from numba import float64, int64, types

from .compiling import inner
from .cubic import add_cubic_stiffness
from .layout import (
    BLOCK,
    DATA,
    F1,
    FLAGS,
    HAS_CR1,
    HAS_CT1,
    HAS_KE1,
    HAS_OE1,
    HAS_QUADRATIC_J,
    NP,
    NQ,
    NV,
    POS,
    RD,
    STIFFENED,
    SYSTEM,
    VEL,
    WORK,
)
from .spatial import body_state, omega_product
from .spatial_columns import (
    ALPHA,
    N_MODAL,
    N_SQUARES,
    N_VECTORS,
    OMEGA,
    P_MASS,
    P_VECTORS,
    S_CR1,
    S_CT1,
    S_DE,
    S_KE,
    S_OE1,
    V_OE0,
    A,
    R,
    V,
)
from .spatial_stiffened_linear import linearise_stiffened
from .vectors import (
    VECTOR,
    add_column,
    add_row,
    column,
    cross,
    dot,
    inertia_times,
    load,
    minus,
    plus,
    rotate_back,
    symmetric_times,
    times,
)


@inner(types.void(F1, int64, int64, VECTOR, float64))
def add_skew(out, at, stride, x, weight):
    """Adds weight * skew(x) to the 3 x 3 block at `at`."""
    out[at + 1] -= weight * x[2]
    out[at + 2] += weight * x[1]
    out[at + stride] += weight * x[2]
    out[at + stride + 2] -= weight * x[0]
    out[at + 2 * stride] -= weight * x[1]
    out[at + 2 * stride + 1] += weight * x[0]


@inner(types.void(F1, int64, int64, VECTOR, VECTOR, float64))
def add_skew_product(out, at, stride, x, y, weight):
    """Adds weight * skew(x) skew(y) = weight * (y x^T - (x.y) I)."""
    d = dot(x, y)
    for i in range(3):
        for j in range(3):
            out[at + i * stride + j] += weight * y[i] * x[j]
        out[at + i * stride + i] -= weight * d


@inner(VECTOR(F1, int64, int64, VECTOR))
def omega_gradient(a, at, stride, w):
    """Gradient by w of `omega_product`."""
    xx, yy, zz = a[at], a[at + stride], a[at + 2 * stride]
    xy, yz, xz = a[at + 3 * stride], a[at + 4 * stride], a[at + 5 * stride]
    return (
        2.0 * xx * w[0] + xy * w[1] + xz * w[2],
        2.0 * yy * w[1] + xy * w[0] + yz * w[2],
        2.0 * zz * w[2] + yz * w[1] + xz * w[0],
    )


@inner(
    types.void(
        F1, F1, int64, int64, F1, float64, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR
    )
)
def _rigid_rotation(P, D, block, nv, s, mass, md, g, velocity, w, bent):
    """Columns of the rotation in the six rows of the frame."""
    r, c = block + 3 * nv, 3
    add_skew(P, block + c, nv, g, -mass)
    add_skew_product(P, r + c, nv, md, g, -1.0)
    add_skew(D, block + c, nv, velocity, -mass)
    add_skew(D, block + c, nv, cross(w, md), -1.0)
    add_skew_product(D, block + c, nv, w, md, -1.0)
    add_skew(D, block + c, nv, bent, -2.0)
    add_skew_product(D, r, nv, md, w, 1.0)
    add_skew_product(D, r + c, nv, md, velocity, -1.0)
    add_skew(D, r + c, nv, inertia_times(s, 3, w), -1.0)
    add_skew(D, r + c, nv, load(s, 18), -1.0)
    for j in range(3):
        e = (1.0 if j == 0 else 0.0, 1.0 if j == 1 else 0.0, 1.0 if j == 2 else 0.0)
        turned = plus(cross(w, inertia_times(s, 3, e)), inertia_times(s, 9, e))
        add_column(D, r + c + j, nv, turned)


@inner(types.void(SYSTEM, WORK, int64, F1, F1, F1, VECTOR, VECTOR))
def _elastic(system, work, b, z, v, acc, a, al):
    """Rows and columns of the elastic coordinates, and what turns them."""
    row = system.body[b]
    nq, nv, rd, flags = row[NQ], row[NV], row[RD], row[FLAGS]
    pool, P, D, w = system.pool, work.Rp, work.Rv, load(work.frame[b], OMEGA)
    block, first = row[BLOCK], row[VEL]
    q, qd = row[POS] + row[NP] - nq, first + rd
    vec = row[DATA] + P_VECTORS
    sq, n2 = vec + N_VECTORS * nq, nq * nq
    quadratic = flags & HAS_QUADRATIC_J != 0
    for k in range(nq):
        line = block + (rd + k) * nv
        turn = omega_gradient(pool, vec + V_OE0 * nq + k, nq, w)
        follow, drag, sway = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for i in range(nq):
            e, f = k * nq + i, i * nq + k
            stiffness, damping = pool[sq + S_KE * n2 + e], pool[sq + S_DE * n2 + e]
            if flags & HAS_CR1:
                c = column(pool, sq + S_CR1 * n2, n2, e)
                swapped = column(pool, sq + S_CR1 * n2, n2, f)
                ge = minus(c, swapped)
                stiffness += dot(c, al)
                damping += dot(ge, w)
                turn = plus(turn, times(v[qd + i], ge))
                follow = plus(follow, times(acc[qd + i], swapped))
                sway = plus(sway, times(v[qd + i], swapped))
            if flags & HAS_OE1:
                stiffness += omega_product(pool, sq + S_OE1 * n2 + e, n2, w)
                gradient = omega_gradient(pool, sq + S_OE1 * n2 + e, n2, w)
                turn = plus(turn, times(z[q + i], gradient))
            if quadratic:
                own = times(-2.0, column(pool, sq + S_OE1 * n2, n2, e))
                xy, yz, xz = column(pool, sq + (S_OE1 + 3) * n2, n2, e)
                grow = symmetric_times(own, (-xy, -xz, -yz), w)
                follow = plus(follow, times(v[qd + i], grow))
            if flags & HAS_CT1:
                bend = column(pool, sq + S_CT1 * n2, n2, e)
                stiffness += dot(bend, a)
                drag = plus(drag, times(acc[qd + i], bend))
                drag = plus(drag, times(2.0 * v[qd + i], cross(w, bend)))
            P[line + rd + i] += stiffness
            D[line + rd + i] += damping
        if rd >= 3:
            add_column(P, block + rd + k, nv, drag)
        if quadratic:
            follow = plus(follow, cross(w, sway))
        if rd == 6:
            add_row(D, line + 3, turn)
            add_column(P, block + 3 * nv + rd + k, nv, follow)
    if flags & HAS_KE1:
        corner = block + rd * nv + rd
        add_cubic_stiffness(pool, sq + N_SQUARES * n2, nq, z, q, P, corner, nv)


@inner(types.void(SYSTEM, WORK, int64, F1, F1, F1))
def linearise_body(system, work, b, z, v, acc):
    """Rp and Rv of one body: derivatives of M z_II' - f by positions and velocities.

    Positions vary in the body frame, see `coordinates`.
    """
    row = system.body[b]
    nq, nv, rd = row[NQ], row[NV], row[RD]
    P, D, block, first = work.Rp, work.Rv, row[BLOCK], row[VEL]
    for i in range(block, block + nv * nv):
        P[i] = 0.0
        D[i] = 0.0
    if nv == 0:
        return
    body_state(system, work, b, z, v)
    pool, frame, s, modal = system.pool, work.frame[b], work.scratch, work.modal
    mass, w = pool[row[DATA] + P_MASS], load(frame, OMEGA)
    g = (system.gravity[0], system.gravity[1], system.gravity[2])
    g = rotate_back(frame, R, g)
    a, al, velocity = minus(load(frame, A), g), load(frame, ALPHA), load(frame, V)
    if rd >= 3:
        a = plus(a, load(acc, first))
    if rd == 6:
        al = plus(al, load(acc, first + 3))
    md, bent = load(s, 0), load(s, 15)
    if rd >= 3:
        add_skew(D, block, nv, w, mass)
    if rd == 6:
        _rigid_rotation(P, D, block, nv, s, mass, md, g, velocity, w, bent)
    for k in range(nq):
        at = k * N_MODAL
        ct, turned = load(modal, at), load(modal, at + 14)
        j1w = inertia_times(modal, at + 6, w)
        if rd >= 3:
            pull = plus(cross(al, ct), cross(w, cross(w, ct)))
            add_column(P, block + rd + k, nv, pull)
            add_column(D, block + rd + k, nv, times(2.0, cross(w, ct)))
            add_row(D, block + (rd + k) * nv, cross(ct, w))
        if rd == 6:
            r = block + 3 * nv
            pull = plus(cross(ct, a), inertia_times(modal, at + 6, al))
            add_column(P, r + rd + k, nv, plus(pull, cross(w, j1w)))
            add_column(D, r + rd + k, nv, plus(j1w, cross(w, turned)))
            line = block + (rd + k) * nv + 3
            add_row(P, line, times(-1.0, cross(ct, g)))
            add_row(D, line, times(-1.0, cross(ct, velocity)))
    _elastic(system, work, b, z, v, acc, a, al)
    if row[FLAGS] & STIFFENED:
        linearise_stiffened(system, work, b, z, v, acc)
