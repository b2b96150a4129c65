"""Inertia of bodies with geometric stiffening: theory, section 12.

To what `bodies` makes of mass, mdCM and Ct come the part of the centre of mass,
|w x md + Ct^T q'|^2 / 2 m (`centre`), the rotation in mean axes, u.H u / 2, and the
elastic mass that no rigid motion has. The rotation is that of the whole body, and
less that of its free shapes.
"""

from __future__ import annotations

import math

from ..compiler.compiling import inner
from ..space.algebra import (
    add_column,
    add_row,
    cross,
    dot,
    entry,
    inertia,
    inertia_times,
    isotropic,
    product,
    size,
    unit,
    zero,
)
from ..space.spaces import BySpace
from ..space.tilted import meant, meant_by, seen, seen_by
from .blocks import H0, bow, coupling, free_mass, free_turning, mass, slope, tilt
from .centre import add_centre, centre, spin_of

#: Moments of inertia below this part of the largest one are rounding: there are none.
NOTHING = 1e-13


@inner()
def begin_mass(system, work, row, x):
    """Begins the elastic block of the mass matrix with that of the free shapes."""
    nq, nv, corner = row.nq, row.nv, row.block + row.rd * (row.nv + 1)
    for k in range(nq):
        for i in range(nq):
            free = free_mass(x, system.pool, row.data, nq, k, i)
            work.M[corner + k * nv + i] = free


@inner()
def coupled(x, pool, o, nq, k, i, whole):
    """Coupling of two coordinates, of the body or of its free shapes."""
    if whole:
        return coupling(x, pool, o, nq, k, i)
    return free_turning(x, pool, o, nq, k, i)


@inner()
def bowed(x, pool, o, nq, k, i, whole):
    """Second derivative of H."""
    if whole:
        return bow(x, pool, o, nq, k, i)
    free = 2.0 * free_mass(x, pool, o, nq, k, i)
    return isotropic(H0(x, pool, o), free)


@inner()
def _invert_in_plane(work, s):
    moment = entry(s.H, 0)
    s.H_inverse = isotropic(s.H, 1.0 / moment)
    return moment > 0.0


@inner()
def _invert_in_space(work, s):
    """Without inertia about an axis there is no motion about it."""
    H = s.H
    xx, yy, zz = entry(H, 0), entry(H, 1), entry(H, 2)
    xy, xz, yz = entry(H, 3), entry(H, 4), entry(H, 5)
    least = NOTHING * max(xx, yy, zz)
    a = 1.0 / xx if xx > least else 0.0
    l1, l2 = xy * a, xz * a
    pivot = yy - l1 * xy
    b = 1.0 / pivot if pivot > least else 0.0
    l3 = (yz - l1 * xz) * b
    last = zz - l2 * xz - l3 * (yz - l1 * xz)
    c = 1.0 / last if last > least else 0.0
    l4 = l1 * l3 - l2
    s.H_inverse = inertia(
        a + l1 * l1 * b + l4 * l4 * c,
        b + l3 * l3 * c,
        c,
        -l1 * b - l3 * l4 * c,
        l4 * c,
        -l3 * c,
    )
    return xx > -least and pivot > -least and last > -least


#: The inverse of H; false if H is not positive.
_invert = BySpace(plane=_invert_in_plane, space=_invert_in_space)


@inner()
def _lengthen(system, work, row, s):
    """Adds to H the terms of third and fourth order in q that leave none in J."""
    inverse = 1.0 / mass(s.mu, system.pool, row.data)
    mu, m1, flow, m1_rate = s.mu, s.m1, s.flow, s.m1_rate
    s.H = s.H + product(mu, mu, 0.5 * inverse) - product(m1, m1, 0.5 * inverse)
    rate = product(mu, flow, inverse) - product(m1, m1_rate, inverse)
    s.H_rate = s.H_rate + rate
    for k in range(row.nq):
        mode = work.stiffened[k]
        ct, ct0 = mode.ct, mode.ct0
        more = product(mu, ct, inverse) - product(m1, ct0, inverse)
        mode.growth = mode.growth + more
        rate = product(ct, flow, inverse) + product(mu, mode.bend, inverse)
        rate = rate - product(ct0, m1_rate, inverse)
        mode.growth_rate = mode.growth_rate + rate


@inner()
def _complete(system, work, row, s, acc):
    """Adds to the coupling the terms of second order in q that leave none in Cr.

    None is added to what tilted axes make of Cr.
    """
    nq, qd, inverse = row.nq, row.vel + row.rd, 1.0 / mass(s.mu, system.pool, row.data)
    mu, m1, flow, m1_rate = s.mu, s.m1, s.flow, s.m1_rate
    tilt_rate, lean_rate, pull = s.theta_rate, s.lean_rate, s.pull + s.bent
    H_bow, H_bow_rate, pull1 = s.H_bow, s.H_bow_rate, zero(mu)
    for k in range(nq):
        pull1 = pull1 + acc[qd + k] * work.stiffened[k].ct0
    for k in range(nq):
        mode = work.stiffened[k]
        ct, ct0, leaned, bowing = mode.ct, mode.ct0, mode.tilt, mode.bow
        bend = cross(mu, mode.bend)
        line = cross(mu, ct) - cross(m1, ct0)
        rate = cross(flow, ct) - cross(m1_rate, ct0) + bend
        across = cross(ct, flow) - cross(ct0, m1_rate) + bend
        follow = cross(ct, pull) - cross(ct0, pull1) + cross(mu, mode.trail)
        turned = inertia_times(bowing, lean_rate)
        turned = turned + inertia_times(mode.bow_rate, tilt_rate)
        mode.row = mode.row - inverse * line - inertia_times(H_bow, leaned)
        rate = inverse * rate + inertia_times(H_bow_rate, leaned)
        mode.row_rate = mode.row_rate - rate
        across = inverse * across + inertia_times(bowing, tilt_rate)
        mode.column = mode.column - across
        mode.follow = mode.follow - inverse * follow - turned


@inner()
def rotate_axes(system, work, b, z, v, acc, weight, whole):
    """The rotation of a body, or of its free shapes; false if H is not positive."""
    row, pool, s = system.body[b], system.pool, work.turning[0]
    nq, o, q, qd = row.nq, row.data, row.pos + row.np - row.nq, row.vel + row.rd
    x, none = s.md, zero(s.turn)
    H, H_rate = H0(x, pool, o), zero(s.H)
    H_bow, H_bow_rate = zero(H), zero(H)
    theta, theta_rate, lean_rate = none, none, none
    for k in range(nq):
        mode, qk, qdk = work.stiffened[k], z[q + k], v[qd + k]
        leaned, grow = none, zero(H)
        if whole:
            leaned, grow = tilt(x, pool, o, nq, k), slope(x, pool, o, nq, k)
        bowing, bow_rate = zero(H), zero(H)
        line, line_rate, across, follow = none, none, none, none
        for i in range(nq):
            qi, qdi = z[q + i], v[qd + i]
            c = coupled(x, pool, o, nq, k, i, whole)
            swapped = coupled(x, pool, o, nq, i, k, whole)
            g = bowed(x, pool, o, nq, k, i, whole)
            bowing, bow_rate = bowing + qi * g, bow_rate + qdi * g
            line, line_rate = line + qi * c, line_rate + qdi * c
            across, follow = across + qdi * swapped, follow + acc[qd + i] * swapped
        theta, theta_rate = theta + qk * leaned, theta_rate + qdk * leaned
        lean_rate = lean_rate + acc[qd + k] * leaned
        mode.row, mode.row_rate, mode.column = line, line_rate, across
        mode.follow, mode.tilt = follow, leaned
        mode.bow, mode.bow_rate = bowing, bow_rate
        mode.growth, mode.growth_rate = grow + bowing, bow_rate
        H, H_rate = H + qk * grow, H_rate + qdk * grow
        H_bow, H_bow_rate = H_bow + (0.5 * qk) * bowing, H_bow_rate + qdk * bowing
    s.H, s.H_rate = H + H_bow, H_rate + H_bow_rate
    s.H_bow, s.H_bow_rate = H_bow, H_bow_rate
    s.theta, s.theta_rate, s.lean_rate = theta, theta_rate, lean_rate
    turn, turn_rate, w = none, none, none
    if whole:
        _lengthen(system, work, row, s)
        _complete(system, work, row, s, acc)
        w, al = spin_of(system, work, b, acc, weight)
        turn = seen(theta, w) + theta_rate
        turn_rate = seen(theta, al) + seen_by(theta, theta_rate, w)
        turn_rate = turn_rate + weight * lean_rate
    if not _invert(work, s):
        return False
    _move(work, row, s, v, acc, weight, turn, turn_rate)
    u, lag = s.u, s.lag
    for k in range(nq):
        mode = work.stiffened[k]
        mode.lean = seen_by(theta, mode.tilt, w)
        mode.heave = inertia_times(mode.growth, u)
        mode.drag = inertia_times(mode.growth, lag)
    return True


@inner()
def _move(work, row, s, v, acc, weight, turn, turn_rate):
    """Angular velocity and momentum of the mean axes, and their rates."""
    qd, kick, kick_rate = row.vel + row.rd, zero(turn), zero(turn)
    H, H_rate, H_inverse = s.H, s.H_rate, s.H_inverse
    for k in range(row.nq):
        mode, qdk, ak = work.stiffened[k], v[qd + k], weight * acc[qd + k]
        kick = kick + qdk * mode.row
        kick_rate = kick_rate + ak * mode.row + qdk * mode.row_rate
    lag = inertia_times(H_inverse, kick)
    u = turn + lag
    momentum_rate = inertia_times(H, turn_rate) + inertia_times(H_rate, turn)
    momentum_rate = momentum_rate + kick_rate
    s.turn, s.turn_rate, s.u, s.lag = turn, turn_rate, u, lag
    s.momentum, s.momentum_rate = inertia_times(H, turn) + kick, momentum_rate
    s.u_rate = inertia_times(H_inverse, momentum_rate - inertia_times(H_rate, u))


@inner()
def torque_of(s, w, p, pull):
    """What changes p and pull of momentum and its rate make of the frame's torque."""
    theta, meanwhile = s.theta, meant_by(s.theta, s.theta_rate, p)
    return meant(theta, pull) + meanwhile + cross(w, meant(theta, p))


@inner()
def _add_rotation(system, work, b, whole):
    """What `rotate_axes` found, to mass matrix and forces."""
    row, s, M, f = system.body[b], work.turning[0], work.M, work.f
    nq, nv, rd, first, n = row.nq, row.nv, row.rd, row.vel, size(s.md)
    block, frame, sign = row.block, row.block + n * row.nv, 1.0 if whole else -1.0
    theta, u, u_rate, H, H_inverse = s.theta, s.u, s.u_rate, s.H, s.H_inverse
    p, pull, turns = s.momentum, s.momentum_rate, whole and rd > n
    if turns:
        add_row(f, first + n, -torque_of(s, work.frame[b].w, p, pull))
        for a in range(size(u)):
            turned = meant(theta, inertia_times(H, seen(theta, unit(u, a))))
            add_column(M, frame + n + a, nv, turned)
    for k in range(nq):
        mode, line = work.stiffened[k], block + (rd + k) * nv
        leaned, across = mode.tilt, mode.row
        slip = mode.row_rate - mode.column + mode.drag - 0.5 * mode.heave
        force = dot(leaned, pull) + dot(across, u_rate) + dot(slip, u)
        f[first + rd + k] -= sign * (force - dot(p, mode.lean))
        if turns:
            turned = meant(theta, inertia_times(H, leaned) + across)
            add_row(M, line + n, turned)
            add_column(M, frame + rd + k, nv, turned)
        spun = leaned + inertia_times(H_inverse, across)
        for i in range(nq):
            other = work.stiffened[i]
            share = inertia_times(H, other.tilt) + other.row
            M[line + rd + i] += sign * dot(spun, share)


@inner()
def add_stiffened(system, work, b, z, v):
    """Completes mass matrix and forces of a stiffened body; spoils a mass matrix that
    is not positive, see `stopping`."""
    row = system.body[b]
    begin_mass(system, work, row, work.frame[b].x)
    centre(system, work, b, z, v, v, 0.0)
    add_centre(system, work, b, v)
    for part in range(2):
        if not rotate_axes(system, work, b, z, v, v, 0.0, part == 0):
            work.M[row.block + row.nv * row.nv - 1] = -math.inf
            return
        _add_rotation(system, work, b, part == 0)
