"""Motion of markers, eq. (5)-(7), from the body frame and the elastic coordinates.

==========  ==================================================
Symbol      Meaning
==========  ==================================================
x, R        inertial position and orientation of the marker
d           position relative to the body frame
Phi, Psi    translational and rotational shape functions
theta       rotation of the marker by deformation
==========  ==================================================
"""

import math

from ..compiler.kernels import inner
from ..spatial.algebra import (
    column,
    cross,
    dot,
    load,
    rotate,
    rotate_about_axis,
    rotation_product,
    shape_function_offset,
    size,
    store_column,
    tangent_operator,
    unit,
    zero,
)
from ..spatial.dimension import BySpace

#: Below this rotation the series of the coefficients of T are used.
SMALL_ROTATION = 0.05


@inner()
def _orient_planar_marker(system, work, m, theta, theta_dot, psi1_terms):
    marker, point = system.marker[m], work.point[m]
    frame, e = work.frame[marker.body], unit(theta, 0)
    offset = system.real_data[marker.data + size(frame.x)]
    point.angle = frame.angle + (offset + dot(e, theta))
    point.w, point.al = frame.w + theta_dot, frame.al + psi1_terms


@inner()
def _orient_spatial_marker(system, work, m, theta, theta_dot, psi1_terms):
    """The rotation exp(theta~) rotates with the angular velocity T theta', T = I + s2
    theta~ + s3 theta~ theta~.
    """
    marker, point = system.marker[m], work.point[m]
    frame = work.frame[marker.body]
    R, omega, alpha = frame.R, frame.w, frame.al
    n2, theta_theta_dot = dot(theta, theta), dot(theta, theta_dot)
    if n2 < SMALL_ROTATION * SMALL_ROTATION:
        s2 = 0.5 - n2 / 24.0 + n2 * n2 / 720.0
        s3 = 1.0 / 6.0 - n2 / 120.0 + n2 * n2 / 5040.0
        d2 = (-1.0 / 12.0 + n2 / 180.0) * theta_theta_dot
        d3 = (-1.0 / 60.0 + n2 / 1260.0) * theta_theta_dot
    else:
        n = math.sqrt(n2)
        s2 = (1.0 - math.cos(n)) / n2
        s3 = (n - math.sin(n)) / (n2 * n)
        d2 = (math.sin(n) / n - 2.0 * s2) / n2 * theta_theta_dot
        d3 = (s2 - 3.0 * s3) / n2 * theta_theta_dot
    theta_cross_rate = cross(theta, theta_dot)
    theta_cross_twice = cross(theta, theta_cross_rate)
    omega_relative = theta_dot + s2 * theta_cross_rate + s3 * theta_cross_twice
    T_dot_theta_dot = (
        d2 * theta_cross_rate
        + d3 * theta_cross_twice
        + s3 * cross(theta_dot, theta_cross_rate)
    )
    T = tangent_operator(theta, s2, s3)
    if marker.psi1 >= 0:
        T_dot_theta_dot = T_dot_theta_dot + rotate(T, psi1_terms)
    point.T = T
    point.w = rotate(R, omega + omega_relative)
    point.al = rotate(R, alpha + cross(omega, omega_relative) + T_dot_theta_dot)
    angle = math.sqrt(n2)
    axis = unit(theta, 2) if angle == 0.0 else (1.0 / angle) * theta
    R = rotate_about_axis(R, axis, math.cos(angle), math.sin(angle))
    point.R = rotation_product(R, load(R, system.real_data, marker.data + 3))


#: Orientation, angular velocity and acceleration from the rotation vector Psi q, its
#: rate, and what the change of Psi adds to its second derivative.
_orient_marker = BySpace(plane=_orient_planar_marker, space=_orient_spatial_marker)


@inner()
def _shape_function_terms(x, real_data, line, nq, z, q, v, qd):
    """Contribution of the elastic coordinates and their rates to a column of Phi or
    Psi.
    """
    g, h = zero(x), zero(x)
    for i in range(nq):
        term = column(x, real_data, line, nq * nq, i)
        g, h = g + z[q + i] * term, h + v[qd + i] * term
    return g, h


@inner()
def evaluate_marker(system, work, m, z, v):
    """Position, orientation, their rates and bias accelerations, (6) and (7)."""
    marker, point, real_data = system.marker[m], work.point[m], system.real_data
    row, frame, data = system.body[marker.body], work.frame[marker.body], marker.data
    omega, alpha, R, nq, n = frame.w, frame.al, frame.R, row.nq, size(frame.x)
    phi, phi1, psi, psi1 = marker.phi, marker.phi1, marker.phi + n * nq, marker.psi1
    q, qd = row.pos + row.np - nq, row.vel + row.rd
    d, u, phi1_terms = load(frame.x, real_data, data), zero(frame.x), zero(frame.x)
    theta, theta_dot, psi1_terms = zero(omega), zero(omega), zero(omega)
    shapes = shape_function_offset(omega, data)
    for k in range(nq):
        phi_k = column(d, real_data, shapes, nq, k)
        psi_k = column(omega, real_data, shapes + n * nq, nq, k)
        if phi1 >= 0:
            phi1_q, phi1_qdot = _shape_function_terms(
                d, real_data, phi1 + k * nq, nq, z, q, v, qd
            )
            store_column(work.phi, phi, nq, k, phi_k + phi1_q)
            phi1_terms = phi1_terms + v[qd + k] * phi1_qdot
            phi_k = phi_k + 0.5 * phi1_q
        d = d + z[q + k] * phi_k
        u = u + v[qd + k] * column(d, work.phi, phi, nq, k)
        if psi1 >= 0:
            psi1_q, psi1_qdot = _shape_function_terms(
                omega, real_data, psi1 + k * nq, nq, z, q, v, qd
            )
            store_column(work.phi, psi, nq, k, psi_k + psi1_q)
            psi1_terms = psi1_terms + v[qd + k] * psi1_qdot
            psi_k = psi_k + 0.5 * psi1_q
        theta = theta + z[q + k] * psi_k
        theta_dot = theta_dot + v[qd + k] * column(omega, work.phi, psi, nq, k)
    wd = cross(omega, d)
    acc = (
        frame.a
        + cross(alpha, d)
        + cross(omega, wd)
        + 2.0 * cross(omega, u)
        + phi1_terms
    )
    x, vel = frame.x + rotate(R, d), rotate(R, frame.v + wd + u)
    point.x, point.v, point.a = x, vel, rotate(R, acc)
    point.d, point.u = d, u
    _orient_marker(system, work, m, theta, theta_dot, psi1_terms)
