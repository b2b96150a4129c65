"""Generalised forces of forces and torques at markers, eq. (15).

The row of a force and a torque at a marker maps velocities to the velocity of the
marker along them; its derivative along the motion gives accelerations.

==========  ==================================================
Symbol      Meaning
==========  ==================================================
F, t        force and torque on the marker
d           position of the marker in the body frame
Phi, Psi    translational and rotational shape functions
==========  ==================================================
"""

from ..compiler.kernels import inner
from ..spatial.algebra import (
    add_row,
    column,
    cross,
    dot,
    load,
    rotate,
    rotate_inverse,
    size,
    zero,
)
from ..spatial.dimension import BySpace


@inner()
def _identity(work, m, x):
    return x


@inner()
def _apply_tangent_operator(work, m, x):
    return rotate(work.point[m].T, x)


@inner()
def _apply_tangent_operator_transposed(work, m, x):
    return rotate_inverse(work.point[m].T, x)


#: Angular velocity, in the body frame, of rates of the rotation vector of a marker.
marker_angular_velocity = BySpace(plane=_identity, space=_apply_tangent_operator)
marker_torque = BySpace(plane=_identity, space=_apply_tangent_operator_transposed)


@inner()
def add_generalised_force(system, work, out, offset, m, force, torque):
    """Add the generalised force of an inertial force and torque at a marker, eq. (15).

    The same row maps velocities to the velocity of the marker along the force plus its
    angular velocity along the torque, and variations of position likewise.
    """
    marker = system.marker[m]
    row, frame = system.body[marker.body], work.frame[marker.body]
    rd, nq, n, phi = row.rd, row.nq, size(force), marker.phi
    psi = phi + n * nq
    f, t = rotate_inverse(frame.R, force), rotate_inverse(frame.R, torque)
    if rd >= n:
        add_row(out, offset, f)
    if rd > n:
        add_row(out, offset + n, cross(work.point[m].d, f) + t)
    if nq == 0:
        return
    t = marker_torque(work, m, t)
    for k in range(nq):
        work_rate = dot(column(f, work.phi, phi, nq, k), f)
        out[offset + rd + k] += work_rate + dot(column(t, work.phi, psi, nq, k), t)


@inner()
def marker_acceleration(system, work, m, acc):
    """Inertial acceleration and angular acceleration of a marker."""
    marker, point = system.marker[m], work.point[m]
    row, frame = system.body[marker.body], work.frame[marker.body]
    nq, rd, first, phi = row.nq, row.rd, row.vel, marker.phi
    a, alpha, theta_ddot = zero(point.a), zero(point.al), zero(point.al)
    n = size(a)
    psi = phi + n * nq
    if rd >= n:
        a = load(a, acc, first)
    if rd > n:
        alpha = load(alpha, acc, first + n)
        a = a + cross(alpha, point.d)
    for k in range(nq):
        rate = acc[first + rd + k]
        a = a + rate * column(a, work.phi, phi, nq, k)
        theta_ddot = theta_ddot + rate * column(alpha, work.phi, psi, nq, k)
    if nq > 0:
        alpha = alpha + marker_angular_velocity(work, m, theta_ddot)
    return point.a + rotate(frame.R, a), point.al + rotate(frame.R, alpha)


@inner()
def add_d_acceleration(system, work, o, m, e, a, v, acc):
    """Adds to Gp and Gv the derivatives of a marker's acceleration a along e."""
    marker, point = system.marker[m], work.point[m]
    row, frame = system.body[marker.body], work.frame[marker.body]
    nq, rd, first, phi, phi1 = row.nq, row.rd, row.vel, marker.phi, marker.phi1
    n, h, omega, alpha = size(e), rotate_inverse(frame.R, e), frame.w, frame.al
    hw = cross(h, omega)
    if rd >= n:
        add_row(work.Gv, o, hw)
    if rd > n:
        alpha = alpha + load(alpha, acc, first + n)
        d = point.d
        add_row(work.Gp, o + n, rotate_inverse(frame.R, cross(a, e)))
        g = cross(frame.v, h) + cross(cross(omega, d), h) + cross(d, hw)
        add_row(work.Gv, o + n, g + 2.0 * cross(point.u, h))
    weight = cross(h, alpha) + cross(hw, omega)
    for k in range(nq):
        p = column(h, work.phi, phi, nq, k)
        work.Gp[o + rd + k] += dot(weight, p)
        work.Gv[o + rd + k] += 2.0 * dot(hw, p)
        if phi1 >= 0:
            for i in range(nq):
                phi1_ki = column(h, system.real_data, phi1 + k * nq, nq * nq, i)
                rate, curvature = v[first + rd + i], acc[first + rd + i]
                h_phi1 = dot(h, phi1_ki)
                work.Gp[o + rd + k] += (
                    h_phi1 * curvature + 2.0 * dot(hw, phi1_ki) * rate
                )
                work.Gv[o + rd + k] += 2.0 * h_phi1 * rate


@inner()
def add_d_velocity(system, work, o, m, e, v):
    """Adds to Gp and Gv the derivatives of a marker's velocity along e."""
    marker, point = system.marker[m], work.point[m]
    row, frame = system.body[marker.body], work.frame[marker.body]
    nq, rd, phi, phi1 = row.nq, row.rd, marker.phi, marker.phi1
    n, h, qd = size(e), rotate_inverse(frame.R, e), row.vel + row.rd
    if rd > n:
        add_row(work.Gp, o + n, rotate_inverse(frame.R, cross(point.v, e)))
    hw = cross(h, frame.w)
    for k in range(nq):
        work.Gp[o + rd + k] += dot(hw, column(h, work.phi, phi, nq, k))
        if phi1 >= 0:
            for i in range(nq):
                phi1_ki = column(h, system.real_data, phi1 + k * nq, nq * nq, i)
                work.Gp[o + rd + k] += dot(h, phi1_ki) * v[qd + i]
    add_generalised_force(system, work, work.Gv, o, m, e, zero(frame.w))


@inner()
def add_d_psi(system, work, out, o, m, torque, rates):
    """Add the derivative by q of T Psi(q) times elastic rates, along an inertial
    torque.

    T is constant.
    """
    marker = system.marker[m]
    psi1 = marker.psi1
    if psi1 < 0:
        return
    row = system.body[marker.body]
    nq, rd, first = row.nq, row.rd, row.vel + row.rd
    t = marker_torque(work, m, rotate_inverse(work.frame[marker.body].R, torque))
    for k in range(nq):
        for i in range(nq):
            t_psi1 = dot(t, column(t, system.real_data, psi1 + k * nq, nq * nq, i))
            out[o + rd + k] += t_psi1 * rates[first + i]


@inner()
def add_d_angular_acceleration(system, work, o, m, d_omega, d_alpha, v, acc):
    """Adds to Gp and Gv what Psi(q) changes in the turning of a marker.

    Parameters
    ----------
    d_omega, d_alpha
        Derivatives of the constraint acceleration by the angular velocity and by the
        angular acceleration of the marker.
    """
    if system.marker[m].psi1 >= 0:
        _add_d_angular_acceleration(system, work, o, m, d_omega, d_alpha, v, acc)


@inner()
def _add_d_angular_acceleration(system, work, o, m, d_omega, d_alpha, v, acc):
    frame = work.frame[system.marker[m].body]
    d_omega = d_omega + cross(d_alpha, rotate(frame.R, frame.w))
    add_d_psi(system, work, work.Gp, o, m, d_omega, v)
    add_d_psi(system, work, work.Gp, o, m, d_alpha, acc)
    add_d_psi(system, work, work.Gv, o, m, 2.0 * d_alpha, v)


@inner()
def add_d_translation(system, work, o, m, e, d_velocity, d_position, a, v, acc):
    """Adds to Gp and Gv what the motion of a marker changes in an acceleration.

    Parameters
    ----------
    e, d_velocity, d_position
        Its derivatives by the marker's acceleration, velocity and position.
    a
        The acceleration of the marker.
    """
    add_d_acceleration(system, work, o, m, e, a, v, acc)
    add_d_velocity(system, work, o, m, d_velocity, v)
    add_generalised_force(
        system, work, work.Gp, o, m, d_position, zero(work.point[m].w)
    )


@inner()
def add_d_rotation(system, work, o, m, d_rotation, d_omega, d_alpha, v, acc):
    """Adds to Gp and Gv what the rotation of a marker changes in an acceleration.

    Parameters
    ----------
    d_rotation, d_omega, d_alpha
        Its derivatives by the marker's rotation, angular velocity and angular
        acceleration.
    """
    add_generalised_force(
        system, work, work.Gp, o, m, zero(work.point[m].x), d_rotation
    )
    add_generalised_force(system, work, work.Gv, o, m, zero(work.point[m].x), d_omega)
    add_d_angular_acceleration(system, work, o, m, d_omega, d_alpha, v, acc)
