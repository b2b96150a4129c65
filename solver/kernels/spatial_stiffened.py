"""Inertia of spatial bodies with geometric stiffening: theory, section 12.

To what `spatial` makes of mass, mdCM and Ct come the part of the centre of mass,
|w x md + Ct^T q'|^2 / 2 m, the rotation in mean axes, u.H u / 2, and the elastic mass
that no rigid motion has.
"""

from __future__ import annotations

from numba import boolean, float64, int64, types

from .compiling import inner
from .layout import BLOCK, DATA, F1, NP, NQ, NV, POS, RD, SYSTEM, VEL, WORK
from .spatial_centre import (
    BEND,
    BENT,
    BOW,
    BOW_RATE,
    COLUMN,
    CT,
    CT0,
    DRAG,
    FLOW,
    FOLLOW,
    GROWTH,
    GROWTH_RATE,
    H_BOW,
    H_BOW_RATE,
    H_INVERSE,
    H_RATE,
    HEAD,
    HEAVE,
    LAG,
    LEAN,
    LEAN_RATE,
    M1,
    M1_RATE,
    MOMENTUM,
    MOMENTUM_RATE,
    MU,
    N_ROW,
    PULL,
    ROW,
    ROW_RATE,
    THETA,
    THETA_RATE,
    TILT,
    TRAIL,
    TURN,
    TURN_RATE,
    U_RATE,
    H,
    U,
    add_centre,
    centre,
    spin_of,
)
from .spatial_columns import (
    N_VECTORS,
    OMEGA,
    P_H,
    P_MASS,
    P_VECTORS,
    S_COUPLING,
    S_FREE_MASS,
    S_FREE_TURN,
    S_H2,
    V_H1,
    V_TILT,
)
from .stiffened import NOTHING, begin_mass, spoil_mass
from .tilted import meant, meant_by, seen, seen_by
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
    mixed_product,
    own_product,
    plus,
    store,
    times,
    unit,
)


@inner(types.UniTuple(VECTOR, 2)(F1, int64, int64, int64, int64, boolean))
def couplings(pool, sq, n2, e, f, whole):
    """Coupling of the entries e = (k, l) and f = (l, k), of the body or free shapes."""
    at = sq + (S_COUPLING if whole else S_FREE_TURN) * n2
    return column(pool, at, n2, e), column(pool, at, n2, f)


@inner(types.UniTuple(VECTOR, 2)(F1, int64, int64, int64, boolean))
def bows(pool, sq, n2, e, whole):
    """Second derivative of H: xx, yy, zz and xy, xz, yz."""
    if whole:
        at = sq + S_H2 * n2
        return column(pool, at, n2, e), column(pool, at + 3 * n2, n2, e)
    m = 2.0 * pool[sq + S_FREE_MASS * n2 + e]
    return (m, m, m), (0.0, 0.0, 0.0)


@inner(boolean(F1))
def _invert(s):
    """H_INVERSE of H; without inertia about an axis there is no motion about it."""
    xx, yy, zz = load(s, H)
    xy, xz, yz = load(s, H + 3)
    least = NOTHING * max(xx, yy, zz)
    a = 1.0 / xx if xx > least else 0.0
    l1, l2 = xy * a, xz * a
    pivot = yy - l1 * xy
    b = 1.0 / pivot if pivot > least else 0.0
    l3 = (yz - l1 * xz) * b
    last = zz - l2 * xz - l3 * (yz - l1 * xz)
    c = 1.0 / last if last > least else 0.0
    if not (xx > -least and pivot > -least and last > -least):
        return False
    l4 = l1 * l3 - l2
    s[H_INVERSE] = a + l1 * l1 * b + l4 * l4 * c
    s[H_INVERSE + 1], s[H_INVERSE + 2] = b + l3 * l3 * c, c
    s[H_INVERSE + 3] = -l1 * b - l3 * l4 * c
    s[H_INVERSE + 4], s[H_INVERSE + 5] = l4 * c, -l3 * c
    return True


@inner(types.void(F1, int64, VECTOR, VECTOR, float64))
def _add_product(s, at, a, b, weight):
    add_row(s, at, own_product(a, b, weight))
    add_row(s, at + 3, mixed_product(a, b, weight))


@inner(types.void(SYSTEM, WORK, int64))
def _lengthen(system, work, b):
    """Adds to H the terms of third and fourth order in q that leave none in J."""
    row, s = system.body[b], work.stiffened
    inverse = 1.0 / system.pool[row[DATA] + P_MASS]
    mu, m1, flow, m1_rate = load(s, MU), load(s, M1), load(s, FLOW), load(s, M1_RATE)
    _add_product(s, H, mu, mu, 0.5 * inverse)
    _add_product(s, H, m1, m1, -0.5 * inverse)
    _add_product(s, H_RATE, mu, flow, inverse)
    _add_product(s, H_RATE, m1, m1_rate, -inverse)
    for k in range(row[NQ]):
        at = HEAD + k * N_ROW
        ct, ct0 = load(s, at + CT), load(s, at + CT0)
        _add_product(s, at + GROWTH, mu, ct, inverse)
        _add_product(s, at + GROWTH, m1, ct0, -inverse)
        _add_product(s, at + GROWTH_RATE, ct, flow, inverse)
        _add_product(s, at + GROWTH_RATE, mu, load(s, at + BEND), inverse)
        _add_product(s, at + GROWTH_RATE, ct0, m1_rate, -inverse)


@inner(types.void(SYSTEM, WORK, int64, F1))
def _complete(system, work, b, acc):
    """Adds to the coupling the terms of second order in q that leave none in Cr.

    None is added to what tilted axes make of Cr.
    """
    row, s = system.body[b], work.stiffened
    nq, qd = row[NQ], row[VEL] + row[RD]
    inverse, pull1 = -1.0 / system.pool[row[DATA] + P_MASS], (0.0, 0.0, 0.0)
    mu, m1, flow, m1_rate = load(s, MU), load(s, M1), load(s, FLOW), load(s, M1_RATE)
    tilt_rate, pull = load(s, THETA_RATE), plus(load(s, PULL), load(s, BENT))
    for k in range(nq):
        pull1 = plus(pull1, times(acc[qd + k], load(s, HEAD + k * N_ROW + CT0)))
    for k in range(nq):
        at = HEAD + k * N_ROW
        ct, ct0, tilt = load(s, at + CT), load(s, at + CT0), load(s, at + TILT)
        bend = cross(mu, load(s, at + BEND))
        line = minus(cross(mu, ct), cross(m1, ct0))
        rate = plus(minus(cross(flow, ct), cross(m1_rate, ct0)), bend)
        across = plus(minus(cross(ct, flow), cross(ct0, m1_rate)), bend)
        follow = minus(cross(ct, pull), cross(ct0, pull1))
        follow = plus(follow, cross(mu, load(s, at + TRAIL)))
        follow = times(inverse, follow)
        follow = minus(follow, inertia_times(s, at + BOW, load(s, LEAN_RATE)))
        follow = minus(follow, inertia_times(s, at + BOW_RATE, tilt_rate))
        line = minus(times(inverse, line), inertia_times(s, H_BOW, tilt))
        rate = minus(times(inverse, rate), inertia_times(s, H_BOW_RATE, tilt))
        across = minus(times(inverse, across), inertia_times(s, at + BOW, tilt_rate))
        add_row(s, at + ROW, line)
        add_row(s, at + ROW_RATE, rate)
        add_row(s, at + COLUMN, across)
        add_row(s, at + FOLLOW, follow)


@inner(boolean(SYSTEM, WORK, int64, F1, F1, F1, float64, boolean))
def rotate_axes(system, work, b, z, v, acc, weight, whole):
    """The rotation of a body, or of its free shapes; false if H is not positive."""
    row, pool, s, none = system.body[b], system.pool, work.stiffened, (0.0, 0.0, 0.0)
    nq, o = row[NQ], row[DATA]
    q, qd = row[POS] + row[NP] - nq, row[VEL] + row[RD]
    vec, sq, n2 = o + P_VECTORS, o + P_VECTORS + N_VECTORS * nq, nq * nq
    for i in range(6):
        s[H + i], s[H_RATE + i] = pool[o + P_H + i], 0.0
        s[H_BOW + i], s[H_BOW_RATE + i] = 0.0, 0.0
    theta, theta_rate, lean_rate = none, none, none
    for k in range(nq):
        tilt, grow, skewed = none, none, none
        if whole:
            tilt = column(pool, vec + V_TILT * nq, nq, k)
            grow = column(pool, vec + V_H1 * nq, nq, k)
            skewed = column(pool, vec + (V_H1 + 3) * nq, nq, k)
        bow, bow_mixed, bow_rate, bow_mixed_rate = none, none, none, none
        line, line_rate, across, follow = none, none, none, none
        for i in range(nq):
            e, qi, qdi = k * nq + i, z[q + i], v[qd + i]
            c, swapped = couplings(pool, sq, n2, e, i * nq + k, whole)
            g, h = bows(pool, sq, n2, e, whole)
            bow, bow_mixed = plus(bow, times(qi, g)), plus(bow_mixed, times(qi, h))
            bow_rate = plus(bow_rate, times(qdi, g))
            bow_mixed_rate = plus(bow_mixed_rate, times(qdi, h))
            line, line_rate = plus(line, times(qi, c)), plus(line_rate, times(qdi, c))
            across = plus(across, times(qdi, swapped))
            follow = plus(follow, times(acc[qd + i], swapped))
        at, qk, qdk = HEAD + k * N_ROW, z[q + k], v[qd + k]
        theta = plus(theta, times(qk, tilt))
        theta_rate = plus(theta_rate, times(qdk, tilt))
        lean_rate = plus(lean_rate, times(acc[qd + k], tilt))
        store(s, at + ROW, line)
        store(s, at + ROW_RATE, line_rate)
        store(s, at + COLUMN, across)
        store(s, at + FOLLOW, follow)
        store(s, at + TILT, tilt)
        store(s, at + BOW, bow)
        store(s, at + BOW + 3, bow_mixed)
        store(s, at + GROWTH, grow)
        store(s, at + GROWTH + 3, skewed)
        store(s, at + GROWTH_RATE, bow_rate)
        store(s, at + GROWTH_RATE + 3, bow_mixed_rate)
        for i in range(6):
            s[H + i] += s[at + GROWTH + i] * qk
            s[H_RATE + i] += s[at + GROWTH + i] * qdk
            s[H_BOW + i] += 0.5 * s[at + BOW + i] * qk
            s[H_BOW_RATE + i] += s[at + BOW + i] * qdk
            s[at + BOW_RATE + i] = s[at + GROWTH_RATE + i]
            s[at + GROWTH + i] += s[at + BOW + i]
    for i in range(6):
        s[H + i] += s[H_BOW + i]
        s[H_RATE + i] += s[H_BOW_RATE + i]
    if whole:
        _lengthen(system, work, b)
    if not _invert(s):
        return False
    turn, turn_rate, w, kick, kick_rate = none, none, none, none, none
    store(s, THETA, theta)
    store(s, THETA_RATE, theta_rate)
    store(s, LEAN_RATE, lean_rate)
    if whole:
        _complete(system, work, b, acc)
        w, al = spin_of(system, work, b, acc, weight)
        turn = plus(seen(theta, w), theta_rate)
        turn_rate = plus(seen(theta, al), seen_by(theta, theta_rate, w))
        turn_rate = plus(turn_rate, times(weight, lean_rate))
    for k in range(nq):
        at, qdk, ak = HEAD + k * N_ROW, v[qd + k], weight * acc[qd + k]
        kick = plus(kick, times(qdk, load(s, at + ROW)))
        kick_rate = plus(kick_rate, times(ak, load(s, at + ROW)))
        kick_rate = plus(kick_rate, times(qdk, load(s, at + ROW_RATE)))
    lag = inertia_times(s, H_INVERSE, kick)
    u = plus(turn, lag)
    momentum_rate = plus(inertia_times(s, H, turn_rate), inertia_times(s, H_RATE, turn))
    momentum_rate = plus(momentum_rate, kick_rate)
    u_rate = minus(momentum_rate, inertia_times(s, H_RATE, u))
    store(s, TURN, turn)
    store(s, TURN_RATE, turn_rate)
    store(s, MOMENTUM, plus(inertia_times(s, H, turn), kick))
    store(s, MOMENTUM_RATE, momentum_rate)
    store(s, U, u)
    store(s, U_RATE, inertia_times(s, H_INVERSE, u_rate))
    store(s, LAG, lag)
    for k in range(nq):
        at = HEAD + k * N_ROW
        store(s, at + LEAN, seen_by(theta, load(s, at + TILT), w))
        store(s, at + HEAVE, inertia_times(s, at + GROWTH, u))
        store(s, at + DRAG, inertia_times(s, at + GROWTH, lag))
    return True


@inner(VECTOR(SYSTEM, WORK, int64, VECTOR, VECTOR))
def torque_of(system, work, b, p, pull):
    """What changes p and pull of momentum and its rate make of the frame's torque."""
    s = work.stiffened
    theta, w = load(s, THETA), load(work.frame[b], OMEGA)
    torque = plus(meant(theta, pull), meant_by(theta, load(s, THETA_RATE), p))
    return plus(torque, cross(w, meant(theta, p)))


@inner(types.void(SYSTEM, WORK, int64, boolean))
def _add_rotation(system, work, b, whole):
    """What `rotate_axes` found, to mass matrix and forces."""
    row, s, M, f = system.body[b], work.stiffened, work.M, work.f
    nq, nv, rd, block, first = row[NQ], row[NV], row[RD], row[BLOCK], row[VEL]
    sign = 1.0 if whole else -1.0
    theta, u, u_rate, frame = (
        load(s, THETA),
        load(s, U),
        load(s, U_RATE),
        block + 3 * nv,
    )
    p, pull = load(s, MOMENTUM), load(s, MOMENTUM_RATE)
    if whole and rd == 6:
        torque = torque_of(system, work, b, p, pull)
        add_row(f, first + 3, times(-1.0, torque))
        for a in range(3):
            e = unit(a)
            turned = meant(theta, inertia_times(s, H, seen(theta, e)))
            add_column(M, frame + 3 + a, nv, turned)
    for k in range(nq):
        at, line = HEAD + k * N_ROW, block + (rd + k) * nv
        tilt, coupled = load(s, at + TILT), load(s, at + ROW)
        gyro = minus(load(s, at + ROW_RATE), load(s, at + COLUMN))
        heave = minus(load(s, at + DRAG), times(0.5, load(s, at + HEAVE)))
        force = dot(tilt, pull) + dot(coupled, u_rate) + dot(gyro, u)
        force += dot(heave, u) - dot(p, load(s, at + LEAN))
        f[first + rd + k] -= sign * force
        share = plus(inertia_times(s, H, tilt), coupled)
        if whole and rd == 6:
            turned = meant(theta, share)
            add_row(M, line + 3, turned)
            add_column(M, frame + rd + k, nv, turned)
        spun = plus(tilt, inertia_times(s, H_INVERSE, coupled))
        for i in range(nq):
            to = HEAD + i * N_ROW
            share = plus(inertia_times(s, H, load(s, to + TILT)), load(s, to + ROW))
            M[line + rd + i] += sign * dot(spun, share)


@inner(types.void(SYSTEM, WORK, int64, F1, F1))
def add_stiffened(system, work, b, z, v):
    """Completes mass matrix and forces of a stiffened body."""
    row = system.body[b]
    squares = row[DATA] + P_VECTORS + N_VECTORS * row[NQ]
    begin_mass(work, row, system.pool, squares + S_FREE_MASS * row[NQ] * row[NQ])
    centre(system, work, b, z, v, v, 0.0)
    add_centre(system, work, b, v)
    for part in range(2):
        if not rotate_axes(system, work, b, z, v, v, 0.0, part == 0):
            spoil_mass(work, row)
            return
        _add_rotation(system, work, b, part == 0)
