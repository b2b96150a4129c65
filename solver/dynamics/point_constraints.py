"""Constraints of the positions of two markers A and B, eq. (14).

==============  ====================================================  =====
Kind            Residual                                              Rows
==============  ====================================================  =====
COINCIDENT      x_B - x_A                                             2, 3
ALONG           n . (x_B - x_A) - s(t), n fixed in marker A           1
DISTANCE        the length of x_B - x_A, less s(t)                    1
==============  ====================================================  =====

Every kind has a kernel of the residual with its first two derivatives in time, and a
kernel of the Jacobian with its derivatives.
"""

import math

from ..compiler.kernels import inner
from ..spatial.algebra import cross, direction, dot, load, rotate, size, unit, zero
from ..spatial.dimension import BySpace
from .constraint_rows import add_jacobian, offset_at, write_row
from .marker_force_derivatives import (
    force_stiffness,
    rotating_force_stiffness,
    transverse_stiffness,
)
from .marker_forces import (
    add_d_acceleration,
    add_d_rotation,
    add_d_translation,
    marker_acceleration,
)


@inner()
def coincident_residual(system, work, con):
    A, B = work.point[con.a], work.point[con.b]
    x, v, a = B.x - A.x, B.v - A.v, B.a - A.a
    for i in range(size(x)):
        e = unit(x, i)
        write_row(work, con.row + i, dot(e, x), dot(e, v), -dot(e, a))
        add_jacobian(system, work, con, i, e, zero(A.w), zero(A.w))


@inner()
def coincident_wrench(system, work, con, lambda_):
    """Force on marker B, torque on A, and torque on B; the reversed force acts on A."""
    none = zero(work.point[con.a].w)
    return load(work.point[con.a].x, lambda_, con.row), none, none


@inner()
def coincident_jacobian(system, work, con, v, acc, lambda_):
    force = load(work.point[con.a].x, lambda_, con.row)
    for side in range(2):
        first = con.seg_a if side == 0 else con.seg_b
        if first < 0:
            continue
        m, sign = (con.a, -1.0) if side == 0 else (con.b, 1.0)
        a, _ = marker_acceleration(system, work, m, acc)
        for i in range(size(force)):
            o = system.segment[first + i].offset
            e = sign * unit(force, i)
            add_d_acceleration(system, work, o, m, e, a, v, acc)
        force_stiffness(system, work, m, sign * force)


@inner()
def _planar_fixed_direction(system, work, m, data):
    angle = work.point[m].angle + system.real_data[data]
    return direction(math.cos(angle), math.sin(angle))


@inner()
def _spatial_fixed_direction(system, work, m, data):
    point = work.point[m]
    return rotate(point.R, load(point.x, system.real_data, data))


#: A direction that is fixed in a marker: its angle, or its components, in the pool.
fixed_direction = BySpace(plane=_planar_fixed_direction, space=_spatial_fixed_direction)


@inner()
def displacement_residual(system, work, con, s, sd, sdd):
    A, B = work.point[con.a], work.point[con.b]
    x, v, a, omega = B.x - A.x, B.v - A.v, B.a - A.a, A.w
    n = fixed_direction(system, work, con.a, con.data)
    wn, n_x = cross(omega, n), cross(n, x)
    value = dot(n, x) - s - system.real_data[offset_at(n, con.data)]
    rate = dot(n, v) + dot(n_x, omega) - sd
    d_position = cross(A.al, n) + cross(omega, wn)
    gamma = sdd - dot(n, a) - 2.0 * dot(wn, v) - dot(d_position, x)
    return value, rate, gamma, n, n_x, zero(omega)


@inner()
def displacement_jacobian(system, work, con, weight, v, acc, lambda_):
    A, B = work.point[con.a], work.point[con.b]
    x, vel, omega = B.x - A.x, B.v - A.v, A.w
    a_a, alpha = marker_acceleration(system, work, con.a, acc)
    a_b, _ = marker_acceleration(system, work, con.b, acc)
    n = fixed_direction(system, work, con.a, con.data)
    wn = cross(omega, n)
    d_velocity, d_position = 2.0 * wn, cross(alpha, n) + cross(omega, wn)
    for side in range(2):
        first = con.seg_a if side == 0 else con.seg_b
        if first < 0:
            continue
        m, weight_of_side, a = (
            (con.a, -weight, a_a) if side == 0 else (con.b, weight, a_b)
        )
        o, e = system.segment[first].offset, weight_of_side * n
        add_d_translation(
            system,
            work,
            o,
            m,
            e,
            weight_of_side * d_velocity,
            weight_of_side * d_position,
            a,
            v,
            acc,
        )
    if con.seg_a >= 0:
        o = system.segment[con.seg_a].offset
        d_rotation = cross(n, a_b - a_a) + cross(d_velocity, vel) + cross(d_position, x)
        d_omega = 2.0 * cross(n, vel) + cross(wn, x) + cross(n, cross(x, omega))
        d_rotation, d_omega, d_alpha = (
            weight * d_rotation,
            weight * d_omega,
            weight * cross(n, x),
        )
        add_d_rotation(system, work, o, con.a, d_rotation, d_omega, d_alpha, v, acc)
    rotating_force_stiffness(
        system, work, con.a, con.b, n, x, weight * lambda_[con.row]
    )


@inner()
def distance_residual(system, work, con, s, sd, sdd):
    A, B = work.point[con.a], work.point[con.b]
    x, v, a = B.x - A.x, B.v - A.v, B.a - A.a
    length = math.sqrt(dot(x, x))
    n = (1.0 / length) * x
    speed = dot(n, v)
    centripetal = (dot(v, v) - speed * speed) / length
    value = length - s - system.real_data[con.data]
    return value, speed - sd, sdd - dot(n, a) - centripetal, n, zero(A.w), zero(A.w)


@inner()
def distance_jacobian(system, work, con, v, acc, lambda_):
    A, B = work.point[con.a], work.point[con.b]
    x, vel = B.x - A.x, B.v - A.v
    a_a, _ = marker_acceleration(system, work, con.a, acc)
    a_b, _ = marker_acceleration(system, work, con.b, acc)
    a, length = a_b - a_a, math.sqrt(dot(x, x))
    n = (1.0 / length) * x
    speed, force = dot(n, vel), lambda_[con.row]
    transverse_velocity = vel - speed * n
    d_velocity = (2.0 / length) * transverse_velocity
    centripetal = dot(n, a) + dot(transverse_velocity, transverse_velocity) / length
    d_position = (1.0 / length) * (a - centripetal * n - speed * d_velocity)
    for side in range(2):
        first = con.seg_a if side == 0 else con.seg_b
        if first < 0:
            continue
        m, sign, marker_acceleration_ = (
            (con.a, -1.0, a_a) if side == 0 else (con.b, 1.0, a_b)
        )
        o, e = system.segment[first].offset, sign * n
        add_d_translation(
            system,
            work,
            o,
            m,
            e,
            sign * d_velocity,
            sign * d_position,
            marker_acceleration_,
            v,
            acc,
        )
        force_stiffness(system, work, m, sign * force * n)
        transverse_stiffness(system, work, m, n, -force / length)
