"""Mass matrix and generalised force of a body from the blocks of its SID, eq. (11).

Source: the equations of motion of one body in SID quantities (Wallrapp 1994).
Velocities and accelerations of a body frame are resolved in that frame.
"""

from __future__ import annotations

from ..compiler.compiling import inner
from ..compiler.lanes import row_times
from ..space.algebra import (
    back,
    cross,
    dot,
    growth,
    inertia_times,
    load,
    omega_product,
    size,
    store,
    store_column,
    write_inertia,
    write_mass,
    zero,
)
from ..space.layout import (
    DIAGONAL_DE,
    DIAGONAL_KE,
    HAS_CR1,
    HAS_CT1,
    HAS_KE1,
    HAS_OE1,
    HAS_QUADRATIC_J,
)
from .blocks import (
    J0,
    J1,
    Cr0,
    Cr1_row,
    Ct0,
    Ct1_row,
    De,
    De_row,
    Ge_row,
    Ke,
    Ke_row,
    Oe0,
    Oe1_row,
    cube_at,
    ksigma,
    mass,
    mdCM,
    row_product,
)
from .cubic import add_cubic_force


@inner()
def gravity_in(system, frame):
    """The acceleration of gravity in the axes of a body frame."""
    return back(frame.R, load(frame.x, system.gravity, 0))


@inner()
def body_state(system, work, row, w, z, v):
    """mdCM, J, J', Ct^T q' and Cr^T q' at a state; rows of the modes in Work.modal."""
    nq, flags, pool, o = row.nq, row.flags, system.pool, row.data
    q, qd, x = row.pos + row.np - row.nq, row.vel + row.rd, work.frame[0].x
    md, J = mdCM(x, pool, o), J0(x, pool, o)
    J_rate, flow, spin = zero(J), zero(x), zero(w)
    for k in range(nq):
        qk, qdk, mode = z[q + k], v[qd + k], work.modal[k]
        oe, ge = omega_product(Oe0(x, pool, o, nq, k), w), 0.0
        ct, constant = Ct0(x, pool, o, nq, k), J1(x, pool, o, nq, k)
        cr, j1, mean = Cr0(x, pool, o, nq, k), constant, ct
        turned = cr
        if flags & HAS_CR1:
            cr = cr + row_product(w, work, pool, Cr1_row(x, o, nq, k), nq, z, q)
            swing = row_product(w, work, pool, Ge_row(x, o, nq, k), nq, v, qd)
            ge = dot(swing, w)
        if flags & HAS_OE1:
            square = row_product(J, work, pool, Oe1_row(x, o, nq, k), nq, z, q)
            oe += omega_product(square, w)
            if flags & HAS_QUADRATIC_J:
                j1 = j1 + growth(square)
        if flags & HAS_CT1:
            bend = row_product(x, work, pool, Ct1_row(x, o, nq, k), nq, z, q)
            mean, ct = mean + 0.5 * bend, ct + bend
        if flags & HAS_QUADRATIC_J:
            turned = cr
        mode.ct, mode.cr, mode.j1, mode.turned = ct, cr, j1, turned
        mode.oe, mode.ge = oe, ge
        md, flow, spin = md + qk * mean, flow + qdk * ct, spin + qdk * turned
        J, J_rate = J + (0.5 * qk) * (j1 + constant), J_rate + qdk * j1
    return md, J, J_rate, flow, spin


@inner()
def _resistance(row, x, pool, k, z, v):
    """Row k of Ke q + De q'."""
    nq, o, q, qd = row.nq, row.data, row.pos + row.np - row.nq, row.vel + row.rd
    if row.flags & DIAGONAL_KE:
        force = Ke(x, pool, o, nq, k, k) * z[q + k]
    else:
        force = row_times(pool, Ke_row(x, o, nq, k), z, q, nq)
    if row.flags & DIAGONAL_DE:
        return force + De(x, pool, o, nq, k, k) * v[qd + k]
    return force + row_times(pool, De_row(x, o, nq, k), v, qd, nq)


@inner()
def evaluate_body(system, work, b, z, v):
    row, frame = system.body[b], work.frame[b]
    nq, nv, rd, n = row.nq, row.nv, row.rd, size(frame.x)
    if nv == 0:
        return
    pool, M, f, o, w, al = system.pool, work.M, work.f, row.data, frame.w, frame.al
    md, J, J_rate, flow, spin = body_state(system, work, row, w, z, v)
    block, first, q, qd = row.block, row.vel, row.pos + row.np - nq, row.vel + rd
    x, m = frame.x, mass(frame.x, pool, o)
    a = frame.a - gravity_in(system, frame)
    if rd >= n:
        h = m * a + cross(w, cross(w, md)) + 2.0 * cross(w, flow)
        store(f, first, -h)
        write_mass(M, block, nv, m, x)
    if rd > n:
        torque = cross(w, inertia_times(J, w) + spin) + inertia_times(J_rate, w)
        store(f, first + n, -(cross(md, a) + torque))
        write_inertia(M, block, nv, m, md, J)
    for k in range(nq):
        mode, line = work.modal[k], block + (rd + k) * nv
        ct, cr = mode.ct, mode.cr
        force = -mode.oe - mode.ge - dot(ct, a) - dot(cr, al)
        force -= ksigma(x, pool, o, nq, k)
        f[qd + k] = force - _resistance(row, x, pool, k, z, v)
        if rd >= n:
            store(M, line, ct)
            store_column(M, block, nv, rd + k, ct)
        if rd > n:
            store(M, line + n, cr)
            store_column(M, block + n * nv, nv, rd + k, cr)
    if row.flags & HAS_KE1:
        add_cubic_force(pool, cube_at(x, o, nq), nq, z, q, f, qd)
