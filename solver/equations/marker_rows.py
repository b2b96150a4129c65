"""What forces at markers do to their bodies, eq. (15), and how markers accelerate.

The row of a force and a torque at a marker maps velocities to the marker's velocity
along them; its derivatives along a motion are those of accelerations.
"""

from __future__ import annotations

from ..compiler.compiling import inner
from ..space.algebra import add_row, back, column, cross, dot, load, rotate, size, zero
from ..space.spaces import BySpace


@inner()
def _same(work, m, x):
    return x


@inner()
def _tilted(work, m, x):
    return rotate(work.point[m].T, x)


@inner()
def _tilted_back(work, m, x):
    return back(work.point[m].T, x)


#: Angular velocity, in the body frame, of rates of the rotation vector of a marker.
tilted = BySpace(plane=_same, space=_tilted)
tilted_back = BySpace(plane=_same, space=_tilted_back)


@inner()
def segment(system, work, out, offset, m, force, torque):
    """Adds the generalised force of an inertial force and torque at a marker.

    The same row maps velocities to the marker's velocity along the force plus its
    angular velocity along the torque, and variations of position likewise.
    """
    marker = system.marker[m]
    row, frame = system.body[marker.body], work.frame[marker.body]
    rd, nq, n, phi = row.rd, row.nq, size(force), marker.phi
    psi = phi + n * nq
    f, t = back(frame.R, force), back(frame.R, torque)
    if rd >= n:
        add_row(out, offset, f)
    if rd > n:
        add_row(out, offset + n, cross(work.point[m].d, f) + t)
    if nq == 0:
        return
    t = tilted_back(work, m, t)
    for k in range(nq):
        moved = dot(column(f, work.phi, phi, nq, k), f)
        out[offset + rd + k] += moved + dot(column(t, work.phi, psi, nq, k), t)


@inner()
def marker_acceleration(system, work, m, acc):
    """Inertial acceleration and angular acceleration of a marker."""
    marker, point = system.marker[m], work.point[m]
    row, frame = system.body[marker.body], work.frame[marker.body]
    nq, rd, first, phi = row.nq, row.rd, row.vel, marker.phi
    a, al, twist = zero(point.a), zero(point.al), zero(point.al)
    n = size(a)
    psi = phi + n * nq
    if rd >= n:
        a = load(a, acc, first)
    if rd > n:
        al = load(al, acc, first + n)
        a = a + cross(al, point.d)
    for k in range(nq):
        rate = acc[first + rd + k]
        a = a + rate * column(a, work.phi, phi, nq, k)
        twist = twist + rate * column(al, work.phi, psi, nq, k)
    if nq > 0:
        al = al + tilted(work, m, twist)
    return point.a + rotate(frame.R, a), point.al + rotate(frame.R, al)


@inner()
def vary_acceleration(system, work, o, m, e, a, v, acc):
    """Adds to Gp and Gv the derivatives of a marker's acceleration a along e."""
    marker, point = system.marker[m], work.point[m]
    row, frame = system.body[marker.body], work.frame[marker.body]
    nq, rd, first, phi, phi1 = row.nq, row.rd, row.vel, marker.phi, marker.phi1
    n, h, w, al = size(e), back(frame.R, e), frame.w, frame.al
    hw = cross(h, w)
    if rd >= n:
        add_row(work.Gv, o, hw)
    if rd > n:
        al = al + load(al, acc, first + n)
        d = point.d
        add_row(work.Gp, o + n, back(frame.R, cross(a, e)))
        g = cross(frame.v, h) + cross(cross(w, d), h) + cross(d, hw)
        add_row(work.Gv, o + n, g + 2.0 * cross(point.u, h))
    weight = cross(h, al) + cross(hw, w)
    for k in range(nq):
        p = column(h, work.phi, phi, nq, k)
        work.Gp[o + rd + k] += dot(weight, p)
        work.Gv[o + rd + k] += 2.0 * dot(hw, p)
        if phi1 >= 0:
            for i in range(nq):
                bend = column(h, system.pool, phi1 + k * nq, nq * nq, i)
                rate, curvature = v[first + rd + i], acc[first + rd + i]
                along = dot(h, bend)
                work.Gp[o + rd + k] += along * curvature + 2.0 * dot(hw, bend) * rate
                work.Gv[o + rd + k] += 2.0 * along * rate


@inner()
def vary_velocity(system, work, o, m, e, v):
    """Adds to Gp and Gv the derivatives of a marker's velocity along e."""
    marker, point = system.marker[m], work.point[m]
    row, frame = system.body[marker.body], work.frame[marker.body]
    nq, rd, phi, phi1 = row.nq, row.rd, marker.phi, marker.phi1
    n, h, qd = size(e), back(frame.R, e), row.vel + row.rd
    if rd > n:
        add_row(work.Gp, o + n, back(frame.R, cross(point.v, e)))
    hw = cross(h, frame.w)
    for k in range(nq):
        work.Gp[o + rd + k] += dot(hw, column(h, work.phi, phi, nq, k))
        if phi1 >= 0:
            for i in range(nq):
                bend = column(h, system.pool, phi1 + k * nq, nq * nq, i)
                work.Gp[o + rd + k] += dot(h, bend) * v[qd + i]
    segment(system, work, work.Gv, o, m, e, zero(frame.w))


@inner()
def vary_psi(system, work, out, o, m, torque, rates):
    """Adds, along an inertial torque, the derivative by q of T Psi(q) elastic rates.

    T stays constant.
    """
    marker = system.marker[m]
    psi1 = marker.psi1
    if psi1 < 0:
        return
    row = system.body[marker.body]
    nq, rd, first = row.nq, row.rd, row.vel + row.rd
    t = tilted_back(work, m, back(work.frame[marker.body].R, torque))
    for k in range(nq):
        for i in range(nq):
            change = dot(t, column(t, system.pool, psi1 + k * nq, nq * nq, i))
            out[o + rd + k] += change * rates[first + i]


@inner()
def vary_turning(system, work, o, m, by_rate, by_acceleration, v, acc):
    """Adds to Gp and Gv what Psi(q) changes in the turning of a marker.

    by_rate, by_acceleration : derivatives of the constraint acceleration by the angular
        velocity and by the angular acceleration of the marker
    """
    if system.marker[m].psi1 >= 0:
        _vary_turning(system, work, o, m, by_rate, by_acceleration, v, acc)


@inner()
def _vary_turning(system, work, o, m, by_rate, by_acceleration, v, acc):
    frame = work.frame[system.marker[m].body]
    by_rate = by_rate + cross(by_acceleration, rotate(frame.R, frame.w))
    vary_psi(system, work, work.Gp, o, m, by_rate, v)
    vary_psi(system, work, work.Gp, o, m, by_acceleration, acc)
    vary_psi(system, work, work.Gv, o, m, 2.0 * by_acceleration, v)


@inner()
def vary_translation(system, work, o, m, e, by_v, by_x, a, v, acc):
    """Adds to Gp and Gv what the motion of a marker changes in an acceleration.

    e, by_v, by_x : its derivatives by the marker's acceleration, velocity and position
    a : the acceleration of the marker
    """
    vary_acceleration(system, work, o, m, e, a, v, acc)
    vary_velocity(system, work, o, m, by_v, v)
    segment(system, work, work.Gp, o, m, by_x, zero(work.point[m].w))


@inner()
def vary_rotation(system, work, o, m, turn, spin, torque, v, acc):
    """Adds to Gp and Gv what the rotation of a marker changes in an acceleration.

    turn, spin, torque : its derivatives by the marker's rotation, angular velocity and
        angular acceleration
    """
    segment(system, work, work.Gp, o, m, zero(work.point[m].x), turn)
    segment(system, work, work.Gv, o, m, zero(work.point[m].x), spin)
    vary_turning(system, work, o, m, spin, torque, v, acc)
