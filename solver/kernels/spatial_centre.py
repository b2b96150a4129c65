"""The centre of mass of spatial bodies with geometric stiffening: theory, section 12.

Here are the columns of `Work.stiffened`, too."""

from __future__ import annotations

from numba import float64, int64, types

from .compiling import inner
from .layout import BLOCK, DATA, F1, NP, NQ, NV, POS, RD, SYSTEM, VEL, WORK
from .spatial_columns import (
    ALPHA,
    N_VECTORS,
    OMEGA,
    P_MASS,
    P_MD,
    P_VECTORS,
    S_CT1,
    V_CT,
)
from .vectors import (
    VECTOR,
    add_column,
    add_row,
    column,
    cross,
    dot,
    load,
    plus,
    store,
    times,
    unit,
)

#: Work.stiffened: mdCM; Ct^T q'; acceleration of the centre of mass relative to the
#: frame; tilt of the mean axes and its rate; their angular velocity and its rate;
#: momentum p = H u and its rate; u and its rate; H^-1 coupling q'.
MD, FLOW, SWAY, THETA, THETA_RATE, TURN, TURN_RATE = range(0, 21, 3)
MOMENTUM, MOMENTUM_RATE, U, U_RATE, LAG = range(21, 36, 3)
#: What q adds to mdCM, the part of first order, and its rate; Ct^T q''; sum over rates
#: of BEND; sum of tilt times accelerations.
MU, M1, M1_RATE, PULL, BENT, LEAN_RATE = range(36, 54, 3)
#: H, its rate and its inverse, and its terms of second order and their rate.
H, H_RATE, H_INVERSE, H_BOW, H_BOW_RATE, HEAD = range(54, 90, 6)
#: Then for each elastic coordinate: Ct, sums of its derivatives times rates and times
#: accelerations; row of the coupling and its rate, sums of its column times rates and
#: times accelerations; tilt, and what it does to the turn of the frame; dH u, dH lag;
#: derivative of H and its rate.
CT, BEND, TRAIL, ROW, ROW_RATE, COLUMN, FOLLOW, TILT, LEAN, HEAVE, DRAG = range(
    0, 33, 3
)
GROWTH, GROWTH_RATE = 33, 39
#: Ct at q = 0; share of terms of second order of H in its derivative, and its rate.
CT0, BOW, BOW_RATE, N_ROW = 45, 48, 54, 60


@inner(types.UniTuple(VECTOR, 2)(SYSTEM, WORK, int64, F1, float64))
def spin_of(system, work, b, acc, weight):
    """Angular velocity and acceleration of a body frame."""
    row, frame = system.body[b], work.frame[b]
    al = load(frame, ALPHA)
    if row[RD] == 6:
        al = plus(al, times(weight, load(acc, row[VEL] + 3)))
    return load(frame, OMEGA), al


@inner(types.void(SYSTEM, WORK, int64, F1, F1, F1, float64))
def centre(system, work, b, z, v, acc, weight):
    """mdCM, Ct and the acceleration of the centre of mass relative to the frame.

    acc : accelerations, of which `weight` counts: 0, or 1
    """
    row, pool, s = system.body[b], system.pool, work.stiffened
    nq, o = row[NQ], row[DATA]
    q, qd = row[POS] + row[NP] - nq, row[VEL] + row[RD]
    vec, sq, n2 = o + P_VECTORS, o + P_VECTORS + N_VECTORS * nq, nq * nq
    w, al = spin_of(system, work, b, acc, weight)
    none = (0.0, 0.0, 0.0)
    mu, m1, m1_rate, flow, bent, pull = none, none, none, none, none, none
    for k in range(nq):
        ct = column(pool, vec + V_CT * nq, nq, k)
        shift, bend, trail = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for i in range(nq):
            c = column(pool, sq + S_CT1 * n2, n2, k * nq + i)
            shift, bend = (
                plus(shift, times(z[q + i], c)),
                plus(bend, times(v[qd + i], c)),
            )
            trail = plus(trail, times(acc[qd + i], c))
        at, qdk = HEAD + k * N_ROW, v[qd + k]
        store(s, at + CT0, ct)
        m1, m1_rate = plus(m1, times(z[q + k], ct)), plus(m1_rate, times(qdk, ct))
        mu = plus(mu, times(z[q + k], plus(ct, times(0.5, shift))))
        ct = plus(ct, shift)
        flow, bent = plus(flow, times(qdk, ct)), plus(bent, times(qdk, bend))
        pull = plus(pull, times(acc[qd + k], ct))
        store(s, at + CT, ct)
        store(s, at + BEND, bend)
        store(s, at + TRAIL, trail)
    md = plus(load(pool, o + P_MD), mu)
    sway = plus(plus(bent, times(weight, pull)), times(2.0, cross(w, flow)))
    sway = plus(sway, plus(cross(al, md), cross(w, cross(w, md))))
    store(s, MU, mu)
    store(s, M1, m1)
    store(s, M1_RATE, m1_rate)
    store(s, PULL, pull)
    store(s, BENT, bent)
    store(s, MD, md)
    store(s, FLOW, flow)
    store(s, SWAY, times(1.0 / pool[o + P_MASS], sway))


@inner(types.void(SYSTEM, WORK, int64, F1))
def add_centre(system, work, b, v):
    """What `centre` found, to mass matrix and forces."""
    row, s, M, f = system.body[b], work.stiffened, work.M, work.f
    nq, nv, rd, block, first = row[NQ], row[NV], row[RD], row[BLOCK], row[VEL]
    inverse = 1.0 / system.pool[row[DATA] + P_MASS]
    md, sway, turn = load(s, MD), load(s, SWAY), block + 3 * nv
    if rd == 6:
        for a in range(3):
            for c in range(3):
                M[turn + a * nv + 3 + c] -= md[a] * md[c] * inverse
            M[turn + a * nv + 3 + a] += dot(md, md) * inverse
        add_row(f, first + 3, times(-1.0, cross(md, sway)))
    for k in range(nq):
        at, line = HEAD + k * N_ROW, block + (rd + k) * nv
        ct = load(s, at + CT)
        f[first + rd + k] -= dot(ct, sway)
        if rd >= 3:
            add_row(f, first, times(-v[first + rd + k], load(s, at + BEND)))
        if rd == 6:
            turned = times(inverse, cross(md, ct))
            add_row(M, line + 3, turned)
            add_column(M, turn + rd + k, nv, turned)
        for i in range(nq):
            M[line + rd + i] += dot(ct, load(s, HEAD + i * N_ROW + CT)) * inverse


@inner(types.void(SYSTEM, WORK, int64, F1))
def linearise_centre(system, work, b, acc):
    """What `centre` found, to Rp and Rv."""
    row, pool, s, P, D = system.body[b], system.pool, work.stiffened, work.Rp, work.Rv
    nq, nv, rd, block, o = row[NQ], row[NV], row[RD], row[BLOCK], row[DATA]
    sq, n2, inverse = o + P_VECTORS + N_VECTORS * nq, nq * nq, 1.0 / pool[o + P_MASS]
    w, al = spin_of(system, work, b, acc, 1.0)
    md, sway, turn = load(s, MD), load(s, SWAY), block + 3 * nv
    if rd == 6:
        for a in range(3):
            e = unit(a)
            by = plus(cross(e, cross(w, md)), cross(w, cross(e, md)))
            by = times(inverse, plus(by, times(2.0, cross(e, load(s, FLOW)))))
            add_column(D, turn + 3 + a, nv, cross(md, by))
            for k in range(nq):
                ct = load(s, HEAD + k * N_ROW + CT)
                D[block + (rd + k) * nv + 3 + a] += dot(ct, by)
    for i in range(nq):
        at = HEAD + i * N_ROW
        ct, bend = load(s, at + CT), load(s, at + BEND)
        by_q = plus(cross(al, ct), cross(w, cross(w, ct)))
        by_q = plus(by_q, plus(times(2.0, cross(w, bend)), load(s, at + TRAIL)))
        by_q = times(inverse, by_q)
        by_rate = times(2.0 * inverse, plus(bend, cross(w, ct)))
        if rd >= 3:
            add_column(D, block + rd + i, nv, times(2.0, bend))
        if rd == 6:
            add_column(P, turn + rd + i, nv, plus(cross(ct, sway), cross(md, by_q)))
            add_column(D, turn + rd + i, nv, cross(md, by_rate))
        for k in range(nq):
            c = column(pool, sq + S_CT1 * n2, n2, k * nq + i)
            ct, line = load(s, HEAD + k * N_ROW + CT), block + (rd + k) * nv + rd + i
            P[line] += dot(c, sway) + dot(ct, by_q)
            D[line] += dot(ct, by_rate)
