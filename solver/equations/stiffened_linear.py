"""Derivatives of the inertia of bodies with geometric stiffening."""

from __future__ import annotations

from ..compiler.compiling import inner
from ..space.algebra import (
    add_column,
    cross,
    dot,
    inertia_times,
    product,
    size,
    unit,
    zero,
)
from ..space.tilted import bent_by, meant, meant_by, seen, seen_by
from .blocks import Ct1, mass
from .centre import centre, linearise_centre, spin_of
from .stiffened import bowed, coupled, rotate_axes, torque_of


@inner()
def _force_of(mode, p, pull, spin, gain, slip):
    """What changes of momentum, its rate, u, its rate and LAG make of a row's force."""
    slope = mode.row_rate - mode.column + mode.drag - mode.heave
    force = dot(mode.tilt, pull) + dot(mode.row, gain) + dot(slope, spin)
    return force + dot(mode.heave, slip) - dot(p, mode.lean)


@inner()
def _linearise_turn(system, work, b):
    """Derivatives by the angular velocity of the frame."""
    row, s, D, w = system.body[b], work.turning[0], work.Rv, work.frame[b].w
    nq, nv, rd, n, theta, none = row.nq, row.nv, row.rd, size(s.md), s.theta, zero(s.u)
    H, H_rate, theta_rate, p0 = s.H, s.H_rate, s.theta_rate, s.momentum
    momentum = meant(theta, p0)
    for a in range(size(w)):
        e = unit(w, a)
        spin, gain = seen(theta, e), seen_by(theta, theta_rate, e)
        p = inertia_times(H, spin)
        pull = inertia_times(H, gain) + inertia_times(H_rate, spin)
        torque = torque_of(s, w, p, pull) + cross(e, momentum)
        add_column(D, row.block + n * nv + n + a, nv, torque)
        for k in range(nq):
            mode, at = work.stiffened[k], row.block + (rd + k) * nv + n + a
            D[at] += _force_of(mode, p, pull, spin, gain, none)
            D[at] -= dot(p0, seen_by(theta, mode.tilt, e))


@inner()
def _completed(s, one, other, c, tilted, inverse):
    """What the terms of second order of the coupling add, in the row of `other`, to
    derivatives by the coordinate of `one`.

    c : derivative of its Ct
    tilted : second derivative of these terms of H times the rate of the tilt

    To that of the row, to that less the one with both exchanged, and to that of
    row_rate - column.
    """
    ct = other.ct
    skewed = cross(one.ct, ct) - cross(one.ct0, other.ct0)
    own = skewed + cross(s.mu, c)
    bent = cross(one.bend, ct) + cross(s.flow, c)
    lean = inertia_times(one.bow, other.tilt)
    swapped = inertia_times(other.bow, one.tilt)
    turned = inertia_times(one.bow_rate, other.tilt) - tilted
    more, twice = -inverse * own - lean, -2.0 * inverse
    return more, twice * skewed + swapped - lean, twice * bent - turned


@inner()
def _lengthened(s, one, other, c, inverse):
    """What the terms of higher order of H add to its second derivative."""
    longer = product(one.ct, other.ct, inverse) + product(s.mu, c, inverse)
    return longer - product(one.ct0, other.ct0, inverse)


@inner()
def _linearise_rotation(system, work, b, acc, whole):
    """Derivatives by elastic coordinates and their rates."""
    row, pool, s, P, D = system.body[b], system.pool, work.turning[0], work.Rp, work.Rv
    nq, nv, rd, block, o = row.nq, row.nv, row.rd, row.block, row.data
    x, none, sign = s.md, zero(s.u), 1.0 if whole else -1.0
    theta, theta_rate, p0, p0_rate = s.theta, s.theta_rate, s.momentum, s.momentum_rate
    u, u_rate, lag, turn, turn_rate = s.u, s.u_rate, s.lag, s.turn, s.turn_rate
    H, H_rate, H_inverse = s.H, s.H_rate, s.H_inverse
    w, al, half = none, none, lag - 0.5 * u
    if whole:
        w, al = spin_of(system, work, b, acc, 1.0)
    n, inverse = size(x), 1.0 / mass(x, pool, o)
    frame = block + n * nv + rd
    for i in range(nq):
        mode = work.stiffened[i]
        leaned, lean, across, heave = mode.tilt, mode.lean, mode.column, mode.heave
        growth, growth_rate, line = mode.growth, mode.growth_rate, mode.row
        lean_rate = seen_by(theta, leaned, al) + bent_by(leaned, theta_rate, w)
        p = inertia_times(H, lean) + inertia_times(growth, turn) + across
        pull = inertia_times(H, lean_rate) + inertia_times(H_rate, lean)
        pull = pull + inertia_times(growth, turn_rate)
        pull = pull + inertia_times(growth_rate, turn) + mode.follow
        spin = inertia_times(H_inverse, p - heave)
        gain = pull - inertia_times(growth, u_rate) - inertia_times(growth_rate, u)
        gain = inertia_times(H_inverse, gain - inertia_times(H_rate, spin))
        slip = inertia_times(H_inverse, across - mode.drag)
        rate_p = inertia_times(H, leaned) + line
        rate_pull = inertia_times(H, lean) + inertia_times(growth, turn)
        rate_pull = rate_pull + inertia_times(H_rate, leaned) + mode.row_rate + across
        rate_slip = inertia_times(H_inverse, line)
        rate_spin = leaned + rate_slip
        rate_gain = rate_pull - heave - inertia_times(H_rate, rate_spin)
        rate_gain = inertia_times(H_inverse, rate_gain)
        if whole and rd > n:
            swung = meant_by(theta, leaned, p0)
            torque = meant_by(theta, leaned, p0_rate) + cross(w, swung)
            torque = torque + bent_by(leaned, theta_rate, p0)
            add_column(P, frame + i, nv, torque + torque_of(s, w, p, pull))
            torque = swung + torque_of(s, w, rate_p, rate_pull)
            add_column(D, frame + i, nv, torque)
        for k in range(nq):
            other, at = work.stiffened[k], block + (rd + k) * nv + rd + i
            c = coupled(x, pool, o, nq, k, i, whole)
            g = bowed(x, pool, o, nq, k, i, whole)
            gyro, gyro_rate = none, c - coupled(x, pool, o, nq, i, k, whole)
            if whole:
                bend = Ct1(x, pool, o, nq, k, i)
                tilted = inertia_times(g, theta_rate)
                g = g + _lengthened(s, mode, other, bend, inverse)
                more, skewed, gyro = _completed(s, mode, other, bend, tilted, inverse)
                c, gyro_rate = c + more, gyro_rate + skewed
            by_q = _force_of(other, p, pull, spin, gain, slip) + dot(c, u_rate)
            by_q += dot(u, inertia_times(g, half)) + dot(gyro, u)
            by_q -= dot(p0, bent_by(leaned, other.tilt, w))
            by_rate = _force_of(
                other, rate_p, rate_pull, rate_spin, rate_gain, rate_slip
            )
            P[at] += sign * by_q
            D[at] += sign * (by_rate + dot(gyro_rate, u))


@inner()
def linearise_stiffened(system, work, b, z, v, acc):
    """Completes Rp and Rv of a stiffened body."""
    centre(system, work, b, z, v, acc, 1.0)
    linearise_centre(system, work, b, acc)
    for part in range(2):
        if rotate_axes(system, work, b, z, v, acc, 1.0, part == 0):
            if part == 0 and system.body[b].rd > size(work.turning[0].md):
                _linearise_turn(system, work, b)
            _linearise_rotation(system, work, b, acc, part == 0)
