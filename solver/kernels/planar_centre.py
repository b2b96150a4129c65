"""The centre of mass of planar bodies with geometric stiffening: theory, section 12.

Here are the columns of `Work.stiffened`, too."""

from __future__ import annotations

from numba import float64, int64, types

from .compiling import inner
from .layout import BLOCK, DATA, F1, NP, NQ, NV, POS, RD, SYSTEM, VEL, WORK
from .planar_columns import (
    AL,
    N_VECTORS,
    P_MASS,
    P_MDX,
    P_MDY,
    P_VECTORS,
    S_CT1X,
    S_CT1Y,
    V_CTX,
    V_CTY,
    W,
)

#: Work.stiffened: mdCM; Ct^T q'; acceleration of the centre of mass relative to the
#: frame; H and its rate; u, its rate and that of H u; coupling q' / H; the angular
#: velocity of the mean axes and its rate.
MDX, MDY, HX, HY, SX, SY = range(6)
H, H_RATE, U, U_RATE, P_RATE, LAG, TURN, TURN_RATE = range(6, 14)
#: What q adds to mdCM, the part of first order, and its rate; rate of the tilt;
#: Ct^T q''; sum over rates of BEND.
MX, MY, X1, Y1, X1_RATE, Y1_RATE, TILT_RATE, PULL_X, PULL_Y = range(14, 23)
BENT_X, BENT_Y, HEAD = range(23, 26)
#: Then for each elastic coordinate: Ct, sums of its derivatives times rates and times
#: accelerations; row of the coupling and its rate, sums of its column times rates and
#: times accelerations; derivative of H and its rate; tilt.
CTX, CTY, BEND_X, BEND_Y, TRAIL_X, TRAIL_Y = range(6)
ROW, ROW_RATE, COLUMN, FOLLOW, GROWTH, GROWTH_RATE, TILT = range(6, 13)
#: Ct at q = 0; share of terms of second order of H in its derivative, and its rate.
X0, Y0, BOW, BOW_RATE, N_ROW = range(13, 18)


@inner(types.void(SYSTEM, WORK, int64, F1, F1, F1, float64))
def centre(system, work, b, z, v, acc, weight):
    """mdCM, Ct and the acceleration of the centre of mass relative to the frame.

    acc : accelerations, of which `weight` counts: 0, or 1
    """
    row, pool, s, frame = system.body[b], system.pool, work.stiffened, work.frame[b]
    nq, o, rd, first = row[NQ], row[DATA], row[RD], row[VEL]
    q, qd = row[POS] + row[NP] - nq, first + rd
    vec, sq, n2 = o + P_VECTORS, o + P_VECTORS + N_VECTORS * nq, nq * nq
    w, al = frame[W], frame[AL]
    if rd == 3:
        al += weight * acc[first + 2]
    hx, hy = 0.0, 0.0
    for i in range(MX, HEAD):
        s[i] = 0.0
    for k in range(nq):
        ctx, cty = pool[vec + V_CTX * nq + k], pool[vec + V_CTY * nq + k]
        gx, gy, bx, by, tx, ty = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(nq):
            kx = pool[sq + S_CT1X * n2 + k * nq + i]
            ky = pool[sq + S_CT1Y * n2 + k * nq + i]
            gx, gy = gx + kx * z[q + i], gy + ky * z[q + i]
            bx, by = bx + kx * v[qd + i], by + ky * v[qd + i]
            tx, ty = tx + kx * acc[qd + i], ty + ky * acc[qd + i]
        at, qk, qdk, ak = HEAD + k * N_ROW, z[q + k], v[qd + k], acc[qd + k]
        s[at + X0], s[at + Y0] = ctx, cty
        s[X1], s[Y1] = s[X1] + ctx * qk, s[Y1] + cty * qk
        s[X1_RATE], s[Y1_RATE] = s[X1_RATE] + ctx * qdk, s[Y1_RATE] + cty * qdk
        s[MX] += (ctx + 0.5 * gx) * qk
        s[MY] += (cty + 0.5 * gy) * qk
        ctx, cty = ctx + gx, cty + gy
        s[at + CTX], s[at + CTY] = ctx, cty
        s[at + BEND_X], s[at + BEND_Y] = bx, by
        s[at + TRAIL_X], s[at + TRAIL_Y] = tx, ty
        s[BENT_X], s[BENT_Y] = s[BENT_X] + bx * qdk, s[BENT_Y] + by * qdk
        s[PULL_X], s[PULL_Y] = s[PULL_X] + ctx * ak, s[PULL_Y] + cty * ak
        hx, hy = hx + ctx * qdk, hy + cty * qdk
    mx, my = pool[o + P_MDX] + s[MX], pool[o + P_MDY] + s[MY]
    sx, sy = s[BENT_X] + weight * s[PULL_X], s[BENT_Y] + weight * s[PULL_Y]
    inverse = 1.0 / pool[o + P_MASS]
    s[MDX], s[MDY], s[HX], s[HY] = mx, my, hx, hy
    s[SX] = (sx - al * my - w * w * mx - 2.0 * w * hy) * inverse
    s[SY] = (sy + al * mx - w * w * my + 2.0 * w * hx) * inverse


@inner(types.void(SYSTEM, WORK, int64, F1))
def add_centre(system, work, b, v):
    """What `centre` found, to mass matrix and forces."""
    row, s, M, f = system.body[b], work.stiffened, work.M, work.f
    nq, nv, rd, block, first = row[NQ], row[NV], row[RD], row[BLOCK], row[VEL]
    inverse = 1.0 / system.pool[row[DATA] + P_MASS]
    mx, my, sx, sy = s[MDX], s[MDY], s[SX], s[SY]
    if rd == 3:
        M[block + 2 * nv + 2] += (mx * mx + my * my) * inverse
        f[first + 2] -= mx * sy - my * sx
    for k in range(nq):
        at, line = HEAD + k * N_ROW, block + (rd + k) * nv
        x, y = s[at + CTX], s[at + CTY]
        f[first + rd + k] -= x * sx + y * sy
        if rd >= 2:
            f[first] -= s[at + BEND_X] * v[first + rd + k]
            f[first + 1] -= s[at + BEND_Y] * v[first + rd + k]
        if rd == 3:
            turned = (mx * y - my * x) * inverse
            M[line + 2] += turned
            M[block + 2 * nv + rd + k] += turned
        for i in range(nq):
            to = HEAD + i * N_ROW
            M[line + rd + i] += (x * s[to + CTX] + y * s[to + CTY]) * inverse


@inner(types.void(SYSTEM, WORK, int64, F1))
def linearise_centre(system, work, b, acc):
    """What `centre` found, to Rp and Rv."""
    row, pool, s, frame = system.body[b], system.pool, work.stiffened, work.frame[b]
    nq, nv, rd, block, o = row[NQ], row[NV], row[RD], row[BLOCK], row[DATA]
    P, D, sq, n2 = work.Rp, work.Rv, o + P_VECTORS + N_VECTORS * nq, nq * nq
    w, al, inverse = frame[W], frame[AL], 1.0 / pool[o + P_MASS]
    if rd == 3:
        al += acc[row[VEL] + 2]
    mx, my, sx, sy = s[MDX], s[MDY], s[SX], s[SY]
    wx, wy = 2.0 * (-w * mx - s[HY]) * inverse, 2.0 * (-w * my + s[HX]) * inverse
    turn = block + 2 * nv
    if rd == 3:
        D[turn + 2] += mx * wy - my * wx
    for i in range(nq):
        at = HEAD + i * N_ROW
        cx, cy, bx, by = s[at + CTX], s[at + CTY], s[at + BEND_X], s[at + BEND_Y]
        gx = (s[at + TRAIL_X] - al * cy - w * w * cx - 2.0 * w * by) * inverse
        gy = (s[at + TRAIL_Y] + al * cx - w * w * cy + 2.0 * w * bx) * inverse
        hx, hy = 2.0 * (bx - w * cy) * inverse, 2.0 * (by + w * cx) * inverse
        if rd >= 2:
            D[block + rd + i] += 2.0 * bx
            D[block + nv + rd + i] += 2.0 * by
        if rd == 3:
            P[turn + rd + i] += cx * sy - cy * sx + mx * gy - my * gx
            D[turn + rd + i] += mx * hy - my * hx
            D[block + (rd + i) * nv + 2] += cx * wx + cy * wy
        for k in range(nq):
            e, to = k * nq + i, HEAD + k * N_ROW
            kx, ky = pool[sq + S_CT1X * n2 + e], pool[sq + S_CT1Y * n2 + e]
            x, y, line = s[to + CTX], s[to + CTY], block + (rd + k) * nv + rd + i
            P[line] += kx * sx + ky * sy + x * gx + y * gy
            D[line] += x * hx + y * hy
