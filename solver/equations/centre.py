"""The centre of mass of bodies with geometric stiffening: theory, section 12."""

from __future__ import annotations

from ..compiler.compiling import inner
from ..space.algebra import (
    add_column,
    add_row,
    add_symmetric,
    cross,
    dot,
    load,
    product,
    size,
    unit,
    zero,
)
from .blocks import Ct0, Ct1, mass, mdCM


@inner()
def spin_of(system, work, b, acc, weight):
    """Angular velocity and acceleration of a body frame."""
    row, frame = system.body[b], work.frame[b]
    al, n = frame.al, size(frame.x)
    if row.rd > n:
        al = al + weight * load(al, acc, row.vel + n)
    return frame.w, al


@inner()
def centre(system, work, b, z, v, acc, weight):
    """mdCM, Ct and the acceleration of the centre of mass relative to the frame.

    acc : accelerations, of which `weight` counts: 0, or 1
    """
    row, pool, s = system.body[b], system.pool, work.turning[0]
    nq, o, q, qd = row.nq, row.data, row.pos + row.np - row.nq, row.vel + row.rd
    x, none = work.frame[b].x, zero(work.frame[b].x)
    mu, m1, m1_rate, flow, bent, pull = none, none, none, none, none, none
    for k in range(nq):
        mode, qk, qdk = work.stiffened[k], z[q + k], v[qd + k]
        ct0 = Ct0(x, pool, o, nq, k)
        shift, bend, trail = none, none, none
        for i in range(nq):
            c = Ct1(x, pool, o, nq, k, i)
            shift, bend = shift + z[q + i] * c, bend + v[qd + i] * c
            trail = trail + acc[qd + i] * c
        ct = ct0 + shift
        m1, m1_rate = m1 + qk * ct0, m1_rate + qdk * ct0
        mu = mu + qk * (ct0 + 0.5 * shift)
        flow, bent, pull = flow + qdk * ct, bent + qdk * bend, pull + acc[qd + k] * ct
        mode.ct0, mode.ct, mode.bend, mode.trail = ct0, ct, bend, trail
    md = mdCM(x, pool, o) + mu
    w, al = spin_of(system, work, b, acc, weight)
    sway = bent + weight * pull + 2.0 * cross(w, flow)
    sway = sway + cross(al, md) + cross(w, cross(w, md))
    s.mu, s.m1, s.m1_rate, s.md = mu, m1, m1_rate, md
    s.flow, s.bent, s.pull = flow, bent, pull
    s.sway = (1.0 / mass(x, pool, o)) * sway


@inner()
def add_centre(system, work, b, v):
    """What `centre` found, to mass matrix and forces."""
    row, s, M, f = system.body[b], work.turning[0], work.M, work.f
    md, sway, nq, nv, rd, first = s.md, s.sway, row.nq, row.nv, row.rd, row.vel
    n, inverse = size(md), 1.0 / mass(md, system.pool, row.data)
    turn = row.block + n * nv
    if rd > n:
        add_symmetric(M, turn + n, nv, product(md, md, -0.5 * inverse))
        add_row(f, first + n, -cross(md, sway))
    for k in range(nq):
        mode, line = work.stiffened[k], row.block + (rd + k) * nv
        ct = mode.ct
        f[first + rd + k] -= dot(ct, sway)
        if rd >= n:
            add_row(f, first, -v[first + rd + k] * mode.bend)
        if rd > n:
            turned = inverse * cross(md, ct)
            add_row(M, line + n, turned)
            add_column(M, turn + rd + k, nv, turned)
        for i in range(nq):
            M[line + rd + i] += dot(ct, work.stiffened[i].ct) * inverse


@inner()
def linearise_centre(system, work, b, acc):
    """What `centre` found, to Rp and Rv."""
    row, pool, s, P, D = system.body[b], system.pool, work.turning[0], work.Rp, work.Rv
    nq, nv, rd, block, o = row.nq, row.nv, row.rd, row.block, row.data
    w, al = spin_of(system, work, b, acc, 1.0)
    md, sway, flow, n = s.md, s.sway, s.flow, size(s.md)
    inverse, turn = 1.0 / mass(md, pool, o), block + n * nv
    if rd > n:
        for a in range(size(w)):
            e = unit(w, a)
            by = cross(e, cross(w, md)) + cross(w, cross(e, md)) + 2.0 * cross(e, flow)
            by = inverse * by
            add_column(D, turn + n + a, nv, cross(md, by))
            for k in range(nq):
                D[block + (rd + k) * nv + n + a] += dot(work.stiffened[k].ct, by)
    for i in range(nq):
        ct, bend = work.stiffened[i].ct, work.stiffened[i].bend
        by_q = cross(al, ct) + cross(w, cross(w, ct)) + 2.0 * cross(w, bend)
        by_q = inverse * (by_q + work.stiffened[i].trail)
        by_rate = (2.0 * inverse) * (bend + cross(w, ct))
        if rd >= n:
            add_column(D, block + rd + i, nv, 2.0 * bend)
        if rd > n:
            add_column(P, turn + rd + i, nv, cross(ct, sway) + cross(md, by_q))
            add_column(D, turn + rd + i, nv, cross(md, by_rate))
        for k in range(nq):
            other, line = work.stiffened[k].ct, block + (rd + k) * nv + rd + i
            P[line] += dot(Ct1(md, pool, o, nq, k, i), sway) + dot(other, by_q)
            D[line] += dot(other, by_rate)
