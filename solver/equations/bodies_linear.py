"""Derivatives of the equations of motion of a body."""

from __future__ import annotations

from ..compiler.compiling import inner
from ..space.algebra import (
    add_column,
    add_cross,
    add_inertia,
    add_row,
    add_twice_cross,
    cross,
    dot,
    growth,
    inertia_times,
    load,
    omega_gradient,
    omega_product,
    size,
    zero,
)
from ..space.layout import HAS_CR1, HAS_CT1, HAS_KE1, HAS_OE1, HAS_QUADRATIC_J
from .blocks import (
    J0,
    Cr1,
    Cr1_row,
    Ct1,
    Ct1_row,
    De,
    Ge,
    Ge_row,
    Ke,
    Oe0,
    Oe1,
    Oe1_row,
    cube_at,
    mass,
    row_product,
)
from .bodies import body_state, gravity_in
from .cubic import add_cubic_stiffness


@inner()
def _elastic(system, work, b, z, v, acc, a, al):
    """Rows and columns of the elastic coordinates, and what turns them."""
    row, frame = system.body[b], work.frame[b]
    nq, nv, rd, flags, o, n = row.nq, row.nv, row.rd, row.flags, row.data, size(a)
    pool, P, D, w, x = system.pool, work.Rp, work.Rv, frame.w, frame.x
    block, first, q = row.block, row.vel, row.pos + row.np - nq
    qd, quadratic, J = first + rd, flags & HAS_QUADRATIC_J != 0, J0(x, pool, o)
    for k in range(nq):
        line = block + (rd + k) * nv
        turn = omega_gradient(Oe0(x, pool, o, nq, k), w)
        follow, drag, sway = zero(w), zero(a), zero(w)
        if flags & HAS_CR1:
            c, ge = Cr1_row(x, o, nq, k), Ge_row(x, o, nq, k)
            swing = row_product(w, work, pool, ge, nq, v, qd)
            turn, sway = turn + swing, row_product(w, work, pool, c, nq, v, qd) - swing
            follow = row_product(w, work, pool, c, nq, acc, qd)
            follow = follow - row_product(w, work, pool, ge, nq, acc, qd)
        if flags & HAS_OE1:
            oe = Oe1_row(x, o, nq, k)
            turn = turn + omega_gradient(row_product(J, work, pool, oe, nq, z, q), w)
            if quadratic:
                grown = growth(row_product(J, work, pool, oe, nq, v, qd))
                follow = follow + inertia_times(grown, w)
        if flags & HAS_CT1:
            ct = Ct1_row(x, o, nq, k)
            drag = 2.0 * cross(w, row_product(a, work, pool, ct, nq, v, qd))
            drag = drag + row_product(a, work, pool, ct, nq, acc, qd)
        for i in range(nq):
            stiffness, damping = Ke(x, pool, o, nq, k, i), De(x, pool, o, nq, k, i)
            if flags & HAS_CR1:
                stiffness += dot(Cr1(x, pool, o, nq, k, i), al)
                damping += dot(Ge(x, pool, o, nq, k, i), w)
            if flags & HAS_OE1:
                stiffness += omega_product(Oe1(x, pool, o, nq, k, i), w)
            if flags & HAS_CT1:
                stiffness += dot(Ct1(x, pool, o, nq, k, i), a)
            P[line + rd + i] += stiffness
            D[line + rd + i] += damping
        if rd >= n:
            add_column(P, block + rd + k, nv, drag)
        if quadratic:
            follow = follow + cross(w, sway)
        if rd > n:
            add_row(D, line + n, turn)
            add_column(P, block + n * nv + rd + k, nv, follow)
    if flags & HAS_KE1:
        at, corner = cube_at(x, o, nq), block + rd * nv + rd
        add_cubic_stiffness(pool, at, nq, z, q, P, corner, nv)


@inner()
def _frame(system, work, b, md, J, J_rate, flow, spin, g):
    """Columns of the frame in its own rows."""
    row, frame, P, D = system.body[b], work.frame[b], work.Rp, work.Rv
    nv, block, n, w, velocity = row.nv, row.block, size(md), frame.w, frame.v
    m = mass(md, system.pool, row.data)
    if row.rd >= n:
        add_cross(D, block, nv, m * w, md)
    if row.rd <= n:
        return
    r, sway = block + n * nv, m * velocity + cross(w, md) + 2.0 * flow
    add_cross(P, block + n, nv, -m * g, w)
    add_twice_cross(P, r + n, nv, -md, g, w)
    add_cross(D, block + n, nv, -sway, w)
    add_twice_cross(D, block + n, nv, -w, md, w)
    add_twice_cross(D, r, nv, md, w, md)
    add_twice_cross(D, r + n, nv, -md, velocity, w)
    add_cross(D, r + n, nv, -inertia_times(J, w) - spin, w)
    add_inertia(D, r + n, nv, w, J, J_rate)


@inner()
def linearise_body(system, work, b, z, v, acc):
    """Rp and Rv of one body: derivatives of M z_II' - f by positions and velocities.

    Positions vary in the body frame, see `coordinates`.
    """
    row, frame = system.body[b], work.frame[b]
    nq, nv, rd, n = row.nq, row.nv, row.rd, size(frame.x)
    P, D, block, first = work.Rp, work.Rv, row.block, row.vel
    for i in range(block, block + nv * nv):
        P[i] = 0.0
        D[i] = 0.0
    if nv == 0:
        return
    w, al, velocity, g = frame.w, frame.al, frame.v, gravity_in(system, frame)
    md, J, J_rate, flow, spin = body_state(system, work, row, w, z, v)
    a = frame.a - g
    if rd >= n:
        a = a + load(a, acc, first)
    if rd > n:
        al = al + load(al, acc, first + n)
    _frame(system, work, b, md, J, J_rate, flow, spin, g)
    for k in range(nq):
        mode, line = work.modal[k], block + (rd + k) * nv
        ct, j1, j1w = mode.ct, mode.j1, inertia_times(mode.j1, w)
        if rd >= n:
            pull = cross(al, ct) + cross(w, cross(w, ct))
            add_column(P, block + rd + k, nv, pull)
            add_column(D, block + rd + k, nv, 2.0 * cross(w, ct))
            add_row(D, line, cross(ct, w))
        if rd > n:
            r = block + n * nv + rd + k
            swing = cross(ct, a) + inertia_times(j1, al) + cross(w, j1w)
            add_column(P, r, nv, swing)
            add_column(D, r, nv, j1w + cross(w, mode.turned))
            add_row(P, line + n, cross(g, ct))
            add_row(D, line + n, cross(velocity, ct))
    _elastic(system, work, b, z, v, acc, a, al)
