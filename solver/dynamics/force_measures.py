"""Measures of forces between two markers A and B, eq. (16).

=========================  ===================================================
Kind                       Measure g
=========================  ===================================================
DISTANCE_MEASURE           distance between the markers
DISPLACEMENT_MEASURE       displacement of B along a direction fixed in A
ANGLE_MEASURE              rotation about an axis of A, counted over full turns
ROTATION_VECTOR_MEASURE    component of the rotation vector from A to B
DIRECTION_COSINE_MEASURE   scalar product of a direction of A and one of B
ANGULAR_VELOCITY_MEASURE   relative angular velocity about an axis
=========================  ===================================================

For every measure there is its value and rate, the wrench of a unit force on it, and
the derivatives of both.
"""

import math

from ..compiler.kernels import inner
from ..compiler.vectors import Vector, formula
from ..spatial.algebra import cross, dot, load, rotate, rotate_inverse, unit, zero
from ..spatial.dimension import BySpace
from ..spatial.system_arrays import (
    ANGULAR_VELOCITY_MEASURE,
    DIRECTION_COSINE_MEASURE,
    ROTATION_VECTOR_MEASURE,
)
from .marker_force_derivatives import (
    force_stiffness,
    rotating_force_stiffness,
    shape_function_stiffness,
    transverse_stiffness,
)
from .point_constraints import fixed_direction

#: Below this distance the direction of the line does not turn.
MIN_DISTANCE = 1e-12

#: Below this rotation the series of the coefficient of the inverse of T is used.
SMALL_ROTATION = 0.05
#: Largest rotation vector that is known [rad]; torques on its components grow without
#: bound towards a full turn.
MAX_ROTATION = 6.0


@inner()
def distance_measure(system, work, row):
    """DISTANCE_MEASURE: a force along the line between the markers."""
    A, B = work.point[row.a], work.point[row.b]
    x, v = B.x - A.x, B.v - A.v
    length = math.sqrt(dot(x, x))
    n = (1.0 / max(length, 1e-300)) * x
    return length, dot(n, v), n, zero(A.w), zero(A.w)


@inner()
def distance_derivatives(system, work, row, g, rate, n):
    A, B = work.point[row.a], work.point[row.b]
    transverse_velocity = zero(n)
    if g > MIN_DISTANCE:
        transverse_velocity = (1.0 / g) * (B.v - A.v - rate * n)
    return transverse_velocity, zero(A.w), zero(A.w)


@inner()
def distance_stiffness(system, work, row, g, n, force):
    for side in range(2):
        if (row.seg_a if side == 0 else row.seg_b) < 0:
            continue
        m, sign = (row.a, -1.0) if side == 0 else (row.b, 1.0)
        force_stiffness(system, work, m, sign * force * n)
        if g > MIN_DISTANCE:
            transverse_stiffness(system, work, m, n, -force / g)


@inner()
def displacement_measure(system, work, row):
    """DISPLACEMENT_MEASURE: of marker B along a direction fixed in marker A."""
    A, B = work.point[row.a], work.point[row.b]
    x = B.x - A.x
    n = fixed_direction(system, work, row.a, row.data)
    n_x = cross(n, x)
    return dot(n, x), dot(n, B.v - A.v) + dot(n_x, A.w), n, n_x, zero(n_x)


@inner()
def displacement_derivatives(system, work, row, g, rate, n):
    A, B = work.point[row.a], work.point[row.b]
    wn = cross(A.w, n)
    return wn, cross(n, B.v - A.v) + cross(wn, B.x - A.x), zero(A.w)


@inner()
def displacement_stiffness(system, work, row, g, n, force):
    x = work.point[row.b].x - work.point[row.a].x
    rotating_force_stiffness(system, work, row.a, row.b, n, x, force)


@inner()
def _planar_rotation_measure(system, work, row):
    A, B = work.point[row.a], work.point[row.b]
    e, angle = unit(A.w, 0), B.angle - A.angle - system.real_data[row.data]
    return angle, dot(e, B.w - A.w), zero(A.x), -e, e


@inner()
def _spatial_rotation_measure(system, work, row):
    rotation = work.rotation_counter[row.rotation]
    axis = rotation.axis
    return rotation.value, rotation.rate, zero(axis), -axis, axis


#: Angles and rotation vectors from A to B; in space they are in `rotation_counter`.
rotation_measure = BySpace(
    plane=_planar_rotation_measure, space=_spatial_rotation_measure
)


@inner()
def rotation_derivatives(system, work, row, axis):
    d_rotation = cross(work.point[row.b].w, axis)
    return zero(work.point[row.b].x), -d_rotation, d_rotation


@inner()
def rotation_stiffness(system, work, row, axis, force):
    for side in range(2):
        if (row.seg_a if side == 0 else row.seg_b) < 0:
            continue
        m, sign = (row.a, -1.0) if side == 0 else (row.b, 1.0)
        none = zero(work.point[m].x)
        shape_function_stiffness(system, work, m, none, sign * force * axis)


@formula
def _skew_part(x, y, z):
    """Axis times sine of the rotation matrix with these columns."""
    return Vector(0.5 * (y[2] - z[1]), 0.5 * (z[0] - x[2]), 0.5 * (x[1] - y[0]))


@formula
def _trace(x, y, z):
    return x[0] + y[1] + z[2]


@formula
def _row_sums(x, y, z, e):
    """R e + R^T e."""
    columns = e[0] * x + e[1] * y + e[2] * z
    return columns + Vector(dot(x, e), dot(y, e), dot(z, e))


@inner()
def relative_rotation(A, B):
    """Rotation vector from marker A to marker B, in the axes of A; at most pi.

    Near half a turn its direction is a column of R + R^T - 2 cos, else that of the skew
    part of R.
    """
    e0, e1, e2 = unit(A.x, 0), unit(A.x, 1), unit(A.x, 2)
    x = rotate_inverse(A.R, rotate(B.R, e0))
    y = rotate_inverse(A.R, rotate(B.R, e1))
    z = rotate_inverse(A.R, rotate(B.R, e2))
    axis = _skew_part(x, y, z)
    sine, cosine = math.sqrt(dot(axis, axis)), 0.5 * (_trace(x, y, z) - 1.0)
    angle = math.atan2(sine, cosine)
    if cosine > -0.9:
        return axis if sine < 1e-8 else (angle / sine) * axis
    xx, yy, zz = dot(x, e0), dot(y, e1), dot(z, e2)
    e = e0 if xx >= yy and xx >= zz else (e1 if yy >= zz else e2)
    n = _row_sums(x, y, z, e) - (2.0 * cosine) * e
    return (math.copysign(angle, dot(n, axis)) / math.sqrt(dot(n, n))) * n


@inner()
def _nearest_rotation_vector(theta, reference):
    """The rotation vector of the same rotation that is nearest to a known one."""
    n = math.sqrt(dot(theta, theta))
    if n < 1e-8:
        return theta
    two_pi = 2.0 * math.pi
    continued = n + two_pi * math.floor(0.5 + (dot(theta, reference) / n - n) / two_pi)
    return (continued / n) * theta if abs(continued) < MAX_ROTATION else theta


@inner()
def rotation_vector_torque(theta, e):
    """T^-T e: the torque that works on the component of the rotation vector along e."""
    n2 = dot(theta, theta)
    if n2 < SMALL_ROTATION * SMALL_ROTATION:
        c = 1.0 / 12.0 + n2 / 720.0 + n2 * n2 / 30240.0
    else:
        n = math.sqrt(n2)
        c = 1.0 / n2 - 0.5 / (n * math.tan(0.5 * n))
    theta_e = cross(theta, e)
    return e + 0.5 * theta_e + c * cross(theta, theta_e)


@inner()
def _rotation_angle(system, work, row, reference):
    """Value of a rotation, and the torque in the axes of A that works on it.

    ANGLE_MEASURE gives the value nearest to a known one; its torque is the axis, except
    for the tilt of B. ANGULAR_VELOCITY_MEASURE has a rate only; its torque is the axis.
    """
    A, B, real_data = work.point[row.a], work.point[row.b], system.real_data
    first, second = load(A.x, real_data, row.data), load(A.x, real_data, row.data + 3)
    if row.kind == ANGULAR_VELOCITY_MEASURE:
        return 0.0, first
    if row.kind == DIRECTION_COSINE_MEASURE:
        b = rotate_inverse(A.R, rotate(B.R, second))
        return dot(first, b), cross(b, first)
    b = rotate_inverse(A.R, rotate(B.R, first))
    axis, two_pi = cross(first, second), 2.0 * math.pi
    angle = math.atan2(dot(second, b), dot(first, b))
    axial_component = dot(axis, b)
    transverse = b - axial_component * axis
    correction = (
        axial_component / max(dot(transverse, transverse), 1e-300)
    ) * transverse
    return angle - two_pi * math.floor(
        0.5 + (angle - reference) / two_pi
    ), axis - correction


@inner()
def _store_rotation(work, to, a, value, axis, w):
    """Store a row of `rotation_counter`; its axis is given in the axes of marker a."""
    two_pi = work.rotation_counter[to]
    two_pi.axis = rotate(work.point[a].R, axis)
    two_pi.value, two_pi.rate = value, dot(two_pi.axis, w)


@inner()
def update_rotations(system, work, z):
    """Rotations between markers, those that are counted near their values in z."""
    counted = system.n_rotation_counters
    for k in range(len(system.rotation_counter)):
        row = system.rotation_counter[k]
        A, B, to = work.point[row.a], work.point[row.b], row.entry
        reference, w = len(z) - counted + to, B.w - A.w
        if row.kind != ROTATION_VECTOR_MEASURE:
            near = z[reference] if to < counted else 0.0
            value, axis = _rotation_angle(system, work, row, near)
            _store_rotation(work, to, row.a, value, axis, w)
            continue
        theta = _nearest_rotation_vector(relative_rotation(A, B), load(w, z, reference))
        for i in range(3):
            e = unit(w, i)
            axis = rotation_vector_torque(theta, e)
            _store_rotation(work, to + i, row.a, dot(e, theta), axis, w)
