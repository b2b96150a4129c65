"""Inertia of planar bodies with geometric stiffening: theory, section 12.

To what `planar` makes of mass, mdCM and Ct come the part of the centre of mass,
|w x md + Ct^T q'|^2 / 2 m, the rotation in mean axes, H u^2 / 2, and the elastic mass
that no rigid motion has.
"""

from __future__ import annotations

from numba import boolean, float64, int64, types

from .compiling import inner
from .layout import BLOCK, DATA, F1, NP, NQ, NV, POS, RD, SYSTEM, VEL, WORK
from .planar_centre import (
    BEND_X,
    BEND_Y,
    BENT_X,
    BENT_Y,
    BOW,
    BOW_RATE,
    COLUMN,
    CTX,
    CTY,
    FOLLOW,
    GROWTH,
    GROWTH_RATE,
    H_RATE,
    HEAD,
    HX,
    HY,
    LAG,
    MX,
    MY,
    N_ROW,
    P_RATE,
    PULL_X,
    PULL_Y,
    ROW,
    ROW_RATE,
    TILT,
    TILT_RATE,
    TRAIL_X,
    TRAIL_Y,
    TURN,
    TURN_RATE,
    U_RATE,
    X0,
    X1,
    X1_RATE,
    Y0,
    Y1,
    Y1_RATE,
    H,
    U,
    add_centre,
    centre,
    linearise_centre,
)
from .planar_columns import (
    AL,
    N_VECTORS,
    P_H,
    P_MASS,
    P_VECTORS,
    S_COUPLING,
    S_CT1X,
    S_CT1Y,
    S_FREE_MASS,
    S_FREE_TURN,
    S_H2,
    V_H1,
    V_TILT,
    W,
)
from .stiffened import begin_mass, spoil_mass


@inner(types.UniTuple(int64, 2)(boolean))
def _tables(whole):
    """Where coupling and second derivative of H stand, or those of free shapes."""
    if whole:
        return S_COUPLING, S_H2
    return S_FREE_TURN, S_FREE_MASS


@inner(types.UniTuple(float64, 2)(SYSTEM, WORK, int64))
def _lengthen(system, work, b):
    """Terms of third and fourth order of H, that leave none in J, and their rate."""
    row, s = system.body[b], work.stiffened
    inverse = 1.0 / system.pool[row[DATA] + P_MASS]
    mx, my, x, y, hx, hy = s[MX], s[MY], s[X1], s[Y1], s[HX], s[HY]
    for k in range(row[NQ]):
        at = HEAD + k * N_ROW
        cx, cy, ex, ey = s[at + CTX], s[at + CTY], s[at + X0], s[at + Y0]
        s[at + GROWTH] -= 2.0 * (mx * cx + my * cy - x * ex - y * ey) * inverse
        rate = cx * hx + cy * hy - ex * s[X1_RATE] - ey * s[Y1_RATE]
        rate += mx * s[at + BEND_X] + my * s[at + BEND_Y]
        s[at + GROWTH_RATE] -= 2.0 * rate * inverse
    rate = mx * hx + my * hy - x * s[X1_RATE] - y * s[Y1_RATE]
    return -(mx * mx + my * my - x * x - y * y) * inverse, -2.0 * rate * inverse


@inner(types.void(SYSTEM, WORK, int64, F1, float64, float64, float64))
def _complete(system, work, b, acc, bend, bend_rate, lean_rate):
    """Adds to the coupling the terms of second order in q that leave none in Cr.

    bend, bend_rate : terms of H of second order and their rate
    lean_rate : sum of tilt times accelerations
    """
    row, s = system.body[b], work.stiffened
    nq, qd = row[NQ], row[VEL] + row[RD]
    inverse, ax, ay = 1.0 / system.pool[row[DATA] + P_MASS], 0.0, 0.0
    mx, my, x, y, hx, hy = s[MX], s[MY], s[X1], s[Y1], s[HX], s[HY]
    xr, yr, tilt_rate = s[X1_RATE], s[Y1_RATE], s[TILT_RATE]
    bx, by = s[PULL_X] + s[BENT_X], s[PULL_Y] + s[BENT_Y]
    for k in range(nq):
        ax += s[HEAD + k * N_ROW + X0] * acc[qd + k]
        ay += s[HEAD + k * N_ROW + Y0] * acc[qd + k]
    for k in range(nq):
        at = HEAD + k * N_ROW
        cx, cy, ex, ey = s[at + CTX], s[at + CTY], s[at + X0], s[at + Y0]
        bent = mx * s[at + BEND_Y] - my * s[at + BEND_X]
        turned = cx * hy - cy * hx - ex * yr + ey * xr
        follow = cx * by - cy * bx - ex * ay + ey * ax
        follow += mx * s[at + TRAIL_Y] - my * s[at + TRAIL_X]
        line = (mx * cy - my * cx - x * ey + y * ex) * inverse
        s[at + ROW] -= line + bend * s[at + TILT]
        s[at + ROW_RATE] -= (bent - turned) * inverse + bend_rate * s[at + TILT]
        s[at + COLUMN] -= (bent + turned) * inverse + s[at + BOW] * tilt_rate
        follow = follow * inverse + s[at + BOW] * lean_rate
        s[at + FOLLOW] -= follow + s[at + BOW_RATE] * tilt_rate


@inner(types.UniTuple(float64, 4)(F1, int64, int64, float64, float64, float64, float64))
def _completed(s, at, to, kx, ky, bow, inverse):
    """What `_lengthen` and `_complete` add, in row k at `to`, to derivatives by
    coordinate l at `at`.

    kx, ky, bow : derivative of Ct_k, second derivative of H

    To that of the row, to that less the one with k and l exchanged, to that of
    ROW_RATE - COLUMN, and to the second derivative of H.
    """
    cx, cy, ex, ey = s[to + CTX], s[to + CTY], s[to + X0], s[to + Y0]
    lx, ly, fx, fy = s[at + CTX], s[at + CTY], s[at + X0], s[at + Y0]
    longer = lx * cx + ly * cy - fx * ex - fy * ey + s[MX] * kx + s[MY] * ky
    longer *= -2.0 * inverse
    skewed = lx * cy - ly * cx - fx * ey + fy * ex
    own = skewed + s[MX] * ky - s[MY] * kx
    bent = s[at + BEND_X] * cy - s[at + BEND_Y] * cx + s[HX] * ky - s[HY] * kx
    lean, tilt = s[at + BOW] * s[to + TILT], s[at + TILT]
    turned = s[at + BOW_RATE] * s[to + TILT] - bow * s[TILT_RATE]
    return (
        -own * inverse - lean,
        -2.0 * skewed * inverse - lean + s[to + BOW] * tilt,
        -2.0 * bent * inverse - turned,
        longer,
    )


@inner(boolean(SYSTEM, WORK, int64, F1, F1, F1, float64, boolean))
def _rotate(system, work, b, z, v, acc, weight, whole):
    """The rotation of a body, or of its free shapes; false if H is not positive."""
    row, pool, s, frame = system.body[b], system.pool, work.stiffened, work.frame[b]
    nq, o, first = row[NQ], row[DATA], row[VEL]
    q, qd = row[POS] + row[NP] - nq, first + row[RD]
    vec, sq, n2 = o + P_VECTORS, o + P_VECTORS + N_VECTORS * nq, nq * nq
    coupling, bow = _tables(whole)
    coupling, bow, scale = sq + coupling * n2, sq + bow * n2, 1.0 if whole else 2.0
    h, h_rate, kick, kick_rate = pool[o + P_H], 0.0, 0.0, 0.0
    bend, bend_rate, lean, lean_rate, turn, turn_rate = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if whole:
        turn, turn_rate = frame[W], frame[AL]
        if row[RD] == 3:
            turn_rate += weight * acc[first + 2]
    for k in range(nq):
        tilt, h1 = 0.0, 0.0
        if whole:
            tilt, h1 = pool[vec + V_TILT * nq + k], pool[vec + V_H1 * nq + k]
        grow, grow_rate, line, line_rate, column, follow = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(nq):
            c, swapped = pool[coupling + k * nq + i], pool[coupling + i * nq + k]
            g, qi, qdi = scale * pool[bow + k * nq + i], z[q + i], v[qd + i]
            grow, grow_rate = grow + g * qi, grow_rate + g * qdi
            line, line_rate = line + c * qi, line_rate + c * qdi
            column, follow = column + swapped * qdi, follow + swapped * acc[qd + i]
        at, qdk = HEAD + k * N_ROW, v[qd + k]
        h, h_rate = h + h1 * z[q + k], h_rate + h1 * qdk
        bend, bend_rate = bend + 0.5 * grow * z[q + k], bend_rate + grow * qdk
        lean, lean_rate = lean + tilt * qdk, lean_rate + tilt * acc[qd + k]
        s[at + ROW], s[at + ROW_RATE], s[at + COLUMN] = line, line_rate, column
        s[at + FOLLOW], s[at + TILT] = follow, tilt
        s[at + BOW], s[at + GROWTH] = grow, h1 + grow
        s[at + BOW_RATE], s[at + GROWTH_RATE] = grow_rate, grow_rate
    h, h_rate = h + bend, h_rate + bend_rate
    turn, turn_rate, s[TILT_RATE] = turn + lean, turn_rate + weight * lean_rate, lean
    if whole:
        longer, longer_rate = _lengthen(system, work, b)
        h, h_rate = h + longer, h_rate + longer_rate
        _complete(system, work, b, acc, bend, bend_rate, lean_rate)
    for k in range(nq):
        at, qdk = HEAD + k * N_ROW, v[qd + k]
        kick += s[at + ROW] * qdk
        kick_rate += weight * s[at + ROW] * acc[qd + k] + s[at + ROW_RATE] * qdk
    if not h > 0.0:
        return False
    s[H], s[H_RATE], s[LAG], s[TURN], s[TURN_RATE] = (
        h,
        h_rate,
        kick / h,
        turn,
        turn_rate,
    )
    s[U], s[P_RATE] = turn + kick / h, h * turn_rate + h_rate * turn + kick_rate
    s[U_RATE] = (s[P_RATE] - h_rate * s[U]) / h
    return True


@inner(types.void(SYSTEM, WORK, int64, boolean))
def _add_rotation(system, work, b, whole):
    """What `_rotate` found, to mass matrix and forces."""
    row, s, M, f = system.body[b], work.stiffened, work.M, work.f
    nq, nv, rd, block, first = row[NQ], row[NV], row[RD], row[BLOCK], row[VEL]
    sign = 1.0 if whole else -1.0
    h, u, pull = s[H], s[U], s[LAG] - 0.5 * s[U]
    turn = block + 2 * nv
    if whole and rd == 3:
        M[turn + 2] += h
        f[first + 2] -= s[P_RATE]
    for k in range(nq):
        at, line = HEAD + k * N_ROW, block + (rd + k) * nv
        force = s[at + TILT] * s[P_RATE] + s[at + ROW] * s[U_RATE]
        force += (s[at + ROW_RATE] - s[at + COLUMN] + s[at + GROWTH] * pull) * u
        f[first + rd + k] -= sign * force
        share = s[at + TILT] + s[at + ROW] / h
        if whole and rd == 3:
            M[line + 2] += h * share
            M[turn + rd + k] += h * share
        for i in range(nq):
            to = HEAD + i * N_ROW
            M[line + rd + i] += sign * share * (h * s[to + TILT] + s[to + ROW])


@inner(types.void(SYSTEM, WORK, int64, boolean))
def _linearise_rotation(system, work, b, whole):
    """What `_rotate` found, to Rp and Rv."""
    row, pool, s, P, D = system.body[b], system.pool, work.stiffened, work.Rp, work.Rv
    nq, nv, rd, block = row[NQ], row[NV], row[RD], row[BLOCK]
    sq, n2, sign = row[DATA] + P_VECTORS + N_VECTORS * nq, nq * nq, 1.0
    coupling, bow = _tables(whole)
    coupling, bow, scale = sq + coupling * n2, sq + bow * n2, 1.0
    if not whole:
        sign, scale = -1.0, 2.0
    h, h_rate, u, lag, turn = s[H], s[H_RATE], s[U], s[LAG], s[TURN]
    frame, inverse = block + 2 * nv, 1.0 / pool[row[DATA] + P_MASS]
    if whole and rd == 3:
        D[frame + 2] += h_rate
    for i in range(nq):
        at = HEAD + i * N_ROW
        grow, grow_rate, column = s[at + GROWTH], s[at + GROWTH_RATE], s[at + COLUMN]
        p = grow * turn + column
        pull = grow * s[TURN_RATE] + grow_rate * turn + s[at + FOLLOW]
        spin = (p - grow * u) / h
        gain = (pull - grow * s[U_RATE] - grow_rate * u - h_rate * spin) / h
        slip = (column - grow * lag) / h
        rate_pull = grow * turn + h_rate * s[at + TILT] + s[at + ROW_RATE] + column
        rate_spin, rate_slip = s[at + TILT] + s[at + ROW] / h, s[at + ROW] / h
        rate_gain = (rate_pull - grow * u - h_rate * rate_spin) / h
        slope = spin * (lag - u) + u * slip
        rate_slope = rate_spin * (lag - u) + u * rate_slip
        if whole and rd == 3:
            P[frame + rd + i] += pull
            D[frame + rd + i] += rate_pull
            by_turn = s[at + TILT] * h_rate + s[at + ROW_RATE] - column
            D[block + (rd + i) * nv + 2] += by_turn + grow * (lag - u)
        for k in range(nq):
            to, line = HEAD + k * N_ROW, block + (rd + k) * nv + rd + i
            e = k * nq + i
            c, swapped = pool[coupling + e], pool[coupling + i * nq + k]
            gyro, bent = s[to + ROW_RATE] - s[to + COLUMN], scale * pool[bow + e]
            gyro_by_rate, gyro_by_q = c - swapped, 0.0
            if whole:
                kx, ky = pool[sq + S_CT1X * n2 + e], pool[sq + S_CT1Y * n2 + e]
                more, skewed, gyro_by_q, longer = _completed(
                    s, at, to, kx, ky, bent, inverse
                )
                bent += longer
                c, gyro_by_rate = c + more, gyro_by_rate + skewed
            by_q = s[to + TILT] * pull + s[to + ROW] * gain + gyro * spin
            by_q += (
                gyro_by_q * u
                + c * s[U_RATE]
                + bent * u * (lag - 0.5 * u)
                + s[to + GROWTH] * slope
            )
            by_rate = s[to + TILT] * rate_pull + s[to + ROW] * rate_gain
            by_rate += gyro * rate_spin + gyro_by_rate * u + s[to + GROWTH] * rate_slope
            P[line] += sign * by_q
            D[line] += sign * by_rate


@inner(types.void(SYSTEM, WORK, int64, F1, F1))
def add_stiffened(system, work, b, z, v):
    """Completes mass matrix and forces of a stiffened body."""
    row = system.body[b]
    squares = row[DATA] + P_VECTORS + N_VECTORS * row[NQ]
    begin_mass(work, row, system.pool, squares + S_FREE_MASS * row[NQ] * row[NQ])
    centre(system, work, b, z, v, v, 0.0)
    add_centre(system, work, b, v)
    for part in range(2):
        if not _rotate(system, work, b, z, v, v, 0.0, part == 0):
            spoil_mass(work, row)
            return
        _add_rotation(system, work, b, part == 0)


@inner(types.void(SYSTEM, WORK, int64, F1, F1, F1))
def linearise_stiffened(system, work, b, z, v, acc):
    """Completes Rp and Rv of a stiffened body."""
    centre(system, work, b, z, v, acc, 1.0)
    linearise_centre(system, work, b, acc)
    for part in range(2):
        if _rotate(system, work, b, z, v, acc, 1.0, part == 0):
            _linearise_rotation(system, work, b, part == 0)
