"""Derivatives of the equations of motion of planar bodies."""

from __future__ import annotations

from numba import int64, types

from .compiling import inner
from .cubic import add_cubic_stiffness
from .layout import (
    BLOCK,
    DATA,
    F1,
    FLAGS,
    HAS_CR1,
    HAS_CT1,
    HAS_GE,
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
from .planar_columns import (
    AL,
    AX,
    AY,
    COS,
    N_SQUARES,
    N_VECTORS,
    P_MASS,
    P_MDX,
    P_MDY,
    P_VECTORS,
    S_CR1,
    S_CT1X,
    S_CT1Y,
    S_DE,
    S_GE,
    S_J2,
    S_KE,
    S_OE1,
    SIN,
    V_CTX,
    V_CTY,
    V_J1,
    V_OE0,
    VX,
    VY,
    W,
)
from .planar_stiffened import linearise_stiffened


@inner(types.void(SYSTEM, WORK, int64, F1, F1, F1))
def linearise_body(system, work, b, z, v, acc):
    """Rp and Rv of one body: derivatives of M z_II' - f by positions and velocities.

    Positions vary in the body frame: z_I + (R dx, dphi, dq).
    """
    row = system.body[b]
    nq, nv, rd, flags = row[NQ], row[NV], row[RD], row[FLAGS]
    pool, frame, P, D = system.pool, work.frame[b], work.Rp, work.Rv
    o, block, first = row[DATA], row[BLOCK], row[VEL]
    for i in range(block, block + nv * nv):
        P[i] = 0.0
        D[i] = 0.0
    if nv == 0:
        return
    q, qd = row[POS] + row[NP] - nq, row[VEL] + rd
    vec, sq, n2 = o + P_VECTORS, o + P_VECTORS + N_VECTORS * nq, nq * nq
    c, s, w, al = frame[COS], frame[SIN], frame[W], frame[AL]
    gx = c * system.gravity[0] + s * system.gravity[1]
    gy = -s * system.gravity[0] + c * system.gravity[1]
    ax, ay = frame[AX] - gx, frame[AY] - gy
    if rd >= 2:
        ax += acc[first]
        ay += acc[first + 1]
    if rd == 3:
        al += acc[first + 2]
    mass, mdx, mdy = pool[o + P_MASS], pool[o + P_MDX], pool[o + P_MDY]
    vx, vy = frame[VX], frame[VY]
    hx, hy, Jd = 0.0, 0.0, 0.0
    for k in range(nq):
        qk, qdk = z[q + k], v[qd + k]
        ctx, cty = pool[vec + V_CTX * nq + k], pool[vec + V_CTY * nq + k]
        j1 = pool[vec + V_J1 * nq + k]
        mean_x, mean_y = ctx, cty
        oe = pool[vec + V_OE0 * nq + k]
        ge_rate, j2q, j2qd, cr1_acc, ct1x_acc, ct1y_acc = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        ct1x_rate, ct1y_rate = 0.0, 0.0
        for i in range(nq):
            qi, qdi = z[q + i], v[qd + i]
            e = k * nq + i
            stiffness = pool[sq + S_KE * n2 + e]
            damping = pool[sq + S_DE * n2 + e]
            if flags & HAS_CR1:
                stiffness += pool[sq + S_CR1 * n2 + e] * al
                cr1_acc += pool[sq + S_CR1 * n2 + i * nq + k] * acc[qd + i]
            if flags & HAS_GE:
                damping += pool[sq + S_GE * n2 + e] * w
                ge_rate += pool[sq + S_GE * n2 + e] * qdi
            if flags & HAS_OE1:
                stiffness += pool[sq + S_OE1 * n2 + e] * w * w
                oe += pool[sq + S_OE1 * n2 + e] * qi
            if flags & HAS_CT1:
                kx, ky = pool[sq + S_CT1X * n2 + e], pool[sq + S_CT1Y * n2 + e]
                stiffness += kx * ax + ky * ay
                ctx += kx * qi
                cty += ky * qi
                mean_x += 0.5 * kx * qi
                mean_y += 0.5 * ky * qi
                ct1x_acc += kx * acc[qd + i]
                ct1y_acc += ky * acc[qd + i]
                ct1x_rate += kx * qdi
                ct1y_rate += ky * qdi
            if flags & HAS_QUADRATIC_J:
                j2q += pool[sq + S_J2 * n2 + e] * qi
                j2qd += pool[sq + S_J2 * n2 + e] * qdi
            P[block + (rd + k) * nv + rd + i] = stiffness
            D[block + (rd + k) * nv + rd + i] = damping
        mdx += mean_x * qk
        mdy += mean_y * qk
        hx += ctx * qdk
        hy += cty * qdk
        Jd += (j1 + 2.0 * j2q) * qdk
        if rd >= 2:
            D[block + (rd + k) * nv] = w * cty
            D[block + (rd + k) * nv + 1] = -w * ctx
            ct1x_acc -= 2.0 * w * ct1y_rate
            ct1y_acc += 2.0 * w * ct1x_rate
            P[block + rd + k] = -al * cty - w * w * ctx + ct1x_acc
            P[block + nv + rd + k] = al * ctx - w * w * cty + ct1y_acc
            D[block + rd + k] = -2.0 * w * cty
            D[block + nv + rd + k] = 2.0 * w * ctx
        if rd == 3:
            P[block + (rd + k) * nv + 2] = -ctx * gy + cty * gx
            D[block + (rd + k) * nv + 2] = -ctx * vy + cty * vx + ge_rate + 2.0 * w * oe
            P[block + 2 * nv + rd + k] = (
                ctx * ay - cty * ax + (j1 + 2.0 * j2q) * al + cr1_acc + 2.0 * j2qd * w
            )
            D[block + 2 * nv + rd + k] = (j1 + 2.0 * j2q) * w
    if flags & HAS_KE1:
        corner = block + rd * nv + rd
        add_cubic_stiffness(pool, sq + N_SQUARES * n2, nq, z, q, P, corner, nv)
    if rd >= 2:
        D[block + 1] = -mass * w
        D[block + nv] = mass * w
    if rd == 3:
        P[block + 2] = -mass * gy
        P[block + nv + 2] = mass * gx
        P[block + 2 * nv + 2] = mdx * gx + mdy * gy
        D[block + 2] = -mass * vy - 2.0 * w * mdx - 2.0 * hy
        D[block + nv + 2] = mass * vx - 2.0 * w * mdy + 2.0 * hx
        D[block + 2 * nv] = mdx * w
        D[block + 2 * nv + 1] = mdy * w
        D[block + 2 * nv + 2] = mdx * vx + mdy * vy + Jd
    if flags & STIFFENED:
        linearise_stiffened(system, work, b, z, v, acc)
