"""Markers: their motion from that of the body frame and the elastic coordinates."""

from __future__ import annotations

import math

from ..compiler.compiling import inner
from ..space.algebra import (
    after,
    column,
    cross,
    dot,
    load,
    rotate,
    shapes_at,
    size,
    store_column,
    tilt_matrix,
    turned,
    unit,
    zero,
)
from ..space.spaces import BySpace

#: Below this rotation the series of the coefficients of T are used.
SMALL_ROTATION = 0.05


@inner()
def _orient_in_plane(system, work, m, theta, rate, curl):
    marker, point = system.marker[m], work.point[m]
    frame, e = work.frame[marker.body], unit(theta, 0)
    offset = system.pool[marker.data + size(frame.x)]
    point.angle = frame.angle + (offset + dot(e, theta))
    point.w, point.al = frame.w + rate, frame.al + curl


@inner()
def _orient_in_space(system, work, m, theta, rate, curl):
    """The rotation exp(theta~) turns with the angular velocity T theta',
    T = I + s2 theta~ + s3 theta~ theta~."""
    marker, point = system.marker[m], work.point[m]
    frame = work.frame[marker.body]
    R, w, al = frame.R, frame.w, frame.al
    n2, along = dot(theta, theta), dot(theta, rate)
    if n2 < SMALL_ROTATION * SMALL_ROTATION:
        s2 = 0.5 - n2 / 24.0 + n2 * n2 / 720.0
        s3 = 1.0 / 6.0 - n2 / 120.0 + n2 * n2 / 5040.0
        d2 = (-1.0 / 12.0 + n2 / 180.0) * along
        d3 = (-1.0 / 60.0 + n2 / 1260.0) * along
    else:
        n = math.sqrt(n2)
        s2 = (1.0 - math.cos(n)) / n2
        s3 = (n - math.sin(n)) / (n2 * n)
        d2 = (math.sin(n) / n - 2.0 * s2) / n2 * along
        d3 = (s2 - 3.0 * s3) / n2 * along
    tr = cross(theta, rate)
    ttr = cross(theta, tr)
    relative = rate + s2 * tr + s3 * ttr
    bent = d2 * tr + d3 * ttr + s3 * cross(rate, tr)
    T = tilt_matrix(theta, s2, s3)
    if marker.psi1 >= 0:
        bent = bent + rotate(T, curl)
    point.T = T
    point.w = rotate(R, w + relative)
    point.al = rotate(R, al + cross(w, relative) + bent)
    angle = math.sqrt(n2)
    axis = unit(theta, 2) if angle == 0.0 else (1.0 / angle) * theta
    R = turned(R, axis, math.cos(angle), math.sin(angle))
    point.R = after(R, load(R, system.pool, marker.data + 3))


#: Orientation, angular velocity and acceleration from the rotation vector Psi q, its
#: rate, and what the change of Psi adds to its second derivative.
_orient = BySpace(plane=_orient_in_plane, space=_orient_in_space)


@inner()
def _bent(x, pool, line, nq, z, q, v, qd):
    """What the elastic coordinates, and their rates, add to a column of Phi or Psi."""
    g, h = zero(x), zero(x)
    for i in range(nq):
        bend = column(x, pool, line, nq * nq, i)
        g, h = g + z[q + i] * bend, h + v[qd + i] * bend
    return g, h


@inner()
def evaluate_marker(system, work, m, z, v):
    """Position, orientation, their rates and bias accelerations, (6) and (7)."""
    marker, point, pool = system.marker[m], work.point[m], system.pool
    row, frame, data = system.body[marker.body], work.frame[marker.body], marker.data
    w, al, R, nq, n = frame.w, frame.al, frame.R, row.nq, size(frame.x)
    phi, phi1, psi, psi1 = marker.phi, marker.phi1, marker.phi + n * nq, marker.psi1
    q, qd = row.pos + row.np - nq, row.vel + row.rd
    d, u, extra = load(frame.x, pool, data), zero(frame.x), zero(frame.x)
    theta, rate, curl = zero(w), zero(w), zero(w)
    shapes = shapes_at(w, data)
    for k in range(nq):
        base = column(d, pool, shapes, nq, k)
        tilt = column(w, pool, shapes + n * nq, nq, k)
        if phi1 >= 0:
            g, h = _bent(d, pool, phi1 + k * nq, nq, z, q, v, qd)
            store_column(work.phi, phi, nq, k, base + g)
            extra = extra + v[qd + k] * h
            base = base + 0.5 * g
        d = d + z[q + k] * base
        u = u + v[qd + k] * column(d, work.phi, phi, nq, k)
        if psi1 >= 0:
            more, rise = _bent(w, pool, psi1 + k * nq, nq, z, q, v, qd)
            store_column(work.phi, psi, nq, k, tilt + more)
            curl = curl + v[qd + k] * rise
            tilt = tilt + 0.5 * more
        theta = theta + z[q + k] * tilt
        rate = rate + v[qd + k] * column(w, work.phi, psi, nq, k)
    wd = cross(w, d)
    acc = frame.a + cross(al, d) + cross(w, wd) + 2.0 * cross(w, u) + extra
    x, vel = frame.x + rotate(R, d), rotate(R, frame.v + wd + u)
    point.x, point.v, point.a = x, vel, rotate(R, acc)
    point.d, point.u = d, u
    _orient(system, work, m, theta, rate, curl)
