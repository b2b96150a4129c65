"""Derivatives of the inertia of spatial bodies with geometric stiffening."""

from __future__ import annotations

from numba import boolean, float64, int64, types

from .compiling import inner
from .layout import BLOCK, DATA, F1, NQ, NV, RD, SYSTEM, WORK
from .spatial_centre import (
    BEND,
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
    H_INVERSE,
    H_RATE,
    HEAD,
    HEAVE,
    LAG,
    LEAN,
    MOMENTUM,
    MOMENTUM_RATE,
    MU,
    N_ROW,
    ROW,
    ROW_RATE,
    THETA,
    THETA_RATE,
    TILT,
    TURN,
    TURN_RATE,
    U_RATE,
    H,
    U,
    centre,
    linearise_centre,
    spin_of,
)
from .spatial_columns import N_VECTORS, P_MASS, P_VECTORS, S_CT1
from .spatial_stiffened import (
    bows,
    couplings,
    rotate_axes,
    torque_of,
)
from .tilted import bent_by, meant, meant_by, seen, seen_by
from .vectors import (
    VECTOR,
    add_column,
    column,
    cross,
    dot,
    inertia_times,
    load,
    minus,
    mixed_product,
    own_product,
    plus,
    symmetric_times,
    times,
    unit,
)


@inner(float64(F1, int64, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR))
def force_of(s, at, p, pull, spin, gain, slip):
    """What changes of momentum, its rate, u, its rate and LAG make of a row's force."""
    gyro = minus(load(s, at + ROW_RATE), load(s, at + COLUMN))
    slope = minus(plus(gyro, load(s, at + DRAG)), load(s, at + HEAVE))
    force = dot(load(s, at + TILT), pull) + dot(load(s, at + ROW), gain)
    force += dot(slope, spin) + dot(load(s, at + HEAVE), slip)
    return force - dot(p, load(s, at + LEAN))


@inner(types.void(SYSTEM, WORK, int64))
def _linearise_turn(system, work, b):
    """Derivatives by the angular velocity of the frame."""
    row, s, D = system.body[b], work.stiffened, work.Rv
    nq, nv, rd, block = row[NQ], row[NV], row[RD], row[BLOCK]
    theta, none = load(s, THETA), (0.0, 0.0, 0.0)
    momentum = meant(theta, load(s, MOMENTUM))
    for a in range(3):
        e = unit(a)
        spin, gain = seen(theta, e), seen_by(theta, load(s, THETA_RATE), e)
        p = inertia_times(s, H, spin)
        pull = plus(inertia_times(s, H, gain), inertia_times(s, H_RATE, spin))
        torque = plus(torque_of(system, work, b, p, pull), cross(e, momentum))
        add_column(D, block + 3 * nv + 3 + a, nv, torque)
        for k in range(nq):
            at, line = HEAD + k * N_ROW, block + (rd + k) * nv + 3 + a
            D[line] += force_of(s, at, p, pull, spin, gain, none)
            lean = seen_by(theta, load(s, at + TILT), e)
            D[line] -= dot(load(s, MOMENTUM), lean)


@inner(types.UniTuple(VECTOR, 3)(F1, int64, int64, VECTOR, VECTOR, float64))
def _completed(s, at, to, c, tilted, inverse):
    """What the terms of second order of the coupling add, in row k at `to`, to
    derivatives by coordinate l at `at`.

    c : derivative of Ct_k
    tilted : second derivative of these terms of H times the rate of the tilt

    To that of the row, to that less the one with k and l exchanged, and to that of
    ROW_RATE - COLUMN.
    """
    ct = load(s, to + CT)
    skewed = cross(load(s, at + CT), ct)
    skewed = minus(skewed, cross(load(s, at + CT0), load(s, to + CT0)))
    own = plus(skewed, cross(load(s, MU), c))
    bent = plus(cross(load(s, at + BEND), ct), cross(load(s, FLOW), c))
    lean = inertia_times(s, at + BOW, load(s, to + TILT))
    swapped = inertia_times(s, to + BOW, load(s, at + TILT))
    turned = minus(inertia_times(s, at + BOW_RATE, load(s, to + TILT)), tilted)
    return (
        minus(times(-inverse, own), lean),
        plus(times(-2.0 * inverse, skewed), minus(swapped, lean)),
        minus(times(-2.0 * inverse, bent), turned),
    )


@inner(types.UniTuple(VECTOR, 2)(F1, int64, int64, VECTOR, float64))
def _lengthened(s, at, to, c, inverse):
    """What the terms of higher order of H add to its second derivative."""
    one, other = load(s, at + CT), load(s, to + CT)
    own = own_product(one, other, inverse)
    own = plus(own, own_product(load(s, MU), c, inverse))
    mixed = mixed_product(one, other, inverse)
    mixed = plus(mixed, mixed_product(load(s, MU), c, inverse))
    one, other = load(s, at + CT0), load(s, to + CT0)
    own = minus(own, own_product(one, other, inverse))
    return own, minus(mixed, mixed_product(one, other, inverse))


@inner(types.void(SYSTEM, WORK, int64, F1, boolean))
def _linearise_rotation(system, work, b, acc, whole):
    """Derivatives by elastic coordinates and their rates."""
    row, pool, s, P, D = system.body[b], system.pool, work.stiffened, work.Rp, work.Rv
    nq, nv, rd, block = row[NQ], row[NV], row[RD], row[BLOCK]
    sq, n2, sign = row[DATA] + P_VECTORS + N_VECTORS * nq, nq * nq, 1.0
    if not whole:
        sign = -1.0
    theta, theta_rate = load(s, THETA), load(s, THETA_RATE)
    u, u_rate, turn, turn_rate = (
        load(s, U),
        load(s, U_RATE),
        load(s, TURN),
        load(s, TURN_RATE),
    )
    p0, lag, none = load(s, MOMENTUM), load(s, LAG), (0.0, 0.0, 0.0)
    w, al = none, none
    if whole:
        w, al = spin_of(system, work, b, acc, 1.0)
    half = minus(lag, times(0.5, u))
    own = (u[0] * half[0], u[1] * half[1], u[2] * half[2])
    mixed = (
        u[0] * half[1] + u[1] * half[0],
        u[0] * half[2] + u[2] * half[0],
        u[1] * half[2] + u[2] * half[1],
    )
    frame, inverse = block + 3 * nv + rd, 1.0 / pool[row[DATA] + P_MASS]
    for i in range(nq):
        at = HEAD + i * N_ROW
        tilt, lean, across = (
            load(s, at + TILT),
            load(s, at + LEAN),
            load(s, at + COLUMN),
        )
        bent = bent_by(tilt, theta_rate, w)
        lean_rate = plus(seen_by(theta, tilt, al), bent)
        grown, grown_rate = at + GROWTH, at + GROWTH_RATE
        p = plus(inertia_times(s, H, lean), inertia_times(s, grown, turn))
        p = plus(p, across)
        pull = plus(inertia_times(s, H, lean_rate), inertia_times(s, H_RATE, lean))
        pull = plus(pull, inertia_times(s, grown, turn_rate))
        pull = plus(
            pull, plus(inertia_times(s, grown_rate, turn), load(s, at + FOLLOW))
        )
        spin = inertia_times(s, H_INVERSE, minus(p, load(s, at + HEAVE)))
        gain = minus(pull, inertia_times(s, grown, u_rate))
        gain = minus(gain, inertia_times(s, grown_rate, u))
        gain = minus(gain, inertia_times(s, H_RATE, spin))
        gain = inertia_times(s, H_INVERSE, gain)
        slip = inertia_times(s, H_INVERSE, minus(across, load(s, at + DRAG)))
        coupled = load(s, at + ROW)
        rate_p = plus(inertia_times(s, H, tilt), coupled)
        rate_pull = plus(inertia_times(s, H, lean), inertia_times(s, grown, turn))
        rate_pull = plus(rate_pull, inertia_times(s, H_RATE, tilt))
        rate_pull = plus(rate_pull, plus(load(s, at + ROW_RATE), across))
        rate_slip = inertia_times(s, H_INVERSE, coupled)
        rate_spin = plus(tilt, rate_slip)
        rate_gain = minus(rate_pull, load(s, at + HEAVE))
        rate_gain = minus(rate_gain, inertia_times(s, H_RATE, rate_spin))
        rate_gain = inertia_times(s, H_INVERSE, rate_gain)
        if whole and rd == 6:
            torque = plus(
                meant_by(theta, tilt, load(s, MOMENTUM_RATE)),
                bent_by(tilt, theta_rate, p0),
            )
            torque = plus(torque, cross(w, meant_by(theta, tilt, p0)))
            add_column(
                P, frame + i, nv, plus(torque, torque_of(system, work, b, p, pull))
            )
            torque = plus(
                meant_by(theta, tilt, p0), torque_of(system, work, b, rate_p, rate_pull)
            )
            add_column(D, frame + i, nv, torque)
        for k in range(nq):
            to, line = HEAD + k * N_ROW, block + (rd + k) * nv + rd + i
            e = k * nq + i
            c, swapped = couplings(pool, sq, n2, e, i * nq + k, whole)
            g, h = bows(pool, sq, n2, e, whole)
            gyro, gyro_rate = none, minus(c, swapped)
            if whole:
                bend = column(pool, sq + S_CT1 * n2, n2, e)
                tilted = symmetric_times(g, h, theta_rate)
                longer, wider = _lengthened(s, at, to, bend, inverse)
                g, h = plus(g, longer), plus(h, wider)
                more, skewed, gyro = _completed(s, at, to, bend, tilted, inverse)
                c, gyro_rate = plus(c, more), plus(gyro_rate, skewed)
            by_q = force_of(s, to, p, pull, spin, gain, slip) + dot(c, u_rate)
            by_q += dot(g, own) + dot(h, mixed) + dot(gyro, u)
            by_q -= dot(p0, bent_by(tilt, load(s, to + TILT), w))
            by_rate = force_of(
                s, to, rate_p, rate_pull, rate_spin, rate_gain, rate_slip
            )
            by_rate += dot(gyro_rate, u)
            P[line] += sign * by_q
            D[line] += sign * by_rate


@inner(types.void(SYSTEM, WORK, int64, F1, F1, F1))
def linearise_stiffened(system, work, b, z, v, acc):
    """Completes Rp and Rv of a stiffened body."""
    centre(system, work, b, z, v, acc, 1.0)
    linearise_centre(system, work, b, acc)
    for part in range(2):
        if rotate_axes(system, work, b, z, v, acc, 1.0, part == 0):
            if part == 0 and system.body[b, RD] == 6:
                _linearise_turn(system, work, b)
            _linearise_rotation(system, work, b, acc, part == 0)
