"""Constraints of the orientations of two markers A and B, eq. (14).

ANGLE is the angle from a direction of A to one of B about an axis n of A. In space its
rate is n . (w_B - w_A) as long as the direction in B stays perpendicular to n. The
other kind keeps a direction of A perpendicular to one of B, a . b = 0.
"""

import math

from ..compiler.kernels import inner
from ..spatial.algebra import (
    add_double_cross,
    add_row,
    column,
    cross,
    dot,
    load,
    rotate,
    rotate_inverse,
    unit,
    zero,
)
from ..spatial.dimension import BySpace
from ..spatial.system_arrays import PERPENDICULAR
from .drives import prescribed_value
from .marker_force_derivatives import shape_function_stiffness, torque_stiffness
from .marker_forces import (
    add_d_angular_acceleration,
    add_d_rotation,
    add_generalised_force,
    marker_acceleration,
)


@inner()
def _planar_angle(system, work, con):
    A, B = work.point[con.a], work.point[con.b]
    return unit(A.w, 0), B.angle - A.angle - system.real_data[con.data]


@inner()
def _spatial_angle(system, work, con):
    """From the first direction of A to that of B, in (-pi, pi]."""
    A, B, pool = work.point[con.a], work.point[con.b], system.real_data
    first = load(A.x, pool, con.data)
    u, w = rotate(A.R, first), rotate(A.R, load(A.x, pool, con.data + 3))
    b = rotate(B.R, first)
    return cross(u, w), math.atan2(dot(w, b), dot(u, b))


_axis_and_angle = BySpace(plane=_planar_angle, space=_spatial_angle)


@inner()
def angle_residual(system, work, con, s, sd, sdd):
    A, B = work.point[con.a], work.point[con.b]
    n, angle = _axis_and_angle(system, work, con)
    rate = dot(n, B.w - A.w) - sd
    gamma = sdd - dot(n, B.al - A.al) - dot(cross(A.w, n), B.w)
    return angle - s, rate, gamma, zero(A.x), -n, n


@inner()
def _planar_axis_derivatives(system, work, con, n, weight, acc):
    return zero(n), zero(n)


@inner()
def _spatial_axis_derivatives(system, work, con, n, weight, acc):
    """Terms of the rotation of the axis; derivatives by both angular velocities."""
    wb, wn = work.point[con.b].w, cross(work.point[con.a].w, n)
    _, al_b = marker_acceleration(system, work, con.b, acc)
    d_rotation, none = weight * (cross(n, al_b) + cross(wn, wb)), zero(n)
    d_omega_a, d_omega_b = weight * cross(n, wb), weight * wn
    if con.seg_a >= 0:
        o = system.segment[con.seg_a].offset
        add_generalised_force(system, work, work.Gp, o, con.a, none, d_rotation)
        add_generalised_force(system, work, work.Gv, o, con.a, none, d_omega_a)
    if con.seg_b >= 0:
        o = system.segment[con.seg_b].offset
        add_generalised_force(system, work, work.Gp, o, con.b, none, -d_rotation)
        add_generalised_force(system, work, work.Gv, o, con.b, none, d_omega_b)
    return d_omega_a, d_omega_b


_axis_derivatives = BySpace(
    plane=_planar_axis_derivatives, space=_spatial_axis_derivatives
)


@inner()
def angle_jacobian(system, work, con, weight, v, acc, lambda_):
    n, _ = _axis_and_angle(system, work, con)
    d_omega_a, d_omega_b = _axis_derivatives(system, work, con, n, weight, acc)
    axis, torque = weight * n, (weight * lambda_[con.row]) * n
    if con.seg_a >= 0:
        o = system.segment[con.seg_a].offset
        add_d_angular_acceleration(system, work, o, con.a, d_omega_a, -axis, v, acc)
        shape_function_stiffness(
            system, work, con.a, zero(work.point[con.a].x), -torque
        )
    if con.seg_b >= 0:
        o = system.segment[con.seg_b].offset
        add_d_angular_acceleration(system, work, o, con.b, d_omega_b, axis, v, acc)
        torque_stiffness(system, work, con.b, torque)


@inner()
def _direction_rates(system, work, con, s, sd, sdd):
    """u, its rate and acceleration, and b."""
    A, B, pool, data = work.point[con.a], work.point[con.b], system.real_data, con.data
    first, second = load(A.x, pool, data), load(A.x, pool, data + 3)
    w, u = A.w, rotate(A.R, first)
    if con.kind == PERPENDICULAR:
        p, b = zero(u), rotate(B.R, second)
    else:
        b, c, sn = rotate(B.R, first), math.cos(s), math.sin(s)
        second_direction = rotate(A.R, second)
        u, p = c * second_direction - sn * u, c * u + sn * second_direction
    wu = cross(w, u)
    acc = cross(A.al, u) + cross(w, wu) - (2.0 * sd) * cross(w, p)
    return u, wu - sd * p, acc - sdd * p - (sd * sd) * u, b


@inner()
def direction_residual(system, work, con, s, sd, sdd):
    B = work.point[con.b]
    u, ud, udd, b = _direction_rates(system, work, con, s, sd, sdd)
    bd, axis = cross(B.w, b), cross(u, b)
    bdd = cross(B.al, b) + cross(B.w, bd)
    rate = dot(ud, b) + dot(u, bd)
    gamma = -dot(udd, b) - 2.0 * dot(ud, bd) - dot(u, bdd)
    return dot(u, b), rate, gamma, zero(u), axis, -axis


@inner()
def _direction_torque_stiffness(system, work, m, own, other, torque):
    """Rp of the torque * (own x other), where `own` rotates with the marker's body."""
    shape_function_stiffness(system, work, m, zero(own), torque * cross(own, other))
    marker = system.marker[m]
    row, frame = system.body[marker.body], work.frame[marker.body]
    nv, nq, rd, rotation_rows = row.nv, row.nq, row.rd, row.block + 3 * row.nv
    if rd != 6:
        return
    psi = marker.phi + 3 * nq
    p, o = -torque * rotate_inverse(frame.R, own), rotate_inverse(frame.R, other)
    add_double_cross(work.Rp, rotation_rows + 3, nv, p, o, p)
    for k in range(nq):
        d_torque = cross(cross(column(p, work.phi, psi, nq, k), p), o)
        add_row(work.Rp, row.block + (rd + k) * nv + 3, d_torque)


@inner()
def direction_jacobian(system, work, con, t, v, acc, lambda_):
    s, sd, sdd = prescribed_value(system, work, con, t)
    A, B = work.point[con.a], work.point[con.b]
    u, ud, udd, b = _direction_rates(system, work, con, s, sd, sdd)
    _, al_a = marker_acceleration(system, work, con.a, acc)
    _, al_b = marker_acceleration(system, work, con.b, acc)
    udd, bd, wu = udd + cross(al_a - A.al, u), cross(B.w, b), cross(A.w, u)
    bdd = cross(al_b, b) + cross(B.w, bd)
    d_rotation = cross(udd, b) + 2.0 * cross(ud, bd) + cross(u, bdd)
    force, axis = lambda_[con.row], cross(u, b)
    if con.seg_a >= 0:
        o = system.segment[con.seg_a].offset
        d_omega = cross(wu, b) + cross(u, cross(b, A.w)) + 2.0 * cross(u, bd)
        d_omega = d_omega - 2.0 * cross(wu - ud, b)
        add_d_rotation(system, work, o, con.a, d_rotation, d_omega, axis, v, acc)
        _direction_torque_stiffness(system, work, con.a, u, b, force)
    if con.seg_b >= 0:
        o = system.segment[con.seg_b].offset
        d_omega = 2.0 * cross(b, ud) + cross(bd, u) + cross(b, cross(u, B.w))
        add_d_rotation(system, work, o, con.b, -d_rotation, d_omega, -axis, v, acc)
        _direction_torque_stiffness(system, work, con.b, b, u, force)
